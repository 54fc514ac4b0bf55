//! `coordinator synth`: a synthetic data set in a folder.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use crate::dataset::SyntheticSettings;
use crate::run::write_synthetic;

/// Write a synthetic data set in the UW RGB-D layout
///
/// Example: coordinator synth results/data/toys --objects 18 --views 24 --seed 1
#[derive(Debug, Args)]
pub struct Synth {
    /// Folder to make, for example results/data/toys
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Number of objects, for example 18
    #[arg(long, value_name = "N", default_value_t = descriptor::synth::SynthSettings::default().objects())]
    objects: u32,
    /// Views of each object, for example 24
    #[arg(long, value_name = "N", default_value_t = descriptor::synth::SynthSettings::default().views())]
    views: u32,
    /// Seed of shapes, colours and views, for example 1
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

impl Synth {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let settings = SyntheticSettings { objects: self.objects, views: self.views, seed: self.seed };
        let made = write_synthetic(&self.folder, &settings)?;
        let clouds = self.objects * self.views;
        let folder = self.folder.display();
        super::print(&if made {
            format!("{folder}: {clouds} clouds and the lists train1, train2, validation, test (.txt)\n")
        } else {
            format!("{folder}: holds this data set already\n")
        })?;
        Ok(ExitCode::SUCCESS)
    }
}
