//! Rows `run`, `worker`, `memory` and `second`: whole runs of the real programs, preprocessing and final test included.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use tempfile::TempDir;

use crate::Bench;
use crate::programs::{Finished, Running, program};
use tests::benches::household::{GENERATIONS, section};
use tests::benches::machine::cores;
use tests::benches::table::{Row, Samples, megabytes, time};

/// Individuals a generation in the experiment.
const POPULATION: u32 = 10;
/// What the worker logs after each job that it has carried out.
const CARRIED_OUT: &str = "work so far";

/// A folder for experiments, caches and run folders, each used once.
pub struct Place {
    folder: TempDir,
    used: u32,
}

impl Place {
    /// A new one.
    pub fn new() -> Self {
        Self { folder: TempDir::new().unwrap(), used: 0 }
    }

    /// Writes an experiment.
    pub fn write(&self, name: &str, experiment: &str) -> PathBuf {
        let path = self.folder.path().join(name);
        fs::write(&path, experiment).unwrap();
        path
    }

    /// A path in it that nothing has.
    pub fn fresh(&mut self, name: &str) -> PathBuf {
        self.used += 1;
        self.folder.path().join(format!("{name}-{}", self.used))
    }

    /// A run of `experiment` into a folder of its own, with this cache.
    pub fn coordinator(&mut self, experiment: &Path, cache: &Path, more: &[&str]) -> Running {
        let mut command = program("coordinator");
        command.arg("run").arg(experiment).arg("--out").arg(self.fresh("run")).arg("--cache").arg(cache);
        command.args(["--listen", "127.0.0.1:0", "--json"]).args(more).env("DESCRY_LOG", "worker=debug");
        Running::start(command)
    }
}

/// Measures the rows that are wanted.
pub fn measure(bench: &mut Bench) {
    if !bench.wants(&["run", "worker", "memory", "second"]) {
        return;
    }
    let mut place = Place::new();
    let forced = place.write("household.toml", &bench.household.forced());
    let repetitions = if bench.wants(&["run"]) { bench.repetitions } else { 1 };
    let mut cache = PathBuf::new();
    let runs: Vec<Finished> = (0..repetitions)
        .map(|_| {
            cache = place.fresh("cache");
            place.coordinator(&forced, &cache, &[]).finish()
        })
        .collect();
    let digest = digest(&runs[0]);
    runs.iter().for_each(|run| check(run, &digest));

    if bench.wants(&["run"]) {
        add_run(bench, &runs);
    }
    if bench.wants(&["worker"]) {
        let row = separate_worker(&mut place, &forced, &digest);
        bench.table.add(row);
    }
    if bench.wants(&["memory"]) {
        for memory in ["600MiB", "100MiB"] {
            let row = bounded(&mut place, &forced, memory, &digest);
            bench.table.add(row);
        }
    }
    if bench.wants(&["second"]) {
        second(bench, &mut place, &cache);
    }
}

fn add_run(bench: &mut Bench, runs: &[Finished]) {
    let summary = runs[0].json();
    let peak = runs.iter().map(|run| run.peak).max().unwrap_or_default();
    let validation_clouds = bench.household.listed(&["train1.txt", "train2.txt", "validation.txt"]).len();
    let peer = bench.peer.search(GENERATIONS * POPULATION, GENERATIONS, validation_clouds);
    let computed = summary["evaluations_computed"].as_u64().unwrap();
    let mut notes = vec![
        format!("{computed} evaluations computed, {} remembered", summary["evaluations_remembered"]),
        format!("peak resident memory of the coordinator with its worker {}", megabytes(peak)),
        format!("run digest {}", summary["run_digest"]),
    ];
    if let Some(peer) = bench.peer.search(computed as u32, 0, validation_clouds) {
        notes.push(format!(
            "PCL is reckoned from its times for one evaluation; those that were computed here, without validation, would take {}, {} with the normals cached",
            time(peer.scratch),
            time(peer.cached)
        ));
    }
    bench.table.add(Row {
        name: "run",
        what: format!(
            "{GENERATIONS} generations of {POPULATION}, validations, final test, from an empty cache, {} threads",
            cores()
        ),
        own: runs.iter().map(|run| run.seconds).collect(),
        peer,
        notes,
    });
}

/// The same run with a bound on what the worker keeps in memory.
fn bounded(place: &mut Place, experiment: &Path, memory: &str, digest: &Value) -> Row {
    let cache = place.fresh("cache");
    let run = place.coordinator(experiment, &cache, &["--memory", memory]).finish();
    check(&run, digest);
    Row {
        name: "memory",
        what: format!("the same run with `--memory {memory}`"),
        own: [run.seconds].into_iter().collect(),
        peer: None,
        notes: vec![format!("peak resident memory {}", megabytes(run.peak)), same(digest)],
    }
}

/// The worker in a process of its own, over loopback, with a cache of its own: nothing is prepared for it.
fn separate_worker(place: &mut Place, experiment: &Path, digest: &Value) -> Row {
    let caches = ["cache", "cache"].map(|name| place.fresh(name));
    let mut coordinator = place.coordinator(experiment, &caches[0], &["--local-workers", "0"]);
    let (_, line) = coordinator.wait_for("workers may join with");
    let address = line.rsplit(' ').next().unwrap();
    let mut command = program("worker");
    // It stays, so that its peak can be read when the run has ended.
    command.args(["--coordinator", address, "--stay", "--threads", "2", "--patience", "5"]);
    command.arg("--cache").arg(&caches[1]);
    let mut worker = Running::start(command);
    worker.wait_for("looking for the coordinator");
    let run = coordinator.finish();
    check(&run, digest);
    Row {
        name: "worker",
        what: "the same run with one `worker` process of two threads".to_owned(),
        own: [run.seconds].into_iter().collect(),
        peer: None,
        notes: vec![
            format!(
                "peak resident memory: worker {}, coordinator {}",
                megabytes(worker.peak()),
                megabytes(run.peak)
            ),
            same(digest),
        ],
    }
}

/// Time from a program's start to its first finished evaluation, when another run has left its cache. Each has a seed
/// of its own: of descriptors that are remembered nothing would be evaluated.
fn second(bench: &mut Bench, place: &mut Place, cache: &Path) {
    let short = bench.household.experiment(|experiment| {
        section(experiment, "stop").insert("generations".to_owned(), 1.into());
    });
    let short = place.write("short.toml", &short);
    let (mut first, mut generation) = (Samples::default(), Samples::default());
    for seed in 0..3 * bench.repetitions {
        let seed = (1_000 + seed).to_string();
        let mut run = place.coordinator(&short, cache, &["--seed", &seed]);
        first.push(run.wait_for(CARRIED_OUT).0);
        generation.push(run.wait_for("generation 1/1: ").0);
        run.finish();
    }
    bench.table.add(Row {
        name: "second",
        what: "another seed on the same clouds: from the program's start to its first evaluation".to_owned(),
        own: first,
        peer: None,
        notes: vec![
            format!("first generation of 10 complete after {generation}"),
            "measured by the arrival of lines in the program's log".to_owned(),
        ],
    });
}

fn digest(run: &Finished) -> Value {
    run.json()["run_digest"].clone()
}

#[track_caller]
fn check(run: &Finished, expected: &Value) {
    assert_eq!(digest(run), *expected, "the run digest differs");
    assert_eq!(run.json()["generations"], GENERATIONS, "the run stopped early");
}

fn same(digest: &Value) -> String {
    let digest = digest.as_str().unwrap_or_default();
    format!("the same run digest, {}…", &digest[..digest.len().min(12)])
}
