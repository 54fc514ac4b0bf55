//! The experiment file: read, checked key by key, and written out again with every default filled in.
//!
//! Two steps: text → `raw` (keys and types, by serde) → [`Experiment`] (meaning, by `validate`). Everything else in
//! the program sees only an [`Experiment`], which is valid by construction.

mod checks;
mod defaults;
mod forms;
mod paths;
mod raw;
mod raw_dataset;
mod resolved;
mod sweep;
mod syntax;
mod validate;
mod validate_dataset;
mod validate_fitness;
mod validate_objectives;

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Read;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use descriptor::recogniser::Method as Recogniser;
use descriptor::weigh::Weighing;
use descriptor::{Descriptor, Family, Preprocess, SearchSpace};
use evolution::{Encoding, GaSettings, Method, Score, StopSettings, WinnerRule};

use crate::dataset::{Clouds, Dataset, DatasetSettings};
use crate::fitness::{Fitness, Measured};
use crate::objectives::Objectives;
pub use artefact::sections::ConfigError;
use artefact::sections::Fault;
pub(crate) use artefact::sections::{advice as name_advice, micrometres};
use cluster::sharding::ShardCount;
pub use sweep::{MAX_MEMBERS, Member, Plan, Sweep};

/// Bytes of the largest file that is read.
const MAX_BYTES: u64 = 1 << 20;

/// Largest seed: TOML's integers end there.
pub const MAX_SEED: u64 = i64::MAX as u64;

/// Most workers inside one coordinator.
pub const MAX_LOCAL_WORKERS: u32 = 1024;

/// Where run folders are made if the experiment names no place, relative to the current folder.
pub const DEFAULT_RESULTS_DIR: &str = "results/runs";

/// One experiment: valid, complete, and independent of how it was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Experiment {
    /// The file it was read from, as named by the user.
    path: PathBuf,
    name: String,
    seed: u64,
    dataset: DatasetSettings,
    preprocess: Preprocess,
    space: SearchSpace,
    max_cost: Option<u64>,
    method: Method,
    objectives: Objectives,
    fitness: Fitness,
    /// Of sets by name; others have 1.
    set_weights: BTreeMap<String, u32>,
    winner: WinnerRule,
    weigh: Option<Weighing>,
    ga: GaSettings,
    encoding: Encoding,
    stop: StopSettings,
    coordinator: CoordinatorSettings,
    recognition: Recogniser,
    baselines: bool,
    /// `None`: [`DEFAULT_RESULTS_DIR`], which no path relative to the file could name.
    results_dir: Option<PathBuf>,
}

/// Settings of the command line that replace those of the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overrides {
    /// Replaces `seed`.
    pub seed: Option<u64>,
    /// Replaces `coordinator.listen`.
    pub listen: Option<SocketAddr>,
    /// Replaces `coordinator.local_workers`.
    pub local_workers: Option<LocalWorkers>,
}

/// How work is shared out. Nothing here changes a result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoordinatorSettings {
    /// Where workers on other machines are awaited; `None`: nobody asked for an address.
    pub listen: Option<SocketAddr>,
    /// Workers inside the coordinator.
    pub local_workers: LocalWorkers,
    /// A worker that has not polled for this long is given up.
    pub lease: Duration,
    /// A job without a result for this long is given to another worker, too.
    pub job: Duration,
    /// Failures after which a job stops the run, at least 1.
    pub max_failures: u32,
    /// How long the run waits for another worker after it lost the last one.
    pub worker_grace: Duration,
    /// How long the search may take in one start of the run; `None`: for ever.
    pub deadline: Option<Duration>,
    /// Share of the evaluations that two workers have to agree on, 0 to 1.
    pub audit: f64,
    /// Into how many pieces an evaluation is cut.
    pub pieces: ShardCount,
}

/// How many workers run inside the coordinator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LocalWorkers {
    /// One on all cores.
    Auto,
    /// This many sharing the cores, at most [`MAX_LOCAL_WORKERS`]; 0 leaves all work to other machines.
    Count(u32),
}

impl FromStr for LocalWorkers {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        match text.parse() {
            Ok(count) if count <= MAX_LOCAL_WORKERS => Ok(Self::Count(count)),
            _ => Err(format!(
                "not `auto` or a number from 0 to {MAX_LOCAL_WORKERS}, got {text:?}\nwrite auto for one on all cores"
            )),
        }
    }
}

impl Experiment {
    /// Reads and checks an experiment file of at most 1 MiB. Nothing but the file and environment variables named
    /// in its paths is looked at: whether the clouds exist is found out by whoever reads them.
    pub fn read(path: &Path, overrides: Overrides) -> Result<Self, ConfigError> {
        let text = read_bounded(path).map_err(|fault| fault.in_file(path))?;
        Self::parse(&text, path, overrides, &|name| std::env::var(name))
    }

    fn parse(
        text: &str,
        path: &Path,
        overrides: Overrides,
        lookup: paths::Lookup<'_>,
    ) -> Result<Self, ConfigError> {
        syntax::parse(text)
            .and_then(|raw| validate::experiment(raw, path, overrides, lookup))
            .map_err(|fault| fault.in_file(path))
    }

    /// The file it was read from, as named by the user.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its name: 1 to 64 of a-z, 0-9, - and _, not beginning with -.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Seed of everything random in the search, at most [`MAX_SEED`].
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Which clouds; all paths are usable from the current folder.
    pub fn dataset(&self) -> &DatasetSettings {
        &self.dataset
    }

    /// What is computed once for each cloud.
    pub fn preprocess(&self) -> &Preprocess {
        &self.preprocess
    }

    /// The search space.
    pub fn space(&self) -> &SearchSpace {
        &self.space
    }

    /// Counted cost of recognising a cloud above which a descriptor has fitness 0; `None`: none has for its cost.
    pub fn max_cost(&self) -> Option<u64> {
        self.max_cost
    }

    /// Whether a descriptor is evaluated; one that costs too much is not, and has fitness 0.
    pub fn affords(&self, descriptor: &Descriptor) -> bool {
        self.max_cost.is_none_or(|most| self.limited_cost(descriptor) <= most)
    }

    /// What is compared with the largest cost: the cost of recognising a cloud, of a member of a structure as if all members
    /// cost as much.
    pub fn limited_cost(&self, descriptor: &Descriptor) -> u64 {
        let shares = match (&self.space, descriptor) {
            (SearchSpace::Structures(space), Descriptor::Structure(structure)) => {
                space.shares(structure.channels.len())
            }
            _ => 1,
        };
        descriptor.recognition_cost().saturating_mul(u64::from(shares))
    }

    /// How the best descriptor is searched for.
    pub fn method(&self) -> Method {
        self.method
    }

    /// What the search minimises.
    pub fn objectives(&self) -> Objectives {
        self.objectives
    }

    /// How good a descriptor is by what was measured of it.
    pub fn score(&self, descriptor: &Descriptor, measured: &Measured) -> Score {
        let further = self.objectives.further(descriptor, self.affords(descriptor));
        Score { further, ..self.fitness.score(measured) }
    }

    /// What the search's fitness counts.
    pub fn fitness(&self) -> &Fitness {
        &self.fitness
    }

    /// How much each set of clouds weighs in the fitness and on validation clouds; one of weight 0 has no part in the
    /// search, and is only tested.
    pub fn set_weights(&self, dataset: &Dataset) -> Vec<u32> {
        let Clouds { sets, .. } = &dataset.clouds;
        if sets.is_empty() {
            return vec![1];
        }
        sets.iter().map(|name| self.set_weights.get(name).copied().unwrap_or(1)).collect()
    }

    /// The sets that the experiment gives weights, by name.
    pub fn weighted_sets(&self) -> impl Iterator<Item = &str> {
        self.set_weights.keys().map(String::as_str)
    }

    /// How clouds get their names once the search is over; the search itself goes by the nearest cloud.
    pub fn recognition(&self) -> Recogniser {
        self.recognition
    }

    /// The random search of so many descriptors that says whether this experiment's search was worth it: with the same
    /// clouds, space, fitness and seed, for the error alone.
    pub fn random_control(&self, evaluations: u32) -> Self {
        let stop = StopSettings {
            generations: evaluations.max(1),
            evaluations: Some(evaluations.max(1)),
            stagnation: None,
            validation_patience: None,
            ..self.stop
        };
        let name = format!("{}-random", self.name);
        Self { name, method: Method::Random, objectives: Objectives::ERROR, stop, ..self.clone() }
    }

    /// Whether the winner is compared with what anybody has without a search.
    pub fn compares_baselines(&self) -> bool {
        self.baselines
    }

    /// Which of the generations' bests wins.
    pub fn winner(&self) -> WinnerRule {
        self.winner
    }

    /// How values of the winner get weights when the search is over; `None` if they get none.
    pub fn weighs(&self) -> Option<Weighing> {
        self.weigh
    }

    /// Whether the best of each generation is measured on the validation clouds.
    pub fn validates(&self) -> bool {
        self.winner.validates(&self.stop)
    }

    /// Whether counts are kept from run to run: only those of the paper's fitness on clouds of one set, of families
    /// without scales.
    pub fn remembers_counts(&self, dataset: &Dataset) -> bool {
        let is_plain = self.fitness == Fitness::PAPER && dataset.clouds.set_count() == 1;
        is_plain && self.space.family() != Family::Structure
    }

    /// The genetic algorithm.
    pub fn ga(&self) -> &GaSettings {
        &self.ga
    }

    /// How the value indices of genes are written as bits.
    pub fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// When the search ends.
    pub fn stop(&self) -> &StopSettings {
        &self.stop
    }

    /// How work is shared out.
    pub fn coordinator(&self) -> &CoordinatorSettings {
        &self.coordinator
    }

    /// The folder that run folders are made in, usable from the current folder.
    pub fn results_dir(&self) -> &Path {
        self.results_dir.as_deref().unwrap_or(Path::new(DEFAULT_RESULTS_DIR))
    }

    /// The whole experiment as TOML, with every default filled in and variables expanded. Read again from the same
    /// folder it gives an equal experiment.
    pub fn resolved_toml(&self) -> String {
        resolved::resolved_toml(self)
    }

    /// As [`Experiment::resolved_toml`], with absolute paths: the record of a run, which [`Experiment::from_record`]
    /// reads wherever the run folder has gone.
    pub fn record_toml(&self) -> String {
        let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let mut record = self.clone();
        record.path = PathBuf::new();
        record.dataset.map_paths(absolute);
        record.results_dir = self.results_dir.as_deref().map(absolute);
        record.resolved_toml()
    }

    /// The experiment of a run's record; `data` is another place of its data root, if that has moved. `origin` names
    /// the record in messages.
    pub fn from_record(
        text: &str,
        origin: &Path,
        data: Option<&Path>,
        overrides: Overrides,
    ) -> Result<Self, ConfigError> {
        let mut experiment = Self::parse(text, origin, overrides, &|name| std::env::var(name))?;
        if let Some(data) = data {
            let old = experiment.dataset.root.clone();
            experiment.dataset.map_paths(|path| match path.strip_prefix(&old) {
                Ok(below) => data.join(below),
                Err(_) => path.to_owned(),
            });
        }
        Ok(experiment)
    }

    /// The part of the experiment that determines the search, as canonical text (DESIGN 4): dataset labels,
    /// preprocess, genes, method, ga, stop and seed; no name, path, address or worker setting. Equal for equal meaning,
    /// however it was written.
    pub fn search_toml(&self) -> String {
        resolved::search_toml(self)
    }

    /// The part of the experiment that determines the value of every descriptor on given clouds, as canonical text:
    /// unit, preprocess and genes.
    pub fn space_toml(&self) -> String {
        resolved::space_toml(self)
    }

    /// `<name>-<12 hex digits of BLAKE3 of search_toml>`: the same command finds its run again (DESIGN 7).
    ///
    /// Two data sets may share a folder name, as paths are not part of it: compare data digests before resuming.
    pub fn run_folder_name(&self) -> String {
        let digest = blake3::hash(self.search_toml().as_bytes()).to_hex();
        format!("{}-{}", self.name, &digest[..12])
    }
}

/// JSON Schema (2020-12) of the experiment file, for editors.
pub fn json_schema() -> serde_json::Value {
    schemars::schema_for!(raw::RawExperiment).to_value()
}

fn read_bounded(path: &Path) -> Result<String, Fault> {
    let unreadable = |error: std::io::Error| {
        Fault::new("file", format!("not readable, got {error}"), "name an experiment file (.toml)")
    };
    // Before it is opened: opening a pipe waits for a writer.
    if !fs::metadata(path).map_err(unreadable)?.is_file() {
        return Err(Fault::new(
            "file",
            "not readable, got something that is no file",
            "name an experiment file (.toml)",
        ));
    }
    let mut bytes = Vec::new();
    File::open(path).and_then(|file| file.take(MAX_BYTES + 1).read_to_end(&mut bytes)).map_err(unreadable)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(Fault::new(
            "file",
            format!("larger than {MAX_BYTES} bytes, got {} or more", bytes.len()),
            "name an experiment file (.toml)",
        ));
    }
    String::from_utf8(bytes).map_err(|error| {
        Fault::new(
            "file",
            format!("not UTF-8, got another byte at offset {}", error.utf8_error().valid_up_to()),
            "save it as UTF-8",
        )
    })
}
