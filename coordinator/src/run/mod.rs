//! One run from an experiment to its results: data, workers, search, final test, tables.

mod data;
pub mod progress;
pub mod rows;
mod search;
mod splits;
pub mod summary;
mod workplace;

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};
use std::{fs, io, io::Read as _, io::Write as _};

use results::{PredictionSplit, RunFolder, RunRow};
use tokio::net::TcpListener;

use crate::cluster::ClusterError;
use crate::dataset::{Dataset, DatasetError};
use crate::evaluation::EvaluationResult;
use crate::evolution::SettingsError;
use crate::experiment::{Experiment, LocalWorkers};
use crate::local::CrewError;
use crate::server::{self, ServerError};

pub use data::{DataError, open_data, write_synthetic};
use progress::Progress;
use search::{Found, Search};
use splits::Matching;
use summary::Summary;
pub use workplace::Workplace;

/// Where workers are awaited unless the experiment or the command line says otherwise.
pub const DEFAULT_LISTEN: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 7700);

/// File in a run folder that says which search it holds.
const SEARCH_FILE: &str = "search.toml";

/// How a run is started, beside its experiment.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    /// The run folder; by default it is named after the search, below the experiment's results folder.
    pub out: Option<PathBuf>,
    /// Begin another run, beside the one that is there.
    pub fresh: bool,
    /// Accept unencrypted connections from other machines.
    pub insecure: bool,
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
    /// Nothing would ever be computed.
    #[error(
        "validation: stop.validation_patience needs validation clouds, got none that is usable\nset stop.validation_patience = \"off\" or give the validation split some clouds"
    )]
    NoValidation,
}

/// Runs an experiment to its stop reason; a finished run is only shown again.
pub async fn run(experiment: &Experiment, options: &RunOptions) -> Result<Summary, RunError> {
    let (started, started_at) = (Instant::now(), SystemTime::now());
    let out = place(experiment, options);
    if let Some(summary) = already_finished(&out, experiment)? {
        return Ok(summary);
    }
    let mut progress = Progress::new(experiment.stop().generations);
    // First what may be wrong with port and data: then no folder is made and nothing in one is touched.
    let local_workers = experiment.coordinator().local_workers;
    let can_do_alone = local_workers != LocalWorkers::Count(0);
    let listener = listen(experiment.coordinator().listen, can_do_alone, options.insecure, &progress).await?;
    let dataset = open_data(experiment, |line| progress.say(line))?;
    if experiment.stop().validation_patience.is_some() && dataset.splits.validation.is_empty() {
        return Err(RunError::NoValidation);
    }
    let mut folder = RunFolder::create(&out, &rows::gene_columns())?;
    claim(&out, &experiment.search_toml())?;
    // Another process may have finished it since.
    if folder.is_finished()
        && let Some(summary) = already_finished(&out, experiment)?
    {
        return Ok(summary);
    }
    if folder.generations() > 0 {
        progress.say(&format!("{}: unfinished, begins again with generation 1", out.display()));
    }
    folder.discard()?; // also what a run left that was killed before its first generation was whole

    let mut workplace = Workplace::new(experiment, &dataset);
    if let Some(listener) = listener {
        workplace.open(listener).await;
    }
    let mut crew = workplace.staff(local_workers);
    if !can_do_alone {
        progress.say("waiting for a worker");
    }
    let search = async {
        let waiting =
            |waited: Duration| progress.say(&format!("no worker yet after {} min", waited.as_secs() / 60));
        workplace.cluster.wait_for_worker(waiting).await;
        progress.search_starts();
        let found = Search::new(experiment, &workplace, &mut progress).run(&mut folder).await?;
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
    let row = RunRow {
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
    };
    let run_digest = folder.write_run(&row)?.to_hex().to_string();
    Ok(Summary { run: row, run_digest, skipped: dataset.clouds.skipped.len(), out })
}

/// The winner on the sets that had no part in the search.
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
        let evaluations = wanted.into_iter().flatten().collect();
        let finished = cluster.evaluate(evaluations, |news| progress.news(news)).await?;
        let mut results = finished.into_iter().map(|finished| finished.result);
        let [validation, test] = measured.map(|measured| if measured { results.next() } else { None });
        Ok(Self { validation, test })
    }
}

/// The summary of a run folder that is finished, unless it is one of another search, of other clouds or of a program
/// that computes other numbers.
fn already_finished(out: &Path, experiment: &Experiment) -> Result<Option<Summary>, RunError> {
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
    // The data may be gone by now; if it is there, it must be the same.
    match Dataset::load(experiment.dataset(), experiment.preprocess()) {
        Ok(dataset) if data_digest(&dataset) != run.data_digest => {
            return Err(RunError::OtherData { folder, then: run.data_digest, now: data_digest(&dataset) });
        }
        Ok(_) => {}
        Err(error) => {
            let error = error.to_string();
            eprintln!("warning: cannot compare with the data: {}", error.lines().next().unwrap_or_default());
        }
    }
    eprintln!("{}: this run is finished; --fresh starts another", out.display());
    let skipped = results::read_table(out, results::TableName::Skipped)?.shape().0;
    Ok(Some(Summary { run, run_digest, skipped, out: folder }))
}

fn host() -> String {
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

/// The folder that the same command finds again; with `fresh` the first one beside it that is not there, as no
/// finished run is ever removed.
fn place(experiment: &Experiment, options: &RunOptions) -> PathBuf {
    let default = || experiment.results_dir().join(experiment.run_folder_name());
    let base = options.out.clone().unwrap_or_else(default);
    if !options.fresh || !base.exists() {
        return base;
    }
    let numbered = |number: u32| {
        let mut name = base.as_os_str().to_owned();
        name.push(format!("-{number}"));
        PathBuf::from(name)
    };
    (2..).map(numbered).find(|folder| !folder.exists()).unwrap_or(base)
}

/// Marks the folder as this search's, and refuses one that holds another.
fn claim(folder: &Path, search: &str) -> Result<(), RunError> {
    let path = folder.join(SEARCH_FILE);
    let failed = |source| RunError::File { path: path.clone(), source };
    match read_bounded(&path) {
        Ok(held) if held == search => Ok(()),
        Ok(held) => {
            let difference = difference(&held, search);
            Err(RunError::OtherSearch { folder: folder.to_owned(), difference })
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            let mut file = tempfile::NamedTempFile::new_in(folder).map_err(failed)?;
            file.write_all(search.as_bytes()).and_then(|()| file.as_file().sync_all()).map_err(failed)?;
            file.persist(&path).map_err(|error| failed(error.error))?;
            Ok(())
        }
        Err(error) => Err(failed(error)),
    }
}

/// A text of at most 1 MiB, as every search is; what is longer is cut, and so differs from all of them.
fn read_bounded(path: &Path) -> io::Result<String> {
    let mut bytes = Vec::new();
    fs::File::open(path)?.take(1 << 20).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Lines of one text that are not in the other, marked - and +.
fn difference(old: &str, new: &str) -> String {
    let only = |a: &str, b: &str, mark: char| {
        let other: Vec<&str> = b.lines().collect();
        a.lines()
            .filter(|line| !other.contains(line))
            .map(|line| format!("  {mark} {line}"))
            .collect::<Vec<_>>()
    };
    let mut lines = only(old, new, '-');
    lines.extend(only(new, old, '+'));
    lines.join("\n")
}

/// Opens the port. The default port is a convenience: if it is taken, a run with workers of its own goes on.
async fn listen(
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_claimed_once_and_refused_to_another_search() {
        let folder = tempfile::tempdir().unwrap();
        claim(folder.path(), "seed = 1\n[ga]\npopulation = 10\n").unwrap();
        claim(folder.path(), "seed = 1\n[ga]\npopulation = 10\n").unwrap();
        let error = claim(folder.path(), "seed = 2\n[ga]\npopulation = 10\n").unwrap_err().to_string();
        assert!(error.contains("  - seed = 1\n  + seed = 2"), "{error}");
    }
}
