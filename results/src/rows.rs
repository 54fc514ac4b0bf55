//! Rows of the tables as plain structs, for those who write them.

use std::time::SystemTime;

/// How many queries were answered correctly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counts {
    /// Queries whose nearest cloud is of the same object.
    pub object_correct: u32,
    /// Queries whose nearest cloud is of the same category.
    pub category_correct: u32,
    /// Queries that took part; at least 1.
    pub queries: u32,
}

impl Counts {
    /// Share of queries with the right object.
    pub fn fitness(&self) -> f64 {
        share(self.object_correct, self.queries)
    }

    /// Share of queries with a wrong object: 1 − fitness, rounded once.
    pub fn object_error(&self) -> f64 {
        share(self.queries.saturating_sub(self.object_correct), self.queries)
    }

    /// Share of queries with a wrong category.
    pub fn category_error(&self) -> f64 {
        share(self.queries.saturating_sub(self.category_correct), self.queries)
    }
}

/// The quotient of two counts, correctly rounded.
pub(crate) fn share(part: u32, whole: u32) -> f64 {
    f64::from(part) / f64::from(whole)
}

/// One individual of one generation.
#[derive(Clone, Debug, PartialEq)]
pub struct EvaluationRow {
    /// Generation, from 1.
    pub generation: u32,
    /// Index in the generation, from 0.
    pub individual: u32,
    /// Bit string of `0` and `1`.
    pub chromosome: String,
    /// Values in the genes' units, in the order of the gene columns; `None` for a gene that is not used.
    pub genes: Vec<Option<f64>>,
    /// Outcome on the first training set.
    pub counts: Counts,
    /// Indices of the parents in the previous generation: none in generation 1, only the first for an elite.
    pub parents: [Option<u32>; 2],
    /// Copied unmutated from the previous generation.
    pub elite: bool,
    /// Who computed it; `None` if it was remembered.
    pub computed: Option<Computed>,
}

/// Where and how fast an evaluation was computed.
#[derive(Clone, Debug, PartialEq)]
pub struct Computed {
    /// Name of the worker.
    pub worker: String,
    /// Attempt that gave the result, from 1.
    pub attempt: u32,
    /// Wait for a worker, seconds.
    pub queued_seconds: f64,
    /// Time on the worker, seconds.
    pub run_seconds: f64,
}

/// What a generation's row says beyond its individuals; the rest is derived from them
/// (see [`PopulationSummary`](crate::PopulationSummary)).
#[derive(Clone, Debug, PartialEq)]
pub struct GenerationRow {
    /// Generation, from 1.
    pub generation: u32,
    /// Highest fitness of this and all earlier generations.
    pub best_so_far_fitness: f64,
    /// Outcome of the generation's best on validation, if it was measured.
    pub validation: Option<Counts>,
    /// Probability of a flip per bit between the two mutation points, for the children of this generation.
    pub mutation_rate: f64,
    /// Wall time, seconds.
    pub seconds: f64,
}

/// The split that predictions belong to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PredictionSplit {
    /// Queries of the validation set against both training sets.
    Validation,
    /// Queries of the test set against everything else.
    Test,
}

impl PredictionSplit {
    /// Both splits.
    pub const ALL: [Self; 2] = [Self::Validation, Self::Test];

    /// Its name: the file's name and the value of column `split`.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Validation => "validation",
            Self::Test => "test",
        }
    }
}

/// The winner's answer to one query.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictionRow {
    /// Index of the query in its split, from 0, ascending.
    pub query: u32,
    /// The query's path below the data root.
    pub cloud: String,
    /// The query's object.
    pub instance: String,
    /// The query's category.
    pub category: String,
    /// Path of the nearest database cloud.
    pub nearest_cloud: String,
    /// Its object.
    pub predicted_instance: String,
    /// Its category.
    pub predicted_category: String,
    /// Set distance to it.
    pub distance: f64,
    /// Nearest database cloud of another object than the predicted one; `None` if there is none.
    pub runner_up: Option<RunnerUp>,
}

/// The nearest cloud of another object than the predicted one.
#[derive(Clone, Debug, PartialEq)]
pub struct RunnerUp {
    /// Path below the data root.
    pub cloud: String,
    /// Set distance to it.
    pub distance: f64,
}

/// A cloud that took no part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkippedRow {
    /// Split that lists it.
    pub split: String,
    /// Path below the data root.
    pub cloud: String,
    /// Why.
    pub reason: String,
}

/// The run as a whole.
#[derive(Clone, Debug, PartialEq)]
pub struct RunRow {
    /// Name of the experiment.
    pub name: String,
    /// What determines the result, as canonical TOML: no path, address, worker or cache setting.
    pub search_config: String,
    /// The whole resolved experiment as TOML.
    pub resolved_toml: String,
    /// Seed of every random stream.
    pub seed: u64,
    /// BLAKE3 over splits, labels and content of the clouds, hexadecimal.
    pub data_digest: String,
    /// Version of the method.
    pub evaluation_version: u32,
    /// Version of the coordinator.
    pub program_version: String,
    /// Build of the coordinator.
    pub build: String,
    /// Machine of the coordinator.
    pub host: String,
    /// Start; kept to the millisecond.
    pub started_at: SystemTime,
    /// End; kept to the millisecond.
    pub finished_at: SystemTime,
    /// Wall time at work, over all starts of the run, seconds.
    pub seconds: f64,
    /// Why evolution stopped.
    pub stop_reason: String,
    /// Number of generations.
    pub generations: u32,
    /// Individuals evaluated by a worker.
    pub evaluations_computed: u64,
    /// Individuals whose result was known already.
    pub evaluations_remembered: u64,
    /// Generation of the winner.
    pub winner_generation: u32,
    /// Index of the winner in its generation.
    pub winner_individual: u32,
    /// The winner's bit string.
    pub best_chromosome: String,
    /// The winner's genes, as in [`EvaluationRow::genes`].
    pub best_genes: Vec<Option<f64>>,
    /// The winner on the first training set.
    pub train: Counts,
    /// The winner on validation, if measured.
    pub validation: Option<Counts>,
    /// The winner on test, if there is a test split.
    pub test: Option<Counts>,
    /// Correct answers of the best descriptor of the whole search space on the first training set, if known.
    pub grid_best_object_correct: Option<u32>,
}

impl RunRow {
    /// How far the winner's training fitness is below that of the best descriptor there is, if that is known.
    pub fn regret(&self) -> Option<f64> {
        let missed = self.grid_best_object_correct?.saturating_sub(self.train.object_correct);
        Some(share(missed, self.train.queries))
    }
}
