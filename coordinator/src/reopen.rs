//! A finished run opened again with its data.

use std::path::{Path, PathBuf};

use cache::Store;
use descriptor::structure::{Structure, StructureChannel, StructureFile};
use descriptor::{Descriptor, SearchSpace};
use results::{FinishedRun, RunRow};

use crate::console::say;
use crate::dataset::{Dataset, Wanted};
use crate::experiment::{Experiment, ExperimentError, Overrides};
use crate::run::{DataError, open_data};

/// Why a run cannot be opened again.
#[derive(Debug, thiserror::Error)]
pub enum ReopenError {
    /// There is no such folder.
    #[error("{0}: no such run folder\nname the folder that the run's summary calls results")]
    NoFolder(PathBuf),
    /// The run folder.
    #[error(transparent)]
    Results(#[from] results::Error),
    /// Other numbers are to be expected.
    #[error(
        "{run}: evaluation version must be {expected}, got {got}\nuse the release that made the run; verify --sample 0 looks at its digest only, with any release"
    )]
    EvaluationVersion {
        /// The run.
        run: PathBuf,
        /// This program's.
        expected: u32,
        /// The run's.
        got: u32,
    },
    /// The recorded experiment.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// The clouds.
    #[error(transparent)]
    Data(#[from] DataError),
}

/// A finished run with its experiment and clouds.
pub struct Reopened {
    /// What was written at its end.
    pub finished: FinishedRun,
    /// What it was started with.
    pub experiment: Experiment,
    /// The clouds as they are: their digest need not be the run's.
    pub dataset: Dataset,
}

/// What was written at the end of the run in a folder.
///
/// # Errors
/// [`ReopenError`] if there is no folder, or no finished run in it.
pub fn finished(run: &Path) -> Result<FinishedRun, ReopenError> {
    if !run.is_dir() {
        return Err(ReopenError::NoFolder(run.to_owned()));
    }
    Ok(results::read_run(run)?)
}

/// The descriptor that a finished run has ended with: its genes, with weights for its values where it was weighed. `None`
/// if it is in no such space, or if the weights are those of another structure.
pub fn winner_of(space: &SearchSpace, row: &RunRow) -> Option<Descriptor> {
    let searched = space.from_values(&row.best_genes)?;
    let Some(text) = &row.weighted_winner else { return Some(searched) };
    let weighted = toml::from_str::<StructureFile>(text).ok()?.structure().ok()?;
    let channels = weighted.channels.iter().map(|one| &one.channel);
    let unweighted = channels.map(|one| StructureChannel { value_weights: Vec::new(), ..one.clone() });
    let Descriptor::Structure(Structure { channels }) = searched else { return None };
    unweighted.eq(channels.into_iter().map(|one| one.channel)).then_some(Descriptor::Structure(weighted))
}

/// Opens a finished run again; `data` is another place of its data root, if that has moved.
pub fn reopen(
    run: &Path,
    data: Option<&Path>,
    overrides: Overrides,
    store: &Store,
) -> Result<Reopened, ReopenError> {
    let finished = finished(run)?;
    let got = finished.row.evaluation_version;
    if got != descriptor::EVALUATION_VERSION {
        let expected = descriptor::EVALUATION_VERSION;
        return Err(ReopenError::EvaluationVersion { run: run.to_owned(), expected, got });
    }
    let record = &finished.row.resolved_toml;
    let experiment = Experiment::from_record(record, run, data, overrides)?;
    let dataset = open_data(&experiment, Wanted::All, Some(store), |line| say(line))?;
    Ok(Reopened { finished, experiment, dataset })
}
