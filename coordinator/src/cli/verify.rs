//! `coordinator verify`: are these the numbers that this data and this program give?

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use worker::StorageArgs;

use crate::verify;

/// Recompute the digest of a finished run and a sample of its fitness values
///
/// Example: coordinator verify results/runs/demo-0123456789ab --sample 20
#[derive(Debug, Args)]
pub struct Verify {
    /// The run folder, for example results/runs/demo-0123456789ab
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// How many fitness values to compute again, for example 20; 0 looks at the digest only
    #[arg(long, value_name = "N", default_value_t = 10)]
    sample: u32,
    /// Another place of the data set, for example /data/rgbd; by default the one the run used
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    #[command(flatten)]
    storage: StorageArgs,
}

impl Verify {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let storage = self.storage.resolve();
        let verify = verify::verify(&self.run, self.sample, self.data, &storage);
        let verdict = super::block_on(async { Ok(verify.await?) })?;
        super::print(&verdict.to_string())?;
        Ok(if verdict.is_sound() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
    }
}
