//! Descriptions in the coordinator's own store: one that was made once is not asked for again.

use std::sync::Arc;

use cache::Store;
use cluster::scheduler::Provenance;
use descriptor::Preprocess;
use proto::task::Description;
use proto::{Digest, SessionId};

use crate::result_cache::Source;
use crate::result_cache::sourced::Sourced;
use crate::storage;
use crate::tasks::CHECK_DESCRIPTION;

/// What the entries hold.
const KIND: Sourced = Sourced::Descriptions;

/// A description that the store has, and where it comes from.
pub type Recalled = (Source, Arc<[u8]>);

/// The descriptions of some shards: which the store has, and which of the others it keeps as workers send them.
pub struct KeptDescriptions<'a> {
    store: &'a Store,
    preprocess: Preprocess,
    shards: &'a [Description],
    /// The session that asks.
    run: SessionId,
}

impl<'a> KeptDescriptions<'a> {
    /// The places of these shards of clouds that are prepared like this.
    pub fn new(store: &'a Store, preprocess: &Preprocess, shards: &'a [Description], run: SessionId) -> Self {
        Self { store, preprocess: *preprocess, shards, run }
    }

    /// The key of a shard's entry: clouds and descriptor, but not the search space for which the clouds are prepared,
    /// because every descriptor is counted exactly from each.
    fn key(&self, shard: &Description) -> Digest {
        let inputs = [shard.subject.descriptor.bytes(), &shard.manifest.0];
        storage::key(KIND.kind(), &self.preprocess, &inputs)
    }

    /// Of each shard the description that the store has, if it has a sound one.
    pub fn recall(&self) -> Vec<Option<Recalled>> {
        let one = |shard: &Description| {
            let (source, bytes) = KIND.get(self.store, self.key(shard))?;
            match CHECK_DESCRIPTION(&shard.subject, &bytes, shard.clouds) {
                Ok(()) => Some((source, bytes.into())),
                Err(what) => {
                    tracing::warn!("cache: {} {} are made again, got {what}", KIND.kind(), self.key(shard));
                    None
                }
            }
        };
        self.shards.iter().map(one).collect()
    }

    /// Keeps the description of a shard, if it has a provenance: the others are nothing to go on with.
    pub fn keep(&self, place: usize, bytes: &[u8], provenance: Option<Provenance>) {
        if let (Some(shard), Some(provenance)) = (self.shards.get(place), provenance) {
            KIND.put(self.store, self.key(shard), &Source { run: self.run, provenance }, bytes);
        }
    }

    /// Removes the descriptions of all shards, whoever wrote them: one of them is wrong.
    pub fn forget_all(&self) {
        for shard in self.shards {
            self.store.remove_local(KIND.kind(), self.key(shard));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use descriptor::{Descriptor, Family, FixedDescriptor, FixedKind, SearchSpace};

    use super::*;
    use crate::result_cache::source::tests::{principal, source};
    use crate::storage::store_in;
    use crate::tasks;
    use cluster::scheduler::Basis;

    const CLOUDS: u32 = 3;
    const RUN: SessionId = SessionId([7; 16]);

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

    fn kept<'a>(store: &'a Store, shards: &'a [Description]) -> KeptDescriptions<'a> {
        KeptDescriptions::new(store, &Preprocess::default(), shards, RUN)
    }

    fn recalled(kept: &KeptDescriptions<'_>) -> Vec<bool> {
        kept.recall().iter().map(Option::is_some).collect()
    }

    #[test]
    fn keys_differ_with_descriptor_clouds_and_preparation_and_not_with_the_search_space() {
        let folder = tempfile::tempdir().unwrap();
        let store = store_in(folder.path());
        let preprocess = Preprocess::default();
        let kept = KeptDescriptions::new(&store, &preprocess, &[], RUN);
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
        let elsewhere = KeptDescriptions::new(&store, &coarser, &[], RUN).key(&shard(&paper, 0));
        let different: BTreeSet<Digest> = keys.into_iter().chain([elsewhere]).collect();
        assert_eq!(different.len(), keys.len() + 1);

        let whole = SearchSpace::DiskRing(descriptor::GeneTable::paper());
        let subject = tasks::subject(&tasks::preparation(&preprocess, whole), &paper);
        let of_run = Description { subject, ..shard(&paper, 0) };
        assert_ne!(of_run.subject.preparation, shard(&paper, 0).subject.preparation);
        assert_eq!(kept.key(&of_run), keys[0]);
    }

    #[test]
    fn what_has_a_provenance_is_kept_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let (store, shards) = (store_in(folder.path()), shards());
        let kept = kept(&store, &shards);
        let source = source(RUN.0[0], &[principal(1)], Basis::Earned);
        kept.keep(2, &zeros(&shards[2]), Some(source.provenance.clone()));
        kept.keep(1, &zeros(&shards[1]), None);
        kept.keep(4, &zeros(&shards[1]), Some(Provenance::own()));
        assert_eq!(recalled(&kept), [false, false, true, false]);
        assert_eq!(kept.recall()[2], Some((source, zeros(&shards[2]))));
        kept.forget_all();
        assert_eq!(recalled(&kept), [false; 4]);
    }

    #[test]
    fn a_description_that_makes_no_sense_is_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let (store, shards) = (store_in(folder.path()), shards());
        let kept = kept(&store, &shards);
        let own = || Some(Provenance::own());
        kept.keep(0, &zeros(&shards[0])[4..], own());
        kept.keep(1, &vec![0xff; zeros(&shards[1]).len()], own());
        store.put_local(KIND.kind(), kept.key(&shards[3]), &zeros(&shards[3])); // as earlier releases did
        kept.keep(2, &zeros(&shards[2]), own());
        assert_eq!(recalled(&kept), [false, false, true, false]);
        (0..2).for_each(|place| kept.keep(place, &zeros(&shards[place]), own()));
        assert_eq!(recalled(&kept), [true, true, true, false]);
    }
}
