//! Looks at the test clouds of a finished run by commands that need no workers of it, noted in its folder.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use rayon::prelude::*;
use results::{LookRow, RunFolder};

use crate::dataset::cloud_bytes;
use crate::examine::{ExamineError, Examiner};
use crate::experiment::{Experiment, Overrides};
use crate::reopen::{ReopenError, finished};
use crate::run::rows;

/// Why a look cannot be noted.
#[derive(Debug, thiserror::Error)]
pub enum LookError {
    /// The run cannot be opened.
    #[error(transparent)]
    Run(#[from] ReopenError),
    /// It does not say which its clouds are.
    #[error(transparent)]
    Clouds(#[from] ExamineError),
}

/// A look that may be about to be taken.
#[derive(Clone, Debug)]
pub struct Look {
    /// The folder of the run.
    pub run: PathBuf,
    /// By which command.
    pub command: &'static str,
    /// What for.
    pub reason: String,
}

impl Look {
    /// Notes it if these files have test clouds of the run, whatever they are called; how many they are. Files that
    /// cannot be read are none.
    ///
    /// # Errors
    /// [`LookError`] if the folder has no finished run, or lists no clouds.
    pub fn note(&self, files: &[&Path], descriptor: &str) -> Result<usize, LookError> {
        let record = finished(&self.run)?.row.resolved_toml;
        let experiment = Experiment::from_record(&record, &self.run, None, Overrides::default())
            .map_err(ReopenError::from)?;
        let examiner = Examiner::new(&self.run, &experiment)?;
        let tests = examiner.clouds().iter().filter(|cloud| examiner.is_test(cloud));
        let tests: HashSet<[u8; 32]> = tests.filter_map(|cloud| cloud.digest).collect();
        let is_test = |file: &&&Path| {
            cloud_bytes(file).is_ok_and(|bytes| tests.contains(blake3::hash(&bytes).as_bytes()))
        };
        let asked = files.par_iter().filter(is_test).count();
        if asked > 0 {
            note(&self.run, &experiment, [self.command, &self.reason, descriptor])
                .map_err(ReopenError::from)?;
        }
        Ok(asked)
    }
}

/// Notes in the folder of a run by which command its test clouds are looked at, what for, and which descriptors are
/// measured.
pub fn note(
    folder: &Path,
    experiment: &Experiment,
    [command, reason, descriptors]: [&str; 3],
) -> Result<(), results::Error> {
    let columns = rows::gene_columns(experiment.space());
    RunFolder::create(folder, &columns)?.record_look(&LookRow {
        at: SystemTime::now(),
        command: command.to_owned(),
        reason: reason.to_owned(),
        descriptors: descriptors.to_owned(),
    })
}
