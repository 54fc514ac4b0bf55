//! How cost grows with clouds, with points in a cloud, with generations and with workers: tables, exponents, curves.

mod cost;
mod curves;
mod dense;
mod series;

use std::fs;
use std::path::Path;
use std::time::Duration;

use tempfile::TempDir;

use crate::load::{self, Load};
use crate::programs;
use cost::{Searched, prepared, searched};
use series::{Growth, Quantity};
use tests::benches::table::{megabytes, time};

/// Objects in each synthetic set, …
const OBJECTS: &str = "24";
/// … and views of each object, for sets of ever more clouds.
const VIEWS: [&str; 3] = ["20", "80", "320"];
/// Objects and views of the largest set.
const LARGE: [&str; 2] = ["100", "1000"];
/// How many times as many points there are in each cloud.
const POINTS: [u32; 3] = [1, 4, 16];
/// Generations of a run.
const GENERATIONS: [u32; 3] = [10, 40, 160];
/// Workers that only wait.
const WORKERS: [u32; 3] = [10, 100, 1000];
/// How long such a worker takes for an evaluation.
const JOB: Duration = Duration::from_secs(1);

fn bytes(bytes: f64) -> String {
    if bytes < 1e7 { format!("{:.0} KB", bytes / 1e3) } else { megabytes(bytes as u64) }
}

const PREPARE: Quantity = Quantity { what: "reading and preparing the training clouds", write: time };
const DESCRIBE: Quantity = Quantity { what: "one new chromosome: histograms", write: time };
const MATCH: Quantity = Quantity { what: "one new chromosome: matching", write: time };
const PREPARED: Quantity = Quantity { what: "prepared training clouds in memory", write: bytes };
const RUN: Quantity = Quantity { what: "a run from an empty cache", write: time };
const PEAK: Quantity = Quantity { what: "its peak resident memory", write: bytes };
const CACHE: Quantity = Quantity { what: "its cache on disk", write: bytes };
const RESULTS: Quantity = Quantity { what: "its results on disk", write: bytes };
const JOURNAL: Quantity = Quantity { what: "its journal on disk, before it ends", write: bytes };
const COORDINATOR: Quantity = Quantity { what: "the coordinator's peak resident memory", write: bytes };
const CORES: Quantity = Quantity { what: "the coordinator's processor time, a second", write: time };

/// Measures all of them, prints a table each, and draws curves where they are wanted.
pub fn measure(repetitions: usize, large: bool, curves: Option<&Path>) {
    let workers = by_workers();
    for growth in [by_points(repetitions), by_generations(), workers, by_clouds(repetitions, large)] {
        println!("\n{}", growth.to_string().trim_end());
        if let Some(folder) = curves {
            fs::write(folder.join(format!("growth-{}.svg", growth.by)), curves::draw(&growth)).unwrap();
        }
    }
}

/// Makes a synthetic set.
fn make(folder: &Path, objects: &str, views: &str) {
    println!("{objects} objects, {views} views");
    programs::run("coordinator", ["synth", folder.to_str().unwrap(), "--objects", objects, "--views", views]);
}

fn by_clouds(repetitions: usize, large: bool) -> Growth {
    let mut growth = Growth::new("clouds", "clouds", &[PREPARE, DESCRIBE, MATCH, PREPARED, RUN, PEAK, CACHE]);
    let sets = VIEWS.map(|views| [OBJECTS, views]).into_iter().chain(large.then_some(LARGE));
    for [objects, views] in sets {
        let folder = TempDir::new().unwrap();
        let data = folder.path().join("data");
        make(&data, objects, views);
        let repetitions = if [objects, views] == LARGE { 1 } else { repetitions };
        let (of_clouds, run) = (prepared(&data, repetitions), searched(folder.path(), &data, 2));
        let clouds = [objects, views].map(|count| count.parse::<f64>().unwrap());
        growth.add(clouds[0] * clouds[1], [&of_clouds[..], &[run.seconds, run.peak, run.cache]].concat());
    }
    growth
}

fn by_points(repetitions: usize) -> Growth {
    let mut growth =
        Growth::new("points", "points in a cloud", &[PREPARE, DESCRIBE, PREPARED, RUN, PEAK, CACHE]);
    for times in POINTS {
        let folder = TempDir::new().unwrap();
        let data = folder.path().join("data");
        make(&data, OBJECTS, VIEWS[0]);
        let points = dense::fill(&data, times);
        let ([prepare, describe, _, memory], run) =
            (prepared(&data, repetitions), searched(folder.path(), &data, 2));
        growth.add(points, vec![prepare, describe, memory, run.seconds, run.peak, run.cache]);
    }
    growth
}

fn by_generations() -> Growth {
    let mut growth = Growth::new("generations", "generations", &[RUN, PEAK, RESULTS, JOURNAL]);
    let folder = TempDir::new().unwrap();
    let data = folder.path().join("data");
    make(&data, OBJECTS, VIEWS[0]);
    for generations in GENERATIONS {
        let Searched { seconds, peak, results, journal, .. } = searched(folder.path(), &data, generations);
        growth.add(generations.into(), vec![seconds, peak, results, journal]);
    }
    growth
}

fn by_workers() -> Growth {
    let mut growth = Growth::new("workers", "workers", &[COORDINATOR, CORES]);
    for workers in WORKERS {
        let (peak, cores) = load::coordinator_cost(Load { workers, job: JOB, ahead: 1 });
        growth.add(workers.into(), vec![peak as f64, cores]);
    }
    growth
}
