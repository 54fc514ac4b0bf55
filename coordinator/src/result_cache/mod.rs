//! What finished runs have computed, kept from run to run: counts by descriptor, for one matching of one data set.
//!
//! Counts are exact for every gene table, so that searches of different spaces, seeds and methods share them.

mod records;

use std::collections::{BTreeMap, BTreeSet};

use cache::Store;
use descriptor::{Descriptor, Preprocess};
use proto::Digest;
use proto::task::DescriptorBytes;
use results::Counts;

use crate::fitness::Measured;
use crate::storage;
use crate::tasks::descriptor_bytes;

/// Kind of the entries in the store.
const KIND: &str = "remembered counts";

/// Counts by descriptor.
pub type Remembered = BTreeMap<Descriptor, Counts>;

/// What is known of descriptors under one fitness.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Known {
    /// On the training clouds.
    pub train: BTreeMap<Descriptor, Measured>,
    /// On the validation clouds.
    pub validation: BTreeMap<Descriptor, Measured>,
}

impl Known {
    /// What is remembered under the paper's fitness.
    pub fn recall(train: &Memory<'_>, validation: &Memory<'_>) -> Self {
        let recalled = |memory: &Memory<'_>| {
            let plain = |(descriptor, counts)| (descriptor, Measured { counts, margin: None });
            memory.recall().into_iter().map(plain).collect()
        };
        Self { train: recalled(train), validation: recalled(validation) }
    }

    /// Adds what is known under the paper's fitness to what is remembered, of those descriptors that are `vouched` for:
    /// nobody goes on with what one stranger alone has said.
    pub fn keep(&self, train: &Memory<'_>, validation: &Memory<'_>, vouched: &BTreeSet<DescriptorBytes>) {
        for (memory, known) in [(train, &self.train), (validation, &self.validation)] {
            let vouched =
                known.iter().filter(|(descriptor, _)| vouched.contains(&descriptor_bytes(descriptor)));
            let plain = vouched.map(|(descriptor, measured)| (descriptor.clone(), measured.counts));
            memory.keep(&plain.collect());
        }
    }
}

/// The place in the store of the counts of one matching on one data set.
pub struct Memory<'a> {
    store: &'a Store,
    key: Digest,
    queries: u32,
}

impl<'a> Memory<'a> {
    /// The place for counts of so many queries, whose manifests come first, against the database, whose manifests come
    /// second.
    pub fn new(store: &'a Store, preprocess: &Preprocess, manifests: [&[Digest]; 2], queries: u32) -> Self {
        // Two lists: the same manifests on other sides are another matching.
        let inputs = manifests.map(|list| list.iter().flat_map(|digest| digest.0).collect::<Vec<u8>>());
        let key = storage::key(KIND, preprocess, &inputs.each_ref().map(Vec::as_slice));
        Self { store, key, queries }
    }

    /// What is remembered; nothing if there is any doubt.
    pub fn recall(&self) -> Remembered {
        let Some(payload) = self.store.get_local(KIND, self.key) else { return Remembered::new() };
        if records::is_older(&payload) {
            return Remembered::new(); // of an earlier release: nothing is wrong with it
        }
        records::decode(&payload, self.queries).unwrap_or_else(|what| {
            tracing::warn!("cache: {KIND} {} are not used, got {what}", self.key);
            Remembered::new()
        })
    }

    /// Adds the counts of a finished run. Of two runs that end at the same moment, one may overwrite what the other
    /// has just added: that is computed once more.
    pub fn keep(&self, found: &Remembered) {
        let mut known = self.recall();
        if merge(&mut known, found) {
            records::truncate(&mut known);
            self.store.put_local(KIND, self.key, &records::encode(&known, self.queries));
        }
    }
}

/// Adds counts and returns whether anything changed. Where two runs disagree, one of them was computed wrongly:
/// neither is kept.
fn merge(known: &mut Remembered, found: &Remembered) -> bool {
    let mut changed = false;
    for (descriptor, counts) in found {
        match known.insert(descriptor.clone(), *counts) {
            Some(before) if before == *counts => {}
            Some(before) => {
                tracing::warn!(
                    "cache: {KIND}: {descriptor}: {} of {} recognised before, got {}\none of the two runs is wrong: check them with `coordinator verify`",
                    before.object_correct,
                    before.queries,
                    counts.object_correct
                );
                known.remove(descriptor);
                changed = true;
            }
            None => changed = true,
        }
    }
    changed
}

#[cfg(test)]
mod tests {
    use descriptor::Parameters;

    use super::*;

    fn memory<'a>(store: &'a Store, preprocess: &Preprocess, query: &[u8], database: &[u8]) -> Memory<'a> {
        let digests = |bytes: &[u8]| bytes.iter().map(|&byte| Digest([byte; 32])).collect::<Vec<_>>();
        Memory::new(store, preprocess, [&digests(query), &digests(database)], 10)
    }

    fn counts(object_correct: u32) -> Counts {
        Counts { object_correct, category_correct: 9, queries: 10 }
    }

    fn remembered(descriptors: &[(u32, u32)]) -> Remembered {
        let one = |&(shape_bins, correct): &(u32, u32)| {
            let parameters = Parameters { shape_bins, ..Parameters::PAPER_BEST };
            (Descriptor::DiskRing(parameters), counts(correct))
        };
        descriptors.iter().map(one).collect()
    }

    #[test]
    fn a_run_remembers_what_earlier_ones_on_the_same_clouds_found() {
        let folder = tempfile::tempdir().unwrap();
        let store = storage::store_in(folder.path());
        let preprocess = Preprocess::default();
        let here = memory(&store, &preprocess, &[1], &[2]);
        assert_eq!(here.recall(), Remembered::new());
        here.keep(&remembered(&[(8, 3), (9, 4)]));
        here.keep(&remembered(&[(9, 4), (10, 5)]));
        assert_eq!(here.recall(), remembered(&[(8, 3), (9, 4), (10, 5)]));

        assert_eq!(memory(&store, &preprocess, &[1], &[2]).recall(), here.recall());
        for (query, database) in [(&[2][..], &[1][..]), (&[1, 2], &[]), (&[1], &[2, 3])] {
            assert_eq!(memory(&store, &preprocess, query, database).recall(), Remembered::new());
        }
        let coarser = Preprocess { leaf_um: 30_000, ..preprocess };
        assert_eq!(memory(&store, &coarser, &[1], &[2]).recall(), Remembered::new());
    }

    #[test]
    fn what_two_runs_disagree_on_is_forgotten() {
        let mut known = remembered(&[(8, 3), (9, 4)]);
        assert!(!merge(&mut known, &remembered(&[(8, 3)])));
        assert!(merge(&mut known, &remembered(&[(9, 5)])));
        assert_eq!(known, remembered(&[(8, 3)]));
    }

    #[test]
    fn a_payload_that_makes_no_sense_is_forgotten_and_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let store = storage::store_in(folder.path());
        let memory = memory(&store, &Preprocess::default(), &[1], &[2]);
        store.put(KIND, memory.key, b"counts?");
        assert_eq!(memory.recall(), Remembered::new());
        memory.keep(&remembered(&[(8, 3)]));
        assert_eq!(memory.recall(), remembered(&[(8, 3)]));
    }
}
