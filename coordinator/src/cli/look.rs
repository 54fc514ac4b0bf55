//! Options of commands that measure on any clouds, which may be test clouds of a run.

use std::path::PathBuf;

use clap::Args;

use crate::looks::Look;

/// Where a look at test clouds is noted.
#[derive(Debug, Args)]
pub(super) struct LookArgs {
    /// Run whose test clouds may be among these; a look at them is noted in its table looks, as those of compare are, for
    /// example results/runs/demo
    #[arg(long, value_name = "RUN")]
    run: Option<PathBuf>,
    /// Why the test clouds are looked at, for example "table 1 of the paper"; kept in table looks
    #[arg(long, value_name = "TEXT", requires = "run", default_value = "measurement on given clouds")]
    reason: String,
}

impl LookArgs {
    /// The look, if a run was named.
    pub(super) fn look(self, command: &'static str) -> Option<Look> {
        let Self { run, reason } = self;
        run.map(|run| Look { run, command, reason })
    }
}

/// What became of a look, for people.
pub(super) fn noted(look: &Look, test_clouds: usize) -> String {
    let run = look.run.display();
    match test_clouds {
        0 => format!("none noted: no cloud is a test cloud of {run}"),
        _ => format!("noted in table looks of {run}: {test_clouds} of these clouds are its test clouds"),
    }
}
