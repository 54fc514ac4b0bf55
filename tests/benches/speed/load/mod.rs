//! How far one coordinator goes: the real program with its journal, and thousands of workers in this process, each over
//! a TCP connection of its own, whose evaluations only take time.

mod endurance;
mod meter;
mod pieces;
mod record;
mod worker;

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use results::TableName;
use tempfile::TempDir;
use tokio::sync::Mutex;
use tokio::task::JoinSet;

use crate::programs::{Finished, Running, program, run};
pub use endurance::measure as measure_endurance;
use meter::{Cost, Meter};
pub use pieces::measure as measure_pieces;
use record::{Findings, Record, percentile};
use tests::benches::table::{megabytes, time};
use worker::{Effort, Manner, Worker};

/// How long the jobs of a row would last if every worker were always busy, seconds.
const SECONDS: u32 = 10;
/// Individuals of the largest generation there may be.
const MAX_POPULATION: u32 = 65_536;

/// One load.
#[derive(Clone, Copy, Debug)]
pub struct Load {
    /// How many there are.
    pub workers: u32,
    /// What an evaluation takes on average.
    pub job: Duration,
    /// Jobs taken ahead.
    pub ahead: usize,
}

/// Rows: workers, milliseconds of a job, jobs taken ahead.
const LOADS: [(u32, u64, usize); 7] = [
    (10, 100, 1),
    (100, 100, 1),
    (500, 100, 1),
    (1000, 100, 1),
    (1000, 100, 0),
    (2000, 100, 1),
    (2000, 1000, 1),
];

/// What was measured under a load.
#[derive(Debug)]
struct Measured {
    load: Load,
    findings: Findings,
    coordinator: Cost,
    generator: Cost,
    /// Entries and milliseconds of each commit.
    commits: Vec<(f64, f64)>,
}

/// Measures the rows with as many workers as `wanted` names, or all; of several repetitions each shows the one with the
/// median rate.
pub fn measure(wanted: &[u32], repetitions: usize) {
    println!("| {} |\n|{}", COLUMNS.join(" | "), "---|".repeat(COLUMNS.len()));
    let is_wanted = |workers: u32| wanted.is_empty() || wanted.contains(&workers);
    for (workers, milliseconds, ahead) in LOADS.into_iter().filter(|(workers, ..)| is_wanted(*workers)) {
        let load = Load { workers, job: Duration::from_millis(milliseconds), ahead };
        let mut measured: Vec<Measured> = (0..repetitions).map(|_| measure_one(load)).collect();
        measured.sort_by(|a, b| a.findings.rate.total_cmp(&b.findings.rate));
        println!("| {} |", measured[repetitions / 2].cells().join(" | "));
    }
}

/// A coordinator's peak resident memory under a load, bytes, and how many cores it keeps busy.
pub fn coordinator_cost(load: Load) -> (u64, f64) {
    let Cost { peak, cores, .. } = measure_one(load).coordinator;
    (peak, cores)
}

fn measure_one(load: Load) -> Measured {
    let folder = TempDir::new().unwrap();
    let place = folder.path();
    let wanted = f64::from(load.workers * SECONDS) / load.job.as_secs_f64();
    let population = (wanted as u32).min(MAX_POPULATION);
    make_search(place, population, "generations = 1");

    let (coordinator, address) = start_coordinator(place, "warn,cluster::journal=debug");
    let process = coordinator.process();
    let meters = [process, std::process::id()].map(Meter::start);
    let records = work(load.workers, load.ahead, Effort::About(load.job), address);
    let finished = coordinator.finish();
    check(&finished, place, population);

    let findings = Findings::of(&records);
    let [coordinator, generator] = meters.map(|meter| meter.cost(findings.from, findings.to));
    Measured { load, findings, coordinator, generator, commits: commits(&finished.log) }
}

/// Writes a search of random individuals, none of which waits for another of its generation, and its clouds.
fn make_search(place: &Path, population: u32, stop: &str) {
    let data = place.join("data");
    let made = ["synth", data.to_str().unwrap(), "--objects", "4", "--views", "12", "--seed", "1"];
    run("coordinator", made);
    let toml = format!(
        "version = 1\nname = \"load\"\nseed = 1\n[dataset]\nroot = \"{}\"\n[search]\nmethod = \"random\"\n\
         [ga]\npopulation = {population}\n[stop]\n{stop}\nstagnation = \"off\"\nperfect = false\n\
         validation_patience = \"off\"\n[results]\nbaselines = false\n",
        data.display()
    );
    fs::write(place.join("load.toml"), toml).unwrap();
}

/// Starts a coordinator; where workers may join it.
fn start_coordinator(place: &Path, log: &str) -> (Running, String) {
    let mut command = program("coordinator");
    command.arg("run").arg(place.join("load.toml"));
    command.arg("--out").arg(place.join("run")).arg("--cache").arg(place.join("cache"));
    command.args(["--listen", "127.0.0.1:0", "--local-workers", "0", "--json"]);
    command.env("DESCRY_LOG", log);
    let mut coordinator = Running::start(command);
    let (_, line) = coordinator.wait_for("workers may join with");
    (coordinator, line.rsplit(' ').next().unwrap().to_owned())
}

/// Lets all workers join and work until the coordinator has gone.
fn work(workers: u32, ahead: usize, effort: Effort, address: String) -> Vec<Record> {
    let manner = Arc::new(Manner { address, effort, ahead, clouds: Mutex::default() });
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        // All join before any works: those who came late to a busy coordinator would find few jobs left, or none.
        let mut joined = Vec::new();
        for number in 0..workers {
            joined.push(Worker::join(Arc::clone(&manner), format!("worker-{number}")).await);
        }
        let at_work: JoinSet<Record> = joined.into_iter().map(Worker::work).collect();
        at_work.join_all().await
    })
}

/// Every individual must have the answer that was given, and every descriptor must have been asked once.
fn check(finished: &Finished, place: &Path, population: u32) {
    let table = results::read_table(place.join("run"), TableName::Evaluations).unwrap();
    assert_eq!(table.shape().0, population as usize, "individuals");
    let numbers = |column: &str| -> Vec<u32> {
        table.column(column).unwrap().u32().unwrap().iter().map(Option::unwrap).collect()
    };
    let [bins, colours, queries, correct] = ["shape_bins", "m", "queries", "object_correct"].map(numbers);
    for row in 0..population as usize {
        assert_eq!(correct[row], worker::answer(bins[row], colours[row], queries[row]), "row {row}");
    }
    let computed = finished.json()["evaluations_computed"].as_u64().unwrap();
    let answered = table.column("worker").unwrap().str().unwrap().iter().flatten().count();
    assert_eq!(computed, answered as u64, "an answer to each evaluation");

    let table = results::read_table(place.join("run"), TableName::Attempts).unwrap();
    let (jobs, ends) = (table.column("job").unwrap(), table.column("end").unwrap());
    let (jobs, ends) = (jobs.u64().unwrap(), ends.str().unwrap());
    let accepted = jobs.iter().zip(ends.iter()).filter(|(_, end)| *end == Some("answered"));
    let accepted: Vec<Option<u64>> = accepted.map(|(job, _)| job).collect();
    let different: BTreeSet<&Option<u64>> = accepted.iter().collect();
    assert_eq!(accepted.len(), different.len(), "one answer to each job");
}

/// Entries and milliseconds of each commit that the coordinator has logged.
fn commits(log: &[String]) -> Vec<(f64, f64)> {
    let number = |text: &str| text.split(' ').next().and_then(|number| number.parse::<f64>().ok());
    let commit = |line: &String| {
        let (_, rest) = line.split_once("journal: commit ")?.1.split_once(", ")?;
        let (entries, took) = rest.split_once(" entries, ")?;
        Some((number(entries)?, number(took)?))
    };
    log.iter().filter_map(commit).collect()
}

const COLUMNS: [&str; 11] = [
    "workers",
    "job",
    "ahead",
    "jobs/s",
    "busy",
    "dispatch p50, p99",
    "gap p50, p99",
    "coordinator, of it journal",
    "its memory",
    "a commit",
    "workers' process",
];

impl Measured {
    fn cells(&self) -> Vec<String> {
        let Self { load, findings, coordinator, generator, commits } = self;
        let both = |times: &[f64]| [0.5, 0.99].map(|share| time(percentile(times, share))).join(", ");
        let count = commits.len().max(1) as f64;
        let [entries, milliseconds] = [
            commits.iter().map(|(entries, _)| entries).sum::<f64>() / count,
            commits.iter().map(|(_, milliseconds)| milliseconds).sum::<f64>() / count,
        ];
        vec![
            load.workers.to_string(),
            time(load.job.as_secs_f64()),
            load.ahead.to_string(),
            format!("{:.0}", findings.rate),
            format!("{:.1} %", 100.0 * findings.busy),
            both(&findings.dispatches),
            both(&findings.gaps),
            format!("{:.2}, {:.2} cores", coordinator.cores, coordinator.journal_cores),
            megabytes(coordinator.peak),
            format!("{entries:.0} entries, {milliseconds:.1} ms"),
            format!("{:.2} cores", generator.cores),
        ]
    }
}
