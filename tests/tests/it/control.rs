//! Orders to runs that go on: what they do, to whom, and that they leave results alone.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use crate::experiments::{Experiment, begun, digest, summary};
use crate::process::{Finished, PATIENCE, Running, run};
use crate::strangers::Site;

/// Long enough to do something to it while it runs.
const SEARCH: &str = "[search]\nmethod = \"random\"\n[ga]\npopulation = 8\n[stop]\ngenerations = 200\n\
    stagnation = \"off\"\nvalidation_patience = \"off\"\n[coordinator]\naudit = 0\n";

/// A sweep of two runs.
const SWEEP: &str = "[ga]\npopulation = 8\n[stop]\ngenerations = 6\nstagnation = \"off\"\n\
    validation_patience = \"off\"\n[coordinator]\naudit = 0\n";

/// Orders something of a run.
fn control(folder: &str, order: &[&str]) -> Finished {
    let args = [&["control", folder], order, &["--reason", "for a test"]].concat();
    run("coordinator", args)
}

/// The same; what it says.
#[track_caller]
fn ordered(folder: &str, order: &[&str]) -> String {
    let finished = control(folder, order).expect_success();
    assert_eq!(finished.stdout.lines().count(), 1, "{finished}");
    finished.stdout.trim_end().to_owned()
}

/// The same, where it is refused with this.
#[track_caller]
fn refused(folder: &str, order: &[&str], expected: &str) {
    let finished = control(folder, order).expect_error();
    assert_eq!(finished.status.code(), Some(1), "{finished}");
    assert!(finished.stderr.contains(expected) && finished.stderr.lines().count() > 1, "{finished}");
}

/// Waits until something is the case.
#[track_caller]
fn wait_until(what: &str, state: impl Fn() -> bool) {
    let begun = Instant::now();
    while !state() {
        assert!(begun.elapsed() < PATIENCE, "not in time: {what}");
        thread::sleep(Duration::from_millis(20));
    }
}

/// How many jobs a worker has begun.
fn jobs(worker: &Running) -> usize {
    begun(&worker.log()).values().sum()
}

/// How many generations a coordinator has complete.
fn generations(coordinator: &Running) -> usize {
    coordinator.log().lines().filter(|line| line.starts_with("generation ")).count()
}

/// Waits until a coordinator has completed so many generations more.
#[track_caller]
fn pass(coordinator: &Running, more: usize) {
    let before = generations(coordinator);
    wait_until("more generations", || generations(coordinator) >= before + more);
}

/// Rows of a run's table of events that this program's operators have caused: event, worker and message.
fn events(folder: &str) -> Vec<(String, Option<String>, String)> {
    let frame = results::read_table(folder, results::TableName::Events).unwrap();
    let text = |name: &str| -> Vec<Option<String>> {
        frame.column(name).unwrap().str().unwrap().iter().map(|cell| cell.map(str::to_owned)).collect()
    };
    let rows = text("event").into_iter().zip(text("worker")).zip(text("message"));
    let rows = rows.map(|((event, worker), message)| (event.unwrap(), worker, message.unwrap()));
    rows.filter(|(.., message)| message.contains(": for a test")).collect()
}

#[test]
fn a_run_that_is_controlled_in_every_way_ends_with_the_digest_of_one_that_is_not() {
    let experiment = Experiment::new(SEARCH);
    let undisturbed = experiment.run("undisturbed", &["--local-workers", "1"]).expect_success();
    let (out, file) = (experiment.path("out"), experiment.path("events.jsonl"));
    let args = experiment.run_args("out", &["--local-workers", "0", "--events", &file]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let [mut one, two] = ["one", "two"].map(|name| experiment.worker(name, &address));
    wait_until("both at work", || jobs(&one) > 0 && jobs(&two) > 0);

    // Drained: it ends what it has, and what follows goes to the other.
    let said = ordered(&out, &["drain", "two"]);
    let drained = jobs(&two);
    let in_hand = match said.strip_prefix("worker two: gets no more jobs, ") {
        Some("has none in hand") => 0,
        Some("ends the one in hand") => 1,
        other => other.and_then(|said| said.split(' ').find_map(|word| word.parse().ok())).expect(&said),
    };
    pass(&coordinator, 5);
    let all = 5 * 8;
    let begun = jobs(&two) - drained;
    assert!(begun <= in_hand && 2 * in_hand < all, "{said}; begun since: {begun}");
    refused(&out, &["drain", "two"], "drain: must be a worker that is given jobs, got two, which is drained");
    refused(
        &out,
        &["drain", "nobody"],
        "worker: must be one that is here, got \"nobody\"\nhere are: one, two",
    );
    assert_eq!(ordered(&out, &["resume", "--worker", "two"]), "worker two: is given jobs again");
    wait_until("at work again", || jobs(&two) > drained + in_hand);

    // Paused: nobody is given anything, whoever joins.
    assert!(ordered(&out, &["pause"]).starts_with("paused: "));
    refused(&out, &["pause"], "pause: must be a run that goes on, got one that is paused\nresume");
    let three = experiment.worker("three", &address);
    coordinator.wait_for("worker three: joined");
    ordered(&out, &["drain", "three"]); // two looks have passed since the pause, and it has asked for jobs
    ordered(&out, &["resume", "--worker", "three"]);
    refused(&out, &["priority", "3"], "priority: must be of one run of a sweep");
    assert_eq!(jobs(&three), 0);

    // Denied: it is gone, and does not come back. While the run is paused, as it must not end before it is stopped.
    let said = ordered(&out, &["deny", "one"]);
    assert!(said.ends_with("let in no more as long as this coordinator is at work"), "{said}");
    let ended = one.wait().expect_error();
    assert!(ended.stderr.contains("this worker was denied by whoever runs the coordinator"), "{ended}");
    assert_eq!(ordered(&out, &["resume"]), "resumed");
    wait_until("given a job", || jobs(&three) > 0);

    // Stopped: as an interrupt ends it, and the same command goes on.
    refused(&out, &["resume"], "resume: must be a run that is paused");
    assert_eq!(ordered(&out, &["stop"]), "stopped");
    let stopped = coordinator.wait().expect_error();
    assert_eq!(stopped.status.code(), Some(130), "{stopped}");
    assert!(stopped.stderr.contains(": for a test\ngo on: the same command again, or coordinator resume "));
    assert!(!stopped.stderr.contains("generation 200/200"), "too late: {stopped}");
    for line in
        [" paused by ", "worker two: drained by ", "worker one: denied by ", "worker two: resumed by "]
    {
        let line = line.trim_start();
        assert_eq!(stopped.stderr.matches(line).count(), 1, "{line}: {stopped}");
    }
    refused(&out, &["pause"], "no coordinator is at work on it\nlet it go on: coordinator resume ");
    let args = ["resume", &out, "--listen", "127.0.0.1:0", "--local-workers", "1", "--json"];
    let finished = run("coordinator", args).expect_success();
    assert_eq!(digest(&finished), digest(&undisturbed), "{finished}");
    refused(&out, &["pause"], "is finished\nonly a run that goes on can be controlled");
    refused(&experiment.path("nowhere"), &["pause"], "holds no run\nname the folder of a run");
    assert!(!Path::new(&out).join("control").exists());

    let (rows, named) = (events(&out), |worker: &str| Some(worker.to_owned()));
    let told: Vec<(&str, Option<String>)> =
        rows.iter().map(|(event, worker, _)| (event.as_str(), worker.clone())).collect();
    let expected = [
        ("drained", named("two")),
        ("resumed", named("two")),
        ("paused", None),
        ("drained", named("three")),
        ("resumed", named("three")),
        ("denied", named("one")),
        ("resumed", None),
        ("stopped", None),
    ];
    assert_eq!(told, expected);
    assert!(rows.iter().all(|(.., message)| message.contains(" by ") && message.contains('@')), "{rows:?}");
    let lines = fs::read_to_string(&file).unwrap();
    assert_eq!(lines.matches("\"event\":\"controlled\"").count(), expected.len(), "{lines}");
    run("coordinator", ["verify", &out]).expect_success();
}

#[test]
fn runs_of_a_sweep_are_paused_and_put_first_each_for_itself_and_stopped_together() {
    let sweep = Experiment::new(&format!("{SWEEP}[sweep]\nseeds = [1, 2]\n"));
    let out = sweep.path("out");
    let [first, second] = [1, 2].map(|seed| sweep.path(&format!("out/seed-{seed}")));
    let args = sweep.run_args("out", &["--local-workers", "0"]);
    let mut coordinator = Running::start(sweep.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    // Before there is any worker.
    coordinator.wait_for("waiting for a worker");
    assert!(ordered(&first, &["pause"]).starts_with("seed-1: paused: "));
    coordinator.wait_for("seed-1: paused by ");
    assert_eq!(ordered(&second, &["priority", "100"]), "seed-2: priority 100");
    refused(&out, &["priority", "3"], "priority: must be of one run of a sweep");
    refused(
        &first,
        &["stop"],
        "stop: must be of a whole sweep, got one of its runs\nname the sweep's folder",
    );
    let mut worker = sweep.worker("one", &address);
    coordinator.wait_for("seed-2: finished after generation");
    assert!(!coordinator.log().contains("seed-1: generation"), "{}", coordinator.log());
    refused(&second, &["pause"], "seed-2: is finished\n");
    let before = jobs(&worker);
    ordered(&out, &["stop"]);
    let stopped = coordinator.wait().expect_error();
    assert_eq!(stopped.status.code(), Some(130), "{stopped}");
    assert_eq!(jobs(&worker), before);
    worker.signal("TERM");
    worker.wait().expect_success();

    // The next start knows of no pause.
    let args = ["resume", &out, "--listen", "127.0.0.1:0", "--local-workers", "1", "--json"];
    let finished = run("coordinator", args).expect_success();
    let digests: BTreeSet<String> = finished
        .stdout
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["run_digest"].to_string())
        .collect();
    let alone = Experiment::new(SWEEP);
    let digest_of = |seed: &str| digest(&alone.run(seed, &["--seed", seed]).expect_success()).to_string();
    assert_eq!(digests, ["1", "2"].map(digest_of).into());
    let told: Vec<String> = events(&first).into_iter().map(|(event, ..)| event).collect();
    assert_eq!(told, ["paused", "priority", "stopped"]);
}

#[test]
fn files_that_are_no_requests_are_answered_and_those_of_an_earlier_start_are_not_carried_out() {
    let experiment = Experiment::new(SEARCH);
    let (out, folder) = (experiment.path("out"), Path::new(&experiment.path("out")).join("control"));
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "first", "coordinator", args.clone());
    let address = coordinator.join_address();
    coordinator.wait_for("waiting for a worker");
    ordered(&out, &["pause"]);
    let file = |kind: &str, number: u32| folder.join(format!("{kind}-{number:016x}.json"));
    let stop = r#"{"version":1,"action":"stop","by":"jo@lab","reason":"stale"}"#;
    fs::create_dir_all(&folder).unwrap();
    for (number, bytes) in [
        (1, b"{".to_vec()),
        (2, vec![b'x'; 1 << 20]),
        (3, stop.replace("stop", "priority").into_bytes()),
        (4, vec![0xff; 100]),
        (5, stop.replace("jo@lab", "\\u202e").into_bytes()),
        (6, stop.replace(":1", ":7").into_bytes()),
        (7, stop.replace("\"by\"", "\"member\":\"seed-1\",\"by\"").replace("stop", "pause").into_bytes()),
    ] {
        fs::write(file("request", number), bytes).unwrap();
    }
    std::os::unix::fs::symlink("/dev/zero", file("request", 8)).unwrap();
    fs::create_dir(file("request", 9)).unwrap();
    fs::write(folder.join("notes.txt"), "mine").unwrap();
    for number in 1..=9 {
        wait_until("an answer", || file("answer", number).exists());
        let answer = fs::read_to_string(file("answer", number)).unwrap();
        assert!(answer.starts_with("{\"error\":\""), "{number}: {answer}");
        assert!(fs::symlink_metadata(file("request", number)).is_err(), "{number}");
    }
    // It is as well as before.
    ordered(&out, &["resume"]);
    let worker = experiment.worker("one", &address);
    coordinator.wait_for("generation 2/200");
    coordinator.signal("KILL");
    coordinator.wait();
    drop(worker);

    fs::write(file("request", 1), stop).unwrap();
    let finished = experiment.run("out", &["--local-workers", "1"]).expect_success();
    assert!(!finished.stderr.contains("stale"), "{finished}");
    let left: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["notes.txt"]);
    assert!(events(&out).iter().all(|(.., message)| !message.contains("stale")));
}

#[test]
fn a_coordinator_that_does_not_answer_is_told_of_and_the_request_taken_back() {
    let experiment = Experiment::new(SEARCH);
    let out = experiment.path("out");
    let args = experiment.run_args("out", &["--local-workers", "1"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    coordinator.wait_for("generation 2/200");
    coordinator.signal("STOP");
    refused(&out, &["stop", "--wait", "1"], "no coordinator took the request within 1 s\nit was taken back");
    assert_eq!(fs::read_dir(Path::new(&out).join("control")).unwrap().count(), 0);
    coordinator.signal("CONT");
    refused(
        &out,
        &["deny", "local"],
        "deny: must be a worker of another process, got local, which is the coord",
    );
    for (reason, expected) in [("", "1 to 200 printable"), ("a\u{7}", "1 to 200 printable")] {
        let bad = run("coordinator", ["control", &out, "pause", "--reason", reason]).expect_error();
        assert!(bad.stderr.contains(expected), "{bad}");
    }
    let finished = coordinator.wait().expect_success();
    assert_eq!(summary(&finished)["generations"], 200, "{finished}");
}

#[test]
fn the_certificate_of_a_denied_worker_goes_onto_the_deny_list() {
    let site = Site::with(Experiment::new(SEARCH), "127.0.0.1", &["lab-1"]);
    let args = site.experiment.run_args("out", &["--local-workers", "0"]);
    let (mut coordinator, port) = site.start("coordinator", "127.0.0.1", args);
    let mut worker = site.certified("lab-1", port);
    let joined = coordinator.wait_for("worker lab-1: joined");
    let (_, fingerprint) = joined.split_once(", with certificate ").unwrap();
    coordinator.wait_for("generation 2/200");
    let said = ordered(&site.experiment.path("out"), &["deny", "lab-1"]);
    assert!(said.ends_with("tls/deny has its certificate now"), "{said}");
    worker.wait().expect_error();
    let list = fs::read_to_string(site.experiment.path("tls/deny")).unwrap();
    let line = list.lines().last().unwrap();
    assert!(line.starts_with(&format!("{fingerprint} # by ")) && line.ends_with(": for a test"), "{list}");
    // Another worker with the same certificate.
    let again = site.certified("lab-1", port).wait().expect_error();
    assert!(again.stderr.contains("on the coordinator's deny list"), "{again}");
}

/// A grid of 480 cells, long enough to do something to it.
const GRID: &str = "[descriptor.genes]\nshape_bins = { min = 8, max = 64, step = 28 }\nm = { min = 3, max = 4, step = 1 }\n\
    R1 = { min = 0.5, max = 2.0, step = 0.1 }\nR2 = { min = 2.1, max = 5.0, step = 0.1 }\n\
    w = { min = 0.0, max = 1.0, step = 0.5 }\n[coordinator]\naudit = 0\n";

#[test]
fn a_grid_that_is_controlled_is_the_same_grid_and_keeps_who_ordered_what() {
    let experiment = Experiment::new(GRID);
    let arguments = |out: &str, more: &[&str]| {
        let (toml, out) = (experiment.path("exp.toml"), experiment.path(out));
        let args = ["exhaust", &toml, "--out", &out, "--listen", "127.0.0.1:0", "--json"];
        [&args[..], more].concat().into_iter().map(str::to_owned).collect::<Vec<String>>()
    };
    let undisturbed =
        run("coordinator", arguments("undisturbed", &["--local-workers", "1"])).expect_success();
    let out = experiment.path("out");
    let alone = arguments("out", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", alone);
    let address = coordinator.join_address();
    coordinator.wait_for("waiting for a worker");

    // Paused before anybody is there: nobody is given anything, whoever joins.
    assert!(ordered(&out, &["pause"]).starts_with("paused: "));
    refused(&out, &["pause"], "pause: must be a run that goes on, got one that is paused\nresume");
    refused(&out, &["priority", "3"], "priority: must be of one run of a sweep, got a grid\n");
    let [mut one, two] = ["one", "two"].map(|name| experiment.worker(name, &address));
    for name in ["one", "two"] {
        coordinator.wait_for(&format!("worker {name}: joined"));
    }
    ordered(&out, &["drain", "two"]); // a look later, both have asked for jobs
    assert_eq!((jobs(&one), jobs(&two)), (0, 0));
    assert_eq!(ordered(&out, &["resume"]), "resumed");
    let cells = || fs::read_dir(Path::new(&out).join("cells")).map_or(0, Iterator::count);
    wait_until("some cells", || cells() >= 3);
    // A worker that stands still keeps the grid from its end until the order is there.
    one.signal("STOP");
    ordered(&out, &["pause"]);
    one.signal("CONT");
    assert_eq!(jobs(&two), 0, "drained");
    assert_eq!(ordered(&out, &["resume", "--worker", "two"]), "worker two: is given jobs again");
    ordered(&out, &["deny", "one"]);
    let ended = one.wait().expect_error();
    assert!(ended.stderr.contains("this worker was denied by whoever runs the coordinator"), "{ended}");
    assert_eq!(jobs(&two), 0, "paused");
    ordered(&out, &["resume"]);
    wait_until("at work again", || jobs(&two) > 0);
    two.signal("STOP");
    assert_eq!(ordered(&out, &["stop"]), "stopped");
    let stopped = coordinator.wait().expect_error();
    assert_eq!(stopped.status.code(), Some(130), "{stopped}");
    assert!(stopped.stderr.contains(": for a test\ngo on: the same command again"), "{stopped}");
    assert!(!Path::new(&out).join("grid/grid.parquet").exists(), "too late: {stopped}");
    refused(
        &out,
        &["pause"],
        "no coordinator is at work on it\nlet it go on: the same coordinator exhaust again",
    );

    let finished = run("coordinator", arguments("out", &["--local-workers", "1"])).expect_success();
    for key in ["grid_digest", "best", "best_object_correct", "optimal_descriptors"] {
        assert_eq!(summary(&finished)[key], summary(&undisturbed)[key], "{key}");
    }
    assert!(summary(&finished)["grid_digest"].is_string());
    refused(&out, &["pause"], "is finished\nonly a run that goes on can be controlled");
    assert!(!Path::new(&out).join("control").exists());
    let (rows, named) = (events(&out), |worker: &str| Some(worker.to_owned()));
    let told: Vec<(&str, Option<String>)> =
        rows.iter().map(|(event, worker, _)| (event.as_str(), worker.clone())).collect();
    let expected = [
        ("paused", None),
        ("drained", named("two")),
        ("resumed", None),
        ("paused", None),
        ("resumed", named("two")),
        ("denied", named("one")),
        ("resumed", None),
        ("stopped", None),
    ];
    assert_eq!(told, expected);
    assert!(rows.iter().all(|(.., message)| message.contains(" by ") && message.contains('@')), "{rows:?}");
}
