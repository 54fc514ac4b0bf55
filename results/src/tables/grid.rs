//! Columns of a grid folder's tables.

use crate::columns::ColumnKind::{F64, Text, Timestamp, U32, U64};
use crate::columns::{Column, GeneColumn};
use crate::tables::counts;

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

pub(super) fn cells(genes: &[GeneColumn]) -> Vec<Column> {
    let mut columns: Vec<Column> = genes.iter().map(|gene| gene.column("")).collect();
    let meaning = "first training set's clouds whose nearest cloud is of the same object";
    columns.push(Column::new("object_correct", U32, "clouds", meaning));
    let meaning = "id of the worker that counted them, hexadecimal; null if not known";
    columns.push(Column::new("worker_id", Text, "", meaning).nullable());
    columns
}

pub(super) fn best(genes: &[GeneColumn]) -> Vec<Column> {
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

pub(super) fn marginals() -> Vec<Column> {
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

pub(super) fn landscapes() -> Vec<Column> {
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

pub(super) fn histogram() -> Vec<Column> {
    let mut columns = object_correct("", "the").to_vec();
    columns.push(descriptors());
    columns
}

pub(super) fn grid(genes: &[GeneColumn]) -> Vec<Column> {
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
