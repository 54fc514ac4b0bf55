//! Descriptors that another program has computed: vectors or distances of the run's clouds, from files.

use std::path::{Component, Path, PathBuf};
use std::str::FromStr;

use descriptor::recognise::Hit;
use descriptor::recogniser::{GivenRecogniser, LearnError, Matrix, Method, Settings, Vote};
use descriptor::{Match, VectorMetric};
use rayon::prelude::*;
use results::{Among, ComparedRow, Foreign, ForeignClouds, ForeignValues, read_foreign};

use super::candidate::{Candidate, Given, check_no_point, label, split_label};
use crate::dataset::Dataset;
use crate::run::Matching;

/// Kind of their rows in the table.
pub const FOREIGN: &str = "foreign";
/// What their clouds are compared by where the file has distances.
pub const GIVEN: &str = "given";

/// A file: `NAME=FILE.parquet`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ForeignSource {
    /// The name that the descriptor has in the comparison.
    pub name: String,
    /// The file.
    pub path: PathBuf,
}

impl FromStr for ForeignSource {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (name, path) = text.split_once('=').ok_or("must be NAME=FILE.parquet")?;
        Ok(Self { name: name.to_owned(), path: path.into() })
    }
}

/// Why a file cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum ForeignFault {
    /// Its content.
    #[error(transparent)]
    File(#[from] results::ForeignError),
    /// A vector that has no distance to others.
    #[error("{path}: values of {cloud}: {what}\nchoose another --foreign-metric, or write other values", path = path.display())]
    Vector {
        /// The file.
        path: PathBuf,
        /// The cloud.
        cloud: String,
        /// What is wrong with it.
        what: &'static str,
    },
    /// A name that it cannot have.
    #[error("--foreign {name}={path}: {what}, got {name:?}\nname it otherwise: --foreign NAME={path}", path = path.display())]
    Name {
        /// The name.
        name: String,
        /// The file.
        path: PathBuf,
        /// What is wrong with the name.
        what: &'static str,
    },
    /// A name that another descriptor has.
    #[error(
        "table comparison: {name} must be one descriptor, got one that is computed here and one from a file\ngive one of them another name, NAME=PATH, or begin the comparison anew with --replace"
    )]
    Clash {
        /// The name.
        name: String,
    },
    /// The table has another file's values, or compares them otherwise.
    #[error(
        "{folder}: table comparison: {name} must be of {then} as before, got {now}\ngive it another name, --foreign NAME=FILE, or begin the comparison anew with --replace",
        folder = folder.display()
    )]
    Other {
        /// The run folder.
        folder: PathBuf,
        /// The descriptor.
        name: String,
        /// What the table has.
        then: String,
        /// What is given.
        now: String,
    },
    /// Nothing can be made of what the file has.
    #[error("--foreign {name}: {what}\n{advice}")]
    Recogniser {
        /// The descriptor.
        name: String,
        /// What is missing.
        what: String,
        /// What to do.
        advice: &'static str,
    },
}

/// A descriptor of the test and database clouds, computed elsewhere.
#[derive(Clone, Debug, PartialEq)]
pub struct ForeignDescriptor {
    /// Its name in the comparison.
    pub name: String,
    /// BLAKE3 of the file.
    pub digest: String,
    values: ForeignValues,
    metric: VectorMetric,
    queries: usize,
    database: usize,
    is_never_negative: bool,
}

impl ForeignDescriptor {
    /// Reads a file; vectors are compared by `metric`.
    ///
    /// # Errors
    /// What is wrong with name or file.
    pub fn read(
        source: &ForeignSource,
        metric: VectorMetric,
        dataset: &Dataset,
    ) -> Result<Self, ForeignFault> {
        let ForeignSource { name, path } = source;
        let wrong = |what| ForeignFault::Name { name: name.clone(), path: path.clone(), what };
        Given::check_name(name).and_then(|()| check_no_point(name)).map_err(wrong)?;
        let queries: Vec<&str> = Matching::Test.queries(dataset).map(|cloud| &*cloud.path).collect();
        let database: Vec<&str> = Matching::Test.database(dataset).map(|cloud| &*cloud.path).collect();
        let root = dataset.clouds.root.as_path();
        let clouds = ForeignClouds {
            queries: &queries,
            database: &database,
            is_known: &|path| is_file_below(root, Path::new(path)),
        };
        let Foreign { digest, values } = read_foreign(path, &clouds)?;
        let is_never_negative = match &values {
            ForeignValues::Vectors { values, .. } => values.iter().all(|value| *value >= 0.0),
            ForeignValues::Distances { .. } => true,
        };
        let found = Self {
            name: name.clone(),
            digest,
            values,
            metric,
            queries: queries.len(),
            database: database.len(),
            is_never_negative,
        };
        if let ForeignValues::Vectors { .. } = &found.values {
            for (index, cloud) in queries.into_iter().chain(database).enumerate() {
                if let Some(what) = metric.fault(found.vector(index)) {
                    return Err(ForeignFault::Vector { path: path.clone(), cloud: cloud.to_owned(), what });
                }
            }
        }
        Ok(found)
    }

    /// The vector of a cloud, queries before database; empty where there are distances only.
    fn vector(&self, cloud: usize) -> &[f64] {
        match &self.values {
            ForeignValues::Vectors { length, values } => &values[cloud * length..][..*length],
            ForeignValues::Distances { .. } => &[],
        }
    }

    /// How many test clouds there are.
    pub fn queries(&self) -> usize {
        self.queries
    }

    /// Values of a cloud, where they are known.
    pub fn size(&self) -> Option<u32> {
        match &self.values {
            ForeignValues::Vectors { length, .. } => u32::try_from(*length).ok(),
            ForeignValues::Distances { .. } => None,
        }
    }

    /// A query's distances to the database.
    pub fn distances(&self, query: usize) -> Vec<f64> {
        match &self.values {
            ForeignValues::Vectors { .. } => {
                let asked = self.vector(query);
                let known = self.queries..self.queries + self.database;
                known.map(|cloud| self.metric.distance(asked, self.vector(cloud))).collect()
            }
            ForeignValues::Distances { to_database, .. } => {
                to_database[query * self.database..][..self.database].to_vec()
            }
        }
    }

    /// What a recogniser learns from the database; `None` by the nearest cloud.
    ///
    /// # Errors
    /// If nothing can be learned from it.
    pub fn learn(
        &self,
        recogniser: Method,
        objects: &[u32],
        sequences: &[Option<u32>],
    ) -> Result<Option<GivenRecogniser>, LearnError> {
        match recogniser {
            Method::Nearest => Ok(None),
            Method::Projection => {
                let known = self.queries..self.queries + self.database;
                let values: Vec<f64> = known.flat_map(|cloud| self.projected(cloud)).collect();
                let columns = values.len() / self.database.max(1);
                GivenRecogniser::projection(&Matrix::new(columns, values), objects, sequences).map(Some)
            }
            Method::KernelRidge => {
                GivenRecogniser::kernel_ridge(|| self.among(), objects, sequences).map(Some)
            }
        }
    }

    /// What a recogniser that has learned makes of a query. Distances are 1 less the score.
    pub fn recognise(&self, recogniser: &GivenRecogniser, query: usize) -> Match {
        let votes = match recogniser.chosen.settings {
            Settings::Projection(_) => recogniser.votes(&self.projected(query)),
            Settings::KernelRidge(_) => recogniser.votes(&self.distances(query)),
        };
        let hit = |vote: Vote| Hit { index: vote.cloud, distance: 1.0 - vote.score };
        // Two objects at least: no other database is learned from.
        Match { nearest: hit(votes[0]), runner_up: votes.get(1).copied().map(hit) }
    }

    /// What projections are learned from. Where the metric is that of histograms and no value is negative, the roots, as of
    /// descriptors that are computed here: they make the deviation of counts the same whatever their size. Where it takes
    /// no notice of lengths, the vector at length 1. Otherwise the values.
    fn projected(&self, cloud: usize) -> Vec<f64> {
        let values = self.vector(cloud);
        let is_histogram = matches!(self.metric, VectorMetric::L1 | VectorMetric::ChiSquared);
        let length = match self.metric {
            VectorMetric::Cosine => values.iter().map(|value| value * value).sum::<f64>().sqrt(),
            _ => 1.0,
        };
        let of =
            |value: &f64| if is_histogram && self.is_never_negative { value.sqrt() } else { value / length };
        values.iter().map(of).collect()
    }

    /// The distances among the clouds of the database.
    fn among(&self) -> Matrix {
        let first = self.queries;
        let values = match &self.values {
            ForeignValues::Distances { among: Among::All(values), .. } => values.clone(),
            _ => {
                let row = |one: usize| {
                    let one = self.vector(first + one);
                    (0..self.database)
                        .map(|other| self.metric.distance(one, self.vector(first + other)))
                        .collect::<Vec<f64>>()
                };
                let rows: Vec<Vec<f64>> = (0..self.database).into_par_iter().map(row).collect();
                rows.concat()
            }
        };
        Matrix::new(self.database, values)
    }

    /// What clouds are compared by, as the table has it.
    pub fn distance(&self) -> &'static str {
        match &self.values {
            ForeignValues::Vectors { .. } => self.metric.name(),
            ForeignValues::Distances { .. } => GIVEN,
        }
    }

    /// What the file has, as the table has it.
    pub fn parameters(&self) -> String {
        let file = described(&self.digest);
        match &self.values {
            ForeignValues::Vectors { length, .. } => format!("{length} values a cloud from {file}"),
            ForeignValues::Distances { .. } => format!("distances from {file}"),
        }
    }

    /// Why a recogniser cannot learn from what the file has, and what to do; `None` if it can.
    fn hindrance(&self, recogniser: Method) -> Option<(String, &'static str)> {
        let ForeignValues::Distances { among, .. } = &self.values else { return None };
        let advice = "write these distances, too, or vectors (columns cloud and values)";
        match (recogniser, among) {
            (Method::Nearest, _) | (Method::KernelRidge, Among::All(_)) => None,
            (Method::Projection, _) => {
                let what = "projection needs vectors, got distances";
                Some((what.to_owned(), "write vectors (columns cloud and values)"))
            }
            (Method::KernelRidge, Among::Nothing) => {
                let what = "kernel-ridge needs the distances among the clouds of the database, got none";
                Some((what.to_owned(), advice))
            }
            (Method::KernelRidge, Among::Some { missing, first: [one, other] }) => {
                let what = format!(
                    "kernel-ridge needs the distances among the clouds of the database, got none for {one} and {other}, the \
                     first of {missing} pairs"
                );
                Some((what, advice))
            }
        }
    }

    /// The candidates of these recognisers; of those that cannot learn from the file `say` is told why.
    ///
    /// # Errors
    /// If that is all of them.
    pub fn candidates(
        &self,
        recognisers: &[Method],
        say: impl Fn(&str),
    ) -> Result<Vec<ForeignCandidate<'_>>, ForeignFault> {
        let mut candidates = Vec::new();
        let mut hindered = None;
        for &recogniser in recognisers {
            match self.hindrance(recogniser) {
                None => {
                    let label = label(&self.name, recogniser);
                    candidates.push(ForeignCandidate { label, recogniser, descriptor: self });
                }
                Some((what, advice)) => {
                    say(&format!("{}: left out: {what}", label(&self.name, recogniser)));
                    hindered = Some((what, advice));
                }
            }
        }
        match hindered {
            Some((what, advice)) if candidates.is_empty() => {
                Err(ForeignFault::Recogniser { name: self.name.clone(), what, advice })
            }
            _ => Ok(candidates),
        }
    }
}

fn described(digest: &str) -> String {
    format!("the file {}", digest.get(..12).unwrap_or(digest))
}

/// Whether it names a file below a folder, and not by way of others.
fn is_file_below(root: &Path, path: &Path) -> bool {
    path.components().all(|part| matches!(part, Component::Normal(_))) && root.join(path).is_file()
}

/// A descriptor from a file under one recogniser.
#[derive(Clone, Debug, PartialEq)]
pub struct ForeignCandidate<'a> {
    /// Unique; can be a file's name.
    pub label: String,
    /// How clouds are named.
    pub recogniser: Method,
    /// The descriptor.
    pub descriptor: &'a ForeignDescriptor,
}

/// What takes part of files: those that are given now, and what an earlier comparison found of others.
#[derive(Clone, Debug, PartialEq)]
pub enum ForeignEntry<'a> {
    /// Given now.
    Given(ForeignCandidate<'a>),
    /// As the table has it.
    Kept(&'a ComparedRow),
}

impl ForeignEntry<'_> {
    /// Its label.
    pub fn label(&self) -> &str {
        match self {
            Self::Given(candidate) => &candidate.label,
            Self::Kept(row) => &row.descriptor,
        }
    }
}

/// Descriptors that are given now, and rows of the table in this folder, in the order of their labels; `others` are
/// computed here.
///
/// # Errors
/// If one name stands for two descriptors.
pub fn entries<'a>(
    folder: &Path,
    there: &'a [ComparedRow],
    given: &[ForeignCandidate<'a>],
    others: &[Candidate],
) -> Result<Vec<ForeignEntry<'a>>, ForeignFault> {
    let name = |row: &'a ComparedRow| split_label(&row.descriptor).0;
    let names = there.iter().map(name).chain(given.iter().map(|one| one.descriptor.name.as_str()));
    for name in names {
        if others.iter().any(|other| other.name == name) {
            return Err(ForeignFault::Clash { name: name.to_owned() });
        }
    }
    let said = |digest: &str, distance: &str| format!("{} by {distance}", described(digest));
    for ForeignCandidate { descriptor, .. } in given {
        let now = said(&descriptor.digest, descriptor.distance());
        let mut of_name = there.iter().filter(|row| name(row) == descriptor.name);
        let other = of_name.find_map(|row| {
            let digest = row.file_digest.as_deref().unwrap_or_default();
            let is_same = digest == descriptor.digest && row.distance == descriptor.distance();
            (!is_same).then(|| said(digest, &row.distance))
        });
        let mut of_call = given.iter().map(|other| other.descriptor);
        let twice = of_call.find(|other| other.name == descriptor.name && other.digest != descriptor.digest);
        let twice = twice.map(|other| said(&other.digest, other.distance()));
        if let Some(then) = other.or(twice) {
            let (folder, name) = (folder.to_owned(), descriptor.name.clone());
            return Err(ForeignFault::Other { folder, name, then, now });
        }
    }
    let kept = there.iter().filter(|row| given.iter().all(|one| one.label != row.descriptor));
    let mut entries: Vec<ForeignEntry<'a>> = given.iter().cloned().map(ForeignEntry::Given).collect();
    entries.extend(kept.map(ForeignEntry::Kept));
    entries.sort_by(|a, b| a.label().cmp(b.label()));
    entries.dedup_by(|a, b| a.label() == b.label());
    Ok(entries)
}
