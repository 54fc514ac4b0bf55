//! The one table of columns: every table of a run or grid folder, from which files, checks and SCHEMA.md are made.

mod comparison;
mod grid;
mod run;

use std::collections::BTreeSet;
use std::fmt;

use crate::columns::ColumnKind::{F64, U32};
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
    /// A row each time that test clouds were released to workers.
    Looks,
    /// One row: the run itself.
    Run,
    /// A row a descriptor and pair of clouds.
    Distances,
    /// A row a descriptor and query.
    Answers,
    /// A row a point of a descriptor's curve.
    RecallPrecision,
    /// A row a pair of descriptors.
    Pairs,
    /// A row a descriptor.
    Comparison,
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
    pub const RUN: [Self; 9] = [
        Self::Evaluations,
        Self::Generations,
        Self::Predictions,
        Self::Skipped,
        Self::Workers,
        Self::Attempts,
        Self::Events,
        Self::Looks,
        Self::Run,
    ];
    /// The tables that a comparison adds to a run folder, in the order in which they are written.
    pub const COMPARISON: [Self; 5] =
        [Self::Distances, Self::Answers, Self::RecallPrecision, Self::Pairs, Self::Comparison];
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
            Self::Looks => "looks",
            Self::Run => "run",
            Self::Distances => "distances",
            Self::Answers => "answers",
            Self::RecallPrecision => "recall_precision",
            Self::Pairs => "pairs",
            Self::Comparison => "comparison",
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
            | Self::Looks
            | Self::Distances
            | Self::Answers
            | Self::RecallPrecision
            | Self::Pairs
            | Self::Comparison
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
                ("an individual of a generation", &["generation", "individual"], run::evaluations(genes))
            }
            TableName::Generations => ("a generation", &["generation"], run::generations()),
            TableName::Predictions => (
                "a query cloud of the winner's validation or final test",
                &["split", "query"],
                run::predictions(),
            ),
            TableName::Skipped => ("a cloud that took no part", &["split", "cloud"], run::skipped()),
            TableName::Workers => {
                ("a worker, from when it joined to when it went", &["worker", "joined_at"], run::workers())
            }
            TableName::Attempts => (
                "an attempt at a job that has ended; a late answer to it makes a second row",
                &["job", "attempt", "ended_at"],
                run::attempts(),
            ),
            TableName::Events => ("something worth telling that happened", &["at"], run::events()),
            TableName::Looks => ("a release of test clouds to workers", &["at"], comparison::looks()),
            TableName::Distances => (
                "a query and a database cloud under one descriptor",
                &["descriptor", "query", "database"],
                comparison::distances(),
            ),
            TableName::Answers => (
                "a test cloud and what one descriptor takes it for",
                &["descriptor", "query"],
                comparison::answers(),
            ),
            TableName::RecallPrecision => (
                "a threshold of the set distance under one descriptor: recall against 1 - precision",
                &["descriptor", "curve", "distance"],
                comparison::recall_precision(),
            ),
            TableName::Pairs => (
                "two descriptors on the same test clouds",
                &["level", "descriptor_a", "descriptor_b"],
                comparison::pairs(),
            ),
            TableName::Comparison => {
                ("a descriptor on the test clouds", &["descriptor"], comparison::comparison())
            }
            TableName::Run => ("the run; the table has one row, written last", &["name"], run::run(genes)),
            TableName::Cells => {
                ("a descriptor; a file has those of one R1 and one R2", &[], grid::cells(genes))
            }
            TableName::Best => {
                ("one of the best descriptors, ties in the order of the genes", &["rank"], grid::best(genes))
            }
            TableName::Marginals => {
                ("all descriptors with one value of one gene", &["gene", "value"], grid::marginals())
            }
            TableName::Landscapes => (
                "all descriptors with one value of each of two genes",
                &["gene_a", "value_a", "gene_b", "value_b"],
                grid::landscapes(),
            ),
            TableName::Counts => {
                ("all descriptors with one number of correct answers", &["object_correct"], grid::histogram())
            }
            TableName::Grid => {
                ("the grid; the table has one row, written last", &["grid_key"], grid::grid(genes))
            }
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
