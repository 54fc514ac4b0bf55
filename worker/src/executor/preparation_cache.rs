//! Prepared clouds in memory: as many as fit, for one way of preparing them. In a grid, also what the next cell needs again.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use cache::ByteSize;
use descriptor::{Preparation, PreparedCloud, Preparer, QuantiseError, cloud_file};
use proto::Digest;

use crate::executor::error::EvaluationError;
use crate::executor::kept_disks::KeptDisks;
use crate::executor::manifest::Listed;
use crate::prepared_cloud::prepared_cloud_key;

/// A prepared cloud that was never seen is taken to be this many times as large as its source.
const GROWTH: usize = 16;
/// Nor less than this, whatever its manifest says, bytes.
const LEAST_COST: usize = 64 << 10;
/// More at once than this does not make batches faster, bytes.
const LARGEST_BATCH: usize = 64 << 20;
/// Most that is kept for the next cell of a grid, bytes: in the paper's search space, the disks within R1 of fourteen hundred
/// clouds and what they add to the distances of one half of the clouds to the other.
const LARGEST_DISKS: usize = 256 << 20;
/// More signatures and distances than this are hardly ever asked for again, bytes: those of some hundred channels, a few
/// generations of structures, of a thousand clouds.
const LARGEST_REUSE: usize = 2 << 30;

/// How a worker's memory is shared out: three quarters for clouds, up to three sixteenths for signatures and distances, the
/// rest for clouds on their way. What cells of a grid need lies beside it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shares {
    clouds: usize,
    pub(super) reuse: usize,
    batch: usize,
    disks: usize,
}

impl Shares {
    pub(super) fn of(memory: ByteSize) -> Self {
        let sixteenth = usize::try_from(memory.as_u64() / 16).unwrap_or(usize::MAX / 16);
        Self {
            clouds: 12 * sixteenth,
            reuse: (3 * sixteenth).min(LARGEST_REUSE),
            batch: sixteenth.min(LARGEST_BATCH),
            disks: sixteenth.min(LARGEST_DISKS),
        }
    }
}

/// One way of preparing clouds, and the clouds that are kept of it.
pub struct PreparationCache {
    preparation: Preparation,
    /// Prepares clouds for the preparation's search space.
    pub preparer: Preparer,
    clouds: Mutex<Clouds>,
    disks: Mutex<KeptDisks>,
}

impl PreparationCache {
    /// Empty; takes up to `memory`.
    ///
    /// # Errors
    /// If clouds cannot be prepared for the search space.
    pub fn new(preparation: &Preparation, memory: ByteSize) -> Result<Self, QuantiseError> {
        let (shares, preparer) = (Shares::of(memory), preparation.space.preparer()?);
        Ok(Self {
            preparation: preparation.clone(),
            clouds: Mutex::new(Clouds::new(if preparer.is_kept() { shares.clouds } else { 0 }, shares.batch)),
            disks: Mutex::new(KeptDisks::new(shares.disks)),
            preparer,
        })
    }

    /// What the clouds are prepared for.
    pub fn preparation(&self) -> &Preparation {
        &self.preparation
    }

    /// The name of a cloud's entry in the store; `None` of clouds that are prepared anew each time.
    pub fn entry_key(&self, cloud: Digest) -> Option<Digest> {
        prepared_cloud_key(&self.preparation.preprocess, &self.preparer, cloud)
    }

    /// Prepares a cloud from the bytes of its source.
    ///
    /// # Errors
    /// If they are no cloud, or none that can be prepared.
    pub fn prepare(&self, cloud: &Listed, bytes: &[u8]) -> Result<PreparedCloud, EvaluationError> {
        let failed = |what: String| EvaluationError::Cloud { path: cloud.path.clone(), what };
        let source = cloud_file::read(bytes).map_err(|error| failed(error.to_string()))?;
        let prepared = self.preparer.prepare(&source, &self.preparation.preprocess);
        prepared.map_err(|error| failed(error.to_string()))
    }

    /// What is kept for the next cell of a grid.
    pub fn disks(&self) -> MutexGuard<'_, KeptDisks> {
        self.disks.lock().unwrap_or_else(PoisonError::into_inner) // entries are inserted whole
    }

    /// The clouds in memory.
    pub fn clouds(&self) -> MutexGuard<'_, Clouds> {
        // Clouds are inserted whole: a panic elsewhere cannot leave a half-made one behind.
        self.clouds.lock().unwrap_or_else(PoisonError::into_inner)
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
        let guess = usize::try_from(cloud.bytes).unwrap_or(usize::MAX).saturating_mul(GROWTH).max(LEAST_COST);
        self.passing.get(&cloud.digest).copied().unwrap_or(guess)
    }
}
