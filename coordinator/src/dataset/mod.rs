//! A data set: labelled clouds in splits, each read once and known to be usable.
//!
//! Clouds are read one a thread and not kept: what a run needs of them later, it reads again by path.

mod check;
mod error;
mod file;
mod findings;
mod found;
mod images;
mod inspect;
mod labelled;
mod layout;
mod leak;
mod load;
mod manifest;
mod named;
mod pattern;
mod protocol;
pub mod record;
mod root;
mod scenes;
mod settings;
mod split;
mod text_columns;

#[cfg(test)]
mod tests;

use std::fmt;
use std::path::{Path, PathBuf};

use cache::Store;
use descriptor::{Preprocess, Skip};

pub use error::{DatasetError, Place};
pub(crate) use file::{MAX_FILE_BYTES, read_file};
pub(crate) use images::{cloud_bytes, reads_camera};
pub(crate) use inspect::SPACING_CLOUDS;
pub use leak::{Leak, Recognised, Verdict};
pub use named::NamedCloud;
pub use pattern::{Pattern, PatternError};
pub use protocol::{Fold, Folds, Protocol};
use record::CloudRecord;
pub use settings::{DatasetSettings, Layout, SeededSplit, SplitRule, SyntheticSettings};

use check::{check_overlap, unrecognisable_warning};
use layout::Labels;
use load::{Loaded, Numbers, load};
use root::Root;
pub(crate) use scenes::reads_objects;
pub(crate) use text_columns::reads_texts;

/// Names of the splits in TOML, manifests, messages and results, in the order in which they enter the data digest.
pub const SPLITS: [&str; 4] = ["train1", "train2", "validation", "test"];

/// One usable cloud.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CloudEntry {
    /// Relative to the data root, with `/`.
    pub path: String,
    /// Index into the categories.
    pub category: u32,
    /// Index into the instances.
    pub instance: u32,
    /// Index into the sequences; `None` if the layout knows none of it.
    pub sequence: Option<u32>,
    /// Index into the sets; 0 where there are none.
    pub set: u32,
    /// BLAKE3 of the file's bytes.
    pub digest: [u8; 32],
    /// Size of the file, bytes.
    pub bytes: u64,
}

/// One object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instance {
    /// Its name, the same in no other category.
    pub name: String,
    /// Index into the categories.
    pub category: u32,
}

/// A listed cloud that takes no part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkippedCloud {
    /// Relative to the data root, with `/`.
    pub path: String,
    /// The split that lists it.
    pub split: &'static str,
    /// Why.
    pub reason: SkipReason,
}

/// Why a listed cloud takes no part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SkipReason {
    /// It has too few points or no keypoint with a normal (DESIGN 5.1).
    Unusable(Skip),
    /// It cannot be read, and `skip_unreadable` is set.
    Unreadable(String),
}

impl fmt::Display for SkipReason {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unusable(skip) => skip.fmt(formatter),
            Self::Unreadable(reason) => write!(formatter, "unreadable: {reason}"),
        }
    }
}

/// The clouds that take part, what they are, and what is to be said about them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Clouds {
    /// Folder that every path is relative to, without symbolic links.
    pub root: PathBuf,
    /// The usable clouds, split after split, each in the order of its list.
    pub entries: Vec<CloudEntry>,
    /// Names of the categories of all listed clouds, sorted.
    pub categories: Vec<String>,
    /// The instances of all listed clouds, sorted by category and name.
    pub instances: Vec<Instance>,
    /// Names of the sequences of all listed clouds: first numbers, by value, then other names, sorted. Clouds of two
    /// objects are of one sequence if its name is the same.
    pub sequences: Vec<String>,
    /// Names of the sets of all listed clouds, sorted; none if the clouds are of one.
    pub sets: Vec<String>,
    /// Listed clouds that take no part, split after split.
    pub skipped: Vec<SkippedCloud>,
    /// What does not stop a run but makes its result doubtful; the last line of each says what to do.
    pub warnings: Vec<String>,
    /// The data digest: BLAKE3 over, for each listed cloud in order, split, category, instance and the digest of
    /// the file's bytes (its path if they cannot be read). Clouds skipped for what they hold are part of it.
    pub digest: [u8; 32],
    /// What the digest is of: every listed cloud, split after split.
    pub listed: Vec<CloudRecord>,
}

impl Clouds {
    /// How many sets there are, whose clouds are compared with those of their own only: 1 where none is named.
    pub fn set_count(&self) -> u32 {
        self.sets.len().max(1) as u32
    }

    /// Those of these indices whose clouds are of a set.
    pub fn of_set<'a>(&'a self, indices: &'a [u32], set: u32) -> impl Iterator<Item = u32> + 'a {
        indices.iter().copied().filter(move |&index| self.entries[index as usize].set == set)
    }

    /// Where the file of a cloud is.
    pub fn file(&self, cloud: &CloudEntry) -> PathBuf {
        self.root.join(&cloud.path)
    }
}

/// Indices of the usable clouds of each split, in the order of its list.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Splits {
    /// Queries of the fitness.
    pub train1: Vec<u32>,
    /// Database of the fitness.
    pub train2: Vec<u32>,
    /// Queries against train1 and train2.
    pub validation: Vec<u32>,
    /// Queries of the final test, against the other three.
    pub test: Vec<u32>,
}

impl Splits {
    /// The four, in the order of [`SPLITS`].
    pub fn all(&self) -> [&[u32]; 4] {
        [&self.train1, &self.train2, &self.validation, &self.test]
    }

    /// Clouds that searches learn from: those of both training sets, the first of every database.
    pub fn trained(&self) -> usize {
        self.train1.len() + self.train2.len()
    }
}

/// Usable clouds whose sequence is not known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SequencesMissing {
    /// How many.
    pub count: usize,
    /// Path of the first.
    pub first: String,
}

/// The clouds of an experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct Dataset {
    /// Clouds, labels, what is skipped.
    pub clouds: Clouds,
    /// Which cloud is in which split.
    pub splits: Splits,
    /// What positions give away, if it is wanted.
    pub leak: Option<Leak>,
}

/// Which splits are loaded; the others are taken for empty, and nothing of them is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// All of them.
    All,
    /// All of them, and what positions give away.
    AllAndLeak,
    /// Both training sets.
    Training,
}

impl Wanted {
    /// How many of [`SPLITS`], from the first.
    fn count(self) -> usize {
        match self {
            Self::All | Self::AllAndLeak => SPLITS.len(),
            Self::Training => 2,
        }
    }

    /// The same for the splits whose clouds' positions are measured: nothing is learned of the test before it.
    fn positioned(self) -> usize {
        match self {
            Self::AllAndLeak => 3,
            Self::All | Self::Training => 0,
        }
    }
}

impl Dataset {
    /// Lists the clouds, reads every one of them once, and decides which take part. What `store` knows of files with
    /// the same bytes is not found out again; the result is the same without it.
    ///
    /// # Errors
    /// [`DatasetError`], before any evaluation is spent. Of the splits that are wanted only validation may be empty, if
    /// it is given no list, row or share, and test, if a seeded rule gives it no share.
    pub fn load(
        settings: &DatasetSettings,
        preprocess: &Preprocess,
        wanted: Wanted,
        store: Option<&Store>,
    ) -> Result<Self, DatasetError> {
        let root = Root::open(&settings.root)?;
        let mut ignored = Vec::new();
        let lists = split::split(settings, &root, wanted, &mut ignored)?;
        let Loaded { mut clouds, indices, positions } =
            load(&root, &lists, wanted.positioned(), preprocess, settings.skip_unreadable, store)?;
        for (split, name) in SPLITS.into_iter().enumerate().take(wanted.count()) {
            if indices[split].is_empty() && !lists[split].is_empty() {
                return Err(DatasetError::all_skipped(name, lists[split].len(), &clouds));
            }
        }
        if let Some(first) = ignored.first() {
            clouds.warnings.push(format!(
                "dataset.layout: only clouds named <instance>_<video>_<frame>.pcd, .ply or _crop.png expected, got {} others, \
                 such as {first}\nthey are not used: rename them or set dataset.layout = \"folders\"",
                ignored.len()
            ));
        }
        let [train1, train2, validation, test] = indices;
        let splits = Splits { train1, train2, validation, test };
        let mut dataset = Self { clouds, splits, leak: None };
        if wanted == Wanted::AllAndLeak {
            dataset.leak = Some(Leak::measure(&dataset, &positions));
        }
        Ok(dataset)
    }

    /// A warning if queries that are all counted are of objects that the database has no cloud of in their set;
    /// splits are given by their positions in [`SPLITS`].
    pub fn unrecognisable(&self, query: usize, database: &[usize]) -> Option<String> {
        unrecognisable_warning(&self.clouds, self.splits.all(), query, database)
    }

    /// Only the clouds of one set, in the splits that they are in.
    pub fn of_set(&self, set: u32) -> Self {
        let Splits { train1, train2, validation, test } = &self.splits;
        let [train1, train2, validation, test] =
            [train1, train2, validation, test].map(|split| self.clouds.of_set(split, set).collect());
        let mut clouds = self.clouds.clone();
        clouds.sets.clear();
        clouds.entries.iter_mut().for_each(|cloud| cloud.set = 0);
        Self { clouds, splits: Splits { train1, train2, validation, test }, leak: None }
    }

    /// The usable clouds of some splits, given by their positions in [`SPLITS`], whose sequence is not known; `None` if
    /// every one has a sequence.
    pub fn sequences_missing(&self, splits: &[usize]) -> Option<SequencesMissing> {
        let all = self.splits.all();
        let clouds =
            splits.iter().flat_map(|&split| all[split]).map(|&index| &self.clouds.entries[index as usize]);
        let mut missing = clouds.filter(|cloud| cloud.sequence.is_none());
        let first = missing.next()?.path.clone();
        Some(SequencesMissing { count: 1 + missing.count(), first })
    }
}

/// A cloud that is there and has labels, but is not yet read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListedCloud {
    /// Relative to the data root, with `/`.
    pub path: String,
    /// Where it is.
    pub file: PathBuf,
    /// Index into the categories.
    pub category: u32,
    /// Index into the instances.
    pub instance: u32,
}

/// Queries and a database without an experiment, not yet read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listing {
    /// The queries, list after list, then the database, list after list.
    pub clouds: Vec<ListedCloud>,
    /// How many of them are queries.
    pub queries: usize,
    /// Names of the categories, sorted.
    pub categories: Vec<String>,
    /// The instances, sorted by category and name.
    pub instances: Vec<Instance>,
}

impl Listing {
    /// Reads lists of queries and lists of database clouds, each taken one after the other.
    ///
    /// # Errors
    /// [`DatasetError`]: as for an experiment, a cloud that is on both sides is refused.
    pub fn load(
        root: &Path,
        layout: &Layout,
        query: &[PathBuf],
        database: &[PathBuf],
    ) -> Result<Self, DatasetError> {
        const SIDES: [&str; 2] = ["query", "database"];
        let root = Root::open(root)?;
        let labels = Labels::read(layout, &root).map_err(|error| error.of_option("manifest"))?;
        let mut lists = [Vec::new(), Vec::new()];
        for ((listed, files), side) in lists.iter_mut().zip([query, database]).zip(SIDES) {
            for file in files {
                listed.extend(labels.list(file, &root).map_err(|error| error.of_option(side))?);
            }
        }
        for (side, listed) in SIDES.into_iter().zip(&lists) {
            if listed.is_empty() {
                return Err(DatasetError::no_cloud(side));
            }
        }
        check_overlap(&SIDES, &lists)?;
        let numbers = Numbers::of(lists.iter().flatten())?;
        let clouds = lists.iter().flatten().map(|cloud| {
            let (category, instance) = numbers.get(cloud);
            let (path, file) = (cloud.located.path.clone(), root.path().join(&cloud.located.path));
            ListedCloud { path, file, category, instance }
        });
        Ok(Self {
            clouds: clouds.collect(),
            queries: lists[0].len(),
            categories: numbers.categories(),
            instances: numbers.instances(),
        })
    }
}
