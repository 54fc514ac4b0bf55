//! Entries of the store that have one source as a whole.

use cache::Store;
use proto::Digest;

use super::source::{self, Source, Wrong};

/// What such an entry holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sourced {
    /// Descriptions of clouds, which `compare` uses.
    Descriptions,
    /// The best descriptor of a grid.
    GridOptimum,
}

impl Sourced {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Descriptions, Self::GridOptimum];

    /// Kind of the entries in the store.
    pub fn kind(self) -> &'static str {
        match self {
            Self::Descriptions => "descriptions",
            Self::GridOptimum => "grid optimum",
        }
    }

    /// What is kept under a key, and where it comes from; `None` also of an entry of an earlier release, which does not say
    /// that.
    pub fn get(self, store: &Store, key: Digest) -> Option<(Source, Vec<u8>)> {
        let mut entry = store.get_local(self.kind(), key)?;
        let (source, payload) = source::split(&entry)?;
        let header = entry.len() - payload.len();
        entry.drain(..header);
        Some((source, entry))
    }

    /// Keeps something that comes from there.
    pub fn put(self, store: &Store, key: Digest, source: &Source, payload: &[u8]) {
        let mut entry = Vec::new();
        source::append(source, &mut entry);
        entry.extend_from_slice(payload);
        store.put_local(self.kind(), key, &entry);
    }

    /// Removes the entries that are in doubt; returns how many.
    pub fn forget(self, store: &Store, wrong: &Wrong) -> usize {
        let keys = store.local_keys(self.kind()).into_iter();
        let doubtful =
            keys.filter(|&key| self.get(store, key).is_some_and(|(source, _)| wrong.concerns(&source)));
        doubtful.map(|key| store.remove_local(self.kind(), key)).count()
    }
}
