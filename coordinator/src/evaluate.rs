//! One descriptor on given lists, in this process, with the time that each stage takes.

use std::ops::AddAssign;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use descriptor::prepare::{Normals, keypoints};
use descriptor::{
    Binning, Correct, GeneTable, Label, Match, Parameters, PrepareError, PreparedCloud, Preprocess,
    Quantiser, Summary, pcd, recognise,
};
use rayon::prelude::*;

use crate::dataset::{DatasetError, Layout, Listing, read_file};

/// What to evaluate.
#[derive(Clone, Debug)]
pub struct Request {
    /// Data root.
    pub root: PathBuf,
    /// How labels are found.
    pub layout: Layout,
    /// Lists of queries.
    pub query: Vec<PathBuf>,
    /// Lists of database clouds.
    pub database: Vec<PathBuf>,
    /// Keypoints and normals.
    pub preprocess: Preprocess,
    /// The descriptor.
    pub parameters: Parameters,
    /// Threads; stages are timed on each of them and added up.
    pub threads: usize,
}

/// Time of each stage, added up over clouds and threads; `total` is wall time from the first list to the last match.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seconds {
    /// Reading and decoding files.
    pub read: Duration,
    /// Keypoints.
    pub keypoints: Duration,
    /// Normals of clouds and keypoints.
    pub normals: Duration,
    /// Neighbours, histograms and their summaries.
    pub describe: Duration,
    /// Distances and nearest clouds.
    pub matching: Duration,
    /// Wall time of everything.
    pub total: Duration,
}

impl AddAssign for Seconds {
    fn add_assign(&mut self, other: Self) {
        self.read += other.read;
        self.keypoints += other.keypoints;
        self.normals += other.normals;
        self.describe += other.describe;
        self.matching += other.matching;
        self.total += other.total;
    }
}

/// What an evaluation gives.
#[derive(Clone, Debug)]
pub struct Report {
    /// Counts of recognised queries.
    pub correct: Correct,
    /// Clouds in the database.
    pub database: usize,
    /// Skipped clouds: path and reason.
    pub skipped: Vec<(String, String)>,
    /// Keypoints with a normal, over all clouds.
    pub keypoints: usize,
    /// Time per stage.
    pub seconds: Seconds,
    /// One a query: its path, the nearest cloud's path, and the match.
    pub matches: Vec<(String, String, Match)>,
}

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// The lists.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A cloud.
    #[error("{path}: {what}")]
    Cloud {
        /// Its path.
        path: String,
        /// What is wrong with it.
        what: String,
    },
    /// All queries or the whole database were skipped.
    #[error(
        "{which}: no usable cloud, got {skipped} skipped ones\nlook at the reasons, or choose other lists"
    )]
    Empty {
        /// Which side.
        which: &'static str,
        /// How many were skipped.
        skipped: usize,
    },
    /// The descriptor.
    #[error(transparent)]
    Parameters(#[from] descriptor::genes::GeneError),
    /// The descriptor.
    #[error(transparent)]
    Quantise(#[from] descriptor::QuantiseError),
    /// Nothing to match with.
    #[error(transparent)]
    Recognise(#[from] descriptor::recognise::RecogniseError),
    /// No threads to be had.
    #[error("--threads: cannot start them, got {0}\nlower --threads")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

struct Described {
    summary: Summary,
    keypoints: usize,
}

/// Evaluates one descriptor.
pub fn evaluate(request: &Request) -> Result<Report, EvaluateError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(request.threads).build()?;
    pool.install(|| evaluate_here(request))
}

fn evaluate_here(request: &Request) -> Result<Report, EvaluateError> {
    let started = Instant::now();
    let listing = Listing::load(&request.root, &request.layout, &request.query, &request.database)?;
    let quantiser = Quantiser::new(&GeneTable::single(&request.parameters)?)?;
    let binning = quantiser.binning(&request.parameters)?;
    let described: Vec<(Option<Described>, Option<String>, Seconds)> = listing
        .clouds
        .par_iter()
        .map(|cloud| describe(&cloud.path, &cloud.file, request, &quantiser, &binning))
        .collect::<Result<_, _>>()?;

    let mut seconds = Seconds::default();
    let mut skipped: Vec<(String, String)> = Vec::new();
    let mut total_keypoints = 0;
    let mut sides: [Side; 2] = Default::default();
    for (index, (cloud, (described, reason, time))) in listing.clouds.iter().zip(described).enumerate() {
        seconds += time;
        let side = &mut sides[usize::from(index >= listing.queries)];
        if let Some(reason) = reason {
            skipped.push((cloud.path.clone(), reason));
            side.skipped += 1;
        }
        let Some(described) = described else { continue };
        total_keypoints += described.keypoints;
        side.summaries.push(described.summary);
        side.labels.push(Label { category: cloud.category, instance: cloud.instance });
        side.paths.push(cloud.path.clone());
    }
    let [query, database] = sides;
    for (which, side) in [("--query", &query), ("--database", &database)] {
        if side.summaries.is_empty() {
            return Err(EvaluateError::Empty { which, skipped: side.skipped });
        }
    }
    let matching = Instant::now();
    let matches = recognise(
        &query.summaries,
        &database.summaries,
        &database.labels,
        request.parameters.shape_weight(),
    )?;
    let correct = Correct::count(&matches, &query.labels, &database.labels);
    seconds.matching = matching.elapsed();
    seconds.total = started.elapsed();
    let named =
        query.paths.iter().zip(&matches).map(|(path, found)| {
            (path.clone(), database.paths[found.nearest.index as usize].clone(), *found)
        });
    Ok(Report {
        correct,
        database: database.summaries.len(),
        skipped,
        keypoints: total_keypoints,
        seconds,
        matches: named.collect(),
    })
}

#[derive(Default)]
struct Side {
    summaries: Vec<Summary>,
    labels: Vec<Label>,
    paths: Vec<String>,
    skipped: usize,
}

/// One cloud through all stages; a skip is no error.
fn describe(
    path: &str,
    file: &std::path::Path,
    request: &Request,
    quantiser: &Quantiser,
    binning: &Binning,
) -> Result<(Option<Described>, Option<String>, Seconds), EvaluateError> {
    let failed = |what: String| EvaluateError::Cloud { path: path.to_owned(), what };
    let mut seconds = Seconds::default();
    let clock = Instant::now();
    let bytes = read_file(file).map_err(|reason| failed(format!("cannot be read, got {reason}")))?;
    let cloud = pcd::read(&bytes).map_err(|error| failed(error.to_string()))?;
    let cloud = cloud.in_metres(request.preprocess.unit.metres());
    seconds.read = clock.elapsed();

    let mut stages = || -> Result<Described, PrepareError> {
        let clock = Instant::now();
        let keypoints = keypoints(&cloud, &request.preprocess)?;
        seconds.keypoints = clock.elapsed();
        let clock = Instant::now();
        let normals = Normals::new(&cloud, &keypoints, &request.preprocess)?;
        seconds.normals = clock.elapsed();
        let clock = Instant::now();
        let prepared = PreparedCloud::describe(&cloud, &keypoints, &normals, quantiser)?;
        let summary = Summary::new(&prepared, binning);
        seconds.describe = clock.elapsed();
        Ok(Described { summary, keypoints: prepared.keypoints() })
    };
    match stages() {
        Ok(described) => Ok((Some(described), None, seconds)),
        Err(PrepareError::Skip(skip)) => Ok((None, Some(skip.to_string()), seconds)),
        Err(error) => Err(failed(error.to_string())),
    }
}
