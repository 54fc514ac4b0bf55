//! Checks of rows before they are written: rows that cannot be true are a defect of the program and refused.

use crate::columns::GeneColumn;
use crate::error::Error;
use crate::table_name::TableName;
use crate::tables::grid::{BestRow, CellPoints, GridRow};
use crate::tables::run::{Counts, EvaluationRow, FrontRow, GenerationRow, PredictionRow, RunRow};

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
pub(crate) fn check_evaluations(genes: &[GeneColumn], rows: &[EvaluationRow]) -> Result<(), Error> {
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
        if let Some(error) = row.set_errors.iter().flatten().find(|error| !(0.0..=1.0).contains(*error)) {
            return Err(refuse(table, index, "set_errors", "shares from 0 to 1", error));
        }
        if row.counts.queries != first.counts.queries {
            let expected = first.counts.queries.to_string();
            return Err(refuse(table, index, "queries", expected, row.counts.queries));
        }
    }
    Ok(())
}

fn check_genes(
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

/// Validation counts that are possible.
pub(crate) fn check_generation(row: &GenerationRow) -> Result<(), Error> {
    row.validation.map_or(Ok(()), |counts| check_counts(TableName::Generations, 0, "validation_", &counts))
}

/// Points 1, 2, … in order, one of them the winner.
pub(crate) fn check_front(genes: &[GeneColumn], rows: &[FrontRow]) -> Result<(), Error> {
    let table = TableName::Front;
    for (index, row) in rows.iter().enumerate() {
        if row.point as usize != index + 1 {
            return Err(refuse(table, index, "point", (index + 1).to_string(), row.point));
        }
        check_genes(table, index, genes, &row.genes)?;
        check_counts(table, index, "train_", &row.train)?;
        row.validation.map_or(Ok(()), |counts| check_counts(table, index, "validation_", &counts))?;
    }
    match rows.iter().filter(|row| row.winner).count() {
        1 => Ok(()),
        winners => Err(refuse(table, 0, "winner", "one winner", winners)),
    }
}

/// Queries in ascending order.
pub(crate) fn check_predictions(rows: &[PredictionRow]) -> Result<(), Error> {
    for (index, pair) in rows.windows(2).enumerate() {
        if pair[0].query >= pair[1].query {
            let expected = format!("more than {}", pair[0].query);
            return Err(refuse(TableName::Predictions, index + 1, "query", expected, pair[1].query));
        }
    }
    Ok(())
}

/// The run's genes and counts.
pub(crate) fn check_run(genes: &[GeneColumn], row: &RunRow) -> Result<(), Error> {
    check_genes(TableName::Run, 0, genes, &row.best_genes)?;
    check_counts(TableName::Run, 0, "train_", &row.train)?;
    for (prefix, counts) in
        [("validation_", &row.validation), ("weighted_train_", &row.weighted_train), ("test_", &row.test)]
    {
        if let Some(counts) = counts {
            check_counts(TableName::Run, 0, prefix, counts)?;
        }
    }
    match (&row.weighted_winner, row.weighted_train) {
        (None, None) => {}
        (Some(_), Some(counts)) if counts.queries == row.train.queries => {}
        (Some(_), Some(counts)) => {
            let expected = format!("{}, as train_queries", row.train.queries);
            return Err(refuse(TableName::Run, 0, "weighted_train_queries", expected, counts.queries));
        }
        (winner, counts) => {
            let is_there = |it: bool| if it { "a value" } else { "none" };
            let (expected, got) = (is_there(winner.is_some()), is_there(counts.is_some()));
            let expected = format!("{expected}, as weighted_winner");
            return Err(refuse(TableName::Run, 0, "weighted_train_queries", expected, got));
        }
    }
    if let Some(best) = row.grid_best_object_correct
        && !(row.train.object_correct..=row.train.queries).contains(&best)
    {
        let expected = format!("{} to {}", row.train.object_correct, row.train.queries);
        return Err(refuse(TableName::Run, 0, "grid_best_object_correct", expected, best));
    }
    Ok(())
}

/// As many values of each gene as counts.
pub(crate) fn check_cell(genes: &[GeneColumn], points: &CellPoints) -> Result<(), Error> {
    let height = points.object_correct.len();
    if points.genes.len() != genes.len() || points.genes.iter().any(|values| values.len() != height) {
        let expected = format!("{} columns of {height} values", genes.len());
        return Err(refuse(TableName::Cells, 0, "genes", expected, "others"));
    }
    Ok(())
}

/// Counts of at most as many queries as there are.
pub(crate) fn check_best(genes: &[GeneColumn], queries: u32, rows: &[BestRow]) -> Result<(), Error> {
    for (index, row) in rows.iter().enumerate() {
        check_genes(TableName::Best, index, genes, &row.genes)?;
        if row.object_correct > queries {
            let expected = format!("at most {queries}");
            return Err(refuse(TableName::Best, index, "object_correct", expected, row.object_correct));
        }
    }
    Ok(())
}

/// The genes and the count of the grid's best descriptor.
pub(crate) fn check_grid(genes: &[GeneColumn], row: &GridRow) -> Result<(), Error> {
    check_genes(TableName::Grid, 0, genes, &row.best_genes)?;
    if row.queries == 0 || row.best_object_correct > row.queries {
        let expected = format!("at most {} of at least 1", row.queries);
        return Err(refuse(TableName::Grid, 0, "best_object_correct", expected, row.best_object_correct));
    }
    Ok(())
}
