//! Rows of a run folder's results.

use std::time::SystemTime;

use crate::population::{Member, PopulationSummary, share};
use crate::record::record;
use crate::statistics::ErrorRate;

record! {
    /// Correct answers. In the meanings of the columns, "`{of}`" stands for the clouds that were asked for.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct Counts {
        object_correct: u32, "clouds", "{of} whose nearest cloud is of the same object";
        category_correct: u32, "clouds", "{of} whose nearest cloud is of the same category";
        /// At least 1;
        queries: u32, "clouds", "{of} that took part: the denominator";
        => object_error: f64, "share", "1 - {prefix}object_correct / {prefix}queries"
            = |counts, _| counts.object_error();
        => category_error: f64, "share", "1 - {prefix}category_correct / {prefix}queries"
            = |counts, _| counts.category_error();
    }
}

impl Counts {
    /// Of no query yet.
    pub const NONE: Self = Self { object_correct: 0, category_correct: 0, queries: 0 };

    /// Counts one more query: whether its answer is of the right object, and of the right category.
    pub fn add(&mut self, is_object: bool, is_category: bool) {
        self.object_correct += u32::from(is_object);
        self.category_correct += u32::from(is_category);
        self.queries += 1;
    }

    /// Share of queries with the right object.
    pub fn fitness(&self) -> f64 {
        share(self.object_correct, self.queries)
    }

    /// Queries with a wrong object.
    pub fn object_errors(&self) -> ErrorRate {
        ErrorRate::new(self.object_correct, self.queries)
    }

    /// Queries with a wrong category.
    pub fn category_errors(&self) -> ErrorRate {
        ErrorRate::new(self.category_correct, self.queries)
    }

    /// Share of queries with a wrong object: 1 − fitness, rounded once.
    pub fn object_error(&self) -> f64 {
        self.object_errors().share()
    }

    /// Share of queries with a wrong category.
    pub fn category_error(&self) -> f64 {
        self.category_errors().share()
    }
}

record! {
    /// One individual of one generation.
    #[derive(Clone, Debug, PartialEq)]
    pub struct EvaluationRow {
        generation: u32, "", "generation, from 1";
        individual: u32, "", "index in the generation, from 0";
        chromosome: String, "bits", "the bit string, genes in table order";
        genes as "": Vec<Option<f64>>, "", "values of the genes, in their units";
        => fitness: f64, "share", "object_correct / queries, or category_correct where categories are the objective"
            = |row, _| share(row.correct(), row.counts.queries);
        counts as "": Counts, "", "training clouds that the fitness asks for";
        objective_correct: Option<u32>, "clouds",
            "what the fitness counts where that is not object_correct; null elsewhere";
        margin: Option<f64>, "",
            "soft margin: mean of (d_other - d_same) / (d_other + d_same) over the queries; null where none is asked for";
        set_errors: Option<Vec<f32>>, "share",
            "errors on the training clouds of each set with a weight, in the order of their names, 1 - fitness each; null of clouds of one set, and of what costs too much to be evaluated";
        parent_a: Option<u32>, "", "first parent's index in the previous generation; null where it was drawn at random or joined of members";
        parent_b: Option<u32>, "", "second parent's index; null where it has one parent or none";
        elite: bool, "", "copied unmutated from the previous generation";
        => remembered: bool, "", "taken from an earlier evaluation instead of computed"
            = |row, _| row.computed.is_none();
        computed as "": Option<Computed>, "", "where it was computed";
    }
}

impl EvaluationRow {
    /// Queries that the fitness counts as answered.
    pub fn correct(&self) -> u32 {
        self.objective_correct.unwrap_or(self.counts.object_correct)
    }
}

record! {
    /// Where and how fast an evaluation was computed.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Computed {
        worker: String, "", "name of the worker, or `N workers` of pieces; null if remembered";
        attempt: u32, "", "attempt that gave the result, from 1, the last of pieces; null as that";
        queued_seconds: f64, "s", "wait for a worker, of the first of pieces; null as that";
        run_seconds: f64, "s", "time on the worker, the sum of pieces; null as that";
    }
}

record! {
    /// A generation. What follows from its individuals is computed from them.
    #[derive(Clone, Debug, PartialEq)]
    pub struct GenerationRow {
        generation: u32, "", "generation, from 1";
        => best_individual: u32, "", "index of the best, the lowest on ties"
            = |_, file| file.population.best_individual;
        => best_object_correct: u32, "clouds", "its object_correct, or what its fitness counts" = |_, file| file.population.best_object_correct;
        => queries: u32, "clouds", "training clouds that the fitness asked for"
            = |_, file| file.population.queries;
        => best_fitness: f64, "share", "highest fitness of the generation" = |_, file| file.population.best_fitness;
        => mean_fitness: f64, "share", "mean fitness of the generation" = |_, file| file.population.mean_fitness;
        => worst_fitness: f64, "share", "lowest fitness of the generation"
            = |_, file| file.population.worst_fitness;
        best_so_far_fitness: f64, "share", "highest fitness of this and all earlier generations";
        validation as "validation_": Option<Counts>, "", "validation clouds";
        validation_margin: Option<f64>, "", "soft margin of the best on validation clouds; null where none is asked for";
        hypervolume: Option<f64>, "share",
            "of the objectives between 0 and the reference point, what the front of this and all earlier generations dominates; the reference point is every query wrong, cost 2000000, size 1000; null of searches of one objective";
        mutation_rate: f64, "",
            "probability with which this generation's children are mutated: per bit between the two points, or per gene";
        => diversity: f64, "share", "mean pairwise Hamming distance of chromosomes, per bit"
            = |_, file| file.population.diversity;
        => evaluations_computed: u32, "", "individuals evaluated by a worker"
            = |_, file| file.population.evaluations_computed;
        => evaluations_remembered: u32, "", "individuals whose result was known already"
            = |_, file| file.population.evaluations_remembered;
        seconds: f64, "s", "wall time of the generation";
        => rows_digest: String, "", "BLAKE3 of the generation's cells that the run digest covers"
            = |_, _| String::new(); // computed from the file's other columns
    }
}

impl PopulationSummary {
    /// Summary of a generation in individual order; `None` if it is empty.
    pub fn of(individuals: &[EvaluationRow]) -> Option<Self> {
        let members = individuals.iter().map(|row| Member {
            chromosome: &row.chromosome,
            correct: row.correct(),
            margin: row.margin.unwrap_or_default(),
            queries: row.counts.queries,
            remembered: row.computed.is_none(),
        });
        Self::of_members(&members.collect::<Vec<_>>())
    }
}

record! {
    /// A point of the front of a search of several objectives.
    #[derive(Clone, Debug, PartialEq)]
    pub struct FrontRow {
        point: u32, "", "place by the training errors that the fitness counts, from 1";
        generation: u32, "", "generation in which it was found";
        individual: u32, "", "its index in that generation";
        chromosome: String, "bits", "its bit string";
        genes as "": Vec<Option<f64>>, "", "values of the genes, as in evaluations";
        train as "train_": Counts, "", "training clouds that the fitness asks for";
        objective_correct: Option<u32>, "clouds",
            "training clouds that the fitness counts where that is not train_object_correct; null elsewhere";
        train_margin: Option<f64>, "", "soft margin on them; null where none is asked for";
        validation as "validation_": Option<Counts>, "", "validation clouds";
        validation_margin: Option<f64>, "", "soft margin on validation clouds; null where none is asked for";
        cost: u64, "", "counted cost of recognising a cloud among 1000: about nanoseconds";
        size: u64, "values", "values kept a cloud";
        winner: bool, "", "the winner of the run";
    }
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

    /// Name of the file with its predictions.
    pub(crate) fn file(self) -> String {
        format!("{}.parquet", self.as_str())
    }
}

record! {
    /// A descriptor's answer to one query.
    #[derive(Clone, Debug, PartialEq)]
    pub struct PredictionRow {
        /// Ascending:
        query: u32, "", "index of the query in its split, from 0";
        cloud: String, "", "the query's path below the data root";
        instance: String, "", "the query's object";
        category: String, "", "the query's category";
        nearest_cloud: String, "",
            "path of the database cloud with the smallest set distance; of a recogniser that learns, a cloud of the object with the highest score";
        predicted_instance: String, "", "object of the nearest cloud";
        predicted_category: String, "", "category of the nearest cloud";
        distance: f64, "", "set distance to the nearest cloud; of a recogniser that learns, 1 - the score of the object";
        runner_up as "runner_up_": Option<RunnerUp>, "", "null if there is no such cloud";
        => correct_object: bool, "", "predicted_instance is instance"
            = |row, _| row.predicted_instance == row.instance;
        => correct_category: bool, "", "predicted_category is category"
            = |row, _| row.predicted_category == row.category;
    }
}

record! {
    /// The nearest cloud of another object than the predicted one.
    #[derive(Clone, Debug, PartialEq)]
    pub struct RunnerUp {
        cloud: String, "",
            "nearest cloud of another object than the predicted one; of a recogniser that learns, one of the object with the next score";
        distance: f64, "", "set distance to it, or 1 - the score of its object";
    }
}

record! {
    /// A cloud that took no part.
    #[derive(Clone, Debug, PartialEq, Eq)]
    pub struct SkippedRow {
        split: String, "", "split that lists the cloud";
        cloud: String, "", "path below the data root";
        reason: String, "", "why it took no part";
    }
}

record! {
    /// The run as a whole.
    #[derive(Clone, Debug, PartialEq)]
    pub struct RunRow {
        name: String, "", "name of the experiment";
        /// No path, address, worker or cache setting:
        search_config: String, "TOML", "what determines the result, in canonical form";
        resolved_toml: String, "TOML", "the whole resolved experiment";
        seed: u64, "", "seed of every random stream";
        data_digest: String, "", "BLAKE3 over splits, labels and content of the clouds";
        evaluation_version: u32, "", "version of the method: equal versions give equal results";
        program_version: String, "", "version of the coordinator";
        build: String, "", "build of the coordinator";
        host: String, "", "machine of the coordinator";
        started_at: SystemTime, "UTC", "start of the run";
        finished_at: SystemTime, "UTC", "end of the run";
        seconds: f64, "s", "wall time at work, over all starts of the run";
        stop_reason: String, "", "why evolution stopped";
        generations: u32, "", "number of generations";
        evaluations_computed: u64, "", "individuals evaluated by a worker";
        evaluations_remembered: u64, "", "individuals whose result was known already";
        winner_generation: u32, "", "generation of the winner";
        winner_individual: u32, "", "its index in that generation";
        best_chromosome: String, "bits", "its bit string";
        best_genes as "best_": Vec<Option<f64>>, "", "the winner's genes, as in evaluations";
        train as "train_": Counts, "", "training clouds that the fitness asks for";
        train_margin: Option<f64>, "", "soft margin of the winner on them; null where none is asked for";
        train_effective: Option<f64>, "clouds",
            "effective sample size of train_queries (Kish), of which intervals are, where clouds count more than once; null where each counts once, and in runs of earlier builds";
        validation as "validation_": Option<Counts>, "", "validation clouds";
        validation_effective: Option<f64>, "clouds", "the same of validation_queries";
        weighted_winner: Option<String>, "TOML",
            "the winner's structure file with weights for its values, which the test asks; null if they were not weighed";
        weighted_train as "weighted_train_": Option<Counts>, "", "the same as train_ of the winner with these weights";
        test as "test_": Option<Counts>, "", "test clouds";
        => predictions_digest: String, "", "BLAKE3 of the predictions" = |_, _| String::new(); // as run_digest
        => front_digest: Option<String>, "", "BLAKE3 of the front; null of searches of one objective"
            = |_, _| None; // as run_digest
        => run_digest: String, "", "BLAKE3 of everything that the columns marked `digest` say"
            = |_, _| String::new(); // computed from this row and the other files
        grid_best_object_correct: Option<u32>, "clouds",
            "object_correct of the best descriptor of the whole search space; null if it was not known at the end of the run";
        => regret: Option<f64>, "share",
            "(grid_best_object_correct - train_object_correct) / train_queries; null as that"
            = |row, _| row.regret();
        => evaluations_digest: Option<String>, "",
            "BLAKE3 of the files of table evaluations, whatever the run digest covers of them; null, as all below, in runs of earlier builds"
            = |_, _| None; // this and those below from the other files
        => generations_digest: Option<String>, "", "the same of table generations" = |_, _| None;
        => skipped_digest: Option<String>, "", "the same of table skipped" = |_, _| None;
        => workers_digest: Option<String>, "", "the same of table workers" = |_, _| None;
        => attempts_digest: Option<String>, "", "the same of table attempts" = |_, _| None;
        => events_digest: Option<String>, "", "the same of table events" = |_, _| None;
        => sets_digest: Option<String>, "", "the same of table sets; null if there is none" = |_, _| None;
        => looks_digest: Option<String>, "", "head of the chain of looks at the end of the run" = |_, _| None;
        => row_digest: Option<String>, "", "BLAKE3 of all other cells of this row" = |_, _| None;
    }
}

impl RunRow {
    /// Whether its fitness counts categories: the experiment's `search.fitness.objective`.
    pub fn counts_categories(&self) -> bool {
        self.search_config.lines().any(|line| line == "objective = \"category\"")
    }

    /// The errors that its fitness would count of these clouds.
    pub fn errors(&self, counts: Counts) -> ErrorRate {
        if self.counts_categories() { counts.category_errors() } else { counts.object_errors() }
    }

    /// How far the winner's training fitness is below that of the best descriptor there is, if that is known.
    pub fn regret(&self) -> Option<f64> {
        let missed = self.grid_best_object_correct?.saturating_sub(self.train.object_correct);
        Some(share(missed, self.train.queries))
    }
}
