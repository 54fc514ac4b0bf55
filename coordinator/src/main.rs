//! The `coordinator` program.

use std::process::ExitCode;

use clap::Parser as _;

fn main() -> ExitCode {
    coordinator::cli::main(coordinator::cli::Cli::parse())
}
