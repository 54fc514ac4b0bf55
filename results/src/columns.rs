//! What a column is: name, kind, unit, whether it may be null and whether the run digest covers it.

use polars::prelude::{DataType, PlSmallStr, TimeUnit};
use serde::{Deserialize, Serialize};

/// The type of a column's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColumnKind {
    /// Unsigned 32-bit integer.
    U32,
    /// Unsigned 64-bit integer.
    U64,
    /// 32-bit float, always finite.
    F32,
    /// 64-bit float, always finite.
    F64,
    /// A list of 32-bit floats, always finite, of one length in all rows of a file.
    F32List,
    /// True or false.
    Bool,
    /// UTF-8 text.
    Text,
    /// Milliseconds since 1970-01-01T00:00:00Z, stored without a time zone: polars panics when it prints a zoned
    /// time without its `timezones` feature.
    Timestamp,
}

impl ColumnKind {
    /// The polars type that holds it.
    pub fn data_type(self) -> DataType {
        match self {
            Self::U32 => DataType::UInt32,
            Self::U64 => DataType::UInt64,
            Self::F32 => DataType::Float32,
            Self::F64 => DataType::Float64,
            Self::F32List => DataType::List(Box::new(DataType::Float32)),
            Self::Bool => DataType::Boolean,
            Self::Text => DataType::String,
            Self::Timestamp => DataType::Datetime(TimeUnit::Milliseconds, None),
        }
    }

    /// Its name in the schema document.
    pub fn name(self) -> &'static str {
        match self {
            Self::U32 => "u32",
            Self::U64 => "u64",
            Self::F32 => "f32",
            Self::F64 => "f64",
            Self::F32List => "list of f32",
            Self::Bool => "bool",
            Self::Text => "text",
            Self::Timestamp => "timestamp (ms)",
        }
    }
}

/// One column of a table. The metadata of a file lists its columns as JSON under `descry.columns`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// Type of its values.
    pub kind: ColumnKind,
    /// Unit of its values, empty for a pure number or text.
    pub unit: String,
    /// Whether a cell may be null.
    pub nullable: bool,
    /// Whether the run digest covers it.
    pub in_digest: bool,
    /// Whether it is a gene: there is one such column for every gene of the experiment.
    pub gene: bool,
    /// Its meaning, in a few words.
    pub meaning: String,
}

impl Column {
    /// A column that is never null, outside the digest.
    pub(crate) fn new(name: &str, kind: ColumnKind, unit: &str, meaning: &str) -> Self {
        Self {
            name: name.to_owned(),
            kind,
            unit: unit.to_owned(),
            nullable: false,
            in_digest: false,
            gene: false,
            meaning: meaning.to_owned(),
        }
    }

    pub(crate) fn nullable(self) -> Self {
        Self { nullable: true, ..self }
    }

    /// The column's name as polars holds names.
    pub(crate) fn key(&self) -> PlSmallStr {
        PlSmallStr::from_str(&self.name)
    }
}

/// A gene of the experiment, as the tables need it. This crate does not know which genes there are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GeneColumn {
    /// Its name in TOML, Parquet and reports.
    pub name: String,
    /// Unit of its values, empty for a pure number.
    pub unit: String,
    /// Whether its values are whole numbers (kind u32 instead of f64).
    pub integer: bool,
    /// What it sets, in a few words.
    pub meaning: String,
}

impl GeneColumn {
    /// The gene's column, named `prefix` + gene name. Null where the experiment does not use the gene
    /// (m without colour).
    pub(crate) fn column(&self, prefix: &str) -> Column {
        let kind = if self.integer { ColumnKind::U32 } else { ColumnKind::F64 };
        let name = format!("{prefix}{}", self.name);
        Column { gene: true, ..Column::new(&name, kind, &self.unit, &self.meaning).nullable() }
    }

    /// Undoes [`GeneColumn::column`]; `None` if the column is no gene with that prefix.
    pub(crate) fn of(column: &Column, prefix: &str) -> Option<Self> {
        let name = column.gene.then(|| column.name.strip_prefix(prefix)).flatten()?;
        Some(Self {
            name: name.to_owned(),
            unit: column.unit.clone(),
            integer: column.kind == ColumnKind::U32,
            meaning: column.meaning.clone(),
        })
    }
}
