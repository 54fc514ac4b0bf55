//! `coordinator weigh`: weights for the values of a run's descriptor.

use std::path::PathBuf;
use std::process::ExitCode;

use artefact::read_structure;
use cache::StorageArgs;
use clap::Args;
use descriptor::weigh::Weighing;

use crate::export::{self, DescriptorChoice};
use crate::lines::{labelled, percent};

/// Weigh the values of a run's descriptor by how well they tell training objects apart
///
/// Writes the file of a structure that takes as long to describe and recognises other clouds better more often than not.
/// Neither validation nor test clouds are looked at.
///
/// Example: coordinator weigh results/runs/demo-0123456789ab weighted.toml
#[derive(Debug, Args)]
pub struct Weigh {
    /// The folder of a finished run, for example results/runs/demo-0123456789ab
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// The file to be written, which evaluate, compare and export take as --structure, for example weighted.toml
    #[arg(value_name = "TOML")]
    out: PathBuf,
    /// File of a structure instead of the winner, on the run's clouds, for example experiments/descriptors/pfhrgb.toml
    #[arg(long, value_name = "TOML")]
    structure: Option<PathBuf>,
    /// A point of the front of a run of several objectives instead, by its number, for example 3
    #[arg(long, value_name = "N", conflicts_with = "structure")]
    point: Option<u32>,
    /// How weights are found: jointly, for the nearest cloud, or separately, for recognisers that learn; by default as the
    /// run's experiment has it, else jointly
    #[arg(long, value_name = "HOW", value_parser = Weighing::ALL.map(Weighing::name))]
    how: Option<String>,
    /// Learn from the clouds of this set only, where the run's clouds are of several, for example kitchen; by default from
    /// all that the run's fitness gives a weight
    #[arg(long, value_name = "NAME")]
    set: Option<String>,
    /// Another place of the data set, for example /data/rgbd; by default the one the run used
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    #[command(flatten)]
    storage: StorageArgs,
}

impl Weigh {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let which = match (&self.structure, self.point) {
            (Some(file), _) => DescriptorChoice::Structure(read_structure(file)?),
            (_, Some(point)) => DescriptorChoice::Point(point),
            _ => DescriptorChoice::Searched,
        };
        let place = (self.data.as_deref(), self.set.as_deref());
        let found = export::weigh(
            &self.run,
            (&which, self.how.as_deref().and_then(Weighing::named)),
            place,
            &self.out,
            &self.storage.resolve(),
        )?;
        let share = |wrong: usize| percent(wrong as f64 / found.queries as f64);
        let [without, with] = found.wrong;
        let told = format!(
            "{} without weights, {} with them: {} of {} training clouds, each matched with other sequences. They are \
             those that the weights were learned from; others say more",
            share(without),
            share(with),
            found.queries,
            found.clouds,
        );
        super::print(&format!(
            "{}{}{}",
            labelled("descriptor", 14, &found.structure.to_string()),
            labelled("object error", 14, &told),
            labelled("structure", 14, &self.out.display().to_string()),
        ))?;
        Ok(ExitCode::SUCCESS)
    }
}
