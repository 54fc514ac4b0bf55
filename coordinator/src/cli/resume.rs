//! `coordinator resume`: a run that was interrupted goes on.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::run::{Afterwards, Manner, Observers};
use super::sign::Sign;
use crate::run;

/// Go on with a run that was interrupted or killed, from the evaluation at which it was
///
/// The experiment is taken from the run folder. A finished run is only shown again. Exit codes are those of `run`.
///
/// Example: coordinator resume results/runs/demo-9c8cd1e943e6
#[derive(Debug, Args)]
pub struct Resume {
    /// The folder of a run or a sweep, for example results/runs/demo-9c8cd1e943e6
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    #[command(flatten)]
    sign: Sign,
    #[command(flatten)]
    observers: Observers,
    #[command(flatten)]
    manner: Manner,
}

impl Resume {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let key = self.sign.key()?;
        let plan = run::recorded_plan(&self.folder, self.manner.workers.overrides(None))?;
        self.manner.execute(&plan, self.folder, self.observers, Afterwards::default(), key.as_ref())
    }
}
