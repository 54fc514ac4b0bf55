//! One run from an experiment to its results: data, workers, search, final test, tables.

mod at_work;
mod data;
pub mod place;
pub mod progress;
mod resume;
pub mod rows;
mod search;
mod source;
mod splits;
pub mod summary;
pub mod tally;
mod workplace;

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use results::RunFolder;
use transport::host_name;
use worker::Storage;
use worker::store::Store;

use crate::dataset::{Dataset, DatasetError, Wanted};
use crate::evolution::{Method, SettingsError};
use crate::exhaust::grid::{Grid, GridError};
use crate::experiment::{Experiment, ExperimentError, LocalWorkers};
use crate::local::CrewError;
use crate::memory::Known;
use crate::observers::event_file::{EventFile, EventFileError};
use cluster::ClusterError;
use cluster::journal::JournalError;
use transport::{ListenError, Listener, Protection};

use at_work::compare_with_optimum;
pub use at_work::{RunAtWork, Start};
pub use data::{DataError, open_data, write_synthetic};
pub use place::folder;
use place::{claim, difference, refuse_another};
use progress::Progress;
pub use resume::{open_journal, recorded_plan, remove_journal};
pub use splits::Matching;
use summary::Summary;
pub use workplace::Workplace;

/// Where workers are awaited unless the experiment or the command line says otherwise.
pub const DEFAULT_LISTEN: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 7700);

/// How a run is started, beside its experiment.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// The run folder; by default it is named after the search, below the experiment's results folder.
    pub out: Option<PathBuf>,
    /// Begin another run, beside the one that is there.
    pub fresh: bool,
    /// A file that events are appended to.
    pub events: Option<PathBuf>,
    /// How connections from other machines are protected.
    pub protection: Protection,
    /// Where what runs find out is kept, and memory for the workers of this process.
    pub storage: Storage,
}

/// Why a run has no result.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The clouds are not to be had.
    #[error(transparent)]
    Data(#[from] DataError),
    /// The data set is not fit for a run.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The genetic algorithm's settings.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The search space cannot be evaluated exhaustively.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// Nobody can connect.
    #[error(transparent)]
    Listen(#[from] ListenError),
    /// Evaluations stopped for good.
    #[error(transparent)]
    Cluster(#[from] ClusterError),
    /// What an earlier start has left.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// The file that events are to be written to.
    #[error(transparent)]
    Events(#[from] EventFileError),
    /// It took too long.
    #[error(
        "coordinator.deadline_seconds: reached, got no result within {seconds} s\nrun the same command to go on, as long again, or raise the deadline"
    )]
    Deadline {
        /// The deadline.
        seconds: u64,
    },
    /// Nothing to go on with.
    #[error(
        "{folder}: holds no run to go on with\nname the folder of a run, or start one: coordinator run EXP.toml"
    )]
    NothingToResume {
        /// The folder.
        folder: PathBuf,
    },
    /// A run that is not finished, and goes on with others.
    #[error("{folder}: is a run of a sweep, and has no journal of its own\ngo on with the sweep: coordinator resume {sweep}", folder = .folder.display(), sweep = .sweep.display())]
    MemberOfSweep {
        /// Its folder.
        folder: PathBuf,
        /// That of the sweep.
        sweep: PathBuf,
    },
    /// The experiment that a run was started with.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// The workers of this process stopped.
    #[error(transparent)]
    Crew(#[from] CrewError),
    /// The run folder.
    #[error(transparent)]
    Results(#[from] results::Error),
    /// A file of the run folder that is no table.
    #[error(
        "{path}: cannot be used, got {source}\ncheck permissions and free space, or choose another --out"
    )]
    File {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The folder belongs to something else.
    #[error(
        "--out {folder}: holds another search, got these differences\n{difference}\nchoose another --out, or remove the folder"
    )]
    OtherSearch {
        /// The folder.
        folder: PathBuf,
        /// Lines that differ.
        difference: String,
    },
    /// The same search has run on other clouds.
    #[error(
        "{folder}: is a run of other clouds, got data digest {now} instead of {then}\nstart another with --fresh, or choose another --out"
    )]
    OtherData {
        /// The folder.
        folder: PathBuf,
        /// Data digest of the run.
        then: String,
        /// Data digest of the clouds as they are.
        now: String,
    },
    /// The run is of a release that computes other numbers.
    #[error(
        "{folder}: is a run of evaluation version {then}, got a program of version {now}\nstart another with --fresh, or choose another --out",
        now = descriptor::EVALUATION_VERSION
    )]
    OtherVersion {
        /// The folder.
        folder: PathBuf,
        /// Its evaluation version.
        then: u32,
    },
    /// A count of an earlier run is not what this one finds.
    #[error(
        "remembered counts: {parameters}: {matching}: must be what was computed now, {computed}, got {remembered}\nrun again with --no-cache, and remove derived/remembered-counts from the cache: another run has kept wrong counts there"
    )]
    Contradiction {
        /// The winner.
        parameters: descriptor::Parameters,
        /// Which counts.
        matching: &'static str,
        /// Recognised objects and categories.
        computed: String,
        /// The same, as they were remembered.
        remembered: String,
    },
    /// Two answers of this run differ, and nobody compared them when they came.
    #[error(
        "workers: {parameters}: {matching}: two of this run's own answers differ, got {computed} after {held}\nstart another run with --fresh and coordinator.audit = 1, on three workers: it finds the one that is wrong"
    )]
    Disagreement {
        /// The winner.
        parameters: descriptor::Parameters,
        /// Which counts.
        matching: &'static str,
        /// Recognised objects and categories.
        computed: String,
        /// The same, as the search took them.
        held: String,
    },
    /// Nothing would ever be computed.
    #[error(
        "validation: stop.validation_patience needs validation clouds, got none that is usable\nset stop.validation_patience = \"off\" or give the validation split some clouds"
    )]
    NoValidation,
}

/// Runs an experiment to its stop reason; a finished run is only shown again.
pub async fn run(experiment: &Experiment, options: &RunOptions) -> Result<Summary, RunError> {
    let (started, started_at) = (Instant::now(), SystemTime::now());
    let store = Arc::new(Store::open(&options.storage, &host_name()));
    let out = folder(experiment, options.out.clone(), options.fresh);
    if let Some(summary) = already_finished(&out, experiment, &store)? {
        return Ok(summary);
    }
    let mut progress = Progress::new(experiment.stop().generations);
    // First what may be wrong with search space, port and data: then no folder is made and nothing in one is touched.
    if experiment.method() == Method::Exhaustive {
        Grid::new(experiment.genes())?;
    }
    let local_workers = experiment.coordinator().local_workers;
    let can_do_alone = local_workers != LocalWorkers::Count(0);
    let listener =
        listen(experiment.coordinator().listen, can_do_alone, &options.protection, &progress).await?;
    let dataset = open_data(experiment, Wanted::All, Some(&store), |line| progress.say(line))?;
    if experiment.stop().validation_patience.is_some() && dataset.splits.validation.is_empty() {
        return Err(RunError::NoValidation);
    }
    refuse_another(&out, &experiment.search_toml())?;
    let mut folder = RunFolder::create(&out, &rows::gene_columns())?;
    claim(&out, &experiment.search_toml())?;
    // Another process may have finished it since.
    if folder.is_finished()
        && let Some(summary) = already_finished(&out, experiment, &store)?
    {
        return Ok(summary);
    }
    let texts = (experiment.search_toml(), experiment.record_toml());
    let (header, journal, recorded) =
        open_journal(texts, &dataset, &out, started_at, || Ok(folder.discard()?))?;
    let at_work = recorded.at_work;
    if recorded.starts > 1 {
        let there = recorded.accepted.len();
        progress.say(&format!(
            "{}: unfinished, goes on with the {there} evaluations that are there",
            out.display()
        ));
    }
    let past = (header.session, journal, recorded);
    let memory = options.storage.memory;
    let mut workplace = Workplace::with_journal(past, experiment, &dataset, Arc::clone(&store), memory)
        .map_err(DataError::from)?;
    if let Some(listener) = listener {
        workplace.open(listener).await;
    }
    let memory = |matching| workplace.splits.memory(&store, experiment.preprocess(), matching);
    let [train_memory, validation_memory] = [Matching::Train, Matching::Validation].map(memory);
    let known = Known { train: train_memory.recall(), validation: validation_memory.recall() };
    progress.follow(&workplace.cluster);
    let mut events = EventFile::open(options.events.as_deref(), &workplace.cluster).await?;
    let client = workplace.cluster.client();
    let mut crew = workplace.staff(local_workers);
    if !can_do_alone {
        progress.say("waiting for a worker");
    }
    let start = Start { now: started, first: header.started_at, before: at_work };
    let (dataset, workplace, remembered) = (&dataset, &workplace, &known);
    let mut run = RunAtWork { experiment, dataset, workplace, remembered, client, folder, progress, start };
    let search = async {
        run.progress.wait_for_worker(&run.client).await;
        run.search().await
    };
    let ended = in_time(experiment.coordinator().deadline, crew.during(search)).await;
    if ended.is_err() {
        run.tell_what_happened();
        EventFile::finish(events.take()).await;
    }
    let outcome = ended?;
    crew.stop().await;
    run.progress.finish();
    let trusted = workplace.cluster.is_trusted();
    workplace.cluster.close();
    EventFile::finish(events).await;
    let summary = run.finish(&outcome)?;
    remove_journal(&out);
    // Not before the run is finished: what a failed one computed is in doubt, and so is what one with a worker that
    // was wrong computed where nobody has looked.
    if trusted {
        train_memory.keep(&outcome.found.known.train);
        validation_memory.keep(&outcome.found.known.validation);
    }
    Ok(summary)
}

/// Does `work` unless it takes too long.
pub async fn in_time<T>(
    deadline: Option<Duration>,
    work: impl Future<Output = Result<T, RunError>>,
) -> Result<T, RunError> {
    let Some(deadline) = deadline else { return work.await };
    let late = |_| RunError::Deadline { seconds: deadline.as_secs() };
    tokio::time::timeout(deadline, work).await.map_err(late)?
}

/// The summary of a run folder that is finished, unless it is one of another search, of other clouds or of a program
/// that computes other numbers.
fn already_finished(out: &Path, experiment: &Experiment, store: &Store) -> Result<Option<Summary>, RunError> {
    let Some(mut summary) = finished(out, experiment)? else { return Ok(None) };
    compare_with_data(std::slice::from_mut(&mut summary), experiment, store)?;
    eprintln!("{}: this run is finished; --fresh starts another", out.display());
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
    let folder = out.to_owned();
    let search = experiment.search_toml();
    if run.search_config != search {
        let difference = difference(&run.search_config, &search);
        return Err(RunError::OtherSearch { folder, difference });
    }
    if run.evaluation_version != descriptor::EVALUATION_VERSION {
        return Err(RunError::OtherVersion { folder, then: run.evaluation_version });
    }
    let skipped = results::read_table(out, results::TableName::Skipped)?.shape().0;
    let descriptors = experiment.genes().size();
    Ok(Some(Summary { run, run_digest, skipped, descriptors, out: folder }))
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
            let error = error.to_string();
            eprintln!("warning: cannot compare with the data: {}", error.lines().next().unwrap_or_default());
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

/// Refuses a folder whose results are of other clouds.
pub fn refuse_other_data(folder: &Path, then: &str, dataset: &Dataset) -> Result<(), RunError> {
    let now = data_digest(dataset);
    if then == now {
        return Ok(());
    }
    Err(RunError::OtherData { folder: folder.to_owned(), then: then.to_owned(), now })
}

/// Digest of a data set.
pub fn data_digest(dataset: &Dataset) -> String {
    proto::Digest(dataset.clouds.digest).to_string()
}

/// Opens the port. The default port is a convenience: if it is taken, a run with workers of its own goes on.
pub async fn listen(
    wanted: Option<SocketAddr>,
    can_do_alone: bool,
    protection: &Protection,
    progress: &Progress,
) -> Result<Option<Listener>, RunError> {
    let listener = match Listener::bind(wanted.unwrap_or(DEFAULT_LISTEN), protection).await {
        Ok(listener) => listener,
        Err(ListenError::PortInUse { address }) if wanted.is_none() && can_do_alone => {
            progress.say(&format!(
                "port {} is in use, so that no remote worker can join; --listen chooses another",
                address.port()
            ));
            return Ok(None);
        }
        Err(error) => return Err(error.into()),
    };
    for notice in listener.notices() {
        progress.say(&notice);
    }
    Ok(Some(listener))
}
