//! `coordinator check`: what an experiment would do, without doing it.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use crate::dataset::Wanted;
use crate::exhaust::grid::Grid;
use crate::experiment::{Experiment, Member, Overrides, Plan};
use crate::run;
use crate::run::search_space;

/// Validate an experiment and its data; print what would be run
///
/// Example: coordinator check experiments/demo.toml
#[derive(Debug, Args)]
pub struct Check {
    /// The experiment, for example experiments/demo.toml
    #[arg(value_name = "EXP.toml")]
    experiment: PathBuf,
}

impl Check {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let plan = Plan::read(&self.experiment, Overrides::default())?;
        let experiment = plan.base();
        let dataset = run::open_data(experiment, Wanted::All, None, |line| eprintln!("{line}"))?;
        let mut text = plan.resolved_toml();
        if !text.ends_with('\n') {
            text.push('\n');
        }
        let splits = &dataset.splits;
        text.push_str(&format!(
            "\n# clouds: train1 {}, train2 {}, validation {}, test {}; skipped {}\n",
            splits.train1.len(),
            splits.train2.len(),
            splits.validation.len(),
            splits.test.len(),
            dataset.clouds.skipped.len()
        ));
        text.push_str(&format!(
            "# objects: {} instances in {} categories\n",
            dataset.clouds.instances.len(),
            dataset.clouds.categories.len()
        ));
        text.push_str(&format!("# data digest: {}\n", proto::Digest(dataset.clouds.digest)));
        text.push_str(&format!(
            "# search space: {} descriptors, {} bits\n",
            experiment.space().size(),
            search_space::genome(experiment.space(), experiment.encoding()).bits()
        ));
        match &plan {
            Plan::Run(experiment) => text.push_str(&format!("# search: {}\n", search(experiment)?)),
            Plan::Sweep(sweep) => {
                for Member { name, experiment } in sweep.members() {
                    text.push_str(&format!("# search of {name}: {}\n", search(&experiment)?));
                }
            }
        }
        super::print(&text)?;
        Ok(ExitCode::SUCCESS)
    }
}

/// The method and what it evaluates.
fn search(experiment: &Experiment) -> anyhow::Result<String> {
    let (method, generations) = (experiment.method(), experiment.stop().generations);
    let genome = search_space::genome(experiment.space(), experiment.encoding());
    Ok(match method.strategy(&genome, *experiment.ga(), experiment.seed())? {
        Some(strategy) => {
            let largest = strategy.largest_generation();
            let most = u64::from(largest) * u64::from(generations);
            let budget = experiment.stop().evaluations.map_or_else(String::new, |budget| {
                format!(", or until {budget} different descriptors are evaluated")
            });
            format!("{method}, at most {most} individuals in {generations} generations of {largest}{budget}")
        }
        None => {
            let grid = Grid::new(experiment.space())?;
            let (descriptors, cells) = (grid.descriptors(), grid.cells());
            format!("{method}, all {descriptors} descriptors in {cells} grid cells")
        }
    })
}
