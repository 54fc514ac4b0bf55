//! One run from an experiment to its results: data, workers, search, final test, tables.

mod data;
pub mod place;
pub mod progress;
pub mod rows;
mod search;
mod source;
mod splits;
pub mod summary;
mod workplace;

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Instant, SystemTime};

use results::{Counts, PredictionSplit, RunFolder, RunRow};
use tokio::net::TcpListener;
use worker::Storage;
use worker::store::Store;

use crate::cluster::ClusterError;
use crate::dataset::{Dataset, DatasetError, Wanted};
use crate::evaluation::EvaluationResult;
use crate::evolution::{Evolution, Individual, Method, RandomSearch, SettingsError};
use crate::exhaust::grid::{Grid, GridError};
use crate::exhaust::{best_of_all, known_optimum};
use crate::experiment::{Experiment, LocalWorkers};
use crate::local::CrewError;
use crate::memory::Known;
use crate::server::{self, ServerError};

pub use data::{DataError, open_data, write_synthetic};
use place::{beside, claim, difference, refuse_another};
use progress::Progress;
use search::{Found, Search};
use source::Source;
use splits::Matching;
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
    /// Accept unencrypted connections from other machines.
    pub insecure: bool,
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
    Server(#[from] ServerError),
    /// Evaluations stopped for good.
    #[error(transparent)]
    Cluster(#[from] ClusterError),
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
        "{folder}: is the finished run of other clouds, got data digest {now} instead of {then}\nstart another with --fresh, or choose another --out"
    )]
    OtherData {
        /// The folder.
        folder: PathBuf,
        /// Data digest of the finished run.
        then: String,
        /// Data digest of the clouds as they are.
        now: String,
    },
    /// The run is of a release that computes other numbers.
    #[error(
        "{folder}: is a finished run of evaluation version {then}, got a program of version {now}\nstart another with --fresh, or choose another --out",
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
    /// Nothing would ever be computed.
    #[error(
        "validation: stop.validation_patience needs validation clouds, got none that is usable\nset stop.validation_patience = \"off\" or give the validation split some clouds"
    )]
    NoValidation,
}

/// Runs an experiment to its stop reason; a finished run is only shown again.
pub async fn run(experiment: &Experiment, options: &RunOptions) -> Result<Summary, RunError> {
    let (started, started_at) = (Instant::now(), SystemTime::now());
    let store = Arc::new(Store::open(&options.storage, &host()));
    let base = options.out.clone();
    let base = base.unwrap_or_else(|| experiment.results_dir().join(experiment.run_folder_name()));
    let out = if options.fresh { beside(&base) } else { base };
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
    let listener = listen(experiment.coordinator().listen, can_do_alone, options.insecure, &progress).await?;
    let dataset = open_data(experiment, Wanted::All, Some(&store), |line| progress.say(line))?;
    if experiment.stop().validation_patience.is_some() && dataset.splits.validation.is_empty() {
        return Err(RunError::NoValidation);
    }
    let mut workplace = Workplace::new(experiment, &dataset, Arc::clone(&store), options.storage.memory)
        .map_err(DataError::from)?;
    refuse_another(&out, &experiment.search_toml())?;
    let mut folder = RunFolder::create(&out, &rows::gene_columns())?;
    claim(&out, &experiment.search_toml())?;
    // Another process may have finished it since.
    if folder.is_finished()
        && let Some(summary) = already_finished(&out, experiment, &store)?
    {
        return Ok(summary);
    }
    if folder.generations() > 0 {
        progress.say(&format!("{}: unfinished, begins again with generation 1", out.display()));
    }
    folder.discard()?; // also what a run left that was killed before its first generation was whole

    if let Some(listener) = listener {
        workplace.open(listener).await;
    }
    let memory = |matching| workplace.splits.memory(&store, experiment.preprocess(), matching);
    let [train_memory, validation_memory] = [Matching::Train, Matching::Validation].map(memory);
    let known = Known { train: train_memory.recall(), validation: validation_memory.recall() };
    let mut crew = workplace.staff(local_workers);
    if !can_do_alone {
        progress.say("waiting for a worker");
    }
    let search = async {
        progress.wait_for_worker(&workplace.cluster).await;
        let source = source(experiment, &dataset, &workplace, &mut progress).await?;
        progress.search_starts();
        let search = Search::new(experiment, &workplace, &mut progress, known);
        let found = search.run(source, &mut folder).await?;
        let finals = Finals::evaluate(&dataset, &workplace, &found, &mut progress).await?;
        Ok::<_, RunError>((found, finals))
    };
    let (found, finals) = crew.during(search).await?;
    crew.stop().await;
    progress.finish();

    folder.write_skipped(&rows::skipped(&dataset))?;
    for (split, matching, result) in [
        (PredictionSplit::Validation, Matching::Validation, &finals.validation),
        (PredictionSplit::Test, Matching::Test, &finals.test),
    ] {
        if let Some(result) = result {
            folder.write_predictions(split, &rows::predictions(&dataset, matching, result))?;
        }
    }
    let mut row = RunRow {
        name: experiment.name().to_owned(),
        search_config: experiment.search_toml(),
        resolved_toml: experiment.record_toml(),
        seed: experiment.seed(),
        data_digest: data_digest(&dataset),
        evaluation_version: descriptor::EVALUATION_VERSION,
        program_version: env!("CARGO_PKG_VERSION").to_owned(),
        build: worker::BUILD.to_owned(),
        host: host(),
        started_at,
        finished_at: SystemTime::now(),
        seconds: started.elapsed().as_secs_f64(),
        stop_reason: found.stop_reason.as_str().to_owned(),
        generations: found.generations,
        evaluations_computed: found.computed,
        evaluations_remembered: found.remembered,
        winner_generation: found.winner.generation,
        winner_individual: found.winner.individual,
        best_chromosome: found.individual.bit_string(),
        best_genes: rows::gene_values(&found.individual.parameters),
        train: found.train,
        validation: finals
            .validation
            .as_ref()
            .map(|result| rows::recount(&dataset, Matching::Validation, result)),
        test: finals.test.as_ref().map(|result| rows::recount(&dataset, Matching::Test, result)),
        grid_best_object_correct: None,
    };
    compare_with_optimum(&mut row, experiment, &dataset, &store);
    let run_digest = folder.write_run(&row)?.to_hex().to_string();
    // Not before the run is finished: what a failed one computed is in doubt.
    train_memory.keep(&found.known.train);
    validation_memory.keep(&found.known.validation);
    let (skipped, descriptors) = (dataset.clouds.skipped.len(), experiment.genes().size());
    Ok(Summary { run: row, run_digest, skipped, descriptors, out })
}

/// The experiment's method, ready for the first generation.
async fn source(
    experiment: &Experiment,
    dataset: &Dataset,
    workplace: &Workplace<'_>,
    progress: &mut Progress,
) -> Result<Source, RunError> {
    let (genes, ga, seed) = (experiment.genes(), *experiment.ga(), experiment.seed());
    Ok(match experiment.method() {
        Method::Ga => Source::Ga(Evolution::new(genes.clone(), ga, seed)?),
        Method::Random => Source::Random(RandomSearch::new(genes.clone(), ga, seed)?),
        Method::Exhaustive => {
            let best = best_of_all(experiment, dataset, workplace, progress).await?;
            Source::Grid([Individual::of(&best.parameters, genes, ga.encoding)])
        }
    })
}

/// Notes how good the best descriptor there is would have been, if that is known.
fn compare_with_optimum(run: &mut RunRow, experiment: &Experiment, dataset: &Dataset, store: &Store) {
    let best = known_optimum(experiment, dataset, store).map(|optimum| optimum.object_correct);
    // What the run has beaten is no optimum: a cache entry that lies.
    if let Some(best) = best.filter(|&best| best < run.train.object_correct) {
        eprintln!(
            "warning: grid: the optimum that is known recognises {best} clouds, fewer than the winner\nevaluate the grid again: coordinator exhaust --fresh"
        );
    }
    run.grid_best_object_correct = best.filter(|&best| best >= run.train.object_correct);
}

/// The winner on the sets that had no part in the search; and on the training sets once more, so that no winner rests
/// on counts that another run has left.
struct Finals {
    validation: Option<EvaluationResult>,
    test: Option<EvaluationResult>,
}

impl Finals {
    async fn evaluate(
        dataset: &Dataset,
        workplace: &Workplace<'_>,
        found: &Found,
        progress: &mut Progress,
    ) -> Result<Self, RunError> {
        let Workplace { cluster, splits, .. } = workplace;
        splits.publish_test(&cluster.blobs);
        let wanted = [Matching::Validation, Matching::Test].map(|matching| {
            let has_queries = !matching.query_clouds(dataset).is_empty();
            has_queries.then(|| splits.evaluation(found.winner.parameters, matching, true))
        });
        let measured = wanted.each_ref().map(Option::is_some);
        let training = splits.evaluation(found.winner.parameters, Matching::Train, false);
        let evaluations = wanted.into_iter().flatten().chain([training]).collect();
        let mut finished = cluster.evaluate(evaluations, |news| progress.news(news)).await?;
        if let Some(training) = finished.pop() {
            agree("training", found, &found.train, &rows::counts(&training.result))?;
        }
        let mut results = finished.into_iter().map(|finished| finished.result);
        let [validation, test] = measured.map(|measured| if measured { results.next() } else { None });
        let known = found.known.validation.get(&found.winner.parameters);
        if let (Some(known), Some(validation)) = (known, &validation) {
            agree("validation", found, known, &rows::counts(validation))?;
        }
        Ok(Self { validation, test })
    }
}

/// Refuses a winner whose counts, as the search took them, are not those that were just computed.
fn agree(matching: &'static str, found: &Found, held: &Counts, computed: &Counts) -> Result<(), RunError> {
    if held == computed {
        return Ok(());
    }
    let said = |counts: &Counts| {
        format!(
            "{} objects and {} categories of {}",
            counts.object_correct, counts.category_correct, counts.queries
        )
    };
    let parameters = found.winner.parameters;
    Err(RunError::Contradiction { parameters, matching, computed: said(computed), remembered: said(held) })
}

/// The summary of a run folder that is finished, unless it is one of another search, of other clouds or of a program
/// that computes other numbers.
fn already_finished(out: &Path, experiment: &Experiment, store: &Store) -> Result<Option<Summary>, RunError> {
    let results::FinishedRun { row: mut run, run_digest, .. } = match results::read_run(out) {
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
    // The data may be gone by now; if it is there, it must be the same.
    match Dataset::load(experiment.dataset(), experiment.preprocess(), Wanted::All, Some(store)) {
        Ok(dataset) if data_digest(&dataset) != run.data_digest => {
            return Err(RunError::OtherData { folder, then: run.data_digest, now: data_digest(&dataset) });
        }
        Ok(dataset) if run.grid_best_object_correct.is_none() => {
            compare_with_optimum(&mut run, experiment, &dataset, store);
        }
        Ok(_) => {}
        Err(error) => {
            let error = error.to_string();
            eprintln!("warning: cannot compare with the data: {}", error.lines().next().unwrap_or_default());
        }
    }
    eprintln!("{}: this run is finished; --fresh starts another", out.display());
    let skipped = results::read_table(out, results::TableName::Skipped)?.shape().0;
    let descriptors = experiment.genes().size();
    Ok(Some(Summary { run, run_digest, skipped, descriptors, out: folder }))
}

/// This machine's name.
pub fn host() -> String {
    hostname::get().map_or_else(|_| "unknown".to_owned(), |name| name.to_string_lossy().into_owned())
}

fn format_ip(address: IpAddr) -> String {
    match address {
        IpAddr::V4(address) => address.to_string(),
        IpAddr::V6(address) => format!("[{address}]"),
    }
}

fn data_digest(dataset: &Dataset) -> String {
    proto::Digest(dataset.clouds.digest).to_string()
}

/// Opens the port. The default port is a convenience: if it is taken, a run with workers of its own goes on.
pub async fn listen(
    wanted: Option<SocketAddr>,
    can_do_alone: bool,
    insecure: bool,
    progress: &Progress,
) -> Result<Option<TcpListener>, RunError> {
    let listener = match server::bind(wanted.unwrap_or(DEFAULT_LISTEN), insecure).await {
        Ok(listener) => listener,
        Err(ServerError::PortInUse { address }) if wanted.is_none() && can_do_alone => {
            progress.say(&format!(
                "port {} is in use, so that no remote worker can join; --listen chooses another",
                address.port()
            ));
            return Ok(None);
        }
        Err(error) => return Err(error.into()),
    };
    let address = listener.local_addr().unwrap_or(DEFAULT_LISTEN);
    if !address.ip().is_loopback() {
        progress.say("warning: --insecure: whoever reaches this port can read the clouds and send results");
    }
    // An unspecified address means every address of this machine, which others know by its name.
    let host = if address.ip().is_unspecified() { host() } else { format_ip(address.ip()) };
    progress.say(&format!("workers may join with: worker --coordinator http://{host}:{}", address.port()));
    Ok(Some(listener))
}
