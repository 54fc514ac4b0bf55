//! Rows of a grid folder's tables. Counts are queries of the first training set that got the right object.

use std::time::SystemTime;

use crate::population::share;
use crate::record::{Context, record};

fn error(correct: u32, file: &Context) -> f64 {
    share(file.queries.saturating_sub(correct), file.queries)
}

/// The same for a mean or median, which is no whole number.
fn mean_error(correct: f64, file: &Context) -> f64 {
    (f64::from(file.queries) - correct) / f64::from(file.queries)
}

/// Descriptors of one cell of the grid and the count that each reached, column by column.
#[derive(Clone, Debug, PartialEq)]
pub struct CellPoints {
    /// For each gene column its values in the gene's unit, one per descriptor; `None` for a gene that is not used.
    pub genes: Vec<Vec<Option<f64>>>,
    /// Queries of the first training set that each descriptor answers with the right object.
    pub object_correct: Vec<u32>,
    /// Id of the worker that counted, hexadecimal; `None` if it is not known.
    pub worker_id: Option<String>,
    /// Who answers for that worker; `None` if it is not known.
    pub principal: Option<String>,
    /// Another principal that counted the same; `None` if there was none.
    pub seconded: Option<String>,
    /// Why later runs may go on with it: own, audited or earned; `None` if they may not, or if it is not known.
    pub basis: Option<String>,
}

record! {
    /// A descriptor of one cell.
    pub(crate) struct CellRow {
        genes as "": Vec<Option<f64>>, "", "values of the genes, in their units";
        object_correct: u32, "clouds", "first training set's clouds whose nearest cloud is of the same object";
        worker_id: Option<String>, "", "id of the worker that counted them, hexadecimal; null if not known";
        principal: Option<String>, "", "who answers for that worker, as in workers; null if not known";
        seconded: Option<String>, "", "another principal that counted the same; null if none";
        basis: Option<String>, "", "why later runs may go on with it: own, audited or earned; null if they may not";
    }
}

record! {
    /// One of the best descriptors.
    #[derive(Clone, Debug, PartialEq)]
    pub struct BestRow {
        rank: u32, "", "place among all descriptors, from 1";
        genes as "": Vec<Option<f64>>, "", "values of the genes, in their units";
        object_correct: u32, "clouds", "first training set's clouds whose nearest cloud is of the same object";
        => queries: u32, "clouds", "first training set's clouds that took part: the denominator"
            = |_, file| file.queries;
        => fitness: f64, "share", "object_correct / queries" = |row, file| share(row.object_correct, file.queries);
        => object_error: f64, "share", "1 - object_correct / queries" = |row, file| error(row.object_correct, file);
    }
}

record! {
    /// All descriptors with one value of one gene.
    #[derive(Clone, Debug, PartialEq)]
    pub struct MarginalRow {
        gene: String, "", "name of the gene";
        value: f64, "the gene's", "value of the gene";
        /// At least 1:
        descriptors: u64, "", "how many they are";
        best as "best_object_correct": u32, "clouds", "highest number of queries of the same object";
        => best_object_error: f64, "share", "1 - best_object_correct / queries" = |row, file| error(row.best, file);
        mean as "mean_object_correct": f64, "clouds", "mean number of queries of the same object";
        => mean_object_error: f64, "share", "1 - mean_object_correct / queries"
            = |row, file| mean_error(row.mean, file);
        /// The mean of both middle ones if their number is even:
        median as "median_object_correct": f64, "clouds", "median number of queries of the same object";
        => median_object_error: f64, "share", "1 - median_object_correct / queries"
            = |row, file| mean_error(row.median, file);
        worst as "worst_object_correct": u32, "clouds", "lowest number of queries of the same object";
        => worst_object_error: f64, "share", "1 - worst_object_correct / queries"
            = |row, file| error(row.worst, file);
    }
}

record! {
    /// All descriptors with one value of each of two genes.
    #[derive(Clone, Debug, PartialEq)]
    pub struct LandscapeRow {
        gene_a: String, "", "name of one gene";
        value_a: f64, "the gene's", "its value";
        gene_b: String, "", "name of a later gene";
        value_b: f64, "the gene's", "its value";
        /// At least 1:
        descriptors: u64, "", "how many they are";
        best as "best_object_correct": u32, "clouds", "highest number of queries of the same object";
        => best_object_error: f64, "share", "1 - best_object_correct / queries" = |row, file| error(row.best, file);
        mean as "mean_object_correct": f64, "clouds", "mean number of queries of the same object";
        => mean_object_error: f64, "share", "1 - mean_object_correct / queries"
            = |row, file| mean_error(row.mean, file);
    }
}

record! {
    /// All descriptors with one count of correct answers.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct CountRow {
        object_correct: u32, "clouds", "the number of queries of the same object";
        => object_error: f64, "share", "1 - object_correct / queries" = |row, file| error(row.object_correct, file);
        /// At least 1:
        descriptors: u64, "", "how many they are";
    }
}

record! {
    /// The grid as a whole.
    #[derive(Clone, Debug, PartialEq)]
    pub struct GridRow {
        name: String, "", "name of the experiment";
        grid_key: String, "", "BLAKE3 of search_space";
        search_space: String, "TOML",
            "what determines the counts: evaluation version, training clouds, preprocessing and genes";
        train_digest: String, "", "BLAKE3 over labels and content of the usable clouds of both training sets";
        evaluation_version: u32, "", "version of the method: equal versions give equal results";
        cells: u32, "", "pairs of R1 and R2";
        descriptors: u64, "", "size of the search space";
        /// At least 1:
        queries: u32, "clouds", "first training set's clouds that took part";
        optimal_descriptors: u64, "", "how many are as good as the best";
        /// Of the first in gene order on ties:
        best_genes as "best_": Vec<Option<f64>>, "", "the best descriptor's values of the genes, in their units";
        best_object_correct: u32, "clouds", "highest number of queries of the same object";
        => best_object_error: f64, "share", "1 - best_object_correct / queries"
            = |row, file| error(row.best_object_correct, file);
        grid_digest: String, "", "BLAKE3 over the counts of all cells, R1 and R2 ascending";
        cells_computed: u32, "", "cells evaluated since the last start";
        cells_found: u32, "", "cells that were evaluated before it";
        run: Option<String>, "", "session that finished it, hexadecimal; null if basis is";
        principals: Option<String>, "", "on whose word its cells rest, separated by commas; null if basis is";
        basis: Option<String>, "", "why later runs may go on with it, as in cells, the least of them; null if they may not";
        seconds: f64, "s", "wall time since the last start";
        finished_at: SystemTime, "UTC", "end of the last cell's evaluation";
    }
}

/// All tables of a grid but the cells.
#[derive(Clone, Debug, PartialEq)]
pub struct GridTables {
    /// The grid itself.
    pub grid: GridRow,
    /// The best descriptors, best first.
    pub best: Vec<BestRow>,
    /// Genes in table order, values ascending.
    pub marginals: Vec<MarginalRow>,
    /// Pairs of genes in table order, values ascending.
    pub landscapes: Vec<LandscapeRow>,
    /// Counts that occur, ascending.
    pub counts: Vec<CountRow>,
}
