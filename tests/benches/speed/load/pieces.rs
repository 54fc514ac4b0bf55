//! What it gives to cut evaluations into pieces: few evaluations that take long, for many workers.

use std::fs;
use std::path::Path;
use std::time::Instant;

use results::TableName;
use tempfile::TempDir;

use super::meter::Meter;
use super::worker::Effort;
use super::{start_coordinator, work};
use crate::programs::run;
use tests::benches::table::megabytes;

/// Individuals of a generation.
const POPULATION: u32 = 10;
/// Generations, of which those after …
const GENERATIONS: u32 = 5;
/// … these are measured: in the first, nobody knows yet what an evaluation takes, and in the second, some workers still
/// carry out what they took ahead before others had joined.
const EARLY: u32 = 2;
/// Clouds of the training sets, as the data set below is split.
const OBJECTS: u32 = 24;
/// Views of each object.
const VIEWS: u32 = 60;
/// Describing all clouds of an evaluation, and matching all their pairs, seconds.
const HALF: f64 = 5.0;

/// Measures rows of ten evaluations of ten seconds for 10, 30 and 100 workers, whole and in pieces.
pub fn measure() {
    let columns = [
        "workers",
        "pieces",
        "a generation",
        "busy",
        "jobs a generation",
        "up, down a generation",
        "coordinator",
        "its memory",
    ];
    println!("| {} |\n|{}", columns.join(" | "), "---|".repeat(columns.len()));
    let folder = TempDir::new().unwrap();
    let data = folder.path().join("data");
    let (objects, views) = (OBJECTS.to_string(), VIEWS.to_string());
    run(
        "coordinator",
        ["synth", data.to_str().unwrap(), "--objects", &objects, "--views", &views, "--seed", "1"],
    );
    let clouds = |list: &str| fs::read_to_string(data.join(list)).unwrap().lines().count() as f64;
    let (queries, database) = (clouds("train1.txt"), clouds("train2.txt"));
    let effort = Effort::Each { cloud: HALF / (queries + database), pair: HALF / (queries * database) };
    for workers in [10, 30, 100] {
        for pieces in ["1", "\"auto\""] {
            println!("| {workers} | {pieces} | {} |", measure_one(&data, workers, pieces, effort));
        }
    }
}

fn measure_one(data: &Path, workers: u32, pieces: &str, effort: Effort) -> String {
    let folder = TempDir::new().unwrap();
    let place = folder.path();
    let toml = format!(
        "version = 1\nname = \"load\"\nseed = 1\n[dataset]\nroot = \"{}\"\n[search]\nmethod = \"random\"\n\
         [ga]\npopulation = {POPULATION}\n[stop]\ngenerations = {GENERATIONS}\nstagnation = \"off\"\nperfect = false\n\
         validation_patience = \"off\"\n[coordinator]\naudit = 0\npieces = {pieces}\n\
         [results]\nbaselines = false\n\
         [descriptor.genes]\nshape_bins = 60\nm = 8\nR2 = 3.6\n",
        data.display()
    );
    fs::write(place.join("load.toml"), toml).unwrap();
    let (coordinator, address) = start_coordinator(place, "warn");
    let (meter, begun) = (Meter::start(coordinator.process()), Instant::now());
    let records = work(workers, 1, effort, address);
    coordinator.finish();

    let table = results::read_table(place.join("run"), TableName::Generations).unwrap();
    let seconds: Vec<f64> = table.column("seconds").unwrap().f64().unwrap().iter().flatten().collect();
    let generation = seconds[EARLY as usize..].iter().sum::<f64>() / f64::from(GENERATIONS - EARLY);
    let busy = 2.0 * HALF * f64::from(POPULATION) / (f64::from(workers) * generation);
    // All but the first, in which nothing is cut.
    let later = f64::from(GENERATIONS - 1);
    let jobs: usize = records.iter().map(|record| record.spans.len()).sum();
    let jobs = (jobs as f64 - f64::from(POPULATION)) / later;
    let total =
        |way: usize| records.iter().map(|record| record.traffic[way]).sum::<u64>() as f64 / later / 1e6;
    let end = records.iter().filter_map(|record| record.end.as_ref()).map(|(end, _)| *end).max().unwrap();
    let cost = meter.cost(begun, end);
    format!(
        "{generation:.2} s | {:.0} % | {jobs:.0} | {:.1}, {:.1} MB | {:.2} cores | {}",
        100.0 * busy,
        total(0),
        total(1),
        cost.cores,
        megabytes(cost.peak)
    )
}
