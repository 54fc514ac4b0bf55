//! The `worker` program: options, connection, signals.

use std::convert::Infallible;
use std::fmt;
use std::fs::File;
use std::future::Future;
use std::io::{IsTerminal as _, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use cache::{StorageArgs, Store};
use clap::Parser;
use descriptor::EVALUATION_VERSION;
use proto::JoinAddress;

use crate::identity::Identity;
use crate::link::link;
use crate::run::{self, Options};

/// Where `--tls` has an address, too.
const JOIN_FILE: &str = "join";
/// The longest address that is read from a file, bytes.
const MAX_ADDRESS_BYTES: u64 = 4096;

/// An address as it was given, perhaps with a token: no debug output shows it.
#[derive(Clone)]
struct Address(String);

impl FromStr for Address {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(Self(text.to_owned()))
    }
}

impl fmt::Debug for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Address(…)")
    }
}

/// Computes evaluations for a coordinator. May join and leave at any time.
///
/// Example: worker --coordinator http://gpu-host:7700
#[derive(Debug, Parser)]
#[command(name = "worker", version, about, long_about)]
pub struct Cli {
    /// Address of the coordinator, for example http://192.0.2.7:7700; one with a token belongs into the environment or
    /// a file, because every user of a machine can read the arguments of its programs
    #[arg(long, env = "DESCRY_COORDINATOR", hide_env_values = true, value_name = "URL")]
    coordinator: Option<Address>,
    /// File that holds the address of the coordinator, for example join
    #[arg(long, value_name = "FILE")]
    coordinator_file: Option<PathBuf>,
    /// Folder with the certificate that lets this worker in, as `coordinator certs --worker NAME` makes it, for example
    /// lab-pc-3; the address may be in it, too
    #[arg(long, value_name = "DIR")]
    tls: Option<PathBuf>,
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
            // Where standard error is lost, the exit code tells.
            let _ = std::io::stderr().write_all(format!("error: {error}\n").as_bytes());
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
        .log_internal_errors(false) // they would go to standard error, too, and panic where that is lost
        .init();
    descriptor::wide::check_environment()?;
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    let done = runtime.block_on(serve(cli));
    // A running job is abandoned: its lease was handed back.
    runtime.shutdown_background();
    done
}

async fn serve(cli: Cli) -> anyhow::Result<()> {
    let threads = match cli.threads {
        Some(threads) => threads,
        None => std::thread::available_parallelism().map_or(1, |cores| cores.get() as u32),
    };
    let name = match &cli.name {
        Some(name) => name.clone(),
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
    anyhow::ensure!(
        name.chars().all(proto::is_printable),
        "--name: must be printable, got {}\nchoose a name without control and format characters",
        proto::printable(&name)
    );
    let address = join_address(&cli)?;
    warn_of(&address);
    tracing::info!("looking for the coordinator at {address}");
    let link = link(&address, cli.tls.as_deref())?;
    let storage = cli.storage.resolve();
    tracing::info!("memory for clouds: {} (--memory)", storage.memory);
    let options = Options {
        store: Arc::new(Store::open(&storage, &name, EVALUATION_VERSION)),
        identity: Identity { name, threads },
        memory: storage.memory,
        source_blobs: true,
        patience: cli.patience.map(Duration::from_secs),
    };
    run::run(link, options, stop_signal()?).await?;
    Ok(())
}

/// The join address, from the first of `--coordinator-file`, `--coordinator` and the folder of `--tls`.
fn join_address(cli: &Cli) -> anyhow::Result<JoinAddress> {
    let join = cli.tls.as_ref().map(|folder| folder.join(JOIN_FILE));
    let address: JoinAddress = match (&cli.coordinator_file, &cli.coordinator, join) {
        (Some(file), _, _) => read_address(file)?.parse()?,
        (None, Some(Address(address)), _) => address.parse()?,
        (None, None, Some(file)) => read_address(&file)?.parse()?,
        (None, None, None) => anyhow::bail!(
            "--coordinator: which one, got no address\ngive its address, or a file that holds it with --coordinator-file"
        ),
    };
    anyhow::ensure!(
        cli.tls.is_none() || address.trust.is_some(),
        "--tls: needs an encrypted connection, got {address}\nuse a join address that begins with https://"
    );
    Ok(address)
}

/// The first line of a small file.
fn read_address(file: &Path) -> anyhow::Result<String> {
    let advice = "copy the join address that `coordinator certs` has made there";
    let mut text = String::new();
    let read = File::open(file).and_then(|file| file.take(MAX_ADDRESS_BYTES).read_to_string(&mut text));
    read.map_err(|error| anyhow::anyhow!("{}: cannot be read, got {error}\n{advice}", file.display()))?;
    Ok(text.lines().next().unwrap_or_default().trim().to_owned())
}

/// Says what an operator may have overlooked.
fn warn_of(address: &JoinAddress) {
    if address.trust.is_none() && !is_loopback(&address.host) {
        tracing::warn!("the connection is not encrypted: use it inside a trusted network only");
    }
    if std::env::args_os().any(|argument| argument.to_string_lossy().contains("token=")) {
        tracing::warn!(
            "every user of this machine can read the token in the list of processes: give the address with --coordinator-file or DESCRY_COORDINATOR"
        );
    }
}

fn is_loopback(host: &str) -> bool {
    host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|address| address.is_loopback())
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
    fn this_machine_is_told_from_others() {
        for host in ["127.0.0.1", "localhost", "::1", "127.8.8.8"] {
            assert!(is_loopback(host), "{host}");
        }
        for host in ["192.0.2.7", "gpu-host", "2001:db8::1", "127.0.0.1.example"] {
            assert!(!is_loopback(host), "{host}");
        }
    }
}
