//! `coordinator exhaust`: every descriptor of the search space, on the training clouds.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;

use cache::StorageArgs;
use clap::Args;

use crate::exhaust;
use crate::experiment::{Experiment, LocalWorkers, Overrides};
use crate::run::RunOptions;
use transport::Protection;

/// Evaluate every descriptor of an experiment's search space on the training clouds; workers may join at any time
///
/// Killed, the same command goes on with the cells that are missing. Later runs on the same training clouds report how
/// far they are from the best. Neither validation nor test clouds are read.
///
/// Example: coordinator exhaust experiments/demo.toml
#[derive(Debug, Args)]
pub struct Exhaust {
    /// The experiment, for example experiments/household.toml
    #[arg(value_name = "EXP.toml")]
    experiment: PathBuf,
    /// Grid folder, for example results/runs/grid; by default named after experiment, search space and clouds
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
    /// Print the summary as one JSON object on standard output, for example for jq
    #[arg(long)]
    json: bool,
    /// Evaluate the grid anew beside the one that is there, for example to compare both. Each use starts another grid: a
    /// killed one goes on with --out and its folder instead
    #[arg(long)]
    fresh: bool,
    /// Compute so many counts of the finished grid again, drawn from all of it, by the evaluator that runs ask, for
    /// example 2000, and exit with 1 if one differs
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    #[arg(value_parser = clap::value_parser!(u32).range(..=i64::from(exhaust::MOST_RECHECKED)))]
    sample: u32,
    #[command(flatten)]
    protection: Protection,
    #[command(flatten)]
    storage: StorageArgs,
}

impl Exhaust {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let overrides = Overrides { seed: None, listen: self.listen, local_workers: self.local_workers };
        let experiment = Experiment::read(&self.experiment, overrides)?;
        let storage = self.storage.resolve();
        let (out, fresh, protection) = (self.out, self.fresh, self.protection);
        let options = RunOptions { out, fresh, events: None, protection, storage, readmit: Vec::new() };
        let summary = super::block_on(
            "run the same command to go on; with --fresh, name its folder with --out instead",
            async { Ok(exhaust::exhaust(&experiment, &options, self.sample).await?) },
        )?;
        if self.json {
            super::print(&format!("{}\n", summary.json()))?;
        } else {
            super::print(&summary.text())?;
        }
        Ok(if summary.is_sound() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
    }
}
