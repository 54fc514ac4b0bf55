//! Why a run has no result.

use std::io;
use std::path::PathBuf;

use cluster::ClusterError;
use cluster::journal::{JOURNAL_FILE, JournalError};
use descriptor::weigh::WeighError;
use evolution::SettingsError;
use transport::ListenError;

use proto::{Digest, Principal};

use crate::dataset::DatasetError;
use crate::exhaust::grid::GridError;
use crate::experiment::ConfigError;
use crate::in_process::InProcessError;
use crate::observers::event_file::EventFileError;
use crate::reference_clouds::ReferenceError;
use crate::result_cache::Wrong;
use crate::run::data::DataError;
use crate::slurm::SlurmError;

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
    /// Slurm gives no workers.
    #[error(transparent)]
    Slurm(#[from] SlurmError),
    /// The file that events are to be written to.
    #[error(transparent)]
    Events(#[from] EventFileError),
    /// Evaluations stopped for good.
    #[error(transparent)]
    Cluster(#[from] ClusterError),
    /// What an earlier start has left.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// It took too long.
    #[error(
        "coordinator.deadline_seconds: reached, got no result within {seconds} s\nrun the same command to go on, as long again, or raise the deadline"
    )]
    Deadline {
        /// The deadline.
        seconds: u64,
    },
    /// An operator has ended it.
    #[error("stopped by {by}: {reason}\ngo on: {go_on}")]
    Stopped {
        /// How to go on.
        go_on: String,
        /// Who.
        by: String,
        /// Why.
        reason: String,
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
    Experiment(#[from] ConfigError),
    /// The workers of this process stopped.
    #[error(transparent)]
    InProcess(#[from] InProcessError),
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
    /// The folder is somebody else's.
    #[error(
        "--out {folder}: must be new, empty, or have a search.toml of this program, got {entry} among others\nchoose another --out: nothing was written"
    )]
    Occupied {
        /// The folder.
        folder: PathBuf,
        /// Something in it.
        entry: PathBuf,
    },
    /// Tables, and nothing that says which answers they rest on.
    #[error(
        "{folder}: has an unfinished run, got no {JOURNAL_FILE} beside its tables\nbring the journal back, start another with --fresh, or choose another --out: nothing was changed"
    )]
    JournalGone {
        /// The folder of the run.
        folder: PathBuf,
    },
    /// The same search has run on other clouds.
    #[error(
        "{folder}: is a run of other clouds, got data digest {now} instead of {then}\n{difference}\nbring its clouds back, start another with --fresh, or choose another --out"
    )]
    OtherData {
        /// The folder.
        folder: PathBuf,
        /// Data digest of the run.
        then: String,
        /// Data digest of the clouds as they are.
        now: String,
        /// Which clouds differ.
        difference: String,
    },
    /// The run is of a release that computes other numbers.
    #[error(
        "{folder}: is a run of evaluation version {then}, got a program of version {now}\ngo on with the release that began it, start another with --fresh, or choose another --out",
        now = descriptor::EVALUATION_VERSION
    )]
    OtherVersion {
        /// The folder.
        folder: PathBuf,
        /// Its evaluation version.
        then: u32,
    },
    /// Counts that earlier runs have left are wrong: the search begins again without them.
    #[error("remembered counts: {what}")]
    WronglyRemembered {
        /// Whoever is to blame.
        wrong: Wrong,
        /// What is wrong with them.
        what: String,
    },
    /// A count of an earlier run is not what this one finds, and nobody is there to tell which is wrong.
    #[error(
        "remembered counts: {descriptor}: {matching}: must be what was computed now, {computed}, got {remembered}\nstart a worker of the coordinator's own process, which decides (--local-workers 1), or run again with --no-cache"
    )]
    Contradiction {
        /// The descriptor.
        descriptor: descriptor::Descriptor,
        /// Which counts.
        matching: &'static str,
        /// Recognised objects and categories.
        computed: String,
        /// The same, as they were remembered.
        remembered: String,
    },
    /// A description that an earlier comparison has left is not what this one finds, and nobody is there to tell which is
    /// wrong.
    #[error(
        "descriptions: those of the clouds of split manifest {manifest} must be what was computed now, got others from the cache\nstart a worker of the coordinator's own process, which decides (--local-workers 1), or use --no-cache"
    )]
    WrongDescription {
        /// The clouds.
        manifest: Digest,
    },
    /// A cell that an earlier start has left is not what this one counts, and nobody is there to tell which is wrong.
    #[error(
        "{folder}: cell {cell} must be what was computed now, got other counts\nstart a worker of the coordinator's own process, which decides (--local-workers 1), or remove the cell", folder = .folder.display()
    )]
    WrongCell {
        /// The grid's folder.
        folder: PathBuf,
        /// Name of the cell.
        cell: String,
    },
    /// A principal that is to be readmitted is not quarantined.
    #[error(
        "--readmit: must name a principal that is quarantined in this run, got {principal}\nthe table `workers` of its folder shows them"
    )]
    NotQuarantined {
        /// The principal.
        principal: Principal,
    },
    /// Two answers of this run differ, and nobody is there to tell which is wrong.
    #[error(
        "workers: {descriptor}: {matching}: two of this run's own answers differ, got {computed} after {held}\nstart a worker with another certificate or at another address, or --local-workers 1, then run the same command again"
    )]
    Disagreement {
        /// The winner.
        descriptor: descriptor::Descriptor,
        /// Which counts.
        matching: &'static str,
        /// Recognised objects and categories.
        computed: String,
        /// The same, as the search took them.
        held: String,
    },
    /// Nothing would ever be computed.
    #[error(
        "validation: stop.validation_patience and search.winner = \"validation\" need validation clouds, got none\nset stop.validation_patience = \"off\" and search.winner = \"fitness\", or give the validation split some clouds"
    )]
    NoValidation,
    /// Clouds cannot be matched across sequences.
    #[error(
        "search.fitness.cross-sequence: needs the sequence of every cloud, got {count} without one, the first of them {first}\nname sequences in a manifest's column, use layout = \"uw\", or write [search.fitness] leave-one-out = 1"
    )]
    NoSequences {
        /// How many clouds have none.
        count: usize,
        /// Path of the first.
        first: String,
    },
    /// Every query would be left out.
    #[error(
        "search.fitness.{protocol}: needs objects with training clouds that may be matched with each other, got none\nadd clouds, in several sequences for cross-sequence, or write [search.fitness] split = 1"
    )]
    NoAnswers {
        /// Under which protocol.
        protocol: &'static str,
    },
    /// Validation would count nothing.
    #[error(
        "search.fitness: needs validation clouds of objects with training clouds that they may be matched with, got none of {clouds}\n{}",
        if *across {
            "give the validation split clouds of other sequences than the training clouds of their objects, or write [search.fitness] split = 1"
        } else {
            "give the validation split clouds of objects that the training splits have, too"
        }
    )]
    NoValidationAnswers {
        /// Validation clouds of sets with a weight.
        clouds: usize,
        /// Whether they are matched across sequences.
        across: bool,
    },
    /// A weight of a set that no cloud is of.
    #[error(
        "{place}: must name sets of the clouds, got {name:?}\nsets of these clouds are: {}",
        if known.is_empty() { "none, as the manifest has no column set" } else { known }
    )]
    UnknownSet {
        /// Where they are named.
        place: &'static str,
        /// The name.
        name: String,
        /// The names that there are.
        known: String,
    },
    /// No values can be weighed.
    #[error("search.weigh: {0}")]
    Weigh(#[from] WeighError),
    /// A cloud that values are to be weighed by.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// No set has a part in the fitness.
    #[error("search.sets: must leave one set a weight above 0, got only zeros\nremove one of them")]
    NoWeight,
    /// A set whose clouds have nothing to be compared with.
    #[error(
        "dataset: set {name}: must have usable clouds in train1 and train2, got none in {split}\nname some in the column split, or leave the set out"
    )]
    EmptySet {
        /// The set.
        name: String,
        /// The split.
        split: &'static str,
    },
    /// Something that is computed of one set only.
    #[error("{what}: needs clouds of one set, got sets {sets}\n{advice}")]
    SeveralSets {
        /// What.
        what: &'static str,
        /// The names of the sets.
        sets: String,
        /// What to do.
        advice: &'static str,
    },
    /// Nothing was evaluated.
    #[error(
        "search: no descriptor costs at most descriptor.max_cost = {max_cost}, got {least} and more\nraise it, or search longer"
    )]
    TooCostly {
        /// What a descriptor may cost.
        max_cost: u64,
        /// The least cost of those that were met.
        least: u64,
    },
}
