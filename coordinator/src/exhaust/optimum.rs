//! The best descriptor of a grid, remembered by the grid's key, so that every later run can say how far it is from it.

use cache::Store;
use descriptor::{Descriptor, GENES, Parameters};
use proto::Digest;
use serde::{Deserialize, Serialize};

use super::grid::Grid;
use crate::result_cache::Source;
use crate::result_cache::sourced::Sourced;

/// Version of the entry's form.
const VERSION: u32 = 1;
/// Bytes of the largest entry that is looked at.
const MAX_BYTES: usize = 4096;

/// The best descriptor of a grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Optimum {
    /// The descriptor, the first in gene order on ties.
    pub parameters: Parameters,
    /// Queries of the first training set that it answers with the right object.
    pub object_correct: u32,
}

/// An optimum as it is kept.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    version: u32,
    /// In the order of [`GENES`].
    ticks: [u32; GENES.len()],
    object_correct: u32,
    queries: u32,
}

impl Optimum {
    /// The descriptor as every family's.
    pub fn descriptor(&self) -> Descriptor {
        Descriptor::DiskRing(self.parameters)
    }

    /// The optimum that a store has under a grid's key, if it is one of this grid.
    pub fn recall(store: &Store, key: Digest, grid: &Grid, queries: u32) -> Option<Self> {
        let (_, payload) = Sourced::GridOptimum.get(store, key)?;
        Self::decode(&payload, grid, queries)
    }

    /// Keeps it for later runs, with who has computed the grid.
    pub fn remember(&self, store: &Store, key: Digest, queries: u32, source: &Source) {
        if let Ok(payload) = serde_json::to_vec(&self.entry(queries)) {
            Sourced::GridOptimum.put(store, key, source, &payload);
        }
    }

    fn entry(&self, queries: u32) -> Entry {
        let ticks = self.parameters.all_ticks();
        Entry { version: VERSION, ticks, object_correct: self.object_correct, queries }
    }

    /// What an entry says if it can be true: a descriptor of this grid, with a count that this many queries can reach.
    fn decode(payload: &[u8], grid: &Grid, queries: u32) -> Option<Self> {
        if payload.len() > MAX_BYTES {
            return None;
        }
        let entry: Entry = serde_json::from_slice(payload).ok()?;
        let found =
            Self { parameters: Parameters::from_ticks(entry.ticks), object_correct: entry.object_correct };
        let sound = entry.version == VERSION
            && entry.queries == queries
            && found.object_correct <= queries
            && grid.table().contains(&found.parameters);
        sound.then_some(found)
    }
}

#[cfg(test)]
mod tests {
    use cache::{ByteSize, Storage};

    use super::super::grid::tests::grid;
    use super::*;
    use crate::result_cache::source::tests::source;
    use cluster::scheduler::Basis;
    use proto::Principal;

    #[test]
    fn what_was_remembered_is_recalled_under_its_key_only() {
        let folder = tempfile::tempdir().unwrap();
        let size = ByteSize::mib(1);
        let storage =
            Storage { cache: Some(folder.path().to_owned()), cache_size: size, ..Storage::in_memory(size) };
        let store = Store::open(&storage, "test", descriptor::EVALUATION_VERSION);
        let grid = grid([2, 2, 2, 2, 2], true);
        let optimum = Optimum { parameters: grid.descriptor([1, 0, 1, 0, 1]), object_correct: 7 };
        let (key, other) = (Digest::of(b"this"), Digest::of(b"other"));
        assert_eq!(Optimum::recall(&store, key, &grid, 9), None);
        let source = source(1, &[Principal::Coordinator], Basis::Own);
        optimum.remember(&store, key, 9, &source);
        assert_eq!(Optimum::recall(&store, key, &grid, 9), Some(optimum));
        assert_eq!(Optimum::recall(&store, other, &grid, 9), None);
    }

    #[test]
    fn an_entry_that_cannot_be_the_grids_optimum_is_none() {
        let grid = grid([2, 2, 2, 2, 2], true);
        let optimum = Optimum { parameters: grid.descriptor([1, 0, 1, 0, 1]), object_correct: 7 };
        let good = || optimum.entry(9);
        let decode = |entry: &Entry| Optimum::decode(&serde_json::to_vec(entry).unwrap(), &grid, 9);
        assert_eq!(decode(&good()), Some(optimum));
        for bad in [
            Entry { version: 2, ..good() },
            Entry { ticks: [1, 2, 3, 4, 5], ..good() },
            Entry { object_correct: 10, ..good() },
            Entry { queries: 8, ..good() },
        ] {
            assert_eq!(decode(&bad), None, "{bad:?}");
        }
        let text = serde_json::to_string(&good()).unwrap();
        for bad in ["", "{}", &text[..text.len() - 1], &text.replace('{', "{\"more\":1,"), &" ".repeat(5000)]
        {
            assert_eq!(Optimum::decode(bad.as_bytes(), &grid, 9), None, "{bad}");
        }
    }
}
