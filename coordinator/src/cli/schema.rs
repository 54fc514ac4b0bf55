//! `coordinator schema`: the JSON Schema of experiment files.

use std::process::ExitCode;

use clap::Args;

use crate::experiment;

/// Print the JSON Schema of experiment files, for editors
///
/// Example: coordinator schema > experiment.schema.json
#[derive(Debug, Args)]
pub struct Schema {}

impl Schema {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        super::print(&format!("{:#}\n", experiment::json_schema()))?;
        Ok(ExitCode::SUCCESS)
    }
}
