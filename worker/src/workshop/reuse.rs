//! What evaluations have in common: shape and colour parts of a split, and the distances between splits.

use std::sync::Arc;

use cache::Lru;
use descriptor::{DistanceMatrix, Parameters, Parts};
use proto::Digest;

/// One of the two halves of a descriptor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Half {
    /// Depends on shape_bins, R1 and R2.
    Shape,
    /// Depends on m, R1 and R2.
    Colour,
}

impl Half {
    /// Both, in the order of all pairs of halves here.
    pub const BOTH: [Self; 2] = [Self::Shape, Self::Colour];
}

/// All parameters that one half of a descriptor depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct HalfKey {
    half: Half,
    bins: u32,
    disk_um: u32,
    ring_um: u32,
}

impl HalfKey {
    /// What of `parameters` matters to `half`.
    pub fn new(half: Half, parameters: &Parameters) -> Self {
        let bins = match half {
            Half::Shape => parameters.shape_bins,
            Half::Colour => parameters.colour_bins,
        };
        Self { half, bins, disk_um: parameters.disk_um, ring_um: parameters.ring_um }
    }

    /// Which half.
    pub fn half(self) -> Half {
        self.half
    }
}

/// Split manifests, or descriptions, of queries and of a database, in order.
pub type Pairing = [Arc<[Digest]>; 2];

/// Parts and distances of recent evaluations under one preparation, bounded in bytes.
#[derive(Debug)]
pub struct Reuse {
    parts: Lru<(Digest, HalfKey), Arc<Parts>>,
    distances: Lru<(Pairing, HalfKey), Arc<DistanceMatrix>>,
}

impl Reuse {
    /// Holds up to `capacity` bytes, half of them parts and half of them distances.
    pub fn new(capacity: usize) -> Self {
        Self { parts: Lru::new(capacity / 2), distances: Lru::new(capacity / 2) }
    }

    /// The parts of one split or one description.
    pub fn parts(&mut self, manifest: Digest, key: HalfKey) -> Option<Arc<Parts>> {
        self.parts.get(&(manifest, key))
    }

    /// Keeps the parts of one split or one description.
    pub fn keep_parts(&mut self, manifest: Digest, key: HalfKey, parts: &Arc<Parts>) {
        self.parts.insert((manifest, key), Arc::clone(parts), parts.bytes());
    }

    /// The distances of queries to a database.
    pub fn distances(&mut self, pairing: &Pairing, key: HalfKey) -> Option<Arc<DistanceMatrix>> {
        self.distances.get(&(pairing.clone(), key))
    }

    /// Keeps the distances of queries to a database.
    pub fn keep_distances(&mut self, pairing: &Pairing, key: HalfKey, matrix: &Arc<DistanceMatrix>) {
        self.distances.insert((pairing.clone(), key), Arc::clone(matrix), matrix.bytes());
    }
}
