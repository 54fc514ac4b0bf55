//! The `worker` program: options, connection, signals.

use std::convert::Infallible;
use std::fmt;
use std::path::PathBuf;
use std::process::ExitCode;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use cache::{ByteSize, StorageArgs, Store};
use clap::{Command, Parser, ValueEnum};
use descriptor::EVALUATION_VERSION;
use proto::JoinAddress;
use tokio::signal::unix::{self, SignalKind};

use crate::command_line;
use crate::identity::{BUILD, Identity};
use crate::join_file::{JoinFile, encrypted_if_shown, read_address};
use crate::lifetime::{Leaving, LifetimeLimits};
use crate::link::{Coordinator, warn_if_plain};
use crate::log::{self, LogFormat};
use crate::names::Names;
use crate::run::{self, Options};
use crate::trace;

/// Where `--tls` has an address, too.
const JOIN_FILE: &str = "join";
/// A worker with less memory for clouds is of little use.
const LITTLE_MEMORY: ByteSize = ByteSize::mib(64);

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
struct Cli {
    /// Address of the coordinator, for example http://192.0.2.7:7700; one with a token belongs in the environment or
    /// a file, because every user of a machine can read the arguments of its programs
    #[arg(long, env = "DESCRY_COORDINATOR", hide_env_values = true, value_name = "URL")]
    coordinator: Option<Address>,
    /// File that holds the address of the coordinator, for example join; the worker waits for it, and reads it again
    /// whenever it looks for the coordinator
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
    /// When a run has ended, wait for the next one at the same address, for example as a service; by default the worker
    /// exits
    #[arg(long)]
    stay: bool,
    /// Seconds without a job after which the worker exits, whether there is none or the coordinator is out of reach, for
    /// example 900; by default it waits for ever
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..))]
    idle_timeout: Option<u64>,
    /// Seconds after which the worker has left, for example 3500 of an allocation of an hour; what it has not finished by
    /// then is handed back
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..))]
    lifetime: Option<u64>,
    /// A worker takes no more jobs from a moment on that is chosen at random in the last so many seconds of its lifetime,
    /// so that workers started together do not all leave at once, for example 300; by default a tenth of it
    #[arg(long, value_name = "SECONDS", requires = "lifetime")]
    lifetime_stagger: Option<u64>,
    /// What follows when the worker was told to stop by SIGTERM and has handed its jobs back: exit with 0, or wait to be
    /// killed, because Slurm does not queue a job again that has ended well: for example requeue where a job can be
    /// preempted
    #[arg(
        long,
        value_name = "exit|requeue",
        value_enum,
        hide_possible_values = true,
        default_value = "exit"
    )]
    on_term: OnTerm,
    /// The log as text, or as json, one object a line, for a program that collects logs, for example json
    #[arg(long, value_name = "FORMAT", value_enum, hide_possible_values = true, default_value_t)]
    log_format: LogFormat,
    #[command(flatten)]
    storage: StorageArgs,
}

/// What follows SIGTERM.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum OnTerm {
    Exit,
    Requeue,
}

/// The command line of the program, under this name and built from this commit.
pub fn command(names: Names, commit: &str) -> Command {
    command_line::command::<Cli>(names.worker(), names, commit)
}

/// Runs the program, built from this commit, until it is told to stop or there is nothing left to do; an error goes to
/// standard error.
pub fn main(commit: &str) -> ExitCode {
    match run(command_line::parse(command(Names::of_this_process(), commit))) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            log::say(format_args!("error: {error}"));
            ExitCode::FAILURE
        }
    }
}

fn run(cli: Cli) -> anyhow::Result<()> {
    log::start(cli.log_format, "info", || trace::layer("descry-worker"));
    trace::announce();
    descriptor::wide::check_environment()?;
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    let done = runtime.block_on(serve(cli));
    // A running job is abandoned: its lease was handed back.
    runtime.shutdown_background();
    trace::stop();
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
    let (coordinator, join_file) = find_coordinator(&cli)?;
    let storage = cli.storage.resolve();
    if let Some(url) = &storage.bucket {
        anyhow::bail!(
            "--shared: a worker needs no bucket, as its coordinator gives it URLs, got {url}\nleave it out here, and start the coordinator with it"
        );
    }
    tracing::info!(
        "{BUILD}, evaluation version {EVALUATION_VERSION}, {} {}, {threads} threads, memory for clouds: {} (--memory)",
        std::env::consts::OS,
        std::env::consts::ARCH,
        storage.memory
    );
    if storage.memory < LITTLE_MEMORY {
        tracing::warn!(
            "with so little memory, clouds are read from the cache for each evaluation: give this worker more"
        );
    }
    let options = Options {
        store: Arc::new(Store::open(&storage, &name, EVALUATION_VERSION)),
        identity: Identity { name, threads },
        memory: storage.memory,
        source_blobs: true,
        patience: cli.patience.map(Duration::from_secs),
        lifetime: cli.lifetime_limits(),
        stay: cli.stay,
        join_file,
    };
    let (mut signals, mut last) = (Signals::listen()?, None);
    let left = run::run(coordinator.link(), options, async { last = Some(signals.next().await) }).await?;
    if (left, last, cli.on_term) == (Leaving::Stopped, Some(Signal::Terminate), OnTerm::Requeue) {
        tracing::info!(
            "all jobs are handed back: waiting to be killed, so that this job is queued again (--on-term requeue)"
        );
        while signals.next().await != Signal::Interrupt {}
    }
    Ok(())
}

impl Cli {
    fn lifetime_limits(&self) -> LifetimeLimits {
        let lifetime = self.lifetime.map(Duration::from_secs);
        let tenth = lifetime.map_or(Duration::ZERO, |lifetime| lifetime / 10);
        LifetimeLimits {
            lifetime,
            stagger: self.lifetime_stagger.map_or(tenth, Duration::from_secs),
            idle: self.idle_timeout.map(Duration::from_secs),
        }
    }
}

/// Where the coordinator is, from the first of `--coordinator-file`, `--coordinator` and the folder of `--tls`; with a file
/// that is looked at again.
fn find_coordinator(cli: &Cli) -> anyhow::Result<(Coordinator, Option<JoinFile>)> {
    if std::env::args_os().any(|argument| argument.to_string_lossy().contains("token=")) {
        tracing::warn!(
            "every user of this machine can read the token in the list of processes: give the address with --coordinator-file or DESCRY_COORDINATOR"
        );
    }
    let join = cli.tls.as_ref().map(|folder| folder.join(JOIN_FILE));
    let (file, address) = match (&cli.coordinator_file, &cli.coordinator, join) {
        (Some(file), _, _) if !file.exists() => {
            tracing::info!("waiting for {}", file.display());
            (Some(file.clone()), None)
        }
        (Some(file), _, _) => (Some(file.clone()), Some(read_address(file).map_err(anyhow::Error::msg)?)),
        (None, Some(Address(address)), _) => (None, Some(address.clone())),
        (None, None, Some(file)) => (None, Some(read_address(&file).map_err(anyhow::Error::msg)?)),
        (None, None, None) => anyhow::bail!(
            "--coordinator: which one, got no address\ngive its address, or a file that holds it with --coordinator-file"
        ),
    };
    let coordinator = Coordinator::default();
    if let Some(address) = address {
        let address: JoinAddress = address.parse()?;
        encrypted_if_shown(&address, cli.tls.as_deref()).map_err(anyhow::Error::msg)?;
        coordinator.move_to(&address, cli.tls.as_deref())?;
        if file.is_none() {
            tracing::info!("looking for the coordinator at {address}");
            warn_if_plain(&address);
        }
    }
    let file = file.map(|file| JoinFile::new(file, cli.tls.clone(), coordinator.clone()));
    Ok((coordinator, file))
}

/// A request to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Signal {
    /// SIGTERM.
    Terminate,
    /// Ctrl-C.
    Interrupt,
}

/// The requests to stop that this process gets.
struct Signals {
    terminate: unix::Signal,
    interrupt: unix::Signal,
}

impl Signals {
    fn listen() -> anyhow::Result<Self> {
        let listen = |kind, name| unix::signal(kind).with_context(|| format!("cannot listen for {name}"));
        Ok(Self {
            terminate: listen(SignalKind::terminate(), "SIGTERM")?,
            interrupt: listen(SignalKind::interrupt(), "Ctrl-C")?,
        })
    }

    async fn next(&mut self) -> Signal {
        tokio::select! {
            _ = self.terminate.recv() => Signal::Terminate,
            _ = self.interrupt.recv() => Signal::Interrupt,
        }
    }
}
