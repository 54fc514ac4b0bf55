//! Peers that ask for too much while a run goes on: they are stopped, counted, and cost the run nothing.

use std::net::TcpStream;
use std::process::Command;

use proto::v2;
use proto::v2::coordinator_client::CoordinatorClient;
use tonic::Code;
use tonic::transport::Channel;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_client::HealthClient;

use super::{SEARCH, digest, http2};
use crate::experiments::Experiment;
use crate::peer;
use crate::process::{Running, program};

fn introduction(number: u8) -> v2::RegisterRequest {
    peer::introduction([number; 32], &format!("../../stranger-{number}"))
}

async fn connect(address: &str) -> Channel {
    Channel::from_shared(address.to_owned()).unwrap().connect().await.unwrap()
}

/// Registers workers until the coordinator has had enough; returns how many.
async fn flood_registrations(address: &str) -> u8 {
    let mut client = CoordinatorClient::new(connect(address).await);
    for number in 1..=100 {
        if let Err(status) = client.register(introduction(number)).await {
            assert_eq!(status.code(), Code::ResourceExhausted, "{status:?}");
            assert!(status.message().contains("\ntry again in"), "{status:?}");
            return number;
        }
    }
    panic!("100 registrations over one connection");
}

/// A poll of more bytes than any message may have.
async fn send_a_huge_message(address: &str) -> Code {
    let mut client = CoordinatorClient::new(connect(address).await);
    let poll = v2::PollRequest { worker_id: vec![0; proto::MAX_MESSAGE_BYTES + 1], ..Default::default() };
    client.poll(poll).await.unwrap_err().code()
}

/// Asks for derived entries by a path.
async fn ask_for_a_path(address: &str) -> Code {
    let mut client = CoordinatorClient::new(connect(address).await);
    let request = v2::FetchDerivedRequest { kind: "../../../etc/passwd".to_owned(), key: vec![0; 32] };
    client.fetch_derived(request).await.unwrap_err().code()
}

/// Opens ever more streams over one connection; they stay open.
async fn open_many_streams(address: &str) -> Vec<tokio::task::JoinHandle<()>> {
    let channel = connect(address).await;
    let watch = |_| {
        let mut health = HealthClient::new(channel.clone());
        tokio::spawn(async move {
            let watched = health.watch(HealthCheckRequest::default()).await;
            let _open = watched.map(tonic::Response::into_inner);
            std::future::pending().await
        })
    };
    (0..500).map(watch).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn whoever_asks_for_too_much_is_stopped_and_the_run_ends_as_if_alone() {
    let experiment = Experiment::new(SEARCH);
    // Few open files, so that few connections are too many.
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -n 512; exec \"$@\"", "sh"]);
    let coordinator = program("coordinator");
    command.arg(coordinator.get_program()).args(experiment.run_args("out", &["--local-workers", "0"]));
    for (name, value) in coordinator.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    let mut coordinator = Running::spawn(experiment.folder(), "coordinator", command);
    let address = coordinator.join_address();
    let host = address.strip_prefix("http://").unwrap();
    let args = ["--coordinator", &address, "--name", "honest", "--threads", "1", "--no-cache"];
    let honest = Running::start(experiment.folder(), "honest", "worker", args);
    coordinator.wait_for("generation 2/100");
    honest.signal("STOP"); // the run waits for it, for a minute at least

    assert!(flood_registrations(&address).await > 10);
    assert_eq!(send_a_huge_message(&address).await, Code::OutOfRange);
    assert_eq!(ask_for_a_path(&address).await, Code::NotFound);
    let streams = open_many_streams(&address).await;
    let slow = http2::begin_a_poll(host);
    // Connections that say nothing at all: more than are let in.
    let silent: Vec<TcpStream> = (0..100).map(|_| TcpStream::connect(host).unwrap()).collect();
    tokio::task::block_in_place(|| {
        for fired in [
            "transport: too many registrations: 1",
            "transport: too many connections: 1",
            "transport: no call after the handshake: 1",
            "transport: a request that does not end: 1",
        ] {
            coordinator.wait_for(fired);
        }
        assert!(http2::read_to_end(slow) > 0);
        for stream in silent {
            http2::read_to_end(stream);
        }
    });
    // There is room again, beside those who keep their streams open.
    let reply = HealthClient::new(connect(&address).await).check(HealthCheckRequest::default()).await;
    assert!(reply.is_ok(), "{reply:?}");
    assert!(streams.iter().all(|stream| !stream.is_finished()));
    assert!(!coordinator.log().contains("generation 100/100"), "too late:\n{}", coordinator.log());

    honest.signal("CONT");
    let finished = tokio::task::block_in_place(|| coordinator.wait()).expect_success();
    let alone = tokio::task::block_in_place(|| experiment.run("alone", &[])).expect_success();
    assert_eq!(digest(&finished), digest(&alone));
    assert!(!experiment.folder().join("../stranger-1").exists());
}
