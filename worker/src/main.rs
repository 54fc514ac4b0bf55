//! The `worker` program.

use std::process::ExitCode;

use clap::Parser as _;

fn main() -> ExitCode {
    worker::cli::main(worker::cli::Cli::parse())
}
