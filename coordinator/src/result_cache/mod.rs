//! What finished runs have computed, kept from run to run: counts by descriptor, for one matching of one data set.
//!
//! Counts are exact for every gene table, so that searches of different spaces, seeds and methods share them.

pub mod finished_runs;
mod forget;
mod found_counts;
mod records;
pub mod source;
pub mod sourced;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use cache::Store;
use cluster::ClusterError;
use cluster::scheduler::Provenance;
use cluster::spill::SpillError;
use descriptor::{Descriptor, Preprocess};
use proto::task::DescriptorBytes;
use proto::{Digest, SessionId};
use results::Counts;

use crate::fitness::Measured;
use crate::storage;
use crate::tasks::descriptor_bytes;
pub use forget::forget;
use found_counts::FoundCounts;
pub use source::{Source, Wrong};

/// Kind of the entries in the store.
const KIND: &str = "remembered counts";

/// Counts that an earlier run has left.
#[derive(Clone, Debug, PartialEq)]
pub struct CachedCounts {
    /// The counts.
    pub counts: Counts,
    /// Where they come from.
    pub source: Arc<Source>,
}

/// What is remembered, by descriptor.
pub type CountsByDescriptor = BTreeMap<Descriptor, CachedCounts>;

/// What is known of descriptors under one fitness on the clouds of one matching.
#[derive(Debug, Default)]
pub struct MatchingCounts {
    /// What those have that an earlier run has left.
    earlier: BTreeMap<DescriptorBytes, Measured>,
    /// Where those come from that an earlier run has left and this one has not used yet.
    pub unused: BTreeMap<Descriptor, Arc<Source>>,
    /// What this run has found, by canonical bytes: a search may come upon millions.
    found: FoundCounts,
}

/// What is known of descriptors under one fitness.
#[derive(Debug, Default)]
pub struct SearchCounts {
    /// On the training clouds.
    pub train: MatchingCounts,
    /// On the validation clouds.
    pub validation: MatchingCounts,
    /// Where those come from that an earlier run has left and this one has used.
    pub used: BTreeSet<Arc<Source>>,
}

impl MatchingCounts {
    fn read(cache: &CountCache<'_>) -> Self {
        let mut known = Self::default();
        for (descriptor, CachedCounts { counts, source }) in cache.read() {
            known.earlier.insert(descriptor_bytes(&descriptor), Measured { counts, margin: None });
            known.unused.insert(descriptor, source);
        }
        known
    }

    /// What earlier runs have left, for a search; what it finds and memory does not hold goes to this folder.
    fn begin(&self, folder: Option<&Path>) -> Self {
        let Self { earlier, unused, found: _ } = self;
        Self { earlier: earlier.clone(), unused: unused.clone(), found: FoundCounts::new(folder) }
    }

    /// What a descriptor has, if it is known.
    ///
    /// # Errors
    /// [`ClusterError::Spill`], here and below, if what has outgrown memory cannot be read any more.
    pub fn get(&self, descriptor: &Descriptor) -> Result<Option<Measured>, ClusterError> {
        let bytes = descriptor_bytes(descriptor);
        let found = self.found.get(&bytes).map_err(ClusterError::Spill)?;
        Ok(found.or_else(|| self.earlier.get(&bytes).copied()))
    }

    /// Whether it is known what a descriptor has.
    pub fn contains(&self, descriptor: &Descriptor) -> Result<bool, ClusterError> {
        let bytes = descriptor_bytes(descriptor);
        let is_found = || self.found.contains(&bytes).map_err(ClusterError::Spill);
        if self.earlier.contains_key(&bytes) { Ok(true) } else { is_found() }
    }

    /// What a descriptor has that was measured.
    ///
    /// # Panics
    /// If it was not measured.
    pub fn measured(&self, descriptor: &Descriptor) -> Result<Measured, ClusterError> {
        let measured = self.get(descriptor)?;
        Ok(measured.unwrap_or_else(|| unreachable!("asked for only after it was measured: {descriptor}")))
    }

    /// Notes what a descriptor has.
    pub fn insert(&mut self, descriptor: &Descriptor, measured: Measured) {
        self.found.insert(&descriptor_bytes(descriptor), measured);
    }

    /// Drops what earlier runs have left of these descriptors.
    pub fn drop_unused(&mut self, is_dropped: impl Fn(&Descriptor, &Source) -> bool) {
        let Self { earlier, unused, .. } = self;
        unused.retain(|descriptor, source| {
            let is_dropped = is_dropped(descriptor, source);
            if is_dropped {
                earlier.remove(&descriptor_bytes(descriptor));
            }
            !is_dropped
        });
    }

    /// Shows all of it to `see`.
    fn for_each(&self, mut see: impl FnMut(&[u8], Measured)) -> Result<(), SpillError> {
        self.earlier.iter().for_each(|(bytes, measured)| see(bytes.bytes(), *measured));
        self.found.for_each(see)
    }
}

impl SearchCounts {
    /// What is remembered under the paper's fitness.
    pub fn read(train: &CountCache<'_>, validation: &CountCache<'_>) -> Self {
        let [train, validation] = [train, validation].map(MatchingCounts::read);
        Self { train, validation, used: BTreeSet::new() }
    }

    /// What earlier runs have left, for a search; what it finds and memory does not hold goes to this folder.
    pub fn begin(&self, folder: Option<&Path>) -> Self {
        let [train, validation] = [&self.train, &self.validation].map(|known| known.begin(folder));
        Self { train, validation, used: self.used.clone() }
    }

    /// Drops what is in doubt.
    pub fn drop_wrong(&mut self, wrong: &Wrong) {
        for counts in [&mut self.train, &mut self.validation] {
            counts.drop_unused(|_, source| wrong.concerns(source));
        }
    }

    /// Whether anything that was used is in doubt.
    pub fn rests_on(&self, wrong: &Wrong) -> bool {
        self.used.iter().any(|source| wrong.concerns(source))
    }

    /// Adds what is known under the paper's fitness to what is remembered, of those descriptors that are in the run's
    /// `provenances`: nobody goes on with what one stranger alone has said.
    pub fn keep(
        &self,
        train: &CountCache<'_>,
        validation: &CountCache<'_>,
        (run, provenances): (SessionId, &BTreeMap<DescriptorBytes, Arc<Provenance>>),
    ) {
        let mut sources: BTreeMap<&Provenance, Arc<Source>> = BTreeMap::new();
        for provenance in provenances.values() {
            let source = || Source { run, provenance: Provenance::clone(provenance) };
            sources.entry(&**provenance).or_insert_with(|| Arc::new(source()));
        }
        for (cache, known) in [(train, &self.train), (validation, &self.validation)] {
            let mut found = CountsByDescriptor::new();
            let shown = known.for_each(|bytes, Measured { counts, .. }| {
                if let Some(provenance) = provenances.get(&DescriptorBytes::from(bytes.to_vec()))
                    && let Ok(descriptor) = Descriptor::from_bytes(bytes)
                {
                    let source = Arc::clone(&sources[&**provenance]);
                    found.insert(descriptor, CachedCounts { counts, source });
                }
            });
            if let Err(failure) = shown {
                tracing::warn!("cache: {KIND} of this run are not all kept: {failure}");
            }
            cache.keep(&found);
        }
    }
}

/// The place in the store of the counts of one matching on one data set.
pub struct CountCache<'a> {
    store: &'a Store,
    key: Digest,
    queries: u32,
}

impl<'a> CountCache<'a> {
    /// The place for counts of so many queries, whose manifests come first, against the database, whose manifests come
    /// second.
    pub fn new(store: &'a Store, preprocess: &Preprocess, manifests: [&[Digest]; 2], queries: u32) -> Self {
        // Two lists: the same manifests on other sides are another matching.
        let inputs = manifests.map(|list| list.iter().flat_map(|digest| digest.0).collect::<Vec<u8>>());
        let key = storage::key(KIND, preprocess, &inputs.each_ref().map(Vec::as_slice));
        Self { store, key, queries }
    }

    /// What is remembered; nothing if there is any doubt.
    pub fn read(&self) -> CountsByDescriptor {
        let Some(payload) = self.store.get_local(KIND, self.key) else { return CountsByDescriptor::new() };
        if records::is_older(&payload) {
            return CountsByDescriptor::new(); // of an earlier release: nothing is wrong with it
        }
        records::decode(&payload, self.queries).unwrap_or_else(|what| {
            tracing::warn!("cache: {KIND} {} are not used, got {what}", self.key);
            CountsByDescriptor::new()
        })
    }

    /// Adds the counts of a finished run. Of two runs that end at the same moment, one may overwrite what the other
    /// has just added: that is computed once more.
    pub fn keep(&self, found: &CountsByDescriptor) {
        let mut known = self.read();
        if merge(&mut known, found) {
            records::truncate(&mut known);
            self.store.put_local(KIND, self.key, &records::encode(&known, self.queries));
        }
    }
}

/// Adds counts and returns whether anything changed. Of two that agree, the one that is believed for the better reason
/// stays. Where two runs disagree, one of them was computed wrongly: neither is kept.
fn merge(known: &mut CountsByDescriptor, found: &CountsByDescriptor) -> bool {
    let mut changed = false;
    for (descriptor, new) in found {
        let (before, now) = match known.get_mut(descriptor) {
            Some(before) => (before, new.counts),
            None => {
                known.insert(descriptor.clone(), new.clone());
                changed = true;
                continue;
            }
        };
        if before.counts != now {
            tracing::warn!(
                "cache: {KIND}: {descriptor}: {} of {} recognised before, got {}\none of the two runs is wrong: check them with `coordinator verify`",
                before.counts.object_correct,
                before.counts.queries,
                now.object_correct
            );
            known.remove(descriptor);
            changed = true;
        } else if before.source.provenance.basis < new.source.provenance.basis {
            before.source = Arc::clone(&new.source);
            changed = true;
        }
    }
    changed
}

#[cfg(test)]
mod tests {
    use cluster::scheduler::Basis;
    use descriptor::Parameters;

    use super::source::tests::{principal, source};
    use super::*;

    fn cache<'a>(store: &'a Store, preprocess: &Preprocess, query: &[u8], database: &[u8]) -> CountCache<'a> {
        let digests = |bytes: &[u8]| bytes.iter().map(|&byte| Digest([byte; 32])).collect::<Vec<_>>();
        CountCache::new(store, preprocess, [&digests(query), &digests(database)], 10)
    }

    fn counts(object_correct: u32) -> Counts {
        Counts { object_correct, category_correct: 9, queries: 10 }
    }

    fn remembered(descriptors: &[(u32, u32)]) -> CountsByDescriptor {
        let one = |&(shape_bins, correct): &(u32, u32)| {
            let parameters = Parameters { shape_bins, ..Parameters::PAPER_BEST };
            let source = Arc::new(source(1, &[principal(1)], Basis::Earned));
            (Descriptor::DiskRing(parameters), CachedCounts { counts: counts(correct), source })
        };
        descriptors.iter().map(one).collect()
    }

    #[test]
    fn a_run_remembers_what_earlier_ones_on_the_same_clouds_found() {
        let folder = tempfile::tempdir().unwrap();
        let store = storage::store_in(folder.path());
        let preprocess = Preprocess::default();
        let here = cache(&store, &preprocess, &[1], &[2]);
        assert_eq!(here.read(), CountsByDescriptor::new());
        here.keep(&remembered(&[(8, 3), (9, 4)]));
        here.keep(&remembered(&[(9, 4), (10, 5)]));
        assert_eq!(here.read(), remembered(&[(8, 3), (9, 4), (10, 5)]));

        assert_eq!(cache(&store, &preprocess, &[1], &[2]).read(), here.read());
        for (query, database) in [(&[2][..], &[1][..]), (&[1, 2], &[]), (&[1], &[2, 3])] {
            assert_eq!(cache(&store, &preprocess, query, database).read(), CountsByDescriptor::new());
        }
        let coarser = Preprocess { leaf_um: 30_000, ..preprocess };
        assert_eq!(cache(&store, &coarser, &[1], &[2]).read(), CountsByDescriptor::new());
    }

    #[test]
    fn what_two_runs_disagree_on_is_forgotten() {
        let mut known = remembered(&[(8, 3), (9, 4)]);
        assert!(!merge(&mut known, &remembered(&[(8, 3)])));
        assert!(merge(&mut known, &remembered(&[(9, 5)])));
        assert_eq!(known, remembered(&[(8, 3)]));
    }

    #[test]
    fn of_two_runs_that_agree_the_surer_one_is_the_source() {
        let mut known = remembered(&[(8, 3)]);
        let mut surer = known.clone();
        let own = Arc::new(source(2, &[proto::Principal::Coordinator], Basis::Own));
        surer.values_mut().for_each(|one| one.source = Arc::clone(&own));
        assert!(merge(&mut known, &surer));
        assert_eq!(known, surer);
        assert!(!merge(&mut known, &remembered(&[(8, 3)])));
        assert_eq!(known, surer);
    }

    #[test]
    fn a_payload_that_makes_no_sense_is_forgotten_and_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let store = storage::store_in(folder.path());
        let here = cache(&store, &Preprocess::default(), &[1], &[2]);
        store.put(KIND, here.key, b"counts?");
        assert_eq!(here.read(), CountsByDescriptor::new());
        here.keep(&remembered(&[(8, 3)]));
        assert_eq!(here.read(), remembered(&[(8, 3)]));
    }
}
