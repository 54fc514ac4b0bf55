//! The exhaustive search: the training fitness of every descriptor of a search space, and what it is good for.
//!
//! `grid`, `landscape` and `cells` decide without IO; `survey` drives the workers and the folder, `recheck` asks for some
//! counts once more. A run of method "exhaustive" and the command `exhaust` share the grid's folder:
//! `<results folder>/<name>-grid-<key>`.

pub mod grid;
pub mod landscape;
pub mod summary;

mod cells;
mod optimum;
mod question;
mod recheck;
mod survey;

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use results::{FinishedGrid, GridFolder};
use worker::store::Store;

use crate::dataset::{Dataset, Wanted};
use crate::experiment::{Experiment, LocalWorkers};
use crate::run::place::{beside, claim, difference, refuse_another};
use crate::run::progress::Progress;
use crate::run::{DataError, RunError, RunOptions, Workplace, listen, open_data, rows};
use cluster::Client;
pub use optimum::Optimum;
use question::Question;
pub use recheck::{MOST as MOST_RECHECKED, Recheck};
use summary::GridSummary;
use survey::Survey;

/// Evaluates every descriptor of an experiment's search space on its training clouds; a finished grid is only shown
/// again. The other two splits are neither read nor given to workers. Then `sample` of its counts, if any, are computed
/// again by the evaluator.
pub async fn exhaust(
    experiment: &Experiment,
    options: &RunOptions,
    sample: u32,
) -> Result<GridSummary, RunError> {
    let mut progress = Progress::new(1);
    let local_workers = experiment.coordinator().local_workers;
    let can_do_alone = local_workers != LocalWorkers::Count(0);
    let store = Arc::new(Store::open(&options.storage, &transport::host_name()));
    let dataset = open_data(experiment, Wanted::Training, Some(&store), |line| progress.say(line))?;
    let question = Question::new(experiment, &dataset)?;
    let base = options.out.clone().unwrap_or_else(|| default_folder(experiment, &question));
    let out = if options.fresh { beside(&base) } else { base };
    let finished = finished(&out, &question)?;
    if let Some(grid) = &finished {
        eprintln!("{}: this grid is finished; --fresh starts another", out.display());
        if sample == 0 {
            keep(&question, grid, &out, &store)?;
            return Ok(GridSummary { grid: grid.clone(), out, recheck: None });
        }
    }
    let listener =
        listen(experiment.coordinator().listen, can_do_alone, &options.protection, &progress).await?;
    // Before a folder is made: the search space may be too fine.
    let mut workplace = Workplace::new(experiment, &dataset, Arc::clone(&store), options.storage.memory)
        .map_err(DataError::from)?;
    let folder = open_folder(&out, &question)?;
    if let Some(listener) = listener {
        workplace.open(listener).await;
    }
    let mut client = workplace.cluster.client();
    let mut crew = workplace.staff(local_workers);
    if !can_do_alone {
        progress.say("waiting for a worker");
    }
    let survey =
        Survey { question: &question, name: experiment.name(), folder: &folder, workplace: &workplace };
    let search = async {
        progress.wait_for_worker(&client).await;
        let grid = match finished {
            Some(grid) => grid,
            None => survey.run(&mut client, &mut progress).await?,
        };
        client.rest(); // it has no further question, and nobody may wait for one
        let recheck = match sample {
            0 => None,
            sample => Some(
                recheck::recheck(&question, &folder, &workplace, sample, |line| progress.say(line)).await?,
            ),
        };
        Ok::<_, RunError>((grid, recheck))
    };
    let (grid, recheck) = crew.during(search).await?;
    crew.stop().await;
    progress.finish();
    let summary = GridSummary { grid, out, recheck };
    if summary.is_sound() {
        keep(&question, &summary.grid, &summary.out, &store)?;
    }
    Ok(summary)
}

/// The best descriptor of an experiment's search space: from the grid in its default folder, which is evaluated first
/// if it is not finished.
pub async fn best_of_all(
    experiment: &Experiment,
    dataset: &Dataset,
    workplace: &Workplace<'_>,
    client: &mut Client,
    progress: &mut Progress,
) -> Result<Optimum, RunError> {
    let question = Question::new(experiment, dataset)?;
    let out = default_folder(experiment, &question);
    let grid = match finished(&out, &question)? {
        Some(finished) => finished,
        None => {
            progress.say(&format!("evaluating the whole grid in {}", out.display()));
            let folder = open_folder(&out, &question)?;
            let survey = Survey { question: &question, name: experiment.name(), folder: &folder, workplace };
            survey.run(client, progress).await?
        }
    };
    keep(&question, &grid, &out, &workplace.store)
}

/// The best descriptor of an experiment's search space, if it is known on this machine.
pub fn known_optimum(experiment: &Experiment, dataset: &Dataset, store: &Store) -> Option<Optimum> {
    let question = Question::new(experiment, dataset).ok()?;
    Optimum::recall(store, question.key, &question.grid, question.queries).or_else(|| {
        let folder = default_folder(experiment, &question);
        let finished = finished(&folder, &question).ok().flatten()?;
        question.optimum(&finished, &folder).ok()
    })
}

fn default_folder(experiment: &Experiment, question: &Question) -> PathBuf {
    experiment.results_dir().join(question.folder_name(experiment))
}

/// A folder to evaluate the grid in, locked, and refused if it holds something else.
fn open_folder(out: &Path, question: &Question) -> Result<GridFolder, RunError> {
    refuse_another(out, &question.text)?;
    let folder = GridFolder::create(out, &rows::gene_columns())?;
    claim(out, &question.text)?;
    Ok(folder)
}

/// The finished grid in a folder, if there is one; another one is refused. One that lacks a cell or whose tables are
/// damaged or gone is not finished: the same search goes on with what is left.
fn finished(out: &Path, question: &Question) -> Result<Option<FinishedGrid>, RunError> {
    let finished = match results::read_grid(out) {
        Ok(finished) => finished,
        Err(results::Error::UnfinishedGrid(_)) => return Ok(None),
        Err(results::Error::Io { path, source, .. }) if source.kind() == io::ErrorKind::NotFound => {
            eprintln!("warning: {}: this table of the finished grid is gone", path.display());
            return Ok(None);
        }
        Err(error) if error.is_damage() => {
            eprintln!("warning: {}", error.to_string().lines().next().unwrap_or_default());
            return Ok(None);
        }
        Err(error) => return Err(error.into()),
    };
    if finished.row.search_space != question.text {
        let difference = difference(&finished.row.search_space, &question.text);
        return Err(RunError::OtherSearch { folder: out.to_owned(), difference });
    }
    let cells = 0..question.grid.cells();
    let missing = cells.filter(|&cell| !GridFolder::has_cell(out, &question.cell_name(cell))).count();
    if missing > 0 {
        eprintln!("warning: {}: {missing} cells of the finished grid are gone", out.display());
        return Ok(None);
    }
    Ok(Some(finished))
}

/// Keeps the optimum for later runs, wherever their results go.
fn keep(question: &Question, grid: &FinishedGrid, out: &Path, store: &Store) -> Result<Optimum, RunError> {
    let optimum = question.optimum(grid, out)?;
    optimum.remember(store, question.key, question.queries);
    Ok(optimum)
}
