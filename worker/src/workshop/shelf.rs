//! What is kept in memory for one preparation: prepared clouds, as many as fit, and what evaluations have in common.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use cache::ByteSize;
use descriptor::{PreparedCloud, QuantiseError, Quantiser};
use proto::Digest;

use crate::prepared_cloud::prepared_cloud_key;
use crate::workshop::Preparation;
use crate::workshop::manifest::Listed;
use crate::workshop::reuse::Reuse;

/// A prepared cloud that was never seen is taken to be this many times as large as its source.
const GROWTH: usize = 16;
/// More at once than this does not make batches faster, bytes.
const LARGEST_BATCH: usize = 64 << 20;
/// More parts and distances than this are hardly ever asked for again, bytes: those of some hundred descriptors of a
/// thousand clouds.
const LARGEST_REUSE: usize = 192 << 20;

/// How a worker's memory is shared out: three quarters for clouds, up to three sixteenths for parts and distances, the
/// rest for clouds on their way.
#[derive(Clone, Copy, Debug)]
struct Shares {
    clouds: usize,
    reuse: usize,
    batch: usize,
}

impl Shares {
    fn of(memory: ByteSize) -> Self {
        let sixteenth = usize::try_from(memory.as_u64() / 16).unwrap_or(usize::MAX / 16);
        Self {
            clouds: 12 * sixteenth,
            reuse: (3 * sixteenth).min(LARGEST_REUSE),
            batch: sixteenth.min(LARGEST_BATCH),
        }
    }
}

/// One preparation and what is known under it.
pub struct Shelf {
    preparation: Preparation,
    /// The classes of the preparation's search space.
    pub quantiser: Quantiser,
    clouds: Mutex<Clouds>,
    reuse: Mutex<Reuse>,
}

impl Shelf {
    /// An empty shelf that takes up to `memory`.
    ///
    /// # Errors
    /// If the search space cannot be quantised.
    pub fn new(preparation: &Preparation, memory: ByteSize) -> Result<Self, QuantiseError> {
        let shares = Shares::of(memory);
        Ok(Self {
            preparation: preparation.clone(),
            quantiser: Quantiser::new(&preparation.genes)?,
            clouds: Mutex::new(Clouds::new(shares.clouds, shares.batch)),
            reuse: Mutex::new(Reuse::new(shares.reuse)),
        })
    }

    /// What the clouds are prepared for.
    pub fn preparation(&self) -> &Preparation {
        &self.preparation
    }

    /// The name of a cloud's entry in the store.
    pub fn entry_key(&self, cloud: Digest) -> Digest {
        prepared_cloud_key(&self.preparation.preprocess, &self.quantiser, cloud)
    }

    /// The clouds in memory.
    pub fn clouds(&self) -> MutexGuard<'_, Clouds> {
        // Clouds are inserted whole: a panic elsewhere cannot leave a half-made one behind.
        self.clouds.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Parts and distances in memory.
    pub fn reuse(&self) -> MutexGuard<'_, Reuse> {
        self.reuse.lock().unwrap_or_else(PoisonError::into_inner) // as above
    }
}

/// Prepared clouds in memory: admitted until they fill their share, and never exchanged. Evaluations go through all
/// clouds in turn, and would find none of them if the latest displaced the oldest.
#[derive(Debug)]
pub struct Clouds {
    capacity: usize,
    batch: usize,
    bytes: usize,
    resident: HashMap<Digest, Arc<PreparedCloud>>,
    /// Sizes of clouds that were seen and found no room.
    passing: HashMap<Digest, usize>,
}

impl Clouds {
    fn new(capacity: usize, batch: usize) -> Self {
        Self { capacity, batch, bytes: 0, resident: HashMap::new(), passing: HashMap::new() }
    }

    /// A cloud, if it is in memory.
    pub fn get(&self, digest: Digest) -> Option<Arc<PreparedCloud>> {
        self.resident.get(&digest).cloned()
    }

    /// Keeps a cloud if there is room for it. Returns whether it is seen for the first time.
    pub fn admit(&mut self, digest: Digest, cloud: &Arc<PreparedCloud>) -> bool {
        let bytes = cloud.bytes();
        if self.resident.contains_key(&digest) {
            return false;
        }
        if self.bytes.saturating_add(bytes) > self.capacity {
            return self.passing.insert(digest, bytes).is_none();
        }
        self.bytes += bytes;
        self.resident.insert(digest, Arc::clone(cloud));
        self.passing.remove(&digest).is_none()
    }

    /// How many of the first clouds of `listed` are to be taken at once, so that those that are not in memory take a
    /// bounded part of it: at least one.
    pub fn batch(&self, listed: &[Listed]) -> usize {
        let mut room = self.batch;
        let fits = |cloud: &&Listed| {
            let left = room.checked_sub(self.cost(cloud));
            room = left.unwrap_or(0);
            left.is_some()
        };
        listed.iter().take_while(fits).count().max(1)
    }

    fn cost(&self, cloud: &Listed) -> usize {
        if self.resident.contains_key(&cloud.digest) {
            return 0;
        }
        let guess = usize::try_from(cloud.bytes).unwrap_or(usize::MAX).saturating_mul(GROWTH);
        self.passing.get(&cloud.digest).copied().unwrap_or(guess)
    }
}
