//! The splits of a run as workers see them: for each set of clouds manifests by digest, so that a query is compared with
//! clouds of its own set only.

use std::ops::Range;

use cache::Store;
use descriptor::{Descriptor, Preprocess, SearchSpace};
use proto::Digest;
use proto::task::{Evaluation, GridCell, MatchingRule, Preparation, Scale, Subject};

use crate::dataset::{CloudEntry, Dataset, SPLITS, cloud_bytes};
use crate::fitness::{Fitness, Part};
use crate::result_cache::CountCache;
use crate::run::matching::{Matching, TEST, TRAIN1, TRAIN2};
use crate::run::scaled::{ChannelScale, Scaled};
use crate::tasks;
use cluster::AwaitingScales;
use cluster::blobs::BlobStore;

/// The set of clouds that are of one only.
pub const ONLY_SET: u32 = 0;

/// The manifests of a data set.
#[derive(Clone)]
pub struct SplitBlobs<'a> {
    dataset: &'a Dataset,
    /// Of each set.
    manifests: Vec<[Digest; SPLITS.len()]>,
    /// Clouds of each set.
    sizes: Vec<[u32; SPLITS.len()]>,
    /// What every task has in common.
    preparation: Preparation,
    /// Whether manifests say sequences.
    with_sequences: bool,
}

impl<'a> SplitBlobs<'a> {
    /// Makes the manifests and releases everything but the test set, which no worker sees before the search is over.
    ///
    /// Manifests are to say sequences only where a fitness looks at them: their digests name clouds in what is kept
    /// from run to run.
    pub fn publish(
        dataset: &'a Dataset,
        preparation: Preparation,
        with_sequences: bool,
        blobs: &BlobStore,
    ) -> Self {
        let (manifests, sizes) = (Vec::new(), Vec::new());
        let mut splits = Self { dataset, manifests, sizes, preparation, with_sequences };
        let publish = |set| {
            std::array::from_fn(|split| match split {
                TEST => Digest::of(&splits.manifest(set, split)),
                _ => splits.publish_split(set, split, blobs),
            })
        };
        let manifests = splits.sets().map(publish).collect();
        let size = |set| std::array::from_fn(|split| splits.clouds(set, split).count() as u32);
        let sizes = splits.sets().map(size).collect();
        (splits.manifests, splits.sizes) = (manifests, sizes);
        splits
    }

    /// Releases the test clouds.
    pub fn publish_test(&self, blobs: &BlobStore) {
        for set in self.sets() {
            self.publish_split(set, TEST, blobs);
        }
    }

    fn publish_split(&self, set: u32, split: usize, blobs: &BlobStore) -> Digest {
        for cloud in self.clouds(set, split) {
            blobs.publish_cloud(Digest(cloud.digest), self.dataset.clouds.file(cloud), cloud_bytes);
        }
        blobs.publish_bytes(self.manifest(set, split))
    }

    fn manifest(&self, set: u32, split: usize) -> Vec<u8> {
        tasks::split_manifest(SPLITS[split], self.clouds(set, split), self.with_sequences)
    }

    fn clouds(&self, set: u32, split: usize) -> impl Iterator<Item = &'a CloudEntry> {
        let Dataset { clouds, splits, .. } = self.dataset;
        clouds.of_set(splits.all()[split], set).map(|index| &clouds.entries[index as usize])
    }

    /// All sets by number.
    pub fn sets(&self) -> Range<u32> {
        0..self.dataset.clouds.set_count()
    }

    /// Where counts of a matching are remembered, of clouds that are of one set.
    pub fn count_cache<'s>(
        &self,
        store: &'s Store,
        preprocess: &Preprocess,
        matching: Matching,
    ) -> CountCache<'s> {
        let (query, database) = matching.splits();
        let [queries, _] = self.sizes(ONLY_SET, query, database);
        let digests = [&query[..], database].map(|splits| self.digests(ONLY_SET, splits));
        CountCache::new(store, preprocess, digests.each_ref().map(Vec::as_slice), queries)
    }

    /// The manifests of a set's splits.
    fn digests(&self, set: u32, splits: &[usize]) -> Vec<Digest> {
        splits.iter().map(|&split| self.manifests[set as usize][split]).collect()
    }

    /// Number of a set's queries, and of clouds in its database.
    fn sizes(&self, set: u32, query: &[usize], database: &[usize]) -> [u32; 2] {
        let sizes = &self.sizes[set as usize];
        [query, database].map(|splits| splits.iter().map(|&split| sizes[split]).sum())
    }

    /// The data set.
    pub fn dataset(&self) -> &Dataset {
        self.dataset
    }

    /// How clouds are prepared for the tasks of this session.
    pub fn preparation(&self) -> &Preparation {
        &self.preparation
    }

    /// The evaluation on the training clouds of the `descriptors` descriptors of a grid cell, of clouds of one set.
    pub fn grid_cell(&self, subject: Subject, descriptors: u32) -> GridCell {
        let (query, database) = Matching::Train.splits();
        let [queries, database_clouds] = self.sizes(ONLY_SET, query, database);
        let [query, database] = [&query[..], database].map(|splits| self.digests(ONLY_SET, splits));
        GridCell { subject, query, database, queries, database_clouds, descriptors }
    }

    /// The evaluation of one descriptor, whose scales are known, on a set's clouds of a matching, plainly: each query among
    /// the whole database.
    pub fn evaluation(
        &self,
        set: u32,
        descriptor: &Scaled<'_>,
        matching: Matching,
        want_matches: bool,
    ) -> Evaluation {
        let (query, database) = matching.splits();
        let part = Part { query, database, rule: MatchingRule::default(), weight: 1 };
        let AwaitingScales { evaluation, .. } = self.part(set, descriptor, &part);
        Evaluation { want_matches, ..evaluation }
    }

    /// The same clouds for tasks of a descriptor that the search space need not hold.
    pub fn beside(&self, descriptor: &Descriptor, (preprocess, space): (&Preprocess, &SearchSpace)) -> Self {
        Self { preparation: tasks::preparation_beside(preprocess, space, descriptor), ..self.clone() }
    }

    /// The sets with clouds to be recognised.
    pub fn sets_with_queries(&self, matching: Matching) -> impl Iterator<Item = u32> {
        let [query] = *matching.splits().0;
        self.sets().filter(move |&set| self.sizes[set as usize][query] > 0)
    }

    /// The evaluations that the fitness of a descriptor is the weighted sum of, with their weights. `weights`: of each
    /// set; those of weight 0 are left out. `scaled`: the descriptor with its scales in a set.
    pub fn measure<'d>(
        &self,
        (fitness, weights): (&Fitness, &[u32]),
        scaled: impl Fn(u32) -> Scaled<'d>,
        matching: Matching,
    ) -> Vec<(AwaitingScales, u32)> {
        let parts = fitness.parts(matching);
        let of_set = |set: u32| {
            let (scaled, weight) = (scaled(set), weights[set as usize]);
            let part = move |part: &Part| (self.part(set, &scaled, part), weight * part.weight);
            parts.iter().map(part).collect::<Vec<_>>()
        };
        let sets = self.sets_with_queries(matching).filter(|&set| weights[set as usize] > 0);
        sets.flat_map(of_set).collect()
    }

    /// What the distances of one channel are scaled by in a set: over all its training clouds.
    pub fn scale(&self, set: u32, channel: &Descriptor) -> Scale {
        let splits = [TRAIN1, TRAIN2];
        let [clouds, _] = self.sizes(set, &splits, &[]);
        let subject = tasks::subject(&self.preparation, channel);
        Scale { subject, splits: self.digests(set, &splits), clouds, described: Vec::new() }
    }

    fn part(&self, set: u32, Scaled { descriptor, scales }: &Scaled<'_>, part: &Part) -> AwaitingScales {
        let [queries, database_clouds] = self.sizes(set, part.query, part.database);
        let [query, database] = [part.query, part.database].map(|splits| self.digests(set, splits));
        let mut evaluation = Evaluation {
            subject: tasks::subject(&self.preparation, descriptor),
            described: Vec::new(),
            query,
            database,
            queries,
            database_clouds,
            want_matches: false,
            rule: part.rule,
            scales: vec![1.0; scales.len()],
        };
        let mut awaited = Vec::new();
        for (place, scale) in (0..).zip(scales) {
            match scale {
                ChannelScale::One => {}
                ChannelScale::Found(found) => found.scale(place, &mut evaluation),
                ChannelScale::Awaited(index) => awaited.push((place, *index)),
            }
        }
        AwaitingScales { evaluation, awaited }
    }
}
