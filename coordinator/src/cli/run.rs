//! `coordinator run`: an experiment from start to result.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use worker::StorageArgs;

use crate::experiment::{Experiment, LocalWorkers, Overrides};
use crate::run::{self, RunOptions};

/// Run an experiment; workers may join at any time
///
/// Example: coordinator run experiments/demo.toml
#[derive(Debug, Args)]
pub struct Run {
    /// The experiment, for example experiments/demo.toml
    #[arg(value_name = "EXP.toml")]
    experiment: PathBuf,
    /// Run folder, for example results/runs/first; by default named after experiment and search settings
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Where workers are awaited, for example 0.0.0.0:7700 (other machines) or 127.0.0.1:0 (any free port); by
    /// default 127.0.0.1:7700
    #[arg(long, value_name = "ADDR")]
    listen: Option<SocketAddr>,
    /// Workers inside this process: auto (one on all cores), a number that shares the cores, or 0 to wait for
    /// `worker`s, for example 0
    #[arg(long, value_name = "auto|N")]
    local_workers: Option<LocalWorkers>,
    /// Replaces the experiment's seed, for example 7
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Print the summary as one JSON object on standard output, for example for jq
    #[arg(long)]
    json: bool,
    /// Begin another run beside the one that is there, for example after an update
    #[arg(long)]
    fresh: bool,
    /// Accept unencrypted connections from other machines, for example inside a trusted network
    #[arg(long)]
    insecure: bool,
    #[command(flatten)]
    storage: StorageArgs,
}

impl Run {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let overrides = Overrides { seed: self.seed, listen: self.listen, local_workers: self.local_workers };
        let experiment = Experiment::read(&self.experiment, overrides)?;
        let options = RunOptions {
            out: self.out,
            fresh: self.fresh,
            insecure: self.insecure,
            storage: self.storage.resolve(),
        };
        let summary = super::block_on(async { Ok(run::run(&experiment, &options).await?) })?;
        if self.json {
            super::print(&format!("{}\n", summary.json()))?;
        } else {
            super::print(&summary.text())?;
        }
        Ok(ExitCode::SUCCESS)
    }
}
