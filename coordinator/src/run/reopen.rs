//! A finished run, opened again with its experiment and its clouds.

use std::path::{Path, PathBuf};

use results::FinishedRun;
use worker::store::Store;

use crate::dataset::{Dataset, Wanted};
use crate::experiment::{Experiment, ExperimentError, Overrides};
use crate::run::{RunError, open_data, refuse_other_data};

/// A finished run and what it is of.
pub struct Reopened {
    /// What was recorded.
    pub run: FinishedRun,
    /// As it was run.
    pub experiment: Experiment,
    /// The same clouds.
    pub dataset: Dataset,
}

/// Why a finished run cannot be opened again.
#[derive(Debug, thiserror::Error)]
pub enum ReopenError {
    /// There is no such folder.
    #[error("{0}: no such run folder\nname the folder that the run's summary calls results")]
    NoFolder(PathBuf),
    /// The run folder.
    #[error(transparent)]
    Results(#[from] results::Error),
    /// The recorded experiment.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// The data, or other clouds than the run's.
    #[error(transparent)]
    Run(Box<RunError>),
    /// Other numbers are to be expected.
    #[error("{run}: evaluation version must be {expected}, got {got}\nuse the release that made it")]
    EvaluationVersion {
        /// The run.
        run: PathBuf,
        /// This program's.
        expected: u32,
        /// The run's.
        got: u32,
    },
}

impl From<RunError> for ReopenError {
    fn from(error: RunError) -> Self {
        Self::Run(Box::new(error))
    }
}

/// Opens a finished run again; `data` is where its clouds are now, if they have moved.
pub fn reopen(
    folder: &Path,
    data: Option<&Path>,
    overrides: Overrides,
    store: &Store,
    say: impl Fn(&str),
) -> Result<Reopened, ReopenError> {
    if !folder.is_dir() {
        return Err(ReopenError::NoFolder(folder.to_owned()));
    }
    let run = results::read_run(folder)?;
    let (expected, got) = (descriptor::EVALUATION_VERSION, run.row.evaluation_version);
    if got != expected {
        return Err(ReopenError::EvaluationVersion { run: folder.to_owned(), expected, got });
    }
    let experiment = Experiment::from_record(&run.row.resolved_toml, folder, data, overrides)?;
    let dataset = open_data(&experiment, Wanted::All, Some(store), say).map_err(RunError::from)?;
    refuse_other_data(folder, &run.row.data_digest, &dataset)?;
    Ok(Reopened { run, experiment, dataset })
}
