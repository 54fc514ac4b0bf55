//! `coordinator exhaust`: every descriptor of the search space, on the training clouds.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::workers::Workers;
use crate::exhaust;
use crate::experiment::Experiment;
use crate::run::RunOptions;

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
    workers: Workers,
}

impl Exhaust {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let experiment = Experiment::read(&self.experiment, self.workers.overrides(None))?;
        let options = RunOptions {
            out: self.out,
            fresh: self.fresh,
            events: None,
            slurm: self.workers.slurm()?,
            port: self.workers.port(),
            storage: self.workers.storage()?,
            readmit: Vec::new(),
            comparison_follows: false,
            metrics: None,
        };
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
