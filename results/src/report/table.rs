//! A table as text.

/// A table as text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TableBlock {
    /// What it shows.
    pub caption: String,
    /// Names of its columns; empty: it has no head.
    pub head: Vec<String>,
    /// Its cells.
    pub rows: Vec<Vec<String>>,
    /// How many columns, from the left, are text; the others are numbers.
    pub texts: usize,
}
