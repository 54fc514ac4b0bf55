//! As many honest workers as there may be behind one address, each with a connection of its own.

use std::fs;
use std::time::Duration;

use proto::JoinAddress;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_client::HealthClient;

use super::Site;

/// Connections, or fewer where processes may not have so many files open.
fn connections() -> usize {
    let limits = fs::read_to_string("/proc/self/limits").unwrap();
    let line = limits.lines().find_map(|line| line.strip_prefix("Max open files")).unwrap();
    let soft = line.split_whitespace().next().unwrap().parse().unwrap_or(usize::MAX);
    let connections = soft.saturating_sub(512).min(2000);
    if connections < 2000 {
        eprintln!("only {connections} connections: `ulimit -n` is {soft}");
    }
    connections
}

/// Calls until it is let in, as a worker does.
async fn arrive(address: JoinAddress) -> worker::Link {
    let link = worker::link(&address, None).unwrap();
    let mut health = HealthClient::new(link.clone());
    while let Err(status) = health.check(HealthCheckRequest::default()).await {
        assert_eq!(status.code(), tonic::Code::Unavailable, "{status:?}");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    link
}

#[tokio::test(flavor = "multi_thread")]
async fn two_thousand_workers_behind_one_address_are_let_in_at_once_and_stay() {
    let site = Site::new(&[]);
    let (coordinator, port) = site.coordinator("127.0.0.1");
    let address: JoinAddress = site.address(port).parse().unwrap();
    let before = coordinator.resident().unwrap();
    let arriving: Vec<_> = (0..connections()).map(|_| tokio::spawn(arrive(address.clone()))).collect();
    let mut links = Vec::new();
    for link in arriving {
        links.push(link.await.unwrap());
    }
    // All of them are there at the same time, and served.
    for link in &links {
        HealthClient::new(link.clone()).check(HealthCheckRequest::default()).await.unwrap();
    }
    let grown = coordinator.resident().unwrap() - before;
    println!("{} connections with TLS: {grown} KiB more in the coordinator", links.len());
}
