//! The exhaustive search: the training fitness of every descriptor of a search space, and what it is good for.
//!
//! `grid`, `landscape` and `cells` decide without IO; `grid_search` drives the workers and the folder, `recheck` asks for some
//! counts once more. A run of method "exhaustive" and the command `exhaust` share the grid's folder:
//! `<results folder>/<name>-grid-<key>`.

pub mod grid;
pub mod landscape;
pub mod summary;

mod cell_task;
mod cells;
mod grid_search;
mod grid_spec;
mod optimum;
mod recheck;

use proto::Message;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use cache::Store;
use descriptor::{GeneTable, SearchSpace};
use results::{FinishedGrid, GridFolder, GridRow};

use crate::console::say;
use crate::control::{Operator, Requests};
use crate::dataset::{Dataset, Wanted};
use crate::experiment::Experiment;
use crate::observers::tables::control_row;
use crate::result_cache::source::source_of;
use crate::run::directory::{beside, claim, refuse_another, refuse_other_search};
use crate::run::progress::Progress;
use crate::run::{RunError, RunOptions, open_data, refuse_sets, rows};
use crate::session::{Session, listen, scale};
use crate::storage;
use cluster::Client;
use cluster::events::Controlled;
use grid::Grid;
use grid_search::GridSearch;
use grid_spec::GridSpec;
pub use optimum::Optimum;
pub use recheck::{MOST as MOST_RECHECKED, Recheck};
use summary::GridSummary;

/// Evaluates every descriptor of an experiment's search space on its training clouds; a finished grid is only shown
/// again. The other two splits are neither read nor given to workers. Then `sample` of its counts, if any, are computed
/// again by the evaluator.
pub async fn exhaust(
    experiment: &Experiment,
    options: &RunOptions,
    sample: u32,
) -> Result<GridSummary, RunError> {
    let mut progress = Progress::new(1);
    let store = storage::open(&options.storage);
    Grid::of(experiment)?;
    let dataset = open_data(experiment, Wanted::Training, Some(&store), |line| progress.say(line))?;
    refuse_sets("exhaust", "name the clouds of one set in another manifest", &dataset)?;
    let spec = GridSpec::new(experiment, &dataset)?;
    let base = options.out.clone().unwrap_or_else(|| default_folder(experiment, &spec));
    let out = if options.fresh { beside(&base) } else { base };
    let finished = finished(&out, &spec)?;
    if let Some(grid) = &finished {
        say(format_args!("{}: this grid is finished; --fresh starts another", out.display()));
        if sample == 0 {
            keep(&spec, grid, &out, &store)?;
            return Ok(GridSummary { grid: grid.clone(), out, recheck: None });
        }
    }
    let listener = listen(experiment, &options.port, progress.console()).await?;
    // Before a folder is made: the search space may be too fine.
    let memory = options.storage.memory;
    let mut session = Session::new(experiment, &dataset, Arc::clone(&store), memory)?;
    let folder = open_folder(&out, &spec)?;
    let mut client = session.cluster.client();
    let settings = experiment.coordinator();
    progress.follow(&session.cluster);
    let scaling = scale(options.slurm.as_ref(), (experiment, &out), &session.cluster, progress.console())?;
    session.start(listener, settings.local_workers).await;
    let (console, tell) = (progress.console().clone(), progress.teller());
    // A grid has no journal: what was ordered is on the disk before whoever ordered it is told.
    let record = |order: &Controlled| folder.record_event(&control_row(SystemTime::now(), order));
    let operator = Operator {
        requests: Requests::begin(&out),
        cluster: Arc::clone(&session.cluster),
        clients: vec![(None, client.id())],
        go_on: "the same command again".to_owned(),
        keep: Some(&record),
        tls: options.port.protection.tls.clone(),
    };
    let search = async {
        let grid = match finished {
            Some(grid) => grid,
            None => {
                let search =
                    GridSearch { spec: &spec, name: experiment.name(), folder: &folder, session: &session };
                search.run(&mut client, &mut progress).await?
            }
        };
        let recheck = match sample {
            0 => None,
            sample => {
                let say = |line: &str| progress.say(line);
                Some(recheck::recheck(&spec, &folder, (&session, &mut client), sample, say).await?)
            }
        };
        client.rest(); // it has no further question, and nobody may wait for one
        Ok((grid, recheck))
    };
    let work = session.perform(&console, settings.deadline, search);
    let (grid, recheck) = operator.during(tell, work).await?;
    progress.finish();
    let summary = GridSummary { grid, out, recheck };
    if summary.is_sound() {
        keep(&spec, &summary.grid, &summary.out, &store)?;
    }
    drop(scaling); // those that wait for an allocation would find nobody
    session.cluster.dismiss_workers().await;
    Ok(summary)
}

/// The best descriptor of an experiment's search space: from the grid in its default folder, which is evaluated first
/// if it is not finished.
pub async fn best_of_all(
    experiment: &Experiment,
    dataset: &Dataset,
    session: &Session<'_>,
    client: &mut Client,
    progress: &mut Progress,
) -> Result<Optimum, RunError> {
    let spec = GridSpec::new(experiment, dataset)?;
    let out = default_folder(experiment, &spec);
    let grid = match finished(&out, &spec)? {
        Some(finished) => finished,
        None => {
            progress.say(&format!("evaluating the whole grid in {}", out.display()));
            let folder = open_folder(&out, &spec)?;
            let grid_search = GridSearch { spec: &spec, name: experiment.name(), folder: &folder, session };
            grid_search.run(client, progress).await?
        }
    };
    keep(&spec, &grid, &out, &session.store)
}

/// The best descriptor of an experiment's search space by its fitness, if it is known on this machine.
pub fn known_optimum(experiment: &Experiment, dataset: &Dataset, store: &Store) -> Option<Optimum> {
    (dataset.clouds.set_count() == 1).then_some(())?;
    let spec = GridSpec::new(experiment, dataset).ok()?;
    Optimum::recall(store, spec.key, &spec.grid, spec.queries).or_else(|| {
        let folder = default_folder(experiment, &spec);
        let finished = finished(&folder, &spec).ok().flatten()?;
        spec.optimum(&finished, &folder).ok()
    })
}

fn default_folder(experiment: &Experiment, spec: &GridSpec) -> PathBuf {
    experiment.results_dir().join(spec.folder_name(experiment))
}

/// A folder to evaluate the grid in, locked, and refused if it holds something else.
fn open_folder(out: &Path, spec: &GridSpec) -> Result<GridFolder, RunError> {
    refuse_another(out, &spec.text)?;
    let folder = GridFolder::create(out, &rows::gene_columns(&SearchSpace::DiskRing(GeneTable::paper())))?;
    claim(out, &spec.text)?;
    Ok(folder)
}

/// The finished grid in a folder, if there is one; another one is refused. One that lacks a cell or whose tables are
/// damaged or gone is not finished: the same search goes on with what is left.
fn finished(out: &Path, spec: &GridSpec) -> Result<Option<FinishedGrid>, RunError> {
    let finished = match results::read_grid(out) {
        Ok(finished) => finished,
        Err(results::Error::UnfinishedGrid(_)) => return Ok(None),
        Err(results::Error::Io { path, source, .. }) if source.kind() == io::ErrorKind::NotFound => {
            say(format_args!("warning: {}: this table of the finished grid is gone", path.display()));
            return Ok(None);
        }
        Err(error) if error.is_damage() => {
            say(format_args!("warning: {}", Message::of(&error).what));
            return Ok(None);
        }
        Err(error) => return Err(error.into()),
    };
    refuse_other_search(out, &finished.row.search_space, &spec.text)?;
    let cells = 0..spec.grid.cells();
    let missing = cells.filter(|&cell| !GridFolder::has_cell(out, &spec.cell_name(cell))).count();
    if missing > 0 {
        say(format_args!("warning: {}: {missing} cells of the finished grid are gone", out.display()));
        return Ok(None);
    }
    Ok(Some(finished))
}

/// Keeps the optimum for later runs, wherever their results go.
fn keep(spec: &GridSpec, grid: &FinishedGrid, out: &Path, store: &Store) -> Result<Optimum, RunError> {
    let optimum = spec.optimum(grid, out)?;
    // As a result, it is what it is; others go on only with what somebody stands for.
    let GridRow { run, principals, basis, .. } = &grid.row;
    if let Some(source) = source_of(run.as_deref(), principals.as_deref(), basis.as_deref()) {
        optimum.remember(store, spec.key, spec.queries, &source);
    }
    Ok(optimum)
}

/// Whether the grid in a folder is of an experiment's search space and of as many training queries: then it is of the
/// same clouds, as far as their list tells.
pub fn is_landscape_of(folder: &Path, experiment: &Experiment, queries: Option<u32>) -> bool {
    let is_alike = |grid: results::FinishedGrid| {
        let is_same_space = grid.row.search_space.ends_with(&experiment.space_toml());
        Some(grid.row.queries) == queries && is_same_space && Grid::of(experiment).is_ok()
    };
    results::read_grid(folder).is_ok_and(is_alike)
}
