//! Results of runs and grids: one table of columns, crash-safe Parquet files, reading them, and the run digest.
//!
//! A run writes through [`RunFolder`], an exhaustive search through [`GridFolder`]; anyone reads with [`read_table`], [`read_run`] or any Parquet reader.
//! `query` (feature `sql`) answers SQL over all tables.
//! [`verify`] recomputes the run digest from the files and names what was changed.
//! SCHEMA.md, made from the column table, lists every column.

mod columns;
mod error;
mod rows;
mod tables;

mod cells;
mod comparison;
mod database;
mod derived;
mod digest;
mod frame;
mod parquet;
mod population;
mod proceedings;
mod schema;

mod file;
mod folder;
mod grid;
mod read;
mod recorded;
mod verify;

mod statistics;

#[cfg(feature = "sql")]
mod query;
mod report;

pub use columns::{Column, ColumnKind, GeneColumn};
pub use comparison::{ComparedRow, Curve, CurvePoint, LookRow, PairRow, Times};
pub use database::{Database, DatabaseCloud, DatabasePart, read_database, write_database};
pub use error::Error;
pub use folder::RunFolder;
pub use grid::{
    BestRow, CellPoints, CountRow, FinishedGrid, GridFolder, GridRow, GridTables, LandscapeRow, MarginalRow,
    read_grid,
};
pub use parquet::SCHEMA_VERSION;
pub use population::PopulationSummary;
pub use proceedings::{AttemptRow, EventRow, Proceedings, WorkerRow};
#[cfg(feature = "sql")]
pub use query::{Answer, AnswerFormat, LONGEST_QUERY, QueryError, query};
pub use read::{FinishedRun, read_run, read_table};
pub use recorded::{RecordedEvaluation, read_evaluations, read_predictions};
pub use report::Report;
pub use rows::{
    Computed, Counts, EvaluationRow, GenerationRow, PredictionRow, PredictionSplit, RunRow, RunnerUp,
    SkippedRow,
};
pub use schema::schema_markdown;
pub use statistics::{Cluster, RankSum, bootstrap, holm, mcnemar, rank_sum, wilson};
pub use tables::{Table, TableName};
pub use verify::{Problem, Verification, run_digest, verify};

#[cfg(test)]
mod tests;
