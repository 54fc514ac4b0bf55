//! Secrets let workers in and show up nowhere else.

use std::fs;
use std::path::Path;

use super::{Site, digest};
use crate::process::{Running, program, run};

/// Every file below a folder that contains a text.
fn files_with(folder: &Path, text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files_with(&path, text));
        } else if fs::read(&path).unwrap().windows(text.len()).any(|bytes| bytes == text.as_bytes()) {
            found.push(path.display().to_string());
        }
    }
    found
}

#[test]
fn a_token_and_a_certificate_let_workers_in_and_no_file_or_log_shows_the_token() {
    let site = Site::new(&["lab-1"]);
    let folder = site.experiment.folder();
    let (mut coordinator, port) = site.coordinator("127.0.0.1");
    // With all that a log can say.
    let mut by_token = program("worker");
    by_token.args(["--name", "by-token", "--threads", "1", "--no-cache"]);
    by_token.env("DESCRY_COORDINATOR", site.address(port)).env("DESCRY_LOG", "trace");
    let mut by_token = Running::spawn(folder, "by-token", by_token);
    by_token.wait_for("joined as by-token");
    coordinator.wait_for("generation 2/100");
    by_token.signal("STOP"); // with a job in hand, so that the run cannot end before the other has joined
    let mut by_certificate = site.certified("lab-1", port);
    by_certificate.wait_for("joined as lab-1");
    by_token.signal("CONT");
    let finished = coordinator.wait().expect_success();
    assert_eq!(digest(&finished), site.undisturbed());

    let token = fs::read_to_string(site.experiment.path("tls/token")).unwrap();
    let found = files_with(folder, token.trim());
    let (join, token) = (site.experiment.path("tls/join"), site.experiment.path("tls/token"));
    assert!(found.len() == 2 && found.contains(&join) && found.contains(&token), "{found:?}");
    // Nor does what people are shown of a program that holds it.
    let mut help = program("worker");
    help.arg("--help").env("DESCRY_COORDINATOR", site.address(port));
    let help = crate::process::finish(&mut help).expect_success();
    assert!(!help.stdout.contains("token="), "{help}");
}

#[test]
fn a_token_among_the_arguments_is_warned_of() {
    let site = Site::new(&[]);
    let (_coordinator, port) = site.coordinator("127.0.0.1");
    let args = ["--coordinator", &site.address(port), "--name", "careless", "--threads", "1", "--no-cache"];
    let mut worker = Running::start(site.experiment.folder(), "careless", "worker", args);
    worker.wait_for("every user of this machine can read the token");
    worker.wait_for("joined as careless");
}

#[test]
fn certificates_are_never_overwritten() {
    let site = Site::new(&["lab-1"]);
    let tls = site.experiment.path("tls");
    let address = run("coordinator", ["certs", &tls]).expect_success();
    assert_eq!(address.stdout, fs::read_to_string(site.experiment.path("tls/join")).unwrap());
    let again = run("coordinator", ["certs", &tls, "--worker", "lab-1"]).expect_error();
    assert!(again.stderr.contains("is there already\n"), "{again}");
    let again = run("coordinator", ["certs", &tls, "--host", "other"]).expect_error();
    assert!(again.stderr.contains("is there already, got other\n"), "{again}");
    let foreign = run("coordinator", ["certs", &site.experiment.path("")]).expect_error();
    assert!(foreign.stderr.contains("must be empty or made by `coordinator certs`"), "{foreign}");
    let outside = run("coordinator", ["certs", &tls, "--worker", "../x"]).expect_error();
    assert!(outside.stderr.contains("--worker: must be"), "{outside}");
}
