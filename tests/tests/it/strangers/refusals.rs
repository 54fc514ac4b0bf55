//! Workers that are not let in, and coordinators that are not trusted: each is told what to do.

use std::net::TcpStream;
use std::ops::Range;
use std::time::{Duration, SystemTime};
use std::{fs, thread};

use tonic::Code;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_client::HealthClient;
use transport::certs::{Authority, Subject};

use super::{Site, digest, http2};
use crate::experiments::Experiment;
use crate::process::{Finished, Running, finish, program};

/// A worker with this address and these options, which must not get in; the first line of its error is checked by
/// the caller, that it says what to do here.
fn refused(address: &str, more: &[&str]) -> Finished {
    let mut command = program("worker");
    command.args(["--name", "stranger", "--threads", "1", "--no-cache"]).args(more);
    let refused = finish(command.env("DESCRY_COORDINATOR", address)).expect_error();
    let (_, error) = refused.stderr.split_once("error: ").unwrap_or_else(|| panic!("{refused}"));
    assert!(error.trim_end().lines().count() >= 2, "{refused}");
    refused
}

fn check(refused: Finished, message: &str) {
    assert!(refused.stderr.contains(message), "{message}: {refused}");
}

/// What a health probe is told that comes with this address.
async fn probe(address: &str) -> Result<(), Code> {
    let link = worker::link(&address.parse().unwrap(), None).unwrap();
    let checked = HealthClient::new(link).check(HealthCheckRequest::default()).await;
    checked.map(|_| ()).map_err(|status| status.code())
}

#[tokio::test]
async fn health_probes_need_a_credential_too() {
    let site = Site::new(&[]);
    let (mut coordinator, port) = site.coordinator("127.0.0.1");
    let address = site.address(port);
    let silent = TcpStream::connect(("127.0.0.1", port)).unwrap();
    let (public, _) = address.split_once("&token=").unwrap();
    assert_eq!(probe(public).await, Err(Code::Unauthenticated));
    assert_eq!(probe(&address).await, Ok(()));
    coordinator.wait_for("transport: no TLS handshake in time: 1");
    assert_eq!(http2::read_to_end(silent), 0);
    assert_eq!(probe(&address).await, Ok(()));
}

#[test]
fn strangers_are_refused_and_told_what_to_do_and_the_run_goes_on() {
    let site = Site::new(&["expired"]);
    let other = Site::new(&["foreign"]);
    let (mut coordinator, port) = site.coordinator("127.0.0.1");
    let address = site.address(port);
    let (public, _) = address.split_once("&token=").unwrap();
    let (place, _) = address.split_once('#').unwrap();

    let turned = if address.ends_with('0') { '1' } else { '0' };
    check(refused(&format!("{}{turned}", &address[..address.len() - 1]), &[]), "neither a token nor");
    check(refused(public, &[]), "neither a token nor a certificate of this coordinator\ntake the join");
    check(refused(&place.replace("https", "http"), &[]), "speaks TLS only\nuse its join address");
    check(
        refused(&other.address(port), &[]),
        "not the one of the join address: its CA must have the fingerprint",
    );
    check(refused(&format!("{}#token={}", place.replace("https", "http"), "0".repeat(64)), &[]), "https://");

    let foreign = other.experiment.path("tls/workers/foreign");
    check(refused(public, &["--tls", &foreign]), "refuses the certificate of this worker");
    let expired = site.experiment.path("tls/workers/expired");
    let now = SystemTime::now();
    let day = Duration::from_secs(24 * 3600);
    let authority = Authority::read(site.experiment.path("tls").as_ref()).unwrap();
    let certified = authority.certify(&Subject::Worker("expired".to_owned()), &(now - 2 * day..now - day));
    let certified = certified.unwrap();
    fs::write(format!("{expired}/cert.pem"), certified.chain).unwrap();
    fs::write(format!("{expired}/key.pem"), certified.key).unwrap();
    check(refused(public, &["--tls", &expired]), "CertificateExpired");

    for fired in ["transport: not let in: 1", "transport: no TLS handshake: 1"] {
        coordinator.wait_for(fired);
    }
    let mut honest = program("worker");
    honest.args(["--name", "honest", "--threads", "2", "--no-cache"]);
    honest.env("DESCRY_COORDINATOR", &address);
    let _honest = Running::spawn(site.experiment.folder(), "honest", honest);
    assert_eq!(digest(&coordinator.wait().expect_success()), site.undisturbed());
}

#[test]
fn coordinators_with_wrong_certificates_are_not_trusted() {
    // Of other names.
    let site = Site::of_host("gpu-host", &[]);
    let (_coordinator, port) = site.coordinator("127.0.0.2");
    let address = site.address(port).replace("gpu-host", "127.0.0.2");
    check(refused(&address, &[]), "certificate is for other names");

    // Expired: long ago, and while the coordinator runs.
    let site = Site::new(&[]);
    let now = SystemTime::now();
    let day = Duration::from_secs(24 * 3600);
    let authority = Authority::read(site.experiment.path("tls").as_ref()).unwrap();
    let valid = |valid: Range<SystemTime>| {
        let subject = Subject::Coordinator(vec!["127.0.0.1".to_owned()]);
        let certified = authority.certify(&subject, &valid).unwrap();
        fs::write(site.experiment.path("tls/cert.pem"), certified.chain).unwrap();
        fs::write(site.experiment.path("tls/key.pem"), certified.key).unwrap();
    };
    valid(now - 2 * day..now - day);
    let tls = site.experiment.path("tls");
    let ended = site.experiment.run("expired", &["--tls", &tls]).expect_error();
    assert!(ended.stderr.contains("cert.pem that no worker will accept"), "{ended}");
    let end = now + Duration::from_secs(15);
    valid(now - day..end);
    let (_coordinator, port) = site.coordinator("127.0.0.1");
    while SystemTime::now() <= end + Duration::from_secs(1) {
        thread::sleep(Duration::from_millis(100));
    }
    check(refused(&site.address(port), &[]), "certificate is out of date");

    // Without any.
    let experiment = Experiment::new("");
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let mut plain = Running::start(experiment.folder(), "plain", "coordinator", args);
    let line = plain.wait_for("workers may join with");
    let port = line.rsplit(':').next().unwrap().parse().unwrap();
    check(refused(&site.address(port), &["--patience", "0"]), "does not speak TLS");
}
