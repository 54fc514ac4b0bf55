//! The answer to a query, and its three forms: a table for people, CSV, JSON.

use std::borrow::Cow;
use std::io::{self, Write};

use polars::prelude::{AnyValue, DataFrame, Series, TimeUnit};
use serde::ser::{Serialize, Serializer};

use super::text;

/// The form of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnswerFormat {
    /// Columns in line, floats rounded to six digits; a single row that is wide is shown column by column.
    Table,
    /// RFC 4180 with a header; NULL is an empty field.
    Csv,
    /// An array of objects, each on a line; NULL and floats that are not finite are `null`.
    Json,
}

/// The rows that a statement gives.
///
/// CSV and JSON keep every digit of a number. Times are ISO 8601 in UTC, durations are seconds.
#[derive(Clone, Debug)]
pub struct Answer {
    frame: DataFrame,
}

impl Answer {
    pub(super) fn new(mut frame: DataFrame) -> Self {
        frame.rechunk_mut(); // cells are looked up one by one
        Self { frame }
    }

    /// The rows as polars has them.
    pub fn frame(&self) -> &DataFrame {
        &self.frame
    }

    /// Writes all rows.
    pub fn write(&self, format: AnswerFormat, out: &mut dyn Write) -> io::Result<()> {
        let columns: Vec<&Series> =
            self.frame.columns().iter().map(|column| column.as_materialized_series()).collect();
        match format {
            AnswerFormat::Table => text::write(&columns, self.frame.height(), out),
            AnswerFormat::Csv => self.write_csv(&columns, out),
            AnswerFormat::Json => self.write_json(&columns, out),
        }
    }

    fn write_csv(&self, columns: &[&Series], out: &mut dyn Write) -> io::Result<()> {
        let mut csv = csv::Writer::from_writer(out);
        csv.write_record(columns.iter().map(|column| column.name().as_str()))?;
        for row in 0..self.frame.height() {
            for column in columns {
                csv.write_field(Cell::of(column, row).plain().as_bytes())?;
            }
            csv.write_record(None::<&[u8]>)?;
        }
        csv.flush()
    }

    fn write_json(&self, columns: &[&Series], out: &mut dyn Write) -> io::Result<()> {
        out.write_all(b"[")?;
        for row in 0..self.frame.height() {
            out.write_all(if row == 0 { b"\n" } else { b",\n" })?;
            serde_json::to_writer(&mut *out, &Row { columns, row })?;
        }
        out.write_all(if self.frame.height() == 0 { b"]\n" } else { b"\n]\n" })
    }
}

struct Row<'a> {
    columns: &'a [&'a Series],
    row: usize,
}

impl Serialize for Row<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let cells = self.columns.iter().map(|column| (column.name().as_str(), Cell::of(column, self.row)));
        serializer.collect_map(cells)
    }
}

/// One value as the three forms know it.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Cell<'a> {
    Null,
    Bool(bool),
    Integer(i128),
    /// Kept apart, because it has fewer digits.
    Single(f32),
    Float(f64),
    Text(Cow<'a, str>),
    List(Vec<Cell<'static>>),
}

impl<'a> Cell<'a> {
    pub(super) fn of(column: &'a Series, row: usize) -> Self {
        column.get(row).map_or(Self::Null, Self::from)
    }

    /// Its text, with all digits; NULL has none.
    pub(super) fn plain(&self) -> Cow<'_, str> {
        match self {
            Self::Null => Cow::Borrowed(""),
            Self::Bool(value) => Cow::Borrowed(if *value { "true" } else { "false" }),
            Self::Integer(value) => Cow::Owned(value.to_string()),
            // The shortest text that is read back as the same number.
            Self::Single(value) => Cow::Owned(format!("{value:?}")),
            Self::Float(value) => Cow::Owned(format!("{value:?}")),
            Self::Text(text) => Cow::Borrowed(text),
            Self::List(_) => Cow::Owned(serde_json::to_string(self).unwrap_or_default()),
        }
    }

    fn into_owned(self) -> Cell<'static> {
        match self {
            Self::Null => Cell::Null,
            Self::Bool(value) => Cell::Bool(value),
            Self::Integer(value) => Cell::Integer(value),
            Self::Single(value) => Cell::Single(value),
            Self::Float(value) => Cell::Float(value),
            Self::Text(text) => Cell::Text(Cow::Owned(text.into_owned())),
            Self::List(cells) => Cell::List(cells),
        }
    }
}

impl<'a> From<AnyValue<'a>> for Cell<'a> {
    fn from(value: AnyValue<'a>) -> Self {
        match value {
            AnyValue::Null => Self::Null,
            AnyValue::Boolean(value) => Self::Bool(value),
            AnyValue::String(text) => Self::Text(Cow::Borrowed(text)),
            AnyValue::StringOwned(text) => Self::Text(Cow::Owned(text.to_string())),
            AnyValue::Float32(value) => Self::Single(value),
            AnyValue::Float64(value) => Self::Float(value),
            AnyValue::Datetime(value, unit, _) => time(value, unit),
            AnyValue::DatetimeOwned(value, unit, _) => time(value, unit),
            AnyValue::Duration(value, unit) => Self::Float(value as f64 / a_second(unit) as f64),
            AnyValue::Decimal(..) => value.extract::<f64>().map_or(Self::Null, Self::Float),
            AnyValue::List(cells) | AnyValue::Array(cells, _) => {
                Self::List(cells.iter().map(|value| Cell::from(value).into_owned()).collect())
            }
            AnyValue::Binary(bytes) => Self::Text(Cow::Owned(hexadecimal(bytes))),
            AnyValue::BinaryOwned(bytes) => Self::Text(Cow::Owned(hexadecimal(&bytes))),
            value if value.is_integer() => value.extract::<i128>().map_or(Self::Null, Self::Integer),
            value => Self::Text(Cow::Owned(value.to_string())),
        }
    }
}

fn a_second(unit: TimeUnit) -> i64 {
    match unit {
        TimeUnit::Nanoseconds => 1_000_000_000,
        TimeUnit::Microseconds => 1_000_000,
        TimeUnit::Milliseconds => 1000,
    }
}

/// ISO 8601. A time beyond the calendar, as arithmetic can make it, stays a number: polars panics on it.
fn time(value: i64, unit: TimeUnit) -> Cell<'static> {
    const YEARS: i64 = 200_000 * 366 * 86_400;
    if (value / a_second(unit)).abs() > YEARS {
        return Cell::Integer(value.into());
    }
    let text = AnyValue::Datetime(value, unit, None).to_string();
    Cell::Text(Cow::Owned(format!("{}Z", text.replacen(' ', "T", 1))))
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

impl Serialize for Cell<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Null => serializer.serialize_unit(),
            Self::Bool(value) => serializer.serialize_bool(*value),
            Self::Integer(value) => match (i64::try_from(*value), u64::try_from(*value)) {
                (Ok(value), _) => serializer.serialize_i64(value),
                (_, Ok(value)) => serializer.serialize_u64(value),
                _ => serializer.serialize_i128(*value),
            },
            Self::Single(value) => serializer.serialize_f32(*value),
            Self::Float(value) => serializer.serialize_f64(*value),
            Self::Text(text) => serializer.serialize_str(text),
            Self::List(cells) => serializer.collect_seq(cells),
        }
    }
}
