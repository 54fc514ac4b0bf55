//! Rows of a grid's tables as plain structs, for those who write them.

use std::time::SystemTime;

/// Descriptors of one cell of the grid and what each reached, column by column.
#[derive(Clone, Debug, PartialEq)]
pub struct CellPoints {
    /// For each gene column its values in the gene's unit, one a descriptor; `None` for a gene that is not used.
    pub genes: Vec<Vec<Option<f64>>>,
    /// Queries of the first training set that each descriptor answers with the right object.
    pub object_correct: Vec<u32>,
    /// Id of the worker that counted, hexadecimal; `None` if it is not known.
    pub worker_id: Option<String>,
}

/// One of the best descriptors; its rank is its place in the list.
#[derive(Clone, Debug, PartialEq)]
pub struct BestRow {
    /// Values in the genes' units, in the order of the gene columns; `None` for a gene that is not used.
    pub genes: Vec<Option<f64>>,
    /// Queries answered with the right object.
    pub object_correct: u32,
}

/// All descriptors with one value of one gene.
#[derive(Clone, Debug, PartialEq)]
pub struct MarginalRow {
    /// Name of the gene.
    pub gene: String,
    /// Its value, in its unit.
    pub value: f64,
    /// How many descriptors have it, at least 1.
    pub descriptors: u64,
    /// The highest count of correct answers among them.
    pub best: u32,
    /// The mean count.
    pub mean: f64,
    /// The median count: the mean of both middle ones if their number is even.
    pub median: f64,
    /// The lowest count.
    pub worst: u32,
}

/// All descriptors with one value of each of two genes.
#[derive(Clone, Debug, PartialEq)]
pub struct LandscapeRow {
    /// Names of the genes, in table order.
    pub genes: [String; 2],
    /// Their values, in their units.
    pub values: [f64; 2],
    /// How many descriptors have both, at least 1.
    pub descriptors: u64,
    /// The highest count of correct answers among them.
    pub best: u32,
    /// The mean count.
    pub mean: f64,
}

/// All descriptors with one count of correct answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CountRow {
    /// The count.
    pub object_correct: u32,
    /// How many descriptors have it, at least 1.
    pub descriptors: u64,
}

/// The grid as a whole.
#[derive(Clone, Debug, PartialEq)]
pub struct GridRow {
    /// Name of the experiment.
    pub name: String,
    /// BLAKE3 of `search_space`, hexadecimal.
    pub grid_key: String,
    /// What determines the counts, as canonical TOML.
    pub search_space: String,
    /// BLAKE3 over the usable clouds of both training sets, hexadecimal.
    pub train_digest: String,
    /// Version of the method.
    pub evaluation_version: u32,
    /// Pairs of R1 and R2.
    pub cells: u32,
    /// Size of the search space.
    pub descriptors: u64,
    /// Clouds of the first training set that took part, at least 1.
    pub queries: u32,
    /// How many descriptors are as good as the best.
    pub optimal_descriptors: u64,
    /// The best descriptor, the first in gene order on ties.
    pub best: BestRow,
    /// BLAKE3 over all counts, hexadecimal.
    pub grid_digest: String,
    /// Cells evaluated since the last start.
    pub cells_computed: u32,
    /// Cells that were there before it.
    pub cells_found: u32,
    /// Wall time since the last start, seconds.
    pub seconds: f64,
    /// End; kept to the millisecond.
    pub finished_at: SystemTime,
}

/// What an exhaustive search amounts to, beside the cells.
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
