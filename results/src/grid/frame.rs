//! A grid's rows to polars frames.

use polars::prelude::DataFrame;

use crate::columns::GeneColumn;
use crate::error::Error;
use crate::frame::{Cell, assemble, cells, check_genes, gene_cells, refuse, text, time};
use crate::grid::rows::{BestRow, CellPoints, CountRow, GridRow, LandscapeRow, MarginalRow};
use crate::rows::share;
use crate::tables::TableName;

/// The descriptors of one cell.
pub(crate) fn cell(genes: &[GeneColumn], points: &CellPoints) -> Result<DataFrame, Error> {
    let table = TableName::Cells;
    let height = points.object_correct.len();
    if points.genes.len() != genes.len() || points.genes.iter().any(|values| values.len() != height) {
        let expected = format!("{} columns of {height} values", genes.len());
        return Err(refuse(table, 0, "genes", expected, "others"));
    }
    let mut columns: Vec<Cell> = Vec::new();
    for (gene, values) in genes.iter().zip(&points.genes) {
        let values = values.iter().copied();
        columns.push(if gene.integer {
            cells(&gene.name, values.map(|value| value.map(|value| value as u32)))
        } else {
            cells(&gene.name, values)
        });
    }
    columns.push(cells("object_correct", points.object_correct.iter().copied()));
    columns.push(cells("worker_id", std::iter::repeat_n(points.worker_id.as_deref(), height)));
    assemble(height, columns)
}

/// Columns of a count of correct answers and of the error that follows from it.
fn correct(prefix: &str, queries: u32, counts: impl Iterator<Item = u32> + Clone) -> [Cell; 2] {
    [
        cells(&format!("{prefix}object_correct"), counts.clone()),
        cells(
            &format!("{prefix}object_error"),
            counts.map(|correct| share(queries.saturating_sub(correct), queries)),
        ),
    ]
}

/// The same for a mean or median, which is no whole number.
fn mean_correct(prefix: &str, queries: u32, counts: impl Iterator<Item = f64> + Clone) -> [Cell; 2] {
    let queries = f64::from(queries);
    [
        cells(&format!("{prefix}object_correct"), counts.clone()),
        cells(&format!("{prefix}object_error"), counts.map(|correct| (queries - correct) / queries)),
    ]
}

pub(crate) fn best(genes: &[GeneColumn], queries: u32, rows: &[BestRow]) -> Result<DataFrame, Error> {
    for (index, row) in rows.iter().enumerate() {
        check_genes(TableName::Best, index, genes, &row.genes)?;
        if row.object_correct > queries {
            let expected = format!("at most {queries}");
            return Err(refuse(TableName::Best, index, "object_correct", expected, row.object_correct));
        }
    }
    let values: Vec<&[Option<f64>]> = rows.iter().map(|row| row.genes.as_slice()).collect();
    let counts = rows.iter().map(|row| row.object_correct);
    let [object_correct, object_error] = correct("", queries, counts.clone());
    let mut columns = vec![cells("rank", 1..=rows.len() as u32)];
    columns.extend(gene_cells(genes, "", &values));
    columns.extend([
        object_correct,
        cells("queries", rows.iter().map(|_| queries)),
        cells("fitness", counts.map(|correct| share(correct, queries))),
        object_error,
    ]);
    assemble(rows.len(), columns)
}

pub(crate) fn marginals(queries: u32, rows: &[MarginalRow]) -> Result<DataFrame, Error> {
    let mut columns = vec![
        cells("gene", rows.iter().map(|row| row.gene.as_str())),
        cells("value", rows.iter().map(|row| row.value)),
        cells("descriptors", rows.iter().map(|row| row.descriptors)),
    ];
    columns.extend(correct("best_", queries, rows.iter().map(|row| row.best)));
    columns.extend(mean_correct("mean_", queries, rows.iter().map(|row| row.mean)));
    columns.extend(mean_correct("median_", queries, rows.iter().map(|row| row.median)));
    columns.extend(correct("worst_", queries, rows.iter().map(|row| row.worst)));
    assemble(rows.len(), columns)
}

pub(crate) fn landscapes(queries: u32, rows: &[LandscapeRow]) -> Result<DataFrame, Error> {
    let mut columns = vec![
        cells("gene_a", rows.iter().map(|row| row.genes[0].as_str())),
        cells("value_a", rows.iter().map(|row| row.values[0])),
        cells("gene_b", rows.iter().map(|row| row.genes[1].as_str())),
        cells("value_b", rows.iter().map(|row| row.values[1])),
        cells("descriptors", rows.iter().map(|row| row.descriptors)),
    ];
    columns.extend(correct("best_", queries, rows.iter().map(|row| row.best)));
    columns.extend(mean_correct("mean_", queries, rows.iter().map(|row| row.mean)));
    assemble(rows.len(), columns)
}

pub(crate) fn counts(queries: u32, rows: &[CountRow]) -> Result<DataFrame, Error> {
    let mut columns = correct("", queries, rows.iter().map(|row| row.object_correct)).to_vec();
    columns.push(cells("descriptors", rows.iter().map(|row| row.descriptors)));
    assemble(rows.len(), columns)
}

pub(crate) fn grid(genes: &[GeneColumn], row: &GridRow) -> Result<DataFrame, Error> {
    let table = TableName::Grid;
    check_genes(table, 0, genes, &row.best.genes)?;
    if row.queries == 0 || row.best.object_correct > row.queries {
        let expected = format!("at most {} of at least 1", row.queries);
        return Err(refuse(table, 0, "best_object_correct", expected, row.best.object_correct));
    }
    let mut columns = vec![
        text("name", &row.name),
        text("grid_key", &row.grid_key),
        text("search_space", &row.search_space),
        text("train_digest", &row.train_digest),
        cells("evaluation_version", [row.evaluation_version].into_iter()),
        cells("cells", [row.cells].into_iter()),
        cells("descriptors", [row.descriptors].into_iter()),
        cells("queries", [row.queries].into_iter()),
        cells("optimal_descriptors", [row.optimal_descriptors].into_iter()),
    ];
    columns.extend(gene_cells(genes, "best_", &[&row.best.genes]));
    columns.extend(correct("best_", row.queries, [row.best.object_correct].into_iter()));
    columns.extend([
        text("grid_digest", &row.grid_digest),
        cells("cells_computed", [row.cells_computed].into_iter()),
        cells("cells_found", [row.cells_found].into_iter()),
        cells("seconds", [row.seconds].into_iter()),
        time("finished_at", row.finished_at),
    ]);
    assemble(1, columns)
}
