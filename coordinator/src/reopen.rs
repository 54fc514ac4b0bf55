//! A finished run opened again with its data.

use std::path::{Path, PathBuf};

use cache::Store;
use descriptor::structure::{Structure, StructureChannel, StructureFile, Weighted};
use descriptor::{Descriptor, SearchSpace};
use results::{FinishedRun, RunRow};

use crate::console::say;
use crate::dataset::{Dataset, Wanted};
use crate::experiment::{ConfigError, Experiment, Overrides};
use crate::run::{DataError, clouds, data_digest, open_data};

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
    Experiment(#[from] ConfigError),
    /// The clouds.
    #[error(transparent)]
    Data(#[from] DataError),
    /// The clouds have changed.
    #[error("{run}: data digest must be {expected}, got {got}\n{difference}\nbring the run's clouds back, or name their place with --data", run = .run.display())]
    OtherData {
        /// The run.
        run: PathBuf,
        /// The run's.
        expected: String,
        /// Of the clouds as they are.
        got: String,
        /// Which clouds differ.
        difference: String,
    },
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

impl Reopened {
    /// Refuses clouds that are not those of the run.
    ///
    /// # Errors
    /// [`ReopenError::OtherData`]
    pub fn refuse_other_data(&self, run: &Path) -> Result<(), ReopenError> {
        let (expected, got) = (&self.finished.row.data_digest, data_digest(&self.dataset));
        if *expected == got {
            return Ok(());
        }
        let difference = clouds::difference(run, expected, &self.dataset);
        Err(ReopenError::OtherData { run: run.to_owned(), expected: expected.clone(), got, difference })
    }
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

/// Why a finished run has no winner that this program could compute: it was changed after it had ended, or is of another
/// release.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WinnerError {
    /// Its genes are in no such space.
    #[error("gene values must lie on the genes' grids, got others")]
    Genes,
    /// The text is no structure, or that of another one.
    #[error(
        "weighted_winner must be the structure of the best genes with weights for its values, got another"
    )]
    Weights,
}

/// The descriptor that the search of a finished run has found, without weights for its values.
///
/// # Errors
/// [`WinnerError::Genes`]
pub fn searched(space: &SearchSpace, row: &RunRow) -> Result<Descriptor, WinnerError> {
    space.from_values(&row.best_genes).ok_or(WinnerError::Genes)
}

/// The descriptor that a finished run has ended with: the one of its search, with weights for its values where it was weighed.
///
/// # Errors
/// [`WinnerError`]
pub fn winner_of(space: &SearchSpace, row: &RunRow) -> Result<Descriptor, WinnerError> {
    let searched = searched(space, row)?;
    let Some(text) = &row.weighted_winner else { return Ok(searched) };
    let weighted = weighted_structure(text).ok_or(WinnerError::Weights)?;
    let Descriptor::Structure(Structure { channels }) = searched else { return Err(WinnerError::Weights) };
    // Weighing changes weights only: of values, and of channels.
    let unweighted = |(one, searched): (&Weighted, &Weighted)| Weighted {
        channel: StructureChannel { value_weights: Vec::new(), ..one.channel.clone() },
        weight_ppm: searched.weight_ppm,
        scale: one.scale,
    };
    let is_same = weighted.channels.len() == channels.len()
        && weighted.channels.iter().zip(&channels).all(|pair| unweighted(pair) == *pair.1);
    if is_same { Ok(Descriptor::Structure(weighted)) } else { Err(WinnerError::Weights) }
}

/// The structure that a run keeps as the text of its file; `None` if it is none.
pub fn weighted_structure(text: &str) -> Option<Structure> {
    toml::from_str::<StructureFile>(text).ok()?.structure().ok()
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
