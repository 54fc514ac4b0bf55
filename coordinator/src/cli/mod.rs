//! The `coordinator` program: one command a file.

mod after_run;
mod assess;
mod certs;
mod check;
mod compare;
mod control;
mod dashboard;
mod evaluate;
mod exhaust;
mod export;
mod join_command;
mod keygen;
mod layout;
mod learn;
mod look;
#[cfg(feature = "sql")]
mod memory_limit;
mod prune;
#[cfg(feature = "sql")]
mod query;
mod recognise;
mod rejection;
mod report;
mod resume;
mod run;
mod schema;
mod sign;
mod split;
mod synth;
mod verify;
mod weigh;
mod workers;

use std::process::ExitCode;

use anyhow::Context as _;
use clap::{Parser, Subcommand};

use crate::compare::CompareError;
use crate::console::say;
use crate::run::RunError;
use cluster::ClusterError;
use worker::command_line;
use worker::log::{self, LogFormat};
use worker::names::Names;

/// The exit code that shells have for Ctrl-C, and a run that an operator has stopped.
const INTERRUPTED: u8 = 130;

/// Evolves 3D point-cloud descriptors, on this machine and on as many others as join.
///
/// Example: coordinator run experiments/demo.toml
#[derive(Debug, Parser)]
#[command(name = "coordinator", version, about, long_about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// The log as text, or as json, one object a line, for a program that collects logs, for example json
    #[arg(
        long,
        value_name = "FORMAT",
        value_enum,
        hide_possible_values = true,
        global = true,
        default_value_t
    )]
    log_format: LogFormat,
}

#[derive(Debug, Subcommand)]
enum Command {
    Run(run::Run),
    Resume(resume::Resume),
    Check(check::Check),
    Compare(Box<compare::Compare>),
    Control(control::Control),
    Certs(certs::Certs),
    Evaluate(evaluate::Evaluate),
    Exhaust(exhaust::Exhaust),
    Export(export::Export),
    JoinCommand(join_command::JoinCommand),
    Keygen(keygen::Keygen),
    Learn(learn::Learn),
    #[cfg(feature = "sql")]
    Query(query::Query),
    Dashboard(dashboard::Dashboard),
    Prune(prune::Prune),
    Recognise(recognise::Recognise),
    Assess(assess::Assess),
    Report(report::Report),
    Split(split::Split),
    Synth(synth::Synth),
    Verify(verify::Verify),
    Weigh(weigh::Weigh),
    Schema(schema::Schema),
}

/// The command line of the program, under this name and built from this commit.
pub fn command(names: Names, commit: &str) -> clap::Command {
    command_line::command::<Cli>(names.coordinator(), names, commit)
}

/// Runs one command of the program, built from this commit; errors go to standard error, the exit code says whether there
/// was one.
pub fn main(commit: &str) -> ExitCode {
    let cli: Cli = command_line::parse(command(Names::of_this_process(), commit));
    log::start(cli.log_format, "warn", || worker::trace::layer("descry-coordinator"));
    let code = match execute(cli.command) {
        Ok(code) => code,
        Err(error) => {
            say(format_args!("error: {error}"));
            exit_code(&error)
        }
    };
    worker::trace::stop();
    code
}

fn execute(command: Command) -> anyhow::Result<ExitCode> {
    descriptor::wide::check_environment()?;
    cluster::spill::check_environment()?;
    match command {
        Command::Run(command) => command.execute(),
        Command::Resume(command) => command.execute(),
        Command::Check(command) => command.execute(),
        Command::Compare(command) => command.execute(),
        Command::Assess(command) => command.execute(),
        Command::Certs(command) => command.execute(),
        Command::Control(command) => command.execute(),
        Command::Dashboard(command) => command.execute(),
        Command::Evaluate(command) => command.execute(),
        Command::Exhaust(command) => command.execute(),
        Command::Export(command) => command.execute(),
        Command::JoinCommand(command) => command.execute(),
        Command::Keygen(command) => command.execute(),
        Command::Learn(command) => command.execute(),
        #[cfg(feature = "sql")]
        Command::Query(command) => command.execute(),
        Command::Prune(command) => command.execute(),
        Command::Recognise(command) => command.execute(),
        Command::Report(command) => command.execute(),
        Command::Split(command) => command.execute(),
        Command::Synth(command) => command.execute(),
        Command::Verify(command) => command.execute(),
        Command::Weigh(command) => command.execute(),
        Command::Schema(command) => command.execute(),
    }
}

/// Scripts tell by it what stopped a run; the help of `run` lists them.
fn exit_code(error: &anyhow::Error) -> ExitCode {
    let of_run = match error.downcast_ref() {
        Some(CompareError::Run(error)) => Some(&**error),
        _ => error.downcast_ref(),
    };
    match of_run {
        Some(RunError::Cluster(ClusterError::NoWorkers { .. })) => ExitCode::from(3),
        Some(RunError::Cluster(ClusterError::JobFailed(_))) => ExitCode::from(4),
        Some(RunError::Deadline { .. }) => ExitCode::from(5),
        Some(RunError::Cluster(ClusterError::Undecided { .. })) => ExitCode::from(6),
        Some(RunError::Stopped { .. }) => ExitCode::from(INTERRUPTED),
        _ => ExitCode::FAILURE,
    }
}

/// Runs a command's asynchronous part; `advice` says how to go on after an interruption. Evaluations have threads of
/// their own.
fn block_on<T>(advice: &str, work: impl Future<Output = anyhow::Result<T>>) -> anyhow::Result<T> {
    let runtime = runtime()?;
    let advice = advice.to_owned();
    // In a task of its own, because reading a large data set keeps this thread busy. What is visible in a run folder
    // is whole at any time, so there is nothing to clean up.
    runtime.spawn(async move {
        if let Ok(code) = interruption().await {
            say(format_args!("\nerror: interrupted\n{advice}"));
            // Not after SIGTERM, with which Slurm ends a job that it starts again.
            let left = if code == i32::from(INTERRUPTED) { crate::slurm::interrupted() } else { None };
            left.into_iter().for_each(|left| say(format_args!("{left}")));
            crate::trace::interrupted();
            std::process::exit(code);
        }
    });
    let done = runtime.block_on(work);
    runtime.shutdown_background(); // an evaluation under way in this process is abandoned
    done
}

fn runtime() -> std::io::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()
}

/// Waits for Ctrl-C or SIGTERM; gives the exit code that shells have for it.
#[cfg(unix)]
async fn interruption() -> std::io::Result<i32> {
    let mut terminate = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate())?;
    tokio::select! {
        interrupt = tokio::signal::ctrl_c() => interrupt.map(|()| INTERRUPTED.into()),
        _ = terminate.recv() => Ok(143),
    }
}

#[cfg(not(unix))]
async fn interruption() -> std::io::Result<i32> {
    tokio::signal::ctrl_c().await.map(|()| INTERRUPTED.into())
}

/// A length given in centimetres.
fn micrometres(option: &str, cm: f64) -> anyhow::Result<u32> {
    crate::experiment::micrometres(cm).with_context(|| {
        format!(
            "{option}: must be from 0.0001 to 100 in steps of 0.0001, got {cm}\nchoose a length in centimetres"
        )
    })
}

/// Writes data to standard output; a reader that has seen enough is no error.
fn print(text: &str) -> anyhow::Result<()> {
    use std::io::Write as _;
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(output_error(&error)),
        _ => Ok(()),
    }
}

/// Why a result could not be printed.
fn output_error(error: &std::io::Error) -> anyhow::Error {
    anyhow::anyhow!("standard output: cannot be written, got {error}\nfree some space, or write it elsewhere")
}
