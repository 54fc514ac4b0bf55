//! When a worker ends: with its run, when it is idle, at the end of its lifetime, when it is told to.

use crate::experiments::{Experiment, digest, free_address};
use crate::process::{Running, finish, program, run};

/// Long enough that workers can come and go while it runs.
const SEARCH: &str = "[ga]\npopulation = 8\n[stop]\ngenerations = 60\nstagnation = \"off\"\n\
    validation_patience = \"off\"\n[coordinator]\nlease_seconds = 2\n";
const SHORT: &str = "[ga]\npopulation = 6\n[stop]\ngenerations = 3\nvalidation_patience = \"off\"\n";

fn worker(experiment: &Experiment, name: &str, address: &str, more: &[&str]) -> Running {
    let cache = experiment.path("cache");
    let mut args = vec!["--coordinator", address, "--name", name, "--threads", "1", "--cache", &cache];
    args.extend(more);
    Running::start(experiment.folder(), name, "worker", args)
}

fn order(out: &str, order: &str) {
    run("coordinator", ["control", out, order, "--reason", "for a test"]).expect_success();
}

#[test]
fn a_worker_ends_well_with_its_run_and_one_that_stays_works_for_the_next() {
    let experiment = Experiment::new(SHORT);
    let address = free_address();
    let mut leaving = worker(&experiment, "leaving", &address, &[]);
    let mut staying = worker(&experiment, "staying", &address, &["--stay"]);
    let args = experiment.run_args_at("first", &address);
    let first = finish(program("coordinator").args(args)).expect_success();
    let left = leaving.wait().expect_success();
    assert!(left.stderr.contains("left: the run has ended"), "{left}");
    assert!(!first.stderr.contains("handed back"), "leaving at the end is no news: {first}");

    staying.wait_for("the run has ended, waiting for the next");
    let args = experiment.run_args_at("second", &address);
    let second = finish(program("coordinator").args(args).args(["--seed", "2"])).expect_success();
    assert_ne!(digest(&second), digest(&first));
    assert_eq!(staying.log().matches("joined as staying").count(), 2, "{}", staying.log());
    assert!(staying.is_running());
    staying.signal("TERM");
    staying.wait().expect_success();
}

#[test]
fn a_worker_stays_for_what_follows_its_run() {
    let experiment = Experiment::new(SHORT);
    // A random search follows, and a comparison of both: three sessions of one command, at a port that the system chose.
    let args = experiment.run_args("out", &["--local-workers", "0", "--control"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let mut worker = worker(&experiment, "follower", &address, &[]);
    let finished = coordinator.wait().expect_success();
    let left = worker.wait().expect_success();
    assert_eq!(left.stderr.matches("joined as follower").count(), 3, "{left}");
    assert_eq!(finished.stderr.matches(&format!("worker --coordinator {address}")).count(), 3, "{finished}");
}

#[test]
fn a_worker_that_has_no_job_for_too_long_ends_well_with_a_coordinator_and_without() {
    let experiment = Experiment::new(SHORT);
    let mut alone = worker(&experiment, "alone", &free_address(), &["--idle-timeout", "1"]);
    let left = alone.wait().expect_success();
    assert!(left.stderr.contains("left: no job for --idle-timeout"), "{left}");

    let experiment = Experiment::new(SEARCH);
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let mut busy = worker(&experiment, "busy", &address, &[]);
    coordinator.wait_for("generation 2/60");
    let out = experiment.path("out");
    order(&out, "pause");
    let mut idle = worker(&experiment, "idle", &address, &["--idle-timeout", "1"]);
    let left = idle.wait().expect_success();
    assert!(left.stderr.contains("joined as idle"), "{left}");
    assert!(left.stderr.contains("left: no job for --idle-timeout"), "{left}");
    coordinator.wait_for("worker idle: left");
    order(&out, "resume");
    coordinator.wait().expect_success();
    busy.wait().expect_success();
}

#[test]
fn at_the_end_of_its_lifetime_a_worker_hands_back_what_it_has_not_finished_and_the_digest_is_the_same() {
    let experiment = Experiment::new(&SEARCH.replace("generations = 60", "generations = 150"));
    let alone = experiment.run("alone", &[]).expect_success();
    // The run cannot end before the first worker, because nobody else works.
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let mut first = worker(&experiment, "first", &address, &["--lifetime", "1", "--lifetime-stagger", "0"]);
    let left = first.wait().expect_success();
    assert!(left.stderr.contains("left: the end of --lifetime"), "{left}");
    coordinator.wait_for("worker first: left");
    // Who works all the time is not idle, however short its jobs are: else the run would wait for another worker. It may
    // be idle while the coordinator writes its tables.
    let mut second = worker(&experiment, "second", &address, &["--idle-timeout", "1"]);
    let finished = coordinator.wait().expect_success();
    assert_eq!(digest(&finished), digest(&alone));
    let left = second.wait().expect_success();
    let reasons = ["left: the run has ended", "left: no job for --idle-timeout"];
    assert!(reasons.iter().any(|reason| left.stderr.contains(reason)), "{left}");
    let workers = results::read_table(experiment.path("out"), results::TableName::Workers).unwrap();
    assert_eq!(workers.height(), 2, "each joined once: {workers}");
    let attempts = results::read_table(experiment.path("out"), results::TableName::Attempts).unwrap();
    let (workers, ends) = (attempts.column("worker").unwrap(), attempts.column("end").unwrap());
    let rows = workers.str().unwrap().iter().zip(ends.str().unwrap().iter());
    let ends: Vec<&str> =
        rows.filter(|(worker, _)| *worker == Some("first")).filter_map(|(_, end)| end).collect();
    let count = |end: &str| ends.iter().filter(|other| **other == end).count();
    // On a busy machine a second may be over before anything is finished.
    assert!(count("answered") + count("left") > 0, "it has worked: {ends:?}");
    assert!(count("left") <= 2, "one in hand and one ahead at most: {ends:?}");
    assert_eq!(count("lost"), 0, "{ends:?}");
}

#[test]
fn a_worker_that_is_to_be_queued_again_hands_its_jobs_back_and_waits_to_be_killed() {
    let experiment = Experiment::new(SEARCH);
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let mut preempted = worker(&experiment, "preempted", &address, &["--on-term", "requeue"]);
    coordinator.wait_for("generation 2/60");
    preempted.signal("TERM");
    coordinator.wait_for("worker preempted: left");
    preempted.wait_for("waiting to be killed");
    // Slurm repeats the signal before it kills.
    preempted.signal("TERM");
    let mut second = worker(&experiment, "second", &address, &[]);
    coordinator.wait().expect_success();
    second.wait().expect_success();
    assert!(preempted.is_running());
    preempted.signal("INT");
    preempted.wait().expect_success();
}
