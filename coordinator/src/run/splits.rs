//! The splits of a run as workers see them: manifests by digest, and what the coordinator needs to read answers.

use cache::Store;
use descriptor::{Descriptor, Preprocess};
use proto::Digest;
use proto::task::{Evaluation, GridCell, MatchingRule, Preparation, Subject};

use crate::dataset::{Dataset, SPLITS, Splits};
use crate::result_cache::Memory;
use crate::tasks;
use cluster::blobs::BlobStore;

/// Position of the test split in [`SPLITS`].
const TEST: usize = 3;

/// Which splits are matched with which (DESIGN 5.7).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Matching {
    /// train1 against train2: the fitness.
    Train,
    /// validation against both training sets.
    Validation,
    /// test against all others.
    Test,
}

impl Matching {
    /// Positions in [`SPLITS`] of the queries and of the database's parts.
    fn splits(self) -> (usize, &'static [usize]) {
        match self {
            Self::Train => (0, &[1]),
            Self::Validation => (2, &[0, 1]),
            Self::Test => (TEST, &[0, 1, 2]),
        }
    }

    /// The queries, as indices into the data set's clouds, in the order in which matches are listed.
    pub fn query_clouds(self, dataset: &Dataset) -> &[u32] {
        clouds_of(dataset, self.splits().0)
    }

    /// The database, as indices into the data set's clouds, in the order in which matches number it.
    pub fn database_clouds(self, dataset: &Dataset) -> Vec<u32> {
        self.splits().1.iter().flat_map(|&split| clouds_of(dataset, split)).copied().collect()
    }
}

fn clouds_of(dataset: &Dataset, split: usize) -> &[u32] {
    let Splits { train1, train2, validation, test } = &dataset.splits;
    [train1, train2, validation, test][split]
}

/// The manifests of a data set.
pub struct SplitBlobs<'a> {
    dataset: &'a Dataset,
    manifests: [Digest; SPLITS.len()],
    /// What every task has in common.
    preparation: Preparation,
}

impl<'a> SplitBlobs<'a> {
    /// Makes the manifests and releases everything but the test set, which no worker sees before the search is over.
    pub fn publish(dataset: &'a Dataset, preparation: Preparation, blobs: &BlobStore) -> Self {
        let manifests = std::array::from_fn(|split| {
            let released = split != TEST;
            if released {
                publish(dataset, split, blobs)
            } else {
                Digest::of(&split_manifest(dataset, split))
            }
        });
        Self { dataset, manifests, preparation }
    }

    /// Releases the test set.
    pub fn publish_test(&self, blobs: &BlobStore) {
        publish(self.dataset, TEST, blobs);
    }

    /// Where counts of a matching are remembered.
    pub fn memory<'s>(&self, store: &'s Store, preprocess: &Preprocess, matching: Matching) -> Memory<'s> {
        let (query, database) = self.manifests(matching);
        Memory::new(store, preprocess, [&[query], &database], self.sizes(matching)[0])
    }

    /// The manifest of the queries, and those of the database.
    fn manifests(&self, matching: Matching) -> (Digest, Vec<Digest>) {
        let (query, database) = matching.splits();
        (self.manifests[query], database.iter().map(|&split| self.manifests[split]).collect())
    }

    /// Number of queries, and of clouds in the database.
    fn sizes(&self, matching: Matching) -> [u32; 2] {
        [matching.query_clouds(self.dataset).len(), matching.database_clouds(self.dataset).len()]
            .map(|clouds| clouds as u32)
    }

    /// How clouds are prepared for the tasks of this session.
    pub fn preparation(&self) -> &Preparation {
        &self.preparation
    }

    /// The evaluation on the training sets of the `descriptors` descriptors of a grid cell.
    pub fn grid_cell(&self, subject: Subject, descriptors: u32) -> GridCell {
        let (query, database) = self.manifests(Matching::Train);
        let [queries, database_clouds] = self.sizes(Matching::Train);
        GridCell { subject, query: vec![query], database, queries, database_clouds, descriptors }
    }

    /// The evaluation of one descriptor.
    pub fn evaluation(&self, descriptor: &Descriptor, matching: Matching, want_matches: bool) -> Evaluation {
        let (query, database) = self.manifests(matching);
        let [queries, database_clouds] = self.sizes(matching);
        let subject = tasks::subject(&self.preparation, descriptor);
        Evaluation {
            subject,
            query: vec![query],
            database,
            queries,
            database_clouds,
            want_matches,
            rule: MatchingRule::default(),
            scales: Vec::new(),
        }
    }
}

fn split_manifest(dataset: &Dataset, split: usize) -> Vec<u8> {
    let clouds = clouds_of(dataset, split).iter().map(|&index| &dataset.clouds.entries[index as usize]);
    tasks::split_manifest(SPLITS[split], clouds)
}

fn publish(dataset: &Dataset, split: usize, blobs: &BlobStore) -> Digest {
    for &index in clouds_of(dataset, split) {
        let cloud = &dataset.clouds.entries[index as usize];
        blobs.publish_file(Digest(cloud.digest), dataset.clouds.file(cloud));
    }
    blobs.publish_bytes(split_manifest(dataset, split))
}
