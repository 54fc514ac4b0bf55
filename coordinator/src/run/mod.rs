//! One run from an experiment to its results: data, workers, search, final test, tables.

mod bounds;
pub mod clouds;
mod contradiction;
mod data;
pub mod directory;
mod driver;
mod effective;
mod error;
pub mod fitness_batch;
mod fitness_check;
mod foresight;
pub mod front;
pub mod matching;
mod met;
pub mod progress;
pub mod recorded_session;
mod resume;
pub mod rows;
pub mod scaled;
pub mod scales;
mod search;
pub mod search_space;
pub mod sets;
pub mod splits;
pub mod summary;
pub mod tally;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Instant, SystemTime};

use cache::Storage;
use cache::Store;
use evolution::Method;
use proto::Message;
use proto::Principal;
use results::RunFolder;

use crate::console::say;
use crate::dataset::{Dataset, Wanted};
use crate::exhaust::grid::Grid;
use crate::experiment::Experiment;
use crate::metrics::MetricsSource;
use crate::reopen::winner_of;
use crate::result_cache::SearchCounts;
use crate::session::listen;
use crate::slurm::SlurmWorkers;
use crate::storage;
use transport::Port;

use bounds::bounds;
pub use clouds::data_digest;
pub use contradiction::counts_text;
pub use data::{DataError, open_data, write_synthetic};
pub use directory::folder;
use directory::{claim, refuse_another, refuse_other_search, refuse_other_version};
use driver::compare_with_optimum;
pub use driver::{RunDriver, Start};
pub use error::RunError;
pub use fitness_check::{check_fitness, nothing_recognised};
pub use matching::Matching;
use progress::Progress;
use recorded_session::{RecordedSession, Setup};
pub use resume::{open_journal, recorded_plan, remove_journal};
use summary::Summary;

/// How a run is started, beside its experiment.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// The run folder; by default it is named after the search, below the experiment's results folder.
    pub out: Option<PathBuf>,
    /// Begin another run, beside the one that is there.
    pub fresh: bool,
    /// A file that events are appended to.
    pub events: Option<PathBuf>,
    /// How workers of other machines reach the command.
    pub port: Port,
    /// Workers that Slurm is asked for, if any.
    pub slurm: Option<SlurmWorkers>,
    /// Where what runs find out is kept, and memory for the workers of this process.
    pub storage: Storage,
    /// Principals that are no longer quarantined.
    pub readmit: Vec<Principal>,
    /// Whether the command compares the run afterwards, if there are test clouds of one set: workers stay for it.
    pub comparison_follows: bool,
    /// Where the run tells what is measured of it, if anybody asks.
    pub metrics: Option<Arc<MetricsSource>>,
}

/// Runs an experiment to its stop reason; a finished run is only shown again.
pub async fn run(experiment: &Experiment, options: &RunOptions) -> Result<Summary, RunError> {
    let (started, started_at) = (Instant::now(), SystemTime::now());
    let store = storage::open(&options.storage);
    let out = folder(experiment, options.out.clone(), options.fresh);
    if let Some(summary) = already_finished(&out, experiment, &store)? {
        return Ok(summary);
    }
    refuse_another(&out, &experiment.search_toml())?;
    let stop = experiment.stop();
    let mut progress = Progress::new(stop.generations).with_budget(stop.evaluations);
    // First what may be wrong with search space, port and data: then no folder is made and nothing in one is touched.
    if experiment.method() == Method::Exhaustive {
        Grid::of(experiment)?;
    }
    let listener = listen(experiment, &options.port, progress.console()).await?;
    let dataset = open_data(experiment, Wanted::All, Some(&store), |line| progress.say(line))?;
    if experiment.method() == Method::Exhaustive {
        refuse_sets("search.method = \"exhaustive\"", "choose another method", &dataset)?;
    }
    for note in check_fitness(experiment, &dataset)? {
        progress.say(&note);
    }
    let folder = RunFolder::create(&out, &rows::gene_columns(experiment.space()))?;
    claim(&out, &experiment.search_toml())?;
    // Another process may have finished it since.
    if folder.is_finished()
        && let Some(summary) = already_finished(&out, experiment, &store)?
    {
        return Ok(summary);
    }
    let setup = Setup {
        texts: (experiment.search_toml(), experiment.record_toml()),
        experiment,
        with_sequences: experiment.fitness().needs_sequences(),
        dataset: &dataset,
        out: &out,
        runs: std::slice::from_ref(&out),
    };
    let mut recorded = RecordedSession::open(setup, &store, options, (started, started_at), &progress)?;
    let client = recorded.session.cluster.client();
    let mut attached = recorded.start(listener, &mut progress).await?;
    let RecordedSession { session, start, .. } = &recorded;
    let cache = |matching| session.splits.count_cache(&store, experiment.preprocess(), matching);
    let [train_cache, validation_cache] = [Matching::Train, Matching::Validation].map(cache);
    let remembers = experiment.remembers_counts(&dataset);
    let remembered = match remembers {
        true => SearchCounts::read(&train_cache, &validation_cache),
        false => SearchCounts::default(),
    };
    let clients = vec![(None, client.id())];
    let (console, tell) = (progress.console().clone(), progress.teller());
    let (dataset, start) = (&dataset, *start);
    let mut run =
        RunDriver { experiment, dataset, session, remembered: &remembered, client, folder, progress, start };
    let search = run.search();
    let searched = recorded.perform(&mut attached, clients, (&console, tell), search).await;
    if searched.is_err() {
        run.tell_what_happened().await;
    }
    let outcome = searched?;
    run.progress.finish();
    let provenance = recorded.provenance(remembers).await?;
    let summary = run.finish(&outcome).await?;
    remove_journal(&out);
    provenance.note(session, &out, &outcome.found.counts);
    provenance.keep(session, &outcome.found.counts, [&train_cache, &validation_cache]);
    recorded.end(attached, dataset).await;
    Ok(summary)
}

/// The summary of a run folder that is finished, unless it is one of another search, of other clouds or of a program
/// that computes other numbers.
fn already_finished(out: &Path, experiment: &Experiment, store: &Store) -> Result<Option<Summary>, RunError> {
    let Some(mut summary) = finished(out, experiment)? else { return Ok(None) };
    compare_with_data(std::slice::from_mut(&mut summary), experiment, store)?;
    // A process that is killed after it has finished the run leaves its journal behind.
    remove_journal(out);
    say(format_args!("{}: this run is finished; --fresh starts another", out.display()));
    Ok(Some(summary))
}

/// The summary of a run folder that is finished, unless it is one of another search or of a program that computes other
/// numbers.
pub fn finished(out: &Path, experiment: &Experiment) -> Result<Option<Summary>, RunError> {
    let results::FinishedRun { row: run, run_digest, .. } = match results::read_run(out) {
        Ok(finished) => finished,
        Err(results::Error::Unfinished(_)) => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    refuse_other_search(out, &run.search_config, &experiment.search_toml())?;
    refuse_other_version(out, run.evaluation_version)?;
    let skipped = results::read_table(out, results::TableName::Skipped)?.shape().0;
    let space = experiment.space();
    let searched = space.from_values(&run.best_genes);
    Ok(Some(Summary {
        winner: winner_of(space, &run).ok(),
        run,
        run_digest,
        front: results::read_front(out)?,
        family: space.family(),
        skipped,
        descriptors: space.size(),
        compared: results::read_comparison(out)?,
        pairs: results::read_pairs(out)?,
        sets: results::read_sets(out)?,
        bounds: searched.map_or_else(Vec::new, |searched| bounds(space, &searched)),
        out: out.to_owned(),
    }))
}

/// Refuses finished runs of other clouds than those of the experiment, if they are there, and notes how good the best
/// descriptor there is would have been.
pub fn compare_with_data(
    summaries: &mut [Summary],
    experiment: &Experiment,
    store: &Store,
) -> Result<(), RunError> {
    let loaded = Dataset::load(experiment.dataset(), experiment.preprocess(), Wanted::All, Some(store));
    let dataset = match loaded {
        Ok(dataset) => dataset,
        // The data may be gone by now; if it is there, it must be the same.
        Err(error) => {
            say(format_args!("warning: cannot compare with the data: {}", Message::of(&error).what));
            return Ok(());
        }
    };
    for Summary { run, out, .. } in summaries {
        refuse_other_data(out, &run.data_digest, &dataset)?;
        if run.grid_best_object_correct.is_none() {
            compare_with_optimum(run, experiment, &dataset, store);
        }
    }
    Ok(())
}

/// Refuses clouds of several sets for something that is computed of one only.
pub fn refuse_sets(what: &'static str, advice: &'static str, dataset: &Dataset) -> Result<(), RunError> {
    if dataset.clouds.set_count() == 1 {
        return Ok(());
    }
    Err(RunError::SeveralSets { what, sets: dataset.clouds.sets.join(", "), advice })
}

/// The clouds of a set by its name, and all clouds without one, which must be of one set.
pub fn choose_set(what: &'static str, set: Option<&str>, dataset: Dataset) -> Result<Dataset, RunError> {
    let Some(name) = set else {
        refuse_sets(what, "name one of them with --set", &dataset)?;
        return Ok(dataset);
    };
    let sets = &dataset.clouds.sets;
    match (0..).zip(sets).find(|(_, set)| *set == name) {
        Some((number, _)) => Ok(dataset.of_set(number)),
        None => Err(RunError::UnknownSet { place: "--set", name: name.to_owned(), known: sets.join(", ") }),
    }
}

/// Refuses a folder whose results are of other clouds.
pub fn refuse_other_data(folder: &Path, then: &str, dataset: &Dataset) -> Result<(), RunError> {
    let now = data_digest(dataset);
    if then == now {
        return Ok(());
    }
    let difference = clouds::difference(folder, then, dataset);
    Err(RunError::OtherData { folder: folder.to_owned(), then: then.to_owned(), now, difference })
}
