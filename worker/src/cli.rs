//! The `worker` program: options, connection, signals.

use std::future::Future;
use std::io::IsTerminal as _;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use clap::Parser;
use tonic::transport::{Endpoint, Uri};

use crate::store::Store;
use crate::{Identity, Options, StorageArgs};

/// The coordinator's port unless an address names another.
const DEFAULT_PORT: u16 = 7700;

/// Computes evaluations for a coordinator. May join and leave at any time.
///
/// Example: worker --coordinator http://gpu-host:7700
#[derive(Debug, Parser)]
#[command(name = "worker", version, about, long_about)]
pub struct Cli {
    /// Address of the coordinator, for example http://192.0.2.7:7700
    #[arg(long, env = "DESCRY_COORDINATOR", value_name = "URL")]
    coordinator: String,
    /// Threads that evaluate, for example 8; all cores by default
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    /// Label in progress and results, for example lab-pc-3; the host's name by default
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    /// Seconds for which the coordinator may be out of reach before the worker gives up, for example 600; by
    /// default it waits for ever
    #[arg(long, value_name = "SECONDS")]
    patience: Option<u64>,
    #[command(flatten)]
    storage: StorageArgs,
}

/// Runs the program until it is told to stop; an error goes to standard error.
pub fn main(cli: Cli) -> ExitCode {
    match run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(cli: Cli) -> anyhow::Result<()> {
    tracing_subscriber::fmt()
        .with_env_filter(
            tracing_subscriber::EnvFilter::try_from_env("DESCRY_LOG").unwrap_or_else(|_| "info".into()),
        )
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .init();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    let done = runtime.block_on(serve(cli));
    // A job in hand is abandoned: its lease was handed back.
    runtime.shutdown_background();
    done
}

async fn serve(cli: Cli) -> anyhow::Result<()> {
    let threads = match cli.threads {
        Some(threads) => threads,
        None => std::thread::available_parallelism().map_or(1, |cores| cores.get() as u32),
    };
    let name = match cli.name {
        Some(name) => name,
        None => {
            hostname::get().map_or_else(|_| "worker".to_owned(), |name| name.to_string_lossy().into_owned())
        }
    };
    anyhow::ensure!(
        name.len() <= proto::MAX_NAME_BYTES,
        "--name: at most {} bytes, got {}\nchoose a shorter name",
        proto::MAX_NAME_BYTES,
        name.len()
    );
    let endpoint = endpoint(&cli.coordinator)?;
    if !is_loopback(endpoint.uri().host().unwrap_or_default()) {
        tracing::warn!("the connection is not encrypted: use it inside a trusted network only");
    }
    tracing::info!(
        "looking for the coordinator at {}",
        endpoint.uri().authority().map_or("", |host| host.as_str())
    );
    let channel = endpoint.connect_lazy();
    let storage = cli.storage.resolve();
    tracing::info!("memory for clouds: {} (--memory)", storage.memory);
    let options = Options {
        store: Arc::new(Store::open(&storage, &name)),
        identity: Identity { name, threads },
        memory: storage.memory,
        source_blobs: true,
        patience: cli.patience.map(Duration::from_secs),
    };
    crate::run(channel, options, stop_signal()?).await?;
    Ok(())
}

/// The connection's settings. Also accepts an address without `http://`, and adds the usual port.
fn endpoint(address: &str) -> anyhow::Result<Endpoint> {
    let wrong = |what: &str| {
        anyhow::anyhow!("--coordinator: {what}, got {address}\nwrite it like http://192.0.2.7:{DEFAULT_PORT}")
    };
    let url = if address.contains("://") { address.to_owned() } else { format!("http://{address}") };
    let uri: Uri = url.parse().map_err(|_| wrong("must be an address"))?;
    match uri.scheme_str() {
        Some("http") => {}
        Some("https") => return Err(wrong("encrypted connections are not supported yet")),
        _ => return Err(wrong("must begin with http://")),
    }
    let authority = uri.authority().filter(|authority| !authority.host().is_empty());
    let Some(authority) = authority.filter(|authority| !authority.as_str().contains('@')) else {
        return Err(wrong("must name a host"));
    };
    if uri.query().is_some() || !matches!(uri.path(), "" | "/") {
        return Err(wrong("must be a host and a port only"));
    }
    // What follows the host must be a port or nothing; the parser lets more pass.
    let port = match authority.as_str().strip_prefix(authority.host()) {
        Some("") => DEFAULT_PORT,
        Some(port) => match port.strip_prefix(':').map(str::parse) {
            Some(Ok(port)) if port > 0 => port,
            _ => return Err(wrong("port must be a number from 1 to 65535")),
        },
        None => return Err(wrong("must be a host and a port only")),
    };
    let endpoint = Endpoint::from_shared(format!("http://{}:{port}", authority.host()));
    Ok(endpoint
        .map_err(|_| wrong("must be an address"))?
        .connect_timeout(Duration::from_secs(5))
        // A cable that was pulled gives no error: ask the other side whether it is still there.
        .http2_keep_alive_interval(Duration::from_secs(10))
        .keep_alive_timeout(Duration::from_secs(10))
        .keep_alive_while_idle(true)
        .tcp_nodelay(true))
}

fn is_loopback(host: &str) -> bool {
    let address = host.trim_start_matches('[').trim_end_matches(']');
    host == "localhost" || address.parse::<std::net::IpAddr>().is_ok_and(|address| address.is_loopback())
}

/// Ready when the process gets SIGTERM or Ctrl-C.
fn stop_signal() -> anyhow::Result<impl Future<Output = ()>> {
    use tokio::signal::unix::{SignalKind, signal};
    let mut terminate = signal(SignalKind::terminate()).context("cannot listen for SIGTERM")?;
    let mut interrupt = signal(SignalKind::interrupt()).context("cannot listen for Ctrl-C")?;
    Ok(async move {
        tokio::select! {
            _ = terminate.recv() => {}
            _ = interrupt.recv() => {}
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_hosts_and_ports() {
        for (address, expected) in [
            ("http://192.0.2.7:7701", "http://192.0.2.7:7701/"),
            ("gpu-host", "http://gpu-host:7700/"),
            ("http://gpu-host/", "http://gpu-host:7700/"),
            ("[::1]:80", "http://[::1]:80/"),
        ] {
            assert_eq!(endpoint(address).unwrap().uri().to_string(), expected);
        }
        for address in [
            "",
            "http://",
            "ht tp://x",
            "ftp://x",
            "https://x",
            "x:99999",
            "x:port",
            "x:0",
            "x:",
            "http://x/path",
            "http://x?y",
            "user@x:1@y",
        ] {
            let error = endpoint(address).map(|endpoint| endpoint.uri().clone()).unwrap_err().to_string();
            assert!(
                error.starts_with("--coordinator: ") && error.contains("\nwrite it like"),
                "{address}: {error}"
            );
        }
    }

    #[test]
    fn this_machine_is_told_from_others() {
        for host in ["127.0.0.1", "localhost", "[::1]", "127.8.8.8"] {
            assert!(is_loopback(host), "{host}");
        }
        for host in ["192.0.2.7", "gpu-host", "[2001:db8::1]", "127.0.0.1.example"] {
            assert!(!is_loopback(host), "{host}");
        }
    }
}
