//! Results of runs and grids: declared tables, crash-safe Parquet files, reading them, and the run digest.
//!
//! A run writes through [`RunFolder`], an exhaustive search through [`GridFolder`]; anyone reads with [`read_table`], [`read_run`] or any Parquet reader.
//! `query` (feature `sql`) answers SQL over all tables.
//! [`verify`] recomputes the run digest from the files and names what was changed.
//! A table's rows are declared once, with `record!` in `tables/`: columns, files, readers and SCHEMA.md follow.

mod columns;
mod error;
mod population;
mod record;
mod table_name;
mod tables;

mod checks;
mod conform;
mod digest;
mod parquet;
mod schema;

mod checksums;
mod columnar;
mod consistency;
mod database;
mod file;
mod file_digests;
mod folder;
mod foreign;
mod grid;
mod look_chain;
mod problem;
mod read;
mod verify;

mod statistics;

#[cfg(feature = "sql")]
mod query;
mod report;

pub use columnar::{Columnar, complete_generations};
pub use columns::{Column, ColumnKind, GeneColumn};
pub use database::write_database;
pub use error::Error;
pub use folder::{LOCK, RunFolder, is_in_use};
pub use foreign::{
    Among, Foreign, ForeignClouds, ForeignError, ForeignValues, read_foreign, write_distances, write_vectors,
};
pub use grid::{FinishedGrid, GridFolder, read_grid};
pub use population::PopulationSummary;
pub use problem::Problem;
#[cfg(feature = "sql")]
pub use query::{Answer, AnswerFormat, LONGEST_QUERY, QueryError, query};
pub use read::{
    FinishedRun, read_answers, read_comparison, read_evaluations, read_front, read_generations,
    read_individual, read_landscapes, read_log, read_looks, read_pairs, read_perturbed, read_predictions,
    read_run, read_sets, read_table, read_workers,
};
pub use report::{
    CLOUD_VIEWER, ChannelPairs, NamedRun, Report, SeenChannel, SeenCloud, SeenPairs, SeenRegion, ShownCloud,
    Told, WinnerChannel, WrongClouds, cloud_bytes,
};
pub use schema::schema_markdown;
pub use statistics::{Cluster, ErrorRate, RankSum, bootstrap, holm, mcnemar, rank_sum, tango, wilson};
pub use table_name::TableName;
pub use tables::Table;
pub use tables::comparison::{
    ComparedRow, Curve, CurvePoint, DistanceRow, PairRow, PerturbedRow, SetRow, Times,
};
pub use tables::grid::{BestRow, CellPoints, CountRow, GridRow, GridTables, LandscapeRow, MarginalRow};
pub use tables::log::{AttemptRow, EventRow, LookRow, RunLog, WorkerRow};
pub use tables::run::{
    Computed, Counts, EvaluationRow, FrontRow, GenerationRow, PredictionRow, PredictionSplit, RunRow,
    RunnerUp, SkippedRow,
};
pub use verify::{Verification, run_digest, verify};

#[cfg(test)]
mod tests;
