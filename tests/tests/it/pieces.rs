//! Evaluations in pieces: the same digest however they are cut, whoever dies, and whenever the run goes on.

use std::thread;
use std::time::Duration;

use descriptor::random;
use rand::RngExt as _;
use results::TableName;

use crate::experiments::{Experiment, begun, digest, free_address};
use crate::process::Running;

/// With validations and a final test, which are cut like everything else.
const SEARCH: &str = "[ga]\npopulation = 4\n[stop]\ngenerations = 5\nstagnation = \"off\"\nperfect = false\n\
    validation_patience = 5\n";

/// A lease of 2 s, after which a worker that was killed is lost.
const SHORT_LEASE: u32 = 2;
/// One that a worker does not lose because the machine is busy.
const LONG_LEASE: u32 = 60;

fn experiment(pieces: u32, lease_seconds: u32) -> Experiment {
    let settings = format!("lease_seconds = {lease_seconds}\naudit = 0\npieces = {pieces}\n");
    Experiment::new(&format!("{SEARCH}[coordinator]\n{settings}"))
}

/// How many attempts of a run were at tasks whose description begins like this.
fn attempts(experiment: &Experiment, out: &str, task: &str) -> usize {
    let frame = results::read_table(experiment.path(out), TableName::Attempts).unwrap();
    let tasks = frame.column("task").unwrap().str().unwrap().clone();
    tasks.iter().flatten().filter(|what| what.starts_with(task)).count()
}

#[test]
fn the_digest_is_the_same_whole_and_in_pieces_and_when_a_worker_dies_between_them() {
    let whole = experiment(1, SHORT_LEASE);
    let expected = digest(&whole.run("out", &["--local-workers", "1"]).expect_success());
    assert_eq!(attempts(&whole, "out", "tile of "), 0);
    for pieces in [3, 16] {
        let experiment = experiment(pieces, SHORT_LEASE);
        for workers in ["1", "3"] {
            let finished = experiment.run(workers, &["--local-workers", workers]).expect_success();
            assert_eq!(digest(&finished), expected, "{pieces} pieces, {workers} workers");
            assert!(attempts(&experiment, workers, "description of ") > 0);
            assert!(attempts(&experiment, workers, "tile of ") > 0);
            assert_eq!(attempts(&experiment, workers, "evaluation of "), 0, "all of them are cut");
        }
    }

    let experiment = experiment(16, SHORT_LEASE);
    let args = experiment.run_args("killed", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let mut victim = experiment.worker("victim", &address);
    let jobs = |log: &str| log.matches(": begun\n").count();
    victim.wait_until("in the middle of an evaluation", |log| jobs(log) > 20);
    victim.signal("KILL");
    assert!(!victim.wait().status.success());
    assert!(!coordinator.log().contains("generation 5/5"), "the fault came too late:\n{}", coordinator.log());
    coordinator.wait_for("worker victim: lost");
    let workers = ["second", "third"].map(|name| experiment.worker(name, &address));
    let finished = coordinator.wait().expect_success();
    assert_eq!(digest(&finished), expected);
    drop(workers);

    // Who took part is said of each individual.
    let frame = results::read_table(experiment.path("killed"), TableName::Evaluations).unwrap();
    let column = frame.column("worker").unwrap().str().unwrap().clone();
    let who: Vec<&str> = column.iter().flatten().collect();
    assert!(who.iter().any(|who| who.ends_with(" workers")), "{who:?}");
}

#[test]
fn a_coordinator_killed_between_pieces_goes_on_with_those_that_are_there() {
    const KILLS: usize = 8;
    let expected = digest(&experiment(1, LONG_LEASE).run("out", &["--local-workers", "1"]).expect_success());
    let experiment = experiment(16, LONG_LEASE);
    let address = free_address();
    let args = experiment.run_args_at("out", &address);
    let mut steady = experiment.worker("steady", &address);
    let mut rng = random::stream(12, "moments of kills", &[]);
    for kill in 0..KILLS {
        let before = steady.log().matches(": begun\n").count();
        let name = format!("start-{kill}");
        let mut coordinator = Running::start(experiment.folder(), &name, "coordinator", args.clone());
        steady.wait_until("given a piece", |log| log.matches(": begun\n").count() > before + 3);
        thread::sleep(Duration::from_millis(rng.random_range(0..30)));
        assert!(coordinator.is_running(), "the fault came too late:\n{}", coordinator.log());
        coordinator.signal("KILL");
        assert_eq!(coordinator.wait().status.code(), None);
    }
    let mut last = Running::start(experiment.folder(), "last", "coordinator", args);
    let finished = last.wait().expect_success();
    assert_eq!(digest(&finished), expected);
    steady.signal("TERM");
    let log = steady.wait().expect_success().stderr;
    // An answer that was not on the disk yet is asked for again first, and the one or two jobs that the worker was given
    // because of it are then unknown and given anew. Pieces that were forgotten would be three or more a kill.
    let twice: usize = begun(&log).into_values().map(|times| times - 1).sum();
    assert!(twice <= 2 * KILLS, "{twice} pieces were begun again\n{log}");
}
