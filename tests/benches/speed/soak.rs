//! Run after run of one experiment while every few seconds the coordinator or a worker is killed, stopped or told to end:
//! every run digest must be that of an undisturbed run.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};
use std::{fs, thread};

use descriptor::random;
use rand::RngExt as _;
use rand::seq::IndexedRandom as _;

use tests::experiments::{Experiment, digest, free_address};
use tests::process::{PATIENCE, Running, program};

/// Some 12 000 evaluations; a worker that is stopped for three seconds has lost its leases.
const SEARCH: &str = "[search]\nmethod = \"random\"\n[ga]\npopulation = 40\n[stop]\ngenerations = 300\n\
    stagnation = \"off\"\nvalidation_patience = \"off\"\n\
    [coordinator]\nlease_seconds = 2\nworker_grace_seconds = 60\naudit = 0.1\n";
const WORKERS: usize = 4;
/// Longer than a lease.
const STOP: Duration = Duration::from_secs(3);

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Fault {
    CoordinatorKilled,
    CoordinatorStopped,
    CoordinatorTerminated,
    WorkerKilled,
    WorkerStopped,
    WorkerTerminated,
    AllKilled,
}

const FAULTS: [Fault; 10] = [
    Fault::CoordinatorKilled,
    Fault::CoordinatorKilled,
    Fault::CoordinatorKilled,
    Fault::CoordinatorStopped,
    Fault::CoordinatorTerminated,
    Fault::WorkerKilled,
    Fault::WorkerKilled,
    Fault::WorkerStopped,
    Fault::WorkerTerminated,
    Fault::AllKilled,
];

/// How often each fault was injected, and how long it took until a generation was written again.
#[derive(Default)]
struct Tally(BTreeMap<Fault, Vec<Duration>>);

/// A run under way, with its workers.
struct Scene<'a> {
    experiment: &'a Experiment,
    args: Vec<String>,
    address: String,
    round: usize,
    /// Programs started in this round.
    started: usize,
    coordinator: Running,
    workers: Vec<Running>,
}

impl<'a> Scene<'a> {
    fn new(experiment: &'a Experiment, round: usize) -> Self {
        let address = free_address();
        let args = experiment.run_args_at(&format!("out-{round}"), &address);
        let name = format!("coordinator-{round}-0");
        let coordinator = Running::start(experiment.folder(), &name, "coordinator", args.clone());
        let mut scene =
            Self { experiment, args, address, round, started: 0, coordinator, workers: Vec::new() };
        for _ in 0..WORKERS {
            let worker = scene.worker();
            scene.workers.push(worker);
        }
        scene
    }

    fn worker(&mut self) -> Running {
        self.started += 1;
        let name = format!("worker-{}-{}", self.round, self.started);
        let cache = self.experiment.path("cache");
        let mut command = program("worker");
        command.args(["--coordinator", &self.address, "--stay", "--threads", "1", "--cache", &cache]);
        command.args(["--name", &name]);
        Running::spawn(self.experiment.folder(), &name, command)
    }

    fn start_coordinator(&mut self) {
        self.started += 1;
        let name = format!("coordinator-{}-{}", self.round, self.started);
        let args = self.args.clone();
        self.coordinator = Running::start(self.experiment.folder(), &name, "coordinator", args);
    }

    /// Generations that are in the run folder.
    fn generations(&self) -> usize {
        let folder = self.experiment.path(&format!("out-{}", self.round));
        let files = fs::read_dir(Path::new(&folder).join("generations"));
        files.map_or(0, |files| {
            files
                .filter(|file| !file.as_ref().unwrap().file_name().as_encoded_bytes().starts_with(b"."))
                .count()
        })
    }

    fn end(program: &mut Running, signal: &str) {
        program.signal(signal);
        program.wait();
    }

    fn pause(program: &Running) {
        program.signal("STOP");
        thread::sleep(STOP);
        program.signal("CONT");
    }

    /// Injects a fault and starts again what it ended.
    fn inject(&mut self, fault: Fault, worker: usize) {
        match fault {
            Fault::CoordinatorKilled | Fault::CoordinatorTerminated => {
                let signal = if fault == Fault::CoordinatorKilled { "KILL" } else { "TERM" };
                Self::end(&mut self.coordinator, signal);
                self.start_coordinator();
            }
            Fault::CoordinatorStopped => Self::pause(&self.coordinator),
            Fault::WorkerKilled | Fault::WorkerTerminated => {
                let signal = if fault == Fault::WorkerKilled { "KILL" } else { "TERM" };
                Self::end(&mut self.workers[worker], signal);
                self.workers[worker] = self.worker();
            }
            Fault::WorkerStopped => Self::pause(&self.workers[worker]),
            Fault::AllKilled => {
                for worker in 0..self.workers.len() {
                    Self::end(&mut self.workers[worker], "KILL");
                }
                Self::end(&mut self.coordinator, "KILL");
                self.start_coordinator();
                for worker in 0..self.workers.len() {
                    self.workers[worker] = self.worker();
                }
            }
        }
    }

    /// Waits until there is a generation more, or the run has ended, and returns how long that took.
    fn recover(&mut self, before: usize) -> Duration {
        let begun = Instant::now();
        while self.generations() <= before && self.coordinator.is_running() {
            assert!(begun.elapsed() < PATIENCE, "no generation after {before}:\n{}", self.coordinator.log());
            thread::sleep(Duration::from_millis(5));
        }
        begun.elapsed()
    }
}

/// Goes on for so many seconds, and to the end of the run that is under way then.
pub fn soak(seconds: u64, seed: u64) {
    let experiment = Experiment::new(SEARCH);
    let undisturbed = experiment.run("undisturbed", &["--local-workers", "2"]).expect_success();
    let (begun, length) = (Instant::now(), Duration::from_secs(seconds));
    let mut rng = random::stream(seed, "soak", &[]);
    let (mut tally, mut memory, mut rounds) = (Tally::default(), 0, 0);
    while begun.elapsed() < length {
        let mut scene = Scene::new(&experiment, rounds);
        let mut faults = 0;
        let finished = loop {
            thread::sleep(Duration::from_millis(rng.random_range(200..4_000)));
            if !scene.coordinator.is_running() {
                break scene.coordinator.wait().expect_success();
            }
            memory = memory.max(scene.coordinator.resident().unwrap_or(0));
            let fault = *FAULTS.choose(&mut rng).unwrap();
            let before = scene.generations();
            scene.inject(fault, rng.random_range(0..WORKERS));
            let recovered = scene.recover(before);
            tally.0.entry(fault).or_default().push(recovered);
            faults += 1;
        };
        assert_eq!(digest(&finished), digest(&undisturbed), "round {rounds}:\n{finished}");
        let left = scene.workers.iter_mut().map(Running::is_running).filter(|running| *running).count();
        println!(
            "{:4.0} s: round {rounds}: {faults} faults, same digest, {left} workers alive",
            begun.elapsed().as_secs_f64()
        );
        rounds += 1;
    }
    println!("{}", report(&mut tally, memory, rounds));
}

fn report(tally: &mut Tally, memory: u64, rounds: usize) -> String {
    let mut text = format!("{rounds} runs, coordinator at most {} MB\n", memory >> 10);
    for (fault, times) in &mut tally.0 {
        times.sort();
        let [median, longest] =
            [times[times.len() / 2], times[times.len() - 1]].map(|time| time.as_secs_f64());
        let name = format!("{fault:?}");
        writeln!(
            text,
            "{name:22} {:4} times, recovered in {median:.2} s, at most {longest:.2} s",
            times.len()
        )
        .unwrap();
    }
    text
}
