//! Workers that are shown out while the run goes on.

use std::fs;

use super::{Site, digest};
use crate::process::{Running, program};

#[test]
fn a_revoked_worker_is_shown_out_at_once_and_another_does_its_work() {
    let site = Site::new(&["lab-1", "lab-2"]);
    let (mut coordinator, port) = site.coordinator("127.0.0.1");
    let mut first = site.certified("lab-1", port);
    let joined = coordinator.wait_for("worker lab-1: joined");
    let (_, fingerprint) = joined.split_once(", with certificate ").unwrap();
    coordinator.wait_for("generation 2/100");
    first.signal("STOP"); // with a job in hand: the run waits, and its lease would last a minute longer
    fs::write(site.experiment.path("tls/deny"), format!("{fingerprint} # was stolen\n")).unwrap();
    coordinator.wait_for("worker lab-1: denied: is not let in any more");
    coordinator.wait_for("transport: on the deny list: 1 refused so far");
    assert!(!coordinator.log().contains("generation 100/100"), "too late:\n{}", coordinator.log());
    first.signal("CONT");
    let ended = first.wait().expect_error();
    assert!(ended.stderr.contains("on the coordinator's deny list\nask"), "{ended}");
    // It does not get in again either, while others do.
    let again = site.certified("lab-1", port).wait().expect_error();
    assert!(again.stderr.contains("on the coordinator's deny list"), "{again}");
    // A list that is gone or garbled lifts nothing.
    fs::remove_file(site.experiment.path("tls/deny")).unwrap();
    coordinator.wait_for("tls/deny: cannot be read, got No such file");
    fs::write(site.experiment.path("tls/deny"), &fingerprint[..40]).unwrap();
    coordinator.wait_for("is not known by its name");
    let again = site.certified("lab-1", port).wait().expect_error();
    assert!(again.stderr.contains("on the coordinator's deny list"), "{again}");
    let _second = site.certified("lab-2", port);
    assert_eq!(digest(&coordinator.wait().expect_success()), site.undisturbed());
}

#[test]
fn a_denied_token_shows_out_who_came_with_it_and_leaves_the_others_in() {
    let site = Site::new(&["lab-1"]);
    let (mut coordinator, port) = site.coordinator("127.0.0.1");
    let mut command = program("worker");
    command.args(["--name", "by-token", "--threads", "1", "--no-cache"]);
    command.env("DESCRY_COORDINATOR", site.address(port));
    let mut by_token = Running::spawn(site.experiment.folder(), "by-token", command);
    let joined = coordinator.wait_for("worker by-token: joined");
    assert!(joined.ends_with(", with token"), "{joined}");
    coordinator.wait_for("generation 2/100");
    by_token.signal("STOP");
    fs::write(site.experiment.path("tls/deny"), "token\n").unwrap();
    coordinator.wait_for("worker by-token: denied");
    by_token.signal("CONT");
    let ended = by_token.wait().expect_error();
    assert!(ended.stderr.contains("the token is on the coordinator's deny list"), "{ended}");
    let _certified = site.certified("lab-1", port);
    assert_eq!(digest(&coordinator.wait().expect_success()), site.undisturbed());
}

#[test]
fn with_a_deny_list_that_is_missing_or_garbled_no_coordinator_starts() {
    let site = Site::new(&[]);
    let (tls, deny) = (site.experiment.path("tls"), site.experiment.path("tls/deny"));
    let refused = || {
        let refused = site.experiment.run("out", &["--tls", &tls]).expect_error();
        assert!(refused.stderr.contains("tls/deny: must say who is denied, "), "{refused}");
        assert!(refused.stderr.contains("\ncorrect it or restore it from a copy; "), "{refused}");
    };
    for garbled in ["", "lab-1\n", "token\n???\n"] {
        fs::write(&deny, garbled).unwrap();
        refused();
    }
    fs::remove_file(&deny).unwrap();
    refused();
    assert!(!site.experiment.folder().join("out").exists());
    fs::write(&deny, "# nobody\n").unwrap();
    site.experiment.run("out", &["--tls", &tls]).expect_success();
}
