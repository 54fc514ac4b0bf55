//! Bring-up, waiting and deadline are the same for every command that has something computed.

use crate::experiments::Experiment;
use crate::process::{Running, run};

const SEARCH: &str = "[ga]\npopulation = 4\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n";
/// What whoever waits says, and how to wait no longer.
const WAITING: &str = "waiting for a worker: none was started here (--local-workers 0)";

#[test]
fn whoever_waits_for_a_worker_says_so_and_why() {
    let experiment = Experiment::new(SEARCH);
    let finished = experiment.path("finished");
    experiment.run("finished", &[]).expect_success();
    let listen = ["--listen", "127.0.0.1:0", "--local-workers", "0"];
    let (file, grid, out) = (experiment.path("exp.toml"), experiment.path("grid"), experiment.path("out"));
    for (name, command) in [
        ("compare", vec!["compare", &finished, "--reason", "test", "--descriptor", "evolved"]),
        ("exhaust", vec!["exhaust", &file, "--out", &grid]),
        ("run", vec!["run", &file, "--out", &out]),
    ] {
        let args = command.into_iter().chain(listen);
        let mut waiting = Running::start(experiment.folder(), name, "coordinator", args);
        waiting.wait_for(WAITING);
        waiting.signal("KILL");
        waiting.wait();
    }
    // What the run was started with holds when it goes on, unless another number is given.
    let args = ["resume", &out, "--listen", "127.0.0.1:0"];
    let mut waiting = Running::start(experiment.folder(), "resume", "coordinator", args);
    waiting.wait_for(WAITING);
    waiting.signal("KILL");
    waiting.wait();
    run("coordinator", args.into_iter().chain(["--local-workers", "1"])).expect_success();
}

#[test]
fn a_grid_search_keeps_to_the_deadline() {
    let experiment = Experiment::new("[coordinator]\ndeadline_seconds = 1\n");
    let (file, out) = (experiment.path("exp.toml"), experiment.path("grid"));
    let args = ["exhaust", &file, "--out", &out, "--listen", "127.0.0.1:0", "--local-workers", "0"];
    let late = run("coordinator", args).expect_error();
    assert_eq!(late.status.code(), Some(5), "{late}");
    assert!(late.stderr.contains("coordinator.deadline_seconds: reached"), "{late}");
}
