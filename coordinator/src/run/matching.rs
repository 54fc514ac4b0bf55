//! Which splits are matched with which.

use crate::dataset::{CloudEntry, Dataset};

/// Positions in [`SPLITS`](crate::dataset::SPLITS).
pub const TRAIN1: usize = 0;
/// As [`TRAIN1`].
pub const TRAIN2: usize = 1;
/// As [`TRAIN1`].
pub const VALIDATION: usize = 2;
/// As [`TRAIN1`].
pub const TEST: usize = 3;

/// Which splits are matched with which (DESIGN 5.7).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Matching {
    /// The fitness: train1 against train2, or both against both, as its protocol says.
    Train,
    /// Validation against both training sets.
    Validation,
    /// Test against all others.
    Test,
}

impl Matching {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Train, Self::Validation, Self::Test];

    /// Positions in [`SPLITS`](crate::dataset::SPLITS) of the queries' split and of the database's.
    pub fn splits(self) -> (&'static [usize; 1], &'static [usize]) {
        match self {
            Self::Train => (&[TRAIN1], &[TRAIN2]),
            Self::Validation => (&[VALIDATION], &[TRAIN1, TRAIN2]),
            Self::Test => (&[TEST], &[TRAIN1, TRAIN2, VALIDATION]),
        }
    }

    /// The queries, as indices into the data set's clouds, in the order in which matches are listed.
    pub fn query_clouds(self, dataset: &Dataset) -> &[u32] {
        dataset.splits.all()[self.splits().0[0]]
    }

    /// The queries, in that order.
    pub fn queries(self, dataset: &Dataset) -> impl Iterator<Item = &CloudEntry> {
        self.query_clouds(dataset).iter().map(|&cloud| &dataset.clouds.entries[cloud as usize])
    }

    /// The clouds of the database, in the order in which matches number them.
    pub fn database(self, dataset: &Dataset) -> impl Iterator<Item = &CloudEntry> {
        self.database_clouds(dataset).into_iter().map(|cloud| &dataset.clouds.entries[cloud as usize])
    }

    /// The database, as indices into the data set's clouds, in the order in which matches number it.
    pub fn database_clouds(self, dataset: &Dataset) -> Vec<u32> {
        self.splits().1.iter().flat_map(|&split| dataset.splits.all()[split]).copied().collect()
    }
}
