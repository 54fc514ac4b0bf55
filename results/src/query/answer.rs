//! The answer to a query, and its three forms: a table for people, CSV, JSON.

use std::borrow::Cow;
use std::io::{self, Write};

use polars::prelude::{DataFrame, Series};
use serde::ser::{Serialize, Serializer};

use super::cell::Cell;
use super::text;

/// The form of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnswerFormat {
    /// Columns in line, floats rounded to six digits; a single row that is wide is shown column by column.
    Table,
    /// RFC 4180 with a header; NULL is an empty field. Texts that a spreadsheet would take for a formula have a single
    /// quote in front.
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
        csv.write_record(columns.iter().map(|column| no_formula(column.name()).into_owned()))?;
        for row in 0..self.frame.height() {
            for column in columns {
                let cell = Cell::of(column, row);
                let text = cell.plain();
                // Numbers begin with a sign, too, and are to stay numbers.
                let text = if matches!(cell, Cell::Text(_)) { no_formula(&text) } else { text };
                csv.write_field(text.as_bytes())?;
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

/// A text that no spreadsheet takes for a formula: names come from files and machines of others. As OWASP's page on CSV
/// injection has it, with the forms of full width, which some take for the same.
fn no_formula(text: &str) -> Cow<'_, str> {
    let begins = ['=', '+', '-', '@', '\t', '\r', '\n', '\u{ff1d}', '\u{ff0b}', '\u{ff0d}', '\u{ff20}'];
    if text.starts_with(begins) { Cow::Owned(format!("'{text}")) } else { Cow::Borrowed(text) }
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
