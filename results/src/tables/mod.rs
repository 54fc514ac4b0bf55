//! Every table: what a row is, which record declares its columns, its key, and what the run digest covers.

pub(crate) mod comparison;
pub(crate) mod database;
pub(crate) mod grid;
pub(crate) mod log;
pub(crate) mod run;

use std::collections::BTreeSet;

use polars::prelude::{DataFrame, PlSmallStr, PolarsError};

use crate::columns::{Column, ColumnKind, GeneColumn};
use crate::error::Error;
use crate::record::{Cells, Context, Field, Value};
use crate::table_name::TableName;
use comparison::{ComparedRow, CurvePoint, DistanceRow, PairRow, PerturbedRow, SetRow};
use database::{ChannelsRow, DatabaseRow};
use grid::{BestRow, CellRow, CountRow, GridRow, LandscapeRow, MarginalRow};
use log::{AttemptRow, EventRow, LookRow, WorkerRow};
use run::{EvaluationRow, FrontRow, GenerationRow, PredictionRow, RunRow, SkippedRow};

/// Stands for all gene columns in [`Declaration::digest`].
const ANY_GENE: &str = "<gene>";

const DESCRIPTOR: (&str, &str) =
    ("descriptor", "label of the descriptor, such as evolved, paper, pfhrgb, shotcolor-l1");

/// What is declared of a table beside the columns of its rows.
struct Declaration {
    meaning: &'static str,
    key: &'static [&'static str],
    columns: fn(&Field, &[GeneColumn]) -> Vec<Column>,
    /// Name and meaning of text columns before those of the rows, with values from the context.
    labels: &'static [(&'static str, &'static str)],
    /// Columns that the run digest covers.
    digest: &'static [&'static str],
}

impl Declaration {
    fn of<R: Value>(meaning: &'static str, key: &'static [&'static str]) -> Self {
        Self { meaning, key, columns: R::columns, labels: &[], digest: &[] }
    }

    fn labels(self, labels: &'static [(&'static str, &'static str)]) -> Self {
        Self { labels, ..self }
    }

    fn digest(self, digest: &'static [&'static str]) -> Self {
        Self { digest, ..self }
    }
}

fn declaration(table: TableName) -> Declaration {
    match table {
        TableName::Evaluations => {
            Declaration::of::<EvaluationRow>("an individual of a generation", &["generation", "individual"])
                .digest(&[
                    "generation",
                    "individual",
                    "chromosome",
                    ANY_GENE,
                    "object_correct",
                    "category_correct",
                    "objective_correct",
                    "margin",
                    "parent_a",
                    "parent_b",
                ])
        }
        TableName::Generations => {
            Declaration::of::<GenerationRow>("a generation", &["generation"]).digest(&[
                "generation",
                "validation_object_correct",
                "validation_category_correct",
                "validation_queries",
                "validation_margin",
                "hypervolume",
                "mutation_rate",
            ])
        }
        TableName::Front => {
            Declaration::of::<FrontRow>("a point of the front of a search of several objectives", &["point"])
                .digest(&[
                    "point",
                    "generation",
                    "individual",
                    "chromosome",
                    ANY_GENE,
                    "train_object_correct",
                    "train_category_correct",
                    "train_queries",
                    "objective_correct",
                    "train_margin",
                    "validation_object_correct",
                    "validation_category_correct",
                    "validation_queries",
                    "validation_margin",
                    "cost",
                    "size",
                    "winner",
                ])
        }
        TableName::Predictions => Declaration::of::<PredictionRow>(
            "a query cloud of the winner's validation or final test",
            &["split", "query"],
        )
        .labels(&[("split", "validation or test")])
        .digest(&[
            "split",
            "query",
            "cloud",
            "instance",
            "category",
            "nearest_cloud",
            "predicted_instance",
            "predicted_category",
            "distance",
            "runner_up_cloud",
            "runner_up_distance",
            "correct_object",
            "correct_category",
        ]),
        TableName::Skipped => Declaration::of::<SkippedRow>("a cloud that took no part", &["split", "cloud"]),
        TableName::Workers => Declaration::of::<WorkerRow>(
            "a worker, from when it joined to when it went",
            &["worker", "joined_at"],
        ),
        TableName::Attempts => Declaration::of::<AttemptRow>(
            "an attempt at a job that has ended; a late answer to it makes a second row",
            &["job", "attempt", "ended_at"],
        ),
        TableName::Events => Declaration::of::<EventRow>("something worth telling that happened", &["at"]),
        TableName::Looks => Declaration::of::<LookRow>(
            "a release of test clouds to workers, that people are shown some, or a measurement on some",
            &["at"],
        ),
        TableName::Run => {
            Declaration::of::<RunRow>("the run; the table has one row, written last", &["name"]).digest(&[
                "search_config",
                "seed",
                "data_digest",
                "stop_reason",
                "weighted_winner",
                "weighted_train_object_correct",
                "weighted_train_category_correct",
                "weighted_train_queries",
            ])
        }
        TableName::Distances => Declaration::of::<DistanceRow>(
            "a query and a database cloud under one descriptor",
            &["descriptor", "query", "database"],
        )
        .labels(&[DESCRIPTOR]),
        TableName::Answers => Declaration::of::<PredictionRow>(
            "a test cloud and what one descriptor takes it for",
            &["descriptor", "query"],
        )
        .labels(&[DESCRIPTOR]),
        TableName::RecallPrecision => Declaration::of::<CurvePoint>(
            "a threshold of the set distance under one descriptor: recall against 1 - precision",
            &["descriptor", "curve", "distance"],
        )
        .labels(&[
            DESCRIPTOR,
            ("curve", "all: every query with every database cloud; nearest: with its nearest"),
        ]),
        TableName::Pairs => Declaration::of::<PairRow>(
            "two descriptors on the same test clouds",
            &["level", "descriptor_a", "descriptor_b"],
        ),
        TableName::Comparison => {
            Declaration::of::<ComparedRow>("a descriptor on the test clouds", &["descriptor"])
        }
        TableName::Perturbed => Declaration::of::<PerturbedRow>(
            "a descriptor on the test clouds under one perturbation",
            &["descriptor", "kind", "strength"],
        ),
        TableName::Sets => {
            Declaration::of::<SetRow>("a descriptor on the test clouds of one set", &["descriptor", "set"])
        }
        TableName::Cells => {
            Declaration::of::<CellRow>("a descriptor; a file has those of one R1 and one R2", &[])
        }
        TableName::Best => Declaration::of::<BestRow>(
            "one of the best descriptors, ties in the order of the genes",
            &["rank"],
        ),
        TableName::Marginals => {
            Declaration::of::<MarginalRow>("all descriptors with one value of one gene", &["gene", "value"])
        }
        TableName::Landscapes => Declaration::of::<LandscapeRow>(
            "all descriptors with one value of each of two genes",
            &["gene_a", "value_a", "gene_b", "value_b"],
        ),
        TableName::Counts => Declaration::of::<CountRow>(
            "all descriptors with one number of correct answers",
            &["object_correct"],
        ),
        TableName::Grid => {
            Declaration::of::<GridRow>("the grid; the table has one row, written last", &["grid_key"])
        }
        TableName::Database => {
            Declaration::of::<DatabaseRow>("a reference cloud, in the order that decides ties", &["cloud"])
        }
        TableName::Channels => Declaration::of::<ChannelsRow>(
            "a reference cloud of a descriptor of channels, in the order that decides ties",
            &["cloud"],
        ),
    }
}

/// What stands before a gene's name in this table's columns; `None` if the table has no genes.
pub(crate) fn gene_prefix(table: TableName) -> Option<String> {
    // The column of a gene without a name is named by the prefix alone.
    let nameless =
        GeneColumn { name: String::new(), unit: String::new(), integer: false, meaning: String::new() };
    let columns = (declaration(table).columns)(&Field::default(), &[nameless]);
    columns.into_iter().find(|column| column.gene).map(|column| column.name)
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
    /// The genes that the gene columns are of.
    pub(crate) genes: Vec<GeneColumn>,
    labels: &'static [(&'static str, &'static str)],
}

impl Table {
    /// The table of an experiment with these genes. Fails if a gene's name is empty, occurs twice or is that of a
    /// fixed column.
    pub fn new(name: TableName, genes: &[GeneColumn]) -> Result<Self, Error> {
        if genes.iter().any(|gene| gene.name.is_empty()) {
            return Err(Error::GeneName { name: String::new() });
        }
        let Declaration { meaning, key, columns, labels, digest } = declaration(name);
        let first = labels.iter().map(|(name, meaning)| Column::new(name, ColumnKind::Text, "", meaning));
        let mut columns: Vec<Column> = first.chain(columns(&Field::default(), genes)).collect();
        let mut seen = BTreeSet::new();
        for column in &mut columns {
            column.in_digest = digest.contains(&if column.gene { ANY_GENE } else { column.name.as_str() });
            if !seen.insert(column.name.clone()) {
                return Err(Error::GeneName { name: column.name.clone() });
            }
        }
        Ok(Self { name, meaning, key, columns, genes: genes.to_vec(), labels })
    }

    /// The column of that name.
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|column| column.name == name)
    }

    /// The table with these rows. The context's genes are the table's.
    pub(crate) fn filled<R: Value>(self, rows: &[R], context: Context) -> Result<TableFile, Error> {
        let context = Context { genes: &self.genes, ..context };
        let label = |((name, _), value): (&(&str, _), &&str)| {
            Cells::new_scalar((*name).into(), PlSmallStr::from_str(value).into(), rows.len())
        };
        let mut columns: Vec<Cells> = self.labels.iter().zip(context.labels).map(label).collect();
        columns.extend(R::cells("", &context, &rows.iter().map(Some).collect::<Vec<_>>())?);
        let frame = DataFrame::new(rows.len(), columns)?;
        Ok(TableFile { table: self, frame })
    }
}

/// A table with rows: those of one file, or of several below each other.
#[derive(Clone, Debug)]
pub(crate) struct TableFile {
    /// Its table, with the genes that the file has.
    pub table: Table,
    /// Its rows; columns in table order, then unknown ones.
    pub frame: DataFrame,
}

impl TableFile {
    /// The rows as structs.
    pub(crate) fn rows<R: Value>(&self) -> Result<Vec<R>, Error> {
        let rows: Option<Vec<R>> = R::read("", &self.frame, &self.table.genes)?.into_iter().collect();
        let missing =
            || format!("{}: expected a value in every cell that must have one, got null", self.table.name);
        Ok(rows.ok_or_else(|| PolarsError::NoData(missing().into()))?)
    }

    /// The row of a table that has one.
    pub(crate) fn row<R: Value>(&self) -> Result<R, Error> {
        let one = || format!("{}: expected one row, got {}", self.table.name, self.frame.height());
        let row = self.rows()?.pop().filter(|_| self.frame.height() == 1);
        Ok(row.ok_or_else(|| PolarsError::ShapeMismatch(one().into()))?)
    }

    /// The first text of a column.
    pub(crate) fn text(&self, column: &str) -> Result<&str, Error> {
        Ok(self.frame.column(column)?.str()?.get(0).unwrap_or_default())
    }

    /// Adds the rows of another file of the table.
    pub(crate) fn append(&mut self, other: Self) -> Result<(), Error> {
        self.frame.vstack_mut_owned(other.frame)?;
        Ok(())
    }

    /// Replaces the texts of a column by one text.
    pub(crate) fn set_text(&mut self, column: &str, text: &str) -> Result<(), Error> {
        let text = PlSmallStr::from_str(text).into();
        self.frame.with_column(Cells::new_scalar(column.into(), text, self.frame.height()))?;
        Ok(())
    }
}
