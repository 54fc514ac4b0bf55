//! The `coordinator` program: one command a file.

mod check;
mod evaluate;
mod exhaust;
mod run;
mod schema;
mod synth;
mod verify;

use std::io::IsTerminal as _;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Evolves 3D point-cloud descriptors, on this machine and on as many others as join.
///
/// Example: coordinator run experiments/demo.toml
#[derive(Debug, Parser)]
#[command(name = "coordinator", version, about, long_about)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Run(run::Run),
    Check(check::Check),
    Evaluate(evaluate::Evaluate),
    Exhaust(exhaust::Exhaust),
    Synth(synth::Synth),
    Verify(verify::Verify),
    Schema(schema::Schema),
}

/// Runs one command; errors go to standard error, the exit code says whether there was one.
pub fn main(cli: Cli) -> ExitCode {
    tracing_subscriber::fmt()
        .with_env_filter(
            tracing_subscriber::EnvFilter::try_from_env("DESCRY_LOG").unwrap_or_else(|_| "warn".into()),
        )
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .init();
    let done = match cli.command {
        Command::Run(command) => command.execute(),
        Command::Check(command) => command.execute(),
        Command::Evaluate(command) => command.execute(),
        Command::Exhaust(command) => command.execute(),
        Command::Synth(command) => command.execute(),
        Command::Verify(command) => command.execute(),
        Command::Schema(command) => command.execute(),
    };
    match done {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Exit code of a program that Ctrl-C has ended, as shells have it.
const INTERRUPTED: i32 = 130;

/// Runs a command's asynchronous part. Evaluations have threads of their own.
fn block_on<T>(work: impl Future<Output = anyhow::Result<T>>) -> anyhow::Result<T> {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    // In a task of its own, because reading a large data set keeps this thread busy. What is visible in a run folder
    // is whole at any time, so there is nothing to clean up.
    runtime.spawn(async {
        if tokio::signal::ctrl_c().await.is_ok() {
            eprintln!("\nerror: interrupted\nrun the same command to begin again");
            std::process::exit(INTERRUPTED);
        }
    });
    let done = runtime.block_on(work);
    runtime.shutdown_background(); // an evaluation under way in this process is abandoned
    done
}

/// Writes data to standard output; a reader that has seen enough is no error.
fn print(text: &str) -> anyhow::Result<()> {
    use std::io::Write as _;
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}
