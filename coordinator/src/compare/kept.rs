//! Descriptions in the coordinator's own store: one that was made once is not asked for again.

use std::collections::BTreeSet;
use std::sync::Arc;

use cache::Store;
use cluster::DescriptionAnswer;
use descriptor::Preprocess;
use proto::Digest;
use proto::task::Description;

use crate::storage;
use crate::tasks::CHECK_DESCRIPTION;

/// Kind of the entries in the store.
const KIND: &str = "descriptions";

/// The descriptions of some shards: which the store has, and which of the others it keeps as workers send them.
pub struct KeptDescriptions<'a> {
    store: &'a Store,
    preprocess: Preprocess,
    shards: &'a [Description],
    /// Shards whose entry this has written.
    written: BTreeSet<usize>,
}

impl<'a> KeptDescriptions<'a> {
    /// The places of these shards of clouds that are prepared like this.
    pub fn new(store: &'a Store, preprocess: &Preprocess, shards: &'a [Description]) -> Self {
        Self { store, preprocess: *preprocess, shards, written: BTreeSet::new() }
    }

    /// The key of a shard's entry: clouds and descriptor, but not the search space for which the clouds are prepared,
    /// because every descriptor is counted exactly from each.
    fn key(&self, shard: &Description) -> Digest {
        let inputs = [shard.subject.descriptor.bytes(), &shard.manifest.0];
        storage::key(KIND, &self.preprocess, &inputs)
    }

    /// Of each shard the description that the store has, if it has a sound one.
    pub fn recall(&self) -> Vec<Option<Arc<[u8]>>> {
        let one = |shard: &Description| {
            let bytes = self.store.get_local(KIND, self.key(shard))?;
            match CHECK_DESCRIPTION(&shard.subject, &bytes, shard.clouds) {
                Ok(()) => Some(bytes.into()),
                Err(what) => {
                    tracing::warn!("cache: {KIND} {} are made again, got {what}", self.key(shard));
                    None
                }
            }
        };
        self.shards.iter().map(one).collect()
    }

    /// Takes in what workers have answered, numbered as the shards. As soon as one of them has turned out to be wrong
    /// (`trusted` is false), nothing more is kept and what was written is removed. An answer whose audit is not over is
    /// left to [`KeptDescriptions::complete`].
    pub fn take(&mut self, answers: &[DescriptionAnswer], trusted: bool) {
        if !trusted {
            return self.forget_written();
        }
        for DescriptionAnswer { place, bytes, settled } in answers {
            if let (Some(bytes), true) = (bytes, settled) {
                self.write(*place, bytes);
            }
        }
    }

    /// Keeps those of these answers, one a place, that are not kept yet: nobody is left who could contradict them.
    pub fn complete<'b>(&mut self, answers: impl Iterator<Item = (usize, &'b [u8])>, trusted: bool) {
        if !trusted {
            return self.forget_written();
        }
        for (place, bytes) in answers {
            self.write(place, bytes);
        }
    }

    fn write(&mut self, place: usize, bytes: &[u8]) {
        if let Some(shard) = self.shards.get(place)
            && self.written.insert(place)
        {
            self.store.put_local(KIND, self.key(shard), bytes);
        }
    }

    fn forget_written(&mut self) {
        for place in std::mem::take(&mut self.written) {
            self.store.remove_local(KIND, self.key(&self.shards[place]));
        }
    }

    /// Removes the descriptions of all shards, whoever wrote them: one of them is wrong.
    pub fn forget_all(&self) {
        for shard in self.shards {
            self.store.remove_local(KIND, self.key(shard));
        }
    }
}

#[cfg(test)]
mod tests {
    use descriptor::{Descriptor, Family, FixedDescriptor, FixedKind, SearchSpace};

    use super::*;
    use crate::storage::store_in;
    use crate::tasks;

    const CLOUDS: u32 = 3;

    fn shard(descriptor: &Descriptor, manifest: u8) -> Description {
        let space = SearchSpace::single(descriptor).unwrap();
        let preparation = tasks::preparation(&Preprocess::default(), space);
        let subject = tasks::subject(&preparation, descriptor);
        Description { subject, manifest: Digest([manifest; 32]), clouds: CLOUDS }
    }

    fn shards() -> Vec<Description> {
        let descriptor = Descriptor::default_of(Family::DiskRing);
        (0..4).map(|manifest| shard(&descriptor, manifest)).collect()
    }

    fn zeros(shard: &Description) -> Arc<[u8]> {
        vec![0; (u64::from(shard.clouds) * shard.subject.facts.description_bytes) as usize].into()
    }

    fn answer(shards: &[Description], place: usize, settled: bool) -> DescriptionAnswer {
        DescriptionAnswer { place, bytes: Some(zeros(&shards[place])), settled }
    }

    fn recalled(kept: &KeptDescriptions<'_>) -> Vec<bool> {
        kept.recall().iter().map(Option::is_some).collect()
    }

    #[test]
    fn keys_differ_with_descriptor_clouds_and_preparation_and_not_with_the_search_space() {
        let folder = tempfile::tempdir().unwrap();
        let store = store_in(folder.path());
        let preprocess = Preprocess::default();
        let kept = KeptDescriptions::new(&store, &preprocess, &[]);
        let paper = Descriptor::default_of(Family::DiskRing);
        let fixed = |kind, radius_um| Descriptor::Fixed(FixedDescriptor { kind, radius_um });
        let keys = [
            kept.key(&shard(&paper, 0)),
            kept.key(&shard(&paper, 1)),
            kept.key(&shard(&fixed(FixedKind::PfhRgb, 50_000), 0)),
            kept.key(&shard(&fixed(FixedKind::ShotColor, 50_000), 0)),
            kept.key(&shard(&fixed(FixedKind::ShotColor, 50_001), 0)),
        ];
        let coarser = Preprocess { leaf_um: preprocess.leaf_um + 1, ..preprocess };
        let elsewhere = KeptDescriptions::new(&store, &coarser, &[]).key(&shard(&paper, 0));
        let different: BTreeSet<Digest> = keys.into_iter().chain([elsewhere]).collect();
        assert_eq!(different.len(), keys.len() + 1);

        let whole = SearchSpace::DiskRing(descriptor::GeneTable::paper());
        let subject = tasks::subject(&tasks::preparation(&preprocess, whole), &paper);
        let of_run = Description { subject, ..shard(&paper, 0) };
        assert_ne!(of_run.subject.preparation, shard(&paper, 0).subject.preparation);
        assert_eq!(kept.key(&of_run), keys[0]);
    }

    #[test]
    fn what_is_settled_is_kept_at_once_and_the_rest_at_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let (store, shards) = (store_in(folder.path()), shards());
        let mut kept = KeptDescriptions::new(&store, &Preprocess::default(), &shards);
        kept.take(&[answer(&shards, 2, true), answer(&shards, 1, false)], true);
        kept.take(&[DescriptionAnswer { place: 0, bytes: None, settled: true }], true);
        assert_eq!(recalled(&kept), [false, false, true, false]);
        let bytes: Vec<Arc<[u8]>> = shards.iter().map(zeros).collect();
        kept.complete(bytes.iter().map(|bytes| &**bytes).enumerate(), true);
        let again = KeptDescriptions::new(&store, &Preprocess::default(), &shards);
        assert_eq!(again.recall(), bytes.into_iter().map(Some).collect::<Vec<_>>());
        again.forget_all();
        assert_eq!(recalled(&again), [false; 4]);
    }

    #[test]
    fn nothing_stays_of_a_call_in_which_a_worker_was_wrong() {
        let folder = tempfile::tempdir().unwrap();
        let (store, shards) = (store_in(folder.path()), shards());
        let mut earlier = KeptDescriptions::new(&store, &Preprocess::default(), &shards);
        earlier.take(&[answer(&shards, 0, true)], true);
        let mut kept = KeptDescriptions::new(&store, &Preprocess::default(), &shards);
        kept.take(&[answer(&shards, 1, true)], true);
        assert_eq!(recalled(&kept), [true, true, false, false]);
        kept.take(&[answer(&shards, 2, true)], false);
        assert_eq!(recalled(&kept), [true, false, false, false], "what an earlier call has kept stays");
        kept.complete([(3, &*zeros(&shards[3]))].into_iter(), false);
        assert_eq!(recalled(&kept), [true, false, false, false]);
    }

    #[test]
    fn a_description_that_makes_no_sense_is_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let (store, shards) = (store_in(folder.path()), shards());
        let mut kept = KeptDescriptions::new(&store, &Preprocess::default(), &shards);
        let no_numbers = vec![0xff; zeros(&shards[1]).len()];
        store.put_local(KIND, kept.key(&shards[0]), &zeros(&shards[0])[4..]);
        store.put_local(KIND, kept.key(&shards[1]), &no_numbers);
        kept.take(&[answer(&shards, 2, true)], true);
        assert_eq!(recalled(&kept), [false, false, true, false]);
        kept.take(&[answer(&shards, 0, true), answer(&shards, 1, true)], true);
        assert_eq!(recalled(&kept), [true, true, true, false]);
    }
}
