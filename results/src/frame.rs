//! Rows to polars frames and back, and the checks that every frame passes on its way in and out.

use std::time::{Duration, SystemTime};

use polars::prelude::*;

use crate::columns::{ColumnKind, GeneColumn};
use crate::error::Error;
use crate::population::PopulationSummary;
use crate::rows::{Counts, EvaluationRow, GenerationRow, PredictionRow, PredictionSplit, RunRow, SkippedRow};
use crate::tables::{Table, TableName};

pub(crate) type Cell = polars::prelude::Column;

pub(crate) fn cells<T, Item>(name: &str, values: impl Iterator<Item = Item>) -> Cell
where
    Vec<Item>: AsRef<T>,
    T: ?Sized,
    Series: NamedFrom<Vec<Item>, T>,
{
    Series::new(name.into(), values.collect::<Vec<Item>>()).into_column()
}

/// A frame from one closure a column: `height` rows, one cell each.
pub(crate) fn assemble(height: usize, columns: Vec<Cell>) -> Result<DataFrame, Error> {
    Ok(DataFrame::new(height, columns)?)
}

pub(crate) fn gene_cells(genes: &[GeneColumn], prefix: &str, rows: &[&[Option<f64>]]) -> Vec<Cell> {
    let column = |(index, gene): (usize, &GeneColumn)| {
        let name = format!("{prefix}{}", gene.name);
        let values = rows.iter().map(|row| row.get(index).copied().flatten());
        if gene.integer {
            cells(&name, values.map(|value| value.map(|value| value as u32)))
        } else {
            cells(&name, values)
        }
    };
    genes.iter().enumerate().map(column).collect()
}

pub(crate) fn counts_cells(prefix: &str, rows: &[Option<Counts>]) -> [Cell; 5] {
    let name = |column: &str| format!("{prefix}{column}");
    let integers = |column: &str, of: fn(&Counts) -> u32| {
        cells(&name(column), rows.iter().map(|counts| counts.as_ref().map(of)))
    };
    let shares = |column: &str, of: fn(&Counts) -> f64| {
        cells(&name(column), rows.iter().map(|counts| counts.as_ref().map(of)))
    };
    [
        integers("object_correct", |counts| counts.object_correct),
        integers("category_correct", |counts| counts.category_correct),
        integers("queries", |counts| counts.queries),
        shares("object_error", Counts::object_error),
        shares("category_error", Counts::category_error),
    ]
}

/// A generation's `evaluations`. Refuses rows that cannot be a generation: see [`check_evaluations`].
pub(crate) fn evaluations(genes: &[GeneColumn], rows: &[EvaluationRow]) -> Result<DataFrame, Error> {
    check_evaluations(genes, rows)?;
    let values: Vec<&[Option<f64>]> = rows.iter().map(|row| row.genes.as_slice()).collect();
    let counts: Vec<Option<Counts>> = rows.iter().map(|row| Some(row.counts)).collect();
    let computed = || rows.iter().map(|row| row.computed.as_ref());
    let mut columns = vec![
        cells("generation", rows.iter().map(|row| row.generation)),
        cells("individual", rows.iter().map(|row| row.individual)),
        cells("chromosome", rows.iter().map(|row| row.chromosome.as_str())),
    ];
    columns.extend(gene_cells(genes, "", &values));
    columns.push(cells("fitness", rows.iter().map(|row| row.counts.fitness())));
    columns.extend(counts_cells("", &counts));
    columns.extend([
        cells("parent_a", rows.iter().map(|row| row.parents[0])),
        cells("parent_b", rows.iter().map(|row| row.parents[1])),
        cells("elite", rows.iter().map(|row| row.elite)),
        cells("remembered", rows.iter().map(|row| row.computed.is_none())),
        cells("worker", computed().map(|by| by.map(|by| by.worker.as_str()))),
        cells("attempt", computed().map(|by| by.map(|by| by.attempt))),
        cells("queued_seconds", computed().map(|by| by.map(|by| by.queued_seconds))),
        cells("run_seconds", computed().map(|by| by.map(|by| by.run_seconds))),
    ]);
    assemble(rows.len(), columns)
}

/// A generation's row. `rows_digest` is left empty: it is computed from this frame.
pub(crate) fn generation(row: &GenerationRow, of: &PopulationSummary) -> Result<DataFrame, Error> {
    if let Some(counts) = &row.validation {
        check_counts(TableName::Generations, 0, "validation_", counts)?;
    }
    let mut columns = vec![
        cells("generation", [row.generation].into_iter()),
        cells("best_individual", [of.best_individual].into_iter()),
        cells("best_object_correct", [of.best_object_correct].into_iter()),
        cells("queries", [of.queries].into_iter()),
        cells("best_fitness", [of.best_fitness].into_iter()),
        cells("mean_fitness", [of.mean_fitness].into_iter()),
        cells("worst_fitness", [of.worst_fitness].into_iter()),
        cells("best_so_far_fitness", [row.best_so_far_fitness].into_iter()),
    ];
    columns.extend(counts_cells("validation_", &[row.validation]));
    columns.extend([
        cells("mutation_rate", [row.mutation_rate].into_iter()),
        cells("diversity", [of.diversity].into_iter()),
        cells("evaluations_computed", [of.evaluations_computed].into_iter()),
        cells("evaluations_remembered", [of.evaluations_remembered].into_iter()),
        cells("seconds", [row.seconds].into_iter()),
        text("rows_digest", ""),
    ]);
    assemble(1, columns)
}

/// One cell of text.
pub(crate) fn text(name: &str, value: &str) -> Cell {
    cells(name, [value].into_iter())
}

/// The predictions of one split.
pub(crate) fn predictions(split: PredictionSplit, rows: &[PredictionRow]) -> Result<DataFrame, Error> {
    for (index, pair) in rows.windows(2).enumerate() {
        if pair[0].query >= pair[1].query {
            let expected = format!("more than {}", pair[0].query);
            return Err(refuse(TableName::Predictions, index + 1, "query", expected, pair[1].query));
        }
    }
    let mut columns = vec![cells("split", rows.iter().map(|_| split.as_str()))];
    columns.extend(prediction_cells(rows));
    assemble(rows.len(), columns)
}

/// Queries and what they are taken for.
pub(crate) fn prediction_cells(rows: &[PredictionRow]) -> [Cell; 12] {
    let runner_up = || rows.iter().map(|row| row.runner_up.as_ref());
    [
        cells("query", rows.iter().map(|row| row.query)),
        cells("cloud", rows.iter().map(|row| row.cloud.as_str())),
        cells("instance", rows.iter().map(|row| row.instance.as_str())),
        cells("category", rows.iter().map(|row| row.category.as_str())),
        cells("nearest_cloud", rows.iter().map(|row| row.nearest_cloud.as_str())),
        cells("predicted_instance", rows.iter().map(|row| row.predicted_instance.as_str())),
        cells("predicted_category", rows.iter().map(|row| row.predicted_category.as_str())),
        cells("distance", rows.iter().map(|row| row.distance)),
        cells("runner_up_cloud", runner_up().map(|other| other.map(|other| other.cloud.as_str()))),
        cells("runner_up_distance", runner_up().map(|other| other.map(|other| other.distance))),
        cells("correct_object", rows.iter().map(|row| row.predicted_instance == row.instance)),
        cells("correct_category", rows.iter().map(|row| row.predicted_category == row.category)),
    ]
}

/// The clouds that took no part.
pub(crate) fn skipped(rows: &[SkippedRow]) -> Result<DataFrame, Error> {
    assemble(
        rows.len(),
        vec![
            cells("split", rows.iter().map(|row| row.split.as_str())),
            cells("cloud", rows.iter().map(|row| row.cloud.as_str())),
            cells("reason", rows.iter().map(|row| row.reason.as_str())),
        ],
    )
}

/// The run's row. Both digests are left empty: they are computed from this frame and the other tables.
pub(crate) fn run(genes: &[GeneColumn], row: &RunRow) -> Result<DataFrame, Error> {
    check_genes(TableName::Run, 0, genes, &row.best_genes)?;
    check_counts(TableName::Run, 0, "train_", &row.train)?;
    for (prefix, counts) in [("validation_", &row.validation), ("test_", &row.test)] {
        if let Some(counts) = counts {
            check_counts(TableName::Run, 0, prefix, counts)?;
        }
    }
    if let Some(best) = row.grid_best_object_correct
        && !(row.train.object_correct..=row.train.queries).contains(&best)
    {
        let expected = format!("{} to {}", row.train.object_correct, row.train.queries);
        return Err(refuse(TableName::Run, 0, "grid_best_object_correct", expected, best));
    }
    let mut columns = vec![
        text("name", &row.name),
        text("search_config", &row.search_config),
        text("resolved_toml", &row.resolved_toml),
        cells("seed", [row.seed].into_iter()),
        text("data_digest", &row.data_digest),
        cells("evaluation_version", [row.evaluation_version].into_iter()),
        text("program_version", &row.program_version),
        text("build", &row.build),
        text("host", &row.host),
        time("started_at", row.started_at),
        time("finished_at", row.finished_at),
        cells("seconds", [row.seconds].into_iter()),
        text("stop_reason", &row.stop_reason),
        cells("generations", [row.generations].into_iter()),
        cells("evaluations_computed", [row.evaluations_computed].into_iter()),
        cells("evaluations_remembered", [row.evaluations_remembered].into_iter()),
        cells("winner_generation", [row.winner_generation].into_iter()),
        cells("winner_individual", [row.winner_individual].into_iter()),
        text("best_chromosome", &row.best_chromosome),
    ];
    columns.extend(gene_cells(genes, "best_", &[&row.best_genes]));
    columns.extend(counts_cells("train_", &[Some(row.train)]));
    columns.extend(counts_cells("validation_", &[row.validation]));
    columns.extend(counts_cells("test_", &[row.test]));
    columns.extend([text("predictions_digest", ""), text("run_digest", "")]);
    columns.push(cells("grid_best_object_correct", [row.grid_best_object_correct].into_iter()));
    columns.push(cells("regret", [row.regret()].into_iter()));
    assemble(1, columns)
}

/// One cell of time.
pub(crate) fn time(name: &str, at: SystemTime) -> Cell {
    let milliseconds = Int64Chunked::from_slice(name.into(), &[milliseconds(at)]);
    milliseconds.into_datetime(TimeUnit::Milliseconds, None).into_column()
}

/// Milliseconds since the Unix epoch, negative before it.
pub(crate) fn milliseconds(at: SystemTime) -> i64 {
    let whole = |span: Duration| i64::try_from(span.as_millis()).unwrap_or(i64::MAX);
    match at.duration_since(SystemTime::UNIX_EPOCH) {
        Ok(after) => whole(after),
        Err(before) => -whole(before.duration()),
    }
}

pub(crate) fn refuse(
    table: TableName,
    row: usize,
    column: &str,
    expected: impl Into<String>,
    got: impl ToString,
) -> Error {
    Error::Row { table, row, column: column.to_owned(), expected: expected.into(), got: got.to_string() }
}

/// One generation, individuals 0, 1, … in order, chromosomes of equal length, the same queries for all.
fn check_evaluations(genes: &[GeneColumn], rows: &[EvaluationRow]) -> Result<(), Error> {
    let table = TableName::Evaluations;
    let Some(first) = rows.first() else {
        return Err(refuse(table, 0, "individual", "at least one individual", "none"));
    };
    for (index, row) in rows.iter().enumerate() {
        if row.generation != first.generation {
            return Err(refuse(table, index, "generation", first.generation.to_string(), row.generation));
        }
        if row.individual as usize != index {
            return Err(refuse(table, index, "individual", index.to_string(), row.individual));
        }
        let bits = first.chromosome.len();
        if row.chromosome.len() != bits || !row.chromosome.bytes().all(|bit| matches!(bit, b'0' | b'1')) {
            return Err(refuse(table, index, "chromosome", format!("{bits} bits 0 or 1"), &row.chromosome));
        }
        check_genes(table, index, genes, &row.genes)?;
        check_counts(table, index, "", &row.counts)?;
        if row.counts.queries != first.counts.queries {
            let expected = first.counts.queries.to_string();
            return Err(refuse(table, index, "queries", expected, row.counts.queries));
        }
    }
    Ok(())
}

pub(crate) fn check_genes(
    table: TableName,
    row: usize,
    genes: &[GeneColumn],
    values: &[Option<f64>],
) -> Result<(), Error> {
    if values.len() != genes.len() {
        let expected = format!("{} gene values", genes.len());
        return Err(refuse(table, row, "genes", expected, values.len()));
    }
    for (gene, value) in genes.iter().zip(values) {
        let whole = |value: f64| value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&value);
        if let Some(value) = value.filter(|&value| gene.integer && !whole(value)) {
            return Err(refuse(table, row, &gene.name, "a whole number", value));
        }
    }
    Ok(())
}

fn check_counts(table: TableName, row: usize, prefix: &str, counts: &Counts) -> Result<(), Error> {
    let column = |name| format!("{prefix}{name}");
    if counts.queries == 0 {
        return Err(refuse(table, row, &column("queries"), "at least 1", 0));
    }
    for (name, correct) in
        [("object_correct", counts.object_correct), ("category_correct", counts.category_correct)]
    {
        if correct > counts.queries {
            let expected = format!("at most {}", counts.queries);
            return Err(refuse(table, row, &column(name), expected, correct));
        }
    }
    Ok(())
}

/// What is wrong with a column of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Mismatch {
    pub column: String,
    pub expected: String,
    pub got: String,
}

/// Brings a frame into the table's form: its columns in order, then unknown ones. A missing nullable column (a file
/// from before the column was added) becomes null. Refuses other types, nulls where none may be, and floats that
/// are not finite.
pub(crate) fn conform(table: &Table, frame: DataFrame) -> Result<Result<DataFrame, Mismatch>, Error> {
    let height = frame.height();
    let mut columns = Vec::with_capacity(table.columns.len());
    for column in &table.columns {
        let mismatch = |expected: &str, got: String| Mismatch {
            column: column.name.clone(),
            expected: expected.to_owned(),
            got,
        };
        let data_type = column.kind.data_type();
        let cell = match frame.column(&column.name) {
            Ok(cell) => cell.clone(),
            Err(_) if column.nullable => Cell::full_null(column.key(), height, &data_type),
            Err(_) => return Ok(Err(mismatch(column.kind.name(), "no such column".to_owned()))),
        };
        if *cell.dtype() != data_type {
            return Ok(Err(mismatch(column.kind.name(), cell.dtype().to_string())));
        }
        if !column.nullable && cell.null_count() > 0 {
            return Ok(Err(mismatch("a value in every row", format!("{} nulls", cell.null_count()))));
        }
        let infinite = match column.kind {
            ColumnKind::F64 => cell.f64()?.iter().flatten().find(|value| !value.is_finite()),
            ColumnKind::F32 => cell.f32()?.iter().flatten().find(|value| !value.is_finite()).map(f64::from),
            _ => None,
        };
        if let Some(value) = infinite {
            return Ok(Err(mismatch("a finite number", value.to_string())));
        }
        columns.push(cell);
    }
    columns.extend(frame.columns().iter().filter(|cell| table.column(cell.name()).is_none()).cloned());
    Ok(Ok(assemble(height, columns)?))
}
