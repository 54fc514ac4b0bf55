//! What evaluations have in common: signatures of a split in one channel, and the distances between splits.

use std::sync::Arc;

use cache::Lru;
use descriptor::{Channel, DistanceMatrix, Preprocess, Signatures};
use proto::Digest;

/// What signatures and distances depend on, beside the clouds.
pub type Key = (Preprocess, Channel);

/// Split manifests, or what signatures that others have encoded are known by, of queries and of a database, in order.
pub type Pairing = [Arc<[Digest]>; 2];

/// Signatures and distances of recent tasks, bounded in bytes.
#[derive(Debug)]
pub struct Reuse {
    signatures: Lru<(Digest, Key), Arc<Signatures>>,
    distances: Lru<(Pairing, Key), Arc<DistanceMatrix>>,
    /// For distances, bytes.
    capacity: usize,
}

impl Reuse {
    /// Holds up to `capacity` bytes, half of them signatures and half of them distances.
    pub fn new(capacity: usize) -> Self {
        let capacity = capacity / 2;
        Self { signatures: Lru::new(capacity), distances: Lru::new(capacity), capacity }
    }

    /// Whether the distances of so many queries to so many clouds can be kept in so many channels at once.
    pub fn has_room(&self, channels: usize, [queries, database]: [usize; 2]) -> bool {
        let of_channel = queries.saturating_mul(database).saturating_mul(size_of::<f32>());
        of_channel.saturating_mul(channels) <= self.capacity
    }

    /// The signatures of one split, or those of others that are known by this digest.
    pub fn signatures(&mut self, source: Digest, key: &Key) -> Option<Arc<Signatures>> {
        self.signatures.get(&(source, key.clone()))
    }

    /// Keeps the signatures of one split, or those of others that are known by this digest.
    pub fn keep_signatures(&mut self, source: Digest, key: &Key, signatures: &Arc<Signatures>) {
        self.signatures.insert((source, key.clone()), Arc::clone(signatures), signatures.bytes());
    }

    /// The distances of queries to a database.
    pub fn distances(&mut self, pairing: &Pairing, key: &Key) -> Option<Arc<DistanceMatrix>> {
        self.distances.get(&(pairing.clone(), key.clone()))
    }

    /// Keeps the distances of queries to a database.
    pub fn keep_distances(&mut self, pairing: &Pairing, key: &Key, matrix: &Arc<DistanceMatrix>) {
        self.distances.insert((pairing.clone(), key.clone()), Arc::clone(matrix), matrix.bytes());
    }
}
