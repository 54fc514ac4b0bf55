//! The splits of a run as workers see them: manifests by digest, and what the coordinator needs to read answers.

use cache::Store;
use descriptor::{Descriptor, Preprocess, SearchSpace};
use proto::Digest;
use proto::task::{Evaluation, GridCell, MatchingRule, Preparation, Scale, Subject};

use crate::dataset::{Dataset, SPLITS};
use crate::fitness::{Fitness, Part};
use crate::result_cache::Memory;
use crate::run::matching::{Matching, TEST, TRAIN1, TRAIN2};
use crate::run::scaled::Scaled;
use crate::tasks;
use cluster::blobs::BlobStore;

/// The manifests of a data set.
pub struct SplitBlobs<'a> {
    dataset: &'a Dataset,
    manifests: [Digest; SPLITS.len()],
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
        let manifests = [Digest([0; 32]); SPLITS.len()];
        let mut splits = Self { dataset, manifests, preparation, with_sequences };
        for split in 0..SPLITS.len() {
            let is_released = split != TEST;
            splits.manifests[split] = if is_released {
                splits.publish_split(split, blobs)
            } else {
                Digest::of(&splits.manifest(split))
            };
        }
        splits
    }

    /// Releases the test set.
    pub fn publish_test(&self, blobs: &BlobStore) {
        self.publish_split(TEST, blobs);
    }

    fn publish_split(&self, split: usize, blobs: &BlobStore) -> Digest {
        for &index in self.dataset.splits.all()[split] {
            let cloud = &self.dataset.clouds.entries[index as usize];
            blobs.publish_file(Digest(cloud.digest), self.dataset.clouds.file(cloud));
        }
        blobs.publish_bytes(self.manifest(split))
    }

    fn manifest(&self, split: usize) -> Vec<u8> {
        let entries = &self.dataset.clouds.entries;
        let clouds = self.dataset.splits.all()[split].iter().map(|&index| &entries[index as usize]);
        tasks::split_manifest(SPLITS[split], clouds, self.with_sequences)
    }

    /// Where counts of a matching are remembered.
    pub fn memory<'s>(&self, store: &'s Store, preprocess: &Preprocess, matching: Matching) -> Memory<'s> {
        let (query, database) = matching.splits();
        let [queries, _] = self.sizes(query, database);
        Memory::new(store, preprocess, [&self.digests(query), &self.digests(database)], queries)
    }

    /// The manifests of splits.
    fn digests(&self, splits: &[usize]) -> Vec<Digest> {
        splits.iter().map(|&split| self.manifests[split]).collect()
    }

    /// Number of queries, and of clouds in the database.
    fn sizes(&self, query: &[usize], database: &[usize]) -> [u32; 2] {
        let clouds = |split: &usize| self.dataset.splits.all()[*split].len() as u32;
        [query, database].map(|splits| splits.iter().map(clouds).sum())
    }

    /// The data set.
    pub fn dataset(&self) -> &Dataset {
        self.dataset
    }

    /// How clouds are prepared for the tasks of this session.
    pub fn preparation(&self) -> &Preparation {
        &self.preparation
    }

    /// The evaluation on the training sets of the `descriptors` descriptors of a grid cell.
    pub fn grid_cell(&self, subject: Subject, descriptors: u32) -> GridCell {
        let (query, database) = Matching::Train.splits();
        let [queries, database_clouds] = self.sizes(query, database);
        let [query, database] = [&query[..], database].map(|splits| self.digests(splits));
        GridCell { subject, query, database, queries, database_clouds, descriptors }
    }

    /// The evaluation of one descriptor on the clouds of a matching, plainly: each query among the whole database.
    pub fn evaluation(&self, descriptor: &Scaled<'_>, matching: Matching, want_matches: bool) -> Evaluation {
        let (query, database) = matching.splits();
        let part = Part { query, database, rule: MatchingRule::default(), weight: 1 };
        Evaluation { want_matches, ..self.part(descriptor, &part) }
    }

    /// The same of a descriptor without scales that a search space need not hold, with its matches.
    pub fn evaluation_beside(
        &self,
        descriptor: &Descriptor,
        (preprocess, space): (&Preprocess, &SearchSpace),
        matching: Matching,
    ) -> Evaluation {
        let subject = tasks::subject_beside(preprocess, space, descriptor);
        Evaluation { subject, ..self.evaluation(&Scaled::from(descriptor), matching, true) }
    }

    /// The evaluations that the fitness of a descriptor is the weighted sum of, with their weights.
    pub fn measure(
        &self,
        fitness: &Fitness,
        descriptor: &Scaled<'_>,
        matching: Matching,
    ) -> Vec<(Evaluation, u32)> {
        let parts = fitness.parts(matching);
        parts.iter().map(|part| (self.part(descriptor, part), part.weight)).collect()
    }

    /// What the distances of one channel are scaled by: over all training clouds.
    pub fn scale(&self, channel: &Descriptor) -> Scale {
        let splits = [TRAIN1, TRAIN2];
        let [clouds, _] = self.sizes(&splits, &[]);
        Scale { subject: tasks::subject(&self.preparation, channel), splits: self.digests(&splits), clouds }
    }

    fn part(&self, Scaled { descriptor, scales }: &Scaled<'_>, part: &Part) -> Evaluation {
        let [queries, database_clouds] = self.sizes(part.query, part.database);
        Evaluation {
            subject: tasks::subject(&self.preparation, descriptor),
            query: self.digests(part.query),
            database: self.digests(part.database),
            queries,
            database_clouds,
            want_matches: false,
            rule: part.rule,
            scales: scales.clone(),
        }
    }
}
