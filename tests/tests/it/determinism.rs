//! One digest, whatever the workers do.

use std::collections::BTreeSet;

use crate::experiments::{Experiment, digest, summary};
use crate::process::{Running, finish, narrower_vectors, program, run};

/// Long enough that workers can come and go while it runs, short enough to run several times.
const SEARCH: &str = "[ga]\npopulation = 8\n[stop]\ngenerations = 60\nstagnation = \"off\"\n\
    validation_patience = \"off\"\n[coordinator]\nlease_seconds = 2\n";

/// Digest of a tiny search on the clouds of [`clouds`](crate::experiments::clouds). If it changes, say why in
/// CHANGELOG.md: everybody's digests change with it.
const GOLDEN: &str = "64a5f85035c677fd1f7cf12cd335103a1ba88fce9c1118cad958e6c3bf4438ad";

fn worker(experiment: &Experiment, name: &str, address: &str, cache: &str) -> Running {
    worker_with(experiment, name, address, cache, "1")
}

fn worker_with(experiment: &Experiment, name: &str, address: &str, cache: &str, threads: &str) -> Running {
    let cache = experiment.path(cache);
    let args = ["--coordinator", address, "--name", name, "--threads", threads, "--cache", &cache];
    Running::start(experiment.folder(), name, "worker", args)
}

/// Who computed evaluations of a run.
fn workers_of(experiment: &Experiment, out: &str) -> BTreeSet<String> {
    let frame = results::read_table(experiment.path(out), results::TableName::Evaluations).unwrap();
    let workers = frame.column("worker").unwrap().str().unwrap().clone();
    workers.iter().flatten().map(str::to_owned).collect()
}

#[test]
fn the_digest_is_the_same_with_one_worker_with_four_and_with_workers_that_die_and_join_late() {
    let experiment = Experiment::new(SEARCH);
    let one = experiment.run("one", &["--local-workers", "1"]).expect_success();
    let four = experiment.run("four", &["--local-workers", "4"]).expect_success();
    assert_eq!(digest(&four), digest(&one));

    // The victim works alone, so that it is sure to be killed with work in hand or about to get some.
    let args = experiment.run_args("processes", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let mut victim = worker(&experiment, "victim", &address, "cold-cache");
    coordinator.wait_for("generation 2/60");
    victim.signal("KILL");
    let killed = victim.wait();
    assert!(!killed.status.success());
    assert!(
        !coordinator.log().contains("generation 60/60"),
        "the fault came too late:\n{}",
        coordinator.log()
    );
    // Nobody is left: the run goes on only once its jobs have been taken from the dead worker.
    coordinator.wait_for("worker victim: lost");
    let mut second = worker_with(&experiment, "second", &address, "cold-cache", "4");
    coordinator.wait_for("generation 5/60");
    let mut late = worker(&experiment, "late", &address, "late-cache");
    late.wait_for("joined as late");
    assert!(
        !coordinator.log().contains("generation 60/60"),
        "the fault came too late:\n{}",
        coordinator.log()
    );
    second.signal("TERM");
    second.wait().expect_success();
    let finished = coordinator.wait().expect_success();
    assert_eq!(digest(&finished), digest(&one));
    assert_eq!(workers_of(&experiment, "processes"), ["late", "second", "victim"].map(str::to_owned).into());
    late.wait().expect_success();

    // Again, with what the workers kept of the first time.
    let args = experiment.run_args("warm", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "warm", "coordinator", args);
    let address = coordinator.join_address();
    let mut warm = worker(&experiment, "warm-worker", &address, "cold-cache");
    let finished = coordinator.wait().expect_success();
    assert_eq!(digest(&finished), digest(&one));
    let warm = warm.wait().expect_success();
    assert!(warm.stderr.contains(" clouds, 0 of them fetched"), "the cache was not used: {warm}");
}

#[test]
fn a_worker_that_is_told_to_stop_hands_its_jobs_back_and_the_run_goes_on_at_once() {
    let experiment = Experiment::new(SEARCH);
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let mut first = worker(&experiment, "first", &address, "cache");
    coordinator.wait_for("generation 2/60");
    first.signal("TERM");
    let left = first.wait().expect_success();
    assert!(left.stderr.contains("left"), "{left}");
    coordinator.wait_for("worker first: left");
    let _second = worker(&experiment, "second", &address, "cache");
    let finished = coordinator.wait().expect_success();
    assert!(!finished.stderr.contains("lost"), "{finished}");
    let alone = experiment.run("alone", &[]).expect_success();
    assert_eq!(digest(&finished), digest(&alone));
}

/// Rows of the table `attempts` of the run in `out`: job, worker and end.
fn attempts(experiment: &Experiment, out: &str) -> Vec<(u64, String, String)> {
    let frame = results::read_table(experiment.path(out), results::TableName::Attempts).unwrap();
    let jobs = frame.column("job").unwrap().u64().unwrap().clone();
    let text = |name: &str| frame.column(name).unwrap().str().unwrap().clone();
    let (workers, ends) = (text("worker"), text("end"));
    let rows = jobs.iter().zip(workers.iter()).zip(ends.iter());
    rows.map(|((job, worker), end)| (job.unwrap(), worker.unwrap().to_owned(), end.unwrap().to_owned()))
        .collect()
}

#[test]
fn a_stopped_workers_job_is_given_to_another_at_once_and_their_answers_are_compared() {
    // A lease is longer than this test may take: only a second lease on the same job lets the run go on.
    let search = SEARCH.replace("lease_seconds = 2", "lease_seconds = 600\naudit = 0");
    let experiment = Experiment::new(&format!("[search]\nmethod = \"random\"\n{search}"));
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let first = worker(&experiment, "first", &address, "cache");
    let _second = worker(&experiment, "second", &address, "cache");
    coordinator.wait_for("worker first: joined");
    coordinator.wait_for("worker second: joined");
    for generation in [5, 15, 25, 35, 45] {
        coordinator.wait_for(&format!("generation {generation}/60"));
        first.signal("STOP");
        coordinator.wait_for(&format!("generation {}/60", generation + 5));
        first.signal("CONT");
    }
    let finished = coordinator.wait().expect_success();
    let alone = experiment.run("alone", &[]).expect_success();
    assert_eq!(digest(&finished), digest(&alone));
    let attempts = attempts(&experiment, "out");
    let agreed: Vec<u64> =
        attempts.iter().filter(|(.., end)| end == "agreed").map(|(job, ..)| *job).collect();
    assert!(!agreed.is_empty(), "no worker was stopped with a job in hand: {attempts:?}");
    for job in agreed {
        let both: BTreeSet<&str> =
            attempts.iter().filter(|row| row.0 == job).map(|row| row.1.as_str()).collect();
        assert_eq!(both, ["first", "second"].into(), "job {job}: {attempts:?}");
    }
    assert!(attempts.iter().all(|(.., end)| end != "lost" && end != "disagreed"), "{attempts:?}");
}

#[test]
fn a_worker_waits_for_a_coordinator_that_is_not_there_yet() {
    let experiment = Experiment::new(SEARCH);
    // A port that was free a moment ago.
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let address = format!("127.0.0.1:{port}");
    let cache = experiment.path("cache");
    let args = ["--coordinator", &address, "--name", "early", "--threads", "1", "--cache", &cache, "--stay"];
    let mut early = Running::start(experiment.folder(), "early", "worker", args);
    early.wait_for("out of reach");
    let args = [
        "run".to_owned(),
        experiment.path("exp.toml"),
        "--out".to_owned(),
        experiment.path("out"),
        "--json".to_owned(),
        "--local-workers".to_owned(),
        "0".to_owned(),
        "--listen".to_owned(),
        address,
    ];
    let first = run("coordinator", &args).expect_success();
    // Another run at the same address: the worker starts afresh with it.
    let second = run("coordinator", args.iter().cloned().chain(["--fresh".to_owned()])).expect_success();
    assert_eq!(digest(&first), digest(&second));
    assert_ne!(summary(&first)["out"], summary(&second)["out"]);
    early.signal("TERM");
    let early = early.wait().expect_success();
    assert_eq!(early.stderr.matches("joined as early").count(), 2, "{early}");
}

#[test]
fn seed_and_labels_change_the_digest_and_names_and_paths_do_not() {
    let experiment =
        Experiment::new("[ga]\npopulation = 4\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n");
    let base = digest(&experiment.run("a", &[]).expect_success());
    assert_eq!(base, GOLDEN);
    assert_ne!(base, digest(&experiment.run("seed", &["--seed", "6"]).expect_success()));

    // The same clouds elsewhere under another experiment's name: the same rows. One line of a split gone: others.
    let copy = Experiment::with("");
    let data = copy.path("elsewhere");
    let args = ["synth", &data, "--objects", "6", "--views", "12", "--seed", "3"];
    run("coordinator", args).expect_success();
    let toml = std::fs::read_to_string(experiment.path("exp.toml")).unwrap();
    let root = crate::experiments::clouds().display().to_string();
    let moved = toml.replace(&root, "elsewhere").replace("name = \"short\"", "name = \"moved\"");
    std::fs::write(copy.path("exp.toml"), moved).unwrap();
    assert_eq!(base, digest(&copy.run("out", &[]).expect_success()));

    let list = std::path::Path::new(&data).join("test.txt");
    let text = std::fs::read_to_string(&list).unwrap();
    let (_, shorter) = text.split_once('\n').unwrap();
    std::fs::write(&list, shorter).unwrap();
    assert_ne!(base, digest(&copy.run("shorter", &[]).expect_success()));
    // The finished run of the longer list is not passed off as one of the shorter.
    let stale = copy.run("out", &[]).expect_error();
    assert!(stale.stderr.contains("is a run of other clouds"), "{stale}");
    assert_ne!(base, digest(&copy.run("out", &["--fresh"]).expect_success()));
}

#[test]
fn narrower_vectors_change_no_digest_and_those_that_are_not_there_are_refused() {
    let experiment = Experiment::new("[stop]\ngenerations = 2\n");
    let with = |vectors: &str, out: &str| {
        let mut command = program("coordinator");
        command.args(experiment.run_args(out, &["--no-cache"])).env("DESCRY_VECTORS", vectors);
        finish(&mut command)
    };
    let widest = digest(&with("", "widest").expect_success());
    for vectors in narrower_vectors() {
        assert_eq!(digest(&with(vectors, vectors).expect_success()), widest, "{vectors}");
    }
    let refused = with("v5", "refused").expect_error();
    let expected =
        "error: DESCRY_VECTORS: baseline, or v3 on a processor with AVX2, expected, got v5\nleave it out";
    assert!(refused.stderr.contains(expected), "{refused}");
    let mut worker = program("worker");
    let refused = finish(worker.args(["--coordinator", "http://127.0.0.1:1"]).env("DESCRY_VECTORS", "AVX2"))
        .expect_error();
    assert!(refused.stderr.contains("expected, got AVX2"), "{refused}");
}
