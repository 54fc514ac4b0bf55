//! The command line of both programs.

use clap::{Command, Parser};

use crate::names::Names;
use crate::version::version;

/// A program's command line, under this one of its names, built from this commit.
pub fn command<C: Parser>(name: &'static str, names: Names, commit: &str) -> Command {
    // Once in a process, and clap keeps no strings of its own here.
    let version: &'static str = version(commit).leak();
    names.in_command(C::command()).name(name).version(version)
}

/// What this process was called with; ends it where that cannot be read, or asks for help.
pub fn parse<C: Parser>(mut command: Command) -> C {
    let mut matches = command.get_matches_mut();
    C::from_arg_matches_mut(&mut matches).unwrap_or_else(|error| error.format(&mut command).exit())
}
