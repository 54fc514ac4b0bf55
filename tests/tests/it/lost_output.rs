//! Standard output or error that is full or closed: lines are lost, never a run.

use std::fs::File;
use std::io;
use std::process::{Command, Stdio};

use crate::experiments::{Experiment, digest, free_address};
use crate::process::program;

const SHORT: &str = "[ga]\npopulation = 6\n[stop]\ngenerations = 4\n";

/// A full volume.
fn full() -> Stdio {
    File::options().write(true).open("/dev/full").unwrap().into()
}

/// A pipe that nobody reads.
fn closed() -> Stdio {
    let (reader, writer) = io::pipe().unwrap();
    drop(reader);
    writer.into()
}

/// The program with every line that it would log.
fn talkative(name: &str) -> Command {
    let mut command = program(name);
    command.env("DESCRY_LOG", "debug");
    command
}

#[test]
fn a_run_goes_on_without_standard_error_and_so_does_its_worker() {
    let experiment = Experiment::new(SHORT);
    let undisturbed = digest(&experiment.run("undisturbed", &[]).expect_success());
    for (how, stderr) in [("full", full as fn() -> Stdio), ("closed", closed)] {
        // Everything in one process.
        let mut command = talkative("coordinator");
        command.args(experiment.run_args(how, &[])).stderr(stderr()).stdout(Stdio::piped());
        let output = command.spawn().unwrap().wait_with_output().unwrap();
        assert!(output.status.success(), "{how}: {:?}", output.status);
        assert!(String::from_utf8_lossy(&output.stdout).contains(undisturbed.as_str().unwrap()), "{how}");

        // A worker beside it, which waits for the next coordinator afterwards.
        let (address, cache) = (free_address(), experiment.path(&format!("cache-{how}")));
        let mut worker = talkative("worker");
        worker.args(["--coordinator", &address, "--stay", "--threads", "1", "--cache", &cache]);
        worker.stderr(stderr());
        let mut worker = worker.spawn().unwrap();
        let mut command = talkative("coordinator");
        command.args(experiment.run_args_at(&format!("{how}-remote"), &address));
        let output =
            command.stderr(stderr()).stdout(Stdio::piped()).spawn().unwrap().wait_with_output().unwrap();
        assert!(output.status.success(), "{how}: {:?}", output.status);
        assert!(String::from_utf8_lossy(&output.stdout).contains(undisturbed.as_str().unwrap()), "{how}");
        assert_eq!(worker.try_wait().unwrap(), None, "{how}: the worker has ended");
        let terminate = Command::new("kill").args(["-TERM", &worker.id().to_string()]).status();
        assert!(terminate.unwrap().success());
        assert!(worker.wait().unwrap().success(), "{how}");

        // An error still has its exit code.
        for (name, args) in
            [("coordinator", ["check", "/nowhere.toml"]), ("worker", ["--coordinator", "nowhere::"])]
        {
            let mut command = talkative(name);
            let status = command.args(args).stderr(stderr()).stdout(Stdio::null()).status().unwrap();
            assert_eq!(status.code(), Some(1), "{how}: {name}");
        }
    }
}

#[test]
fn a_reader_that_has_seen_enough_is_no_error_and_a_full_volume_is_one() {
    let experiment = Experiment::new(SHORT);
    let finished = experiment.run("out", &[]).expect_success();
    let out = experiment.path("out");
    let query = ["query", &out, "SELECT * FROM evaluations"];
    let again = experiment.run_args("out", &[]);
    let again: Vec<&str> = again.iter().map(String::as_str).collect();
    let schema = ["schema"];
    for args in [&query[..], &again, &schema] {
        let mut command = program("coordinator");
        command.args(args).stderr(Stdio::piped());
        let output = command.stdout(closed()).spawn().unwrap().wait_with_output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && !stderr.contains("error"), "{args:?}: {stderr}");
        let output = command.stdout(full()).spawn().unwrap().wait_with_output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{args:?}: {stderr}");
        assert!(stderr.contains("error: standard output: cannot be written"), "{args:?}: {stderr}");
    }
    assert_eq!(digest(&experiment.run("out", &[]).expect_success()), digest(&finished));
}
