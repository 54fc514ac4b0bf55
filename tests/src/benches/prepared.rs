//! Clouds prepared in memory, and evaluations on them with the calls that a worker makes.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use coordinator::dataset::{Layout, ListedCloud, Listing};
use descriptor::recognise::recognise_from;
use descriptor::{
    Correct, DistanceMatrix, GeneTable, Label, Parameters, PrepareError, Preprocess, QuantisedCloud,
    Quantiser, Signatures, pcd, recognise,
};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Prepared clouds of one side.
#[derive(Debug, Default)]
struct Side {
    clouds: Vec<QuantisedCloud>,
    labels: Vec<Label>,
}

/// Queries and a database, prepared for every descriptor of the paper's search space.
pub struct Pair {
    quantiser: Quantiser,
    query: Side,
    database: Side,
}

/// What one evaluation finds, and how long it takes.
#[derive(Clone, Copy, Debug)]
pub struct Evaluated {
    /// Recognised queries.
    pub correct: Correct,
    /// Histograms and signatures, seconds.
    pub describe: f64,
    /// Distances and nearest clouds, seconds.
    pub matching: f64,
}

/// A pool of so many threads.
pub fn pool(threads: usize) -> ThreadPool {
    ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}

impl Pair {
    /// Reads and prepares the clouds of two lists, on the current pool.
    pub fn prepare(root: &Path, query: &str, database: &str) -> Self {
        let list = |name: &str| -> [PathBuf; 1] { [root.join(name)] };
        let listing = Listing::load(root, &Layout::Folders, &list(query), &list(database)).unwrap();
        let quantiser = Quantiser::new(&GeneTable::paper()).unwrap();
        let (queries, entries) = listing.clouds.split_at(listing.queries);
        let [query, database] = [queries, entries].map(|clouds| Side::prepare(clouds, &quantiser));
        Self { quantiser, query, database }
    }

    /// Number of clouds that take part.
    pub fn clouds(&self) -> usize {
        self.query.clouds.len() + self.database.clouds.len()
    }

    /// Keypoints that are described, and their neighbours within the largest radius.
    pub fn keypoints_and_records(&self) -> [u64; 2] {
        let clouds = || self.query.clouds.iter().chain(&self.database.clouds);
        let keypoints = clouds().map(|cloud| cloud.keypoints() as u64).sum();
        [keypoints, clouds().map(|cloud| cloud.records() as u64).sum()]
    }

    /// Memory that the prepared clouds take, bytes.
    pub fn bytes(&self) -> u64 {
        let clouds = self.query.clouds.iter().chain(&self.database.clouds);
        clouds.map(|cloud| cloud.bytes() as u64).sum()
    }

    /// Evaluates one descriptor of which nothing is known yet, on the current pool.
    pub fn evaluate(&self, parameters: &Parameters) -> Evaluated {
        let clock = Instant::now();
        let signatures = self.signatures(parameters);
        let describe = clock.elapsed().as_secs_f64();
        let clock = Instant::now();
        let correct = self.recognise(&distances(&signatures), parameters.shape_weight());
        Evaluated { correct, describe, matching: clock.elapsed().as_secs_f64() }
    }

    /// Distances in shape and in colour.
    pub fn distances(&self, parameters: &Parameters) -> [DistanceMatrix; 2] {
        distances(&self.signatures(parameters))
    }

    /// Queries and database, in shape and in colour.
    fn signatures(&self, parameters: &Parameters) -> [[Signatures; 2]; 2] {
        let binning = self.quantiser.binning(parameters).unwrap();
        [&self.query, &self.database].map(|side| binning.signatures(&side.clouds))
    }

    /// Recognises the queries from kept distances.
    pub fn recognise(&self, [shape, colour]: &[DistanceMatrix; 2], shape_weight: f64) -> Correct {
        let Self { query, database, .. } = self;
        let matches = recognise_from(
            query.clouds.len(),
            &[(shape, shape_weight), (colour, 1.0 - shape_weight)],
            &database.labels,
        )
        .unwrap();
        Correct::count(&matches, &query.labels, &database.labels)
    }

    /// The same as [`Pair::evaluate`] finds, without anything that is kept between evaluations.
    pub fn evaluate_at_once(&self, parameters: &Parameters) -> Correct {
        let Self { query, database, .. } = self;
        let binning = self.quantiser.binning(parameters).unwrap();
        let [queries, entries] = [query, database].map(|side| binning.signatures(&side.clouds));
        let weights = [parameters.shape_weight(), 1.0 - parameters.shape_weight()];
        let matches = recognise(&queries, &entries, &weights, &database.labels).unwrap();
        Correct::count(&matches, &query.labels, &database.labels)
    }
}

fn distances([query, database]: &[[Signatures; 2]; 2]) -> [DistanceMatrix; 2] {
    [0, 1].map(|half| DistanceMatrix::new(&query[half], &database[half]))
}

impl Side {
    fn prepare(clouds: &[ListedCloud], quantiser: &Quantiser) -> Self {
        let prepared: Vec<_> = clouds.par_iter().filter_map(|cloud| prepare(cloud, quantiser)).collect();
        let (clouds, labels) = prepared.into_iter().unzip();
        Self { clouds, labels }
    }
}

/// `None` for a cloud that takes no part.
fn prepare(listed: &ListedCloud, quantiser: &Quantiser) -> Option<(QuantisedCloud, Label)> {
    let failed = |error: &dyn std::fmt::Display| -> ! { panic!("{}: {error}", listed.path) };
    let bytes = fs::read(&listed.file).unwrap_or_else(|error| failed(&error));
    let cloud = pcd::read(&bytes).unwrap_or_else(|error| failed(&error));
    match QuantisedCloud::new(&cloud, &Preprocess::default(), quantiser) {
        Ok(prepared) => Some((prepared, Label { category: listed.category, instance: listed.instance })),
        Err(PrepareError::Skip(_)) => None,
        Err(error) => failed(&error),
    }
}

/// Descriptors all over the paper's search space, of which no two neighbours share a gene's value.
pub fn spread() -> impl Iterator<Item = Parameters> {
    (0u32..).map(|k| {
        // Steps that share no factor with the number of a gene's values visit all of them.
        Parameters::from_ticks([
            8 + 23 * k % 57,
            3 + 5 * k % 6,
            5_000 + 1_000 * (7 * k % 16),
            21_000 + 1_000 * (11 * k % 30),
            10_000 * (37 * k % 101),
        ])
    })
}
