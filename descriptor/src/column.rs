//! A column of tables: how one gene appears in them.

/// A gene as tables need it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Column {
    /// Its name in TOML, Parquet and reports.
    pub name: &'static str,
    /// Unit of its values, empty for a pure number.
    pub unit: &'static str,
    /// Whether its values are whole numbers.
    pub integer: bool,
    /// What it sets, in a few words.
    pub meaning: &'static str,
}
