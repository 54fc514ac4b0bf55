//! The one table of columns: every table of a run or grid folder, from which files, checks and SCHEMA.md are made.

use std::collections::BTreeSet;
use std::fmt;

use crate::columns::ColumnKind::{Bool, F64, Text, Timestamp, U32, U64};
use crate::columns::{Column, GeneColumn};
use crate::database;
use crate::error::Error;

/// The tables of run folders and of grid folders. A table's files lie in the folder of its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum TableName {
    /// A row an individual and generation.
    Evaluations,
    /// A row a generation.
    Generations,
    /// A row a query of validation and test.
    Predictions,
    /// A row a cloud that took no part.
    Skipped,
    /// A row a worker, each time that it joined.
    Workers,
    /// A row an attempt that has ended.
    Attempts,
    /// A row a thing that happened and is worth telling.
    Events,
    /// One row: the run itself.
    Run,
    /// A row a descriptor of one cell of the grid.
    Cells,
    /// A row each for the best descriptors of the grid.
    Best,
    /// A row a gene and value.
    Marginals,
    /// A row a pair of genes and their values.
    Landscapes,
    /// A row a number of correct answers that occurs in the grid.
    Counts,
    /// One row: the grid itself.
    Grid,
    /// A row a reference cloud of an artefact.
    Database,
}

impl TableName {
    /// The tables of a run folder.
    pub const RUN: [Self; 8] = [
        Self::Evaluations,
        Self::Generations,
        Self::Predictions,
        Self::Skipped,
        Self::Workers,
        Self::Attempts,
        Self::Events,
        Self::Run,
    ];
    /// The tables of a grid folder.
    pub const GRID: [Self; 6] =
        [Self::Cells, Self::Best, Self::Marginals, Self::Landscapes, Self::Counts, Self::Grid];
    /// The tables of artefacts.
    pub const ARTEFACT: [Self; 1] = [Self::Database];

    /// Its name: the folder's name and the value of `descry.table` in the files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Evaluations => "evaluations",
            Self::Generations => "generations",
            Self::Predictions => "predictions",
            Self::Skipped => "skipped",
            Self::Workers => "workers",
            Self::Attempts => "attempts",
            Self::Events => "events",
            Self::Run => "run",
            Self::Cells => "cells",
            Self::Best => "best",
            Self::Marginals => "marginals",
            Self::Landscapes => "landscapes",
            Self::Counts => "counts",
            Self::Grid => "grid",
            Self::Database => "database",
        }
    }

    /// What stands before a gene's name in this table's columns; `None` if the table has no genes.
    pub(crate) fn gene_prefix(self) -> Option<&'static str> {
        match self {
            Self::Evaluations | Self::Cells | Self::Best => Some(""),
            Self::Run | Self::Grid => Some("best_"),
            Self::Generations
            | Self::Predictions
            | Self::Skipped
            | Self::Workers
            | Self::Attempts
            | Self::Events
            | Self::Marginals
            | Self::Landscapes
            | Self::Counts
            | Self::Database => None,
        }
    }
}

impl fmt::Display for TableName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// A table: what a row is and which columns it has, in order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Table {
    /// Which table.
    pub name: TableName,
    /// What a row stands for.
    pub meaning: &'static str,
    /// Names of the columns that identify a row and give the order of rows.
    pub key: &'static [&'static str],
    /// The columns in file order.
    pub columns: Vec<Column>,
}

impl Table {
    /// The table of an experiment with these genes. Fails if a gene's name is empty, occurs twice or is that of a
    /// fixed column.
    pub fn new(name: TableName, genes: &[GeneColumn]) -> Result<Self, Error> {
        let (meaning, key, columns): (_, &'static [&'static str], _) = match name {
            TableName::Evaluations => {
                ("an individual of a generation", &["generation", "individual"], evaluations(genes))
            }
            TableName::Generations => ("a generation", &["generation"], generations()),
            TableName::Predictions => {
                ("a query cloud of the winner's validation or final test", &["split", "query"], predictions())
            }
            TableName::Skipped => ("a cloud that took no part", &["split", "cloud"], skipped()),
            TableName::Workers => {
                ("a worker, from when it joined to when it went", &["worker", "joined_at"], workers())
            }
            TableName::Attempts => (
                "an attempt at a job that has ended; a late answer to it makes a second row",
                &["job", "attempt", "ended_at"],
                attempts(),
            ),
            TableName::Events => ("something worth telling that happened", &["at"], events()),
            TableName::Run => ("the run; the table has one row, written last", &["name"], run(genes)),
            TableName::Cells => ("a descriptor; a file has those of one R1 and one R2", &[], cells(genes)),
            TableName::Best => {
                ("one of the best descriptors, ties in the order of the genes", &["rank"], best(genes))
            }
            TableName::Marginals => {
                ("all descriptors with one value of one gene", &["gene", "value"], marginals())
            }
            TableName::Landscapes => (
                "all descriptors with one value of each of two genes",
                &["gene_a", "value_a", "gene_b", "value_b"],
                landscapes(),
            ),
            TableName::Counts => {
                ("all descriptors with one number of correct answers", &["object_correct"], histogram())
            }
            TableName::Grid => ("the grid; the table has one row, written last", &["grid_key"], grid(genes)),
            TableName::Database => {
                ("a reference cloud, in the order that decides ties", &["cloud"], database::columns())
            }
        };
        let mut seen = BTreeSet::new();
        for column in &columns {
            let gene = column.name.strip_prefix(name.gene_prefix().unwrap_or_default());
            if !seen.insert(column.name.as_str()) || gene.is_none_or(str::is_empty) && column.gene {
                return Err(Error::GeneName { name: column.name.clone() });
            }
        }
        Ok(Self { name, meaning, key, columns })
    }

    /// The column of that name.
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|column| column.name == name)
    }
}

/// `object`, `category` and `queries` counts with their errors, as `<prefix>object_correct` and so on.
fn counts(prefix: &str, of: &str) -> [Column; 5] {
    let column = |name: &str, kind, unit: &str, meaning: String| {
        Column::new(&format!("{prefix}{name}"), kind, unit, &meaning)
    };
    [
        column("object_correct", U32, "clouds", format!("{of} whose nearest cloud is of the same object")),
        column(
            "category_correct",
            U32,
            "clouds",
            format!("{of} whose nearest cloud is of the same category"),
        ),
        column("queries", U32, "clouds", format!("{of} that took part: the denominator")),
        column("object_error", F64, "share", format!("1 - {prefix}object_correct / {prefix}queries")),
        column("category_error", F64, "share", format!("1 - {prefix}category_correct / {prefix}queries")),
    ]
}

fn evaluations(genes: &[GeneColumn]) -> Vec<Column> {
    let mut columns = vec![
        Column::new("generation", U32, "", "generation, from 1").in_digest(),
        Column::new("individual", U32, "", "index in the generation, from 0").in_digest(),
        Column::new("chromosome", Text, "bits", "the bit string, genes in table order").in_digest(),
    ];
    columns.extend(genes.iter().map(|gene| gene.column("").in_digest()));
    columns.push(Column::new("fitness", F64, "share", "object_correct / queries"));
    let [object_correct, category_correct, queries, object_error, category_error] =
        counts("", "first training set's clouds");
    columns.extend([
        object_correct.in_digest(),
        category_correct.in_digest(),
        queries,
        object_error,
        category_error,
        Column::new(
            "parent_a",
            U32,
            "",
            "first parent's index in the previous generation; null in generation 1",
        )
        .nullable()
        .in_digest(),
        Column::new("parent_b", U32, "", "second parent's index; null in generation 1 and for an elite")
            .nullable()
            .in_digest(),
        Column::new("elite", Bool, "", "copied unmutated from the previous generation"),
        Column::new("remembered", Bool, "", "taken from an earlier evaluation instead of computed"),
        Column::new("worker", Text, "", "name of the worker, or `N workers` of pieces; null if remembered")
            .nullable(),
        Column::new(
            "attempt",
            U32,
            "",
            "attempt that gave the result, from 1, the last of pieces; null as that",
        )
        .nullable(),
        Column::new("queued_seconds", F64, "s", "wait for a worker, of the first of pieces; null as that")
            .nullable(),
        Column::new("run_seconds", F64, "s", "time on the worker, the sum of pieces; null as that")
            .nullable(),
    ]);
    columns
}

fn generations() -> Vec<Column> {
    let mut columns = vec![
        Column::new("generation", U32, "", "generation, from 1").in_digest(),
        Column::new("best_individual", U32, "", "index of the best, the lowest on ties"),
        Column::new("best_object_correct", U32, "clouds", "its object_correct"),
        Column::new("queries", U32, "clouds", "first training set's clouds that took part"),
        Column::new("best_fitness", F64, "share", "highest fitness of the generation"),
        Column::new("mean_fitness", F64, "share", "mean fitness of the generation"),
        Column::new("worst_fitness", F64, "share", "lowest fitness of the generation"),
        Column::new(
            "best_so_far_fitness",
            F64,
            "share",
            "highest fitness of this and all earlier generations",
        ),
    ];
    let [object_correct, category_correct, queries, object_error, category_error] =
        counts("validation_", "validation clouds");
    columns.extend([
        object_correct.nullable().in_digest(),
        category_correct.nullable().in_digest(),
        queries.nullable().in_digest(),
        object_error.nullable(),
        category_error.nullable(),
        Column::new(
            "mutation_rate",
            F64,
            "",
            "probability of a flip per bit between the two mutation points, for this generation's children",
        )
        .in_digest(),
        Column::new("diversity", F64, "share", "mean pairwise Hamming distance of chromosomes, per bit"),
        Column::new("evaluations_computed", U32, "", "individuals evaluated by a worker"),
        Column::new("evaluations_remembered", U32, "", "individuals whose result was known already"),
        Column::new("seconds", F64, "s", "wall time of the generation"),
        Column::new("rows_digest", Text, "", "BLAKE3 of the generation's cells that the run digest covers"),
    ]);
    columns
}

fn predictions() -> Vec<Column> {
    [
        Column::new("split", Text, "", "validation or test"),
        Column::new("query", U32, "", "index of the query in its split, from 0"),
        Column::new("cloud", Text, "", "the query's path below the data root"),
        Column::new("instance", Text, "", "the query's object"),
        Column::new("category", Text, "", "the query's category"),
        Column::new("nearest_cloud", Text, "", "path of the database cloud with the smallest set distance"),
        Column::new("predicted_instance", Text, "", "object of the nearest cloud"),
        Column::new("predicted_category", Text, "", "category of the nearest cloud"),
        Column::new("distance", F64, "", "set distance to the nearest cloud"),
        Column::new("runner_up_cloud", Text, "", "nearest cloud of another object than the predicted one")
            .nullable(),
        Column::new("runner_up_distance", F64, "", "set distance to it").nullable(),
        Column::new("correct_object", Bool, "", "predicted_instance is instance"),
        Column::new("correct_category", Bool, "", "predicted_category is category"),
    ]
    .into_iter()
    .map(Column::in_digest)
    .collect()
}

fn skipped() -> Vec<Column> {
    vec![
        Column::new("split", Text, "", "split that lists the cloud"),
        Column::new("cloud", Text, "", "path below the data root"),
        Column::new("reason", Text, "", "why it took no part"),
    ]
}

fn workers() -> Vec<Column> {
    vec![
        Column::new("worker", Text, "", "unique name of the worker"),
        Column::new("id", Text, "", "random id that it made when it started, hexadecimal"),
        Column::new("threads", U32, "", "threads that evaluate"),
        Column::new("build", Text, "", "build of the worker"),
        Column::new(
            "credential",
            Text,
            "",
            "token, or certificate and fingerprint; null where nothing is asked for",
        )
        .nullable(),
        Column::new("joined_at", Timestamp, "UTC", "when it registered"),
        Column::new("gone_at", Timestamp, "UTC", "when it went; null if it was there to the end").nullable(),
        Column::new(
            "departure",
            Text,
            "",
            "left, lost, quarantined, denied or ended (with the coordinator's process); null as that",
        )
        .nullable(),
        Column::new("leases", U32, "", "jobs it had in hand when it went; null as that").nullable(),
        Column::new("answers", U64, "", "valid answers it had given when it went; null as that").nullable(),
    ]
}

fn attempts() -> Vec<Column> {
    let ends = "answered (first), agreed or disagreed (with an earlier answer), late (after it was given up), failed, \
                overdue, undelivered, revoked, left, lost, quarantined, denied or dropped (the run ended)";
    vec![
        Column::new("job", U64, "", "number of the job"),
        Column::new("attempt", U32, "", "attempt at it, from 1"),
        Column::new("worker", Text, "", "name of the worker"),
        Column::new("task", Text, "", "what was asked"),
        Column::new("handed_out_at", Timestamp, "UTC", "when the worker got it"),
        Column::new("ended_at", Timestamp, "UTC", "when it ended"),
        Column::new("end", Text, "", ends),
        Column::new("reason", Text, "", "what more there is to say of the end").nullable(),
        Column::new("run_seconds", F64, "s", "time on the worker, if it reported").nullable(),
    ]
}

fn events() -> Vec<Column> {
    let kinds = "lost, quarantined, denied, disagreement, undecided, rewind, unaudited, starving or omitted (rows that had no room)";
    vec![
        Column::new("at", Timestamp, "UTC", "when"),
        Column::new("event", Text, "", kinds),
        Column::new("worker", Text, "", "whom it is about").nullable(),
        Column::new("generation", U32, "", "generation that the run went back to").nullable(),
        Column::new("message", Text, "", "what happened, for people"),
    ]
}

fn run(genes: &[GeneColumn]) -> Vec<Column> {
    let mut columns = vec![
        Column::new("name", Text, "", "name of the experiment"),
        Column::new("search_config", Text, "TOML", "what determines the result, in canonical form")
            .in_digest(),
        Column::new("resolved_toml", Text, "TOML", "the whole resolved experiment"),
        Column::new("seed", U64, "", "seed of every random stream").in_digest(),
        Column::new("data_digest", Text, "", "BLAKE3 over splits, labels and content of the clouds")
            .in_digest(),
        Column::new(
            "evaluation_version",
            U32,
            "",
            "version of the method: equal versions give equal results",
        ),
        Column::new("program_version", Text, "", "version of the coordinator"),
        Column::new("build", Text, "", "build of the coordinator"),
        Column::new("host", Text, "", "machine of the coordinator"),
        Column::new("started_at", Timestamp, "UTC", "start of the run"),
        Column::new("finished_at", Timestamp, "UTC", "end of the run"),
        Column::new("seconds", F64, "s", "wall time at work, over all starts of the run"),
        Column::new("stop_reason", Text, "", "why evolution stopped").in_digest(),
        Column::new("generations", U32, "", "number of generations"),
        Column::new("evaluations_computed", U64, "", "individuals evaluated by a worker"),
        Column::new("evaluations_remembered", U64, "", "individuals whose result was known already"),
        Column::new("winner_generation", U32, "", "generation of the winner"),
        Column::new("winner_individual", U32, "", "its index in that generation"),
        Column::new("best_chromosome", Text, "bits", "its bit string"),
    ];
    columns.extend(genes.iter().map(|gene| gene.column("best_")));
    columns.extend(counts("train_", "first training set's clouds"));
    columns.extend(counts("validation_", "validation clouds").map(Column::nullable));
    columns.extend(counts("test_", "test clouds").map(Column::nullable));
    columns.extend([
        Column::new("predictions_digest", Text, "", "BLAKE3 of the predictions"),
        Column::new("run_digest", Text, "", "BLAKE3 of everything that the columns marked `digest` say"),
        Column::new(
            "grid_best_object_correct",
            U32,
            "clouds",
            "object_correct of the best descriptor of the whole search space; null if it was not known at the end of \
             the run",
        )
        .nullable(),
        Column::new(
            "regret",
            F64,
            "share",
            "(grid_best_object_correct - train_object_correct) / train_queries; null as that",
        )
        .nullable(),
    ]);
    columns
}

/// Number of correct answers of the first training set, and the error that follows from it.
fn object_correct(prefix: &str, which: &str) -> [Column; 2] {
    let (correct, error) = (format!("{prefix}object_correct"), format!("{prefix}object_error"));
    [
        Column::new(&correct, U32, "clouds", &format!("{which} number of queries of the same object")),
        Column::new(&error, F64, "share", &format!("1 - {correct} / queries")),
    ]
}

fn mean_object_correct(prefix: &str) -> [Column; 2] {
    let (correct, error) = (format!("{prefix}_object_correct"), format!("{prefix}_object_error"));
    [
        Column::new(&correct, F64, "clouds", &format!("{prefix} number of queries of the same object")),
        Column::new(&error, F64, "share", &format!("1 - {correct} / queries")),
    ]
}

fn descriptors() -> Column {
    Column::new("descriptors", U64, "", "how many they are")
}

fn cells(genes: &[GeneColumn]) -> Vec<Column> {
    let mut columns: Vec<Column> = genes.iter().map(|gene| gene.column("")).collect();
    let meaning = "first training set's clouds whose nearest cloud is of the same object";
    columns.push(Column::new("object_correct", U32, "clouds", meaning));
    let meaning = "id of the worker that counted them, hexadecimal; null if not known";
    columns.push(Column::new("worker_id", Text, "", meaning).nullable());
    columns
}

fn best(genes: &[GeneColumn]) -> Vec<Column> {
    let mut columns = vec![Column::new("rank", U32, "", "place among all descriptors, from 1")];
    columns.extend(genes.iter().map(|gene| gene.column("")));
    let [object_correct, _, queries, object_error, _] = counts("", "first training set's clouds");
    columns.extend([
        object_correct,
        queries,
        Column::new("fitness", F64, "share", "object_correct / queries"),
        object_error,
    ]);
    columns
}

fn marginals() -> Vec<Column> {
    let mut columns = vec![
        Column::new("gene", Text, "", "name of the gene"),
        Column::new("value", F64, "the gene's", "value of the gene"),
        descriptors(),
    ];
    columns.extend(object_correct("best_", "highest"));
    columns.extend(mean_object_correct("mean"));
    columns.extend(mean_object_correct("median"));
    columns.extend(object_correct("worst_", "lowest"));
    columns
}

fn landscapes() -> Vec<Column> {
    let mut columns = vec![
        Column::new("gene_a", Text, "", "name of one gene"),
        Column::new("value_a", F64, "the gene's", "its value"),
        Column::new("gene_b", Text, "", "name of a later gene"),
        Column::new("value_b", F64, "the gene's", "its value"),
        descriptors(),
    ];
    columns.extend(object_correct("best_", "highest"));
    columns.extend(mean_object_correct("mean"));
    columns
}

fn histogram() -> Vec<Column> {
    let mut columns = object_correct("", "the").to_vec();
    columns.push(descriptors());
    columns
}

fn grid(genes: &[GeneColumn]) -> Vec<Column> {
    let mut columns = vec![
        Column::new("name", Text, "", "name of the experiment"),
        Column::new("grid_key", Text, "", "BLAKE3 of search_space"),
        Column::new(
            "search_space",
            Text,
            "TOML",
            "what determines the counts: evaluation version, training clouds, preprocessing and genes",
        ),
        Column::new(
            "train_digest",
            Text,
            "",
            "BLAKE3 over labels and content of the usable clouds of both training sets",
        ),
        Column::new(
            "evaluation_version",
            U32,
            "",
            "version of the method: equal versions give equal results",
        ),
        Column::new("cells", U32, "", "pairs of R1 and R2"),
        Column::new("descriptors", U64, "", "size of the search space"),
        Column::new("queries", U32, "clouds", "first training set's clouds that took part"),
        Column::new("optimal_descriptors", U64, "", "how many are as good as the best"),
    ];
    columns.extend(genes.iter().map(|gene| gene.column("best_")));
    columns.extend(object_correct("best_", "highest"));
    columns.extend([
        Column::new("grid_digest", Text, "", "BLAKE3 over the counts of all cells, R1 and R2 ascending"),
        Column::new("cells_computed", U32, "", "cells evaluated since the last start"),
        Column::new("cells_found", U32, "", "cells that were evaluated before it"),
        Column::new("seconds", F64, "s", "wall time since the last start"),
        Column::new("finished_at", Timestamp, "UTC", "end of the last cell's evaluation"),
    ]);
    columns
}
