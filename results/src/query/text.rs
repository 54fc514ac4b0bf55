//! An answer as a table for people.

use std::borrow::Cow;
use std::io::{self, Write};

use artefact::text::is_printable;
use polars::prelude::Series;

use super::cell::Cell;

/// A single row that is wider is shown column by column.
const WIDE: usize = 120;

/// Writes all rows and columns, nothing cut off, and how many rows they are.
pub(super) fn write(columns: &[&Series], rows: usize, out: &mut dyn Write) -> io::Result<()> {
    let names: Vec<Cow<'_, str>> = columns.iter().map(|column| shown_text(column.name())).collect();
    let numbers: Vec<bool> = columns.iter().map(|column| column.dtype().is_primitive_numeric()).collect();
    let width = |text: &str| text.chars().count();
    let mut widths: Vec<usize> = names.iter().map(|name| width(name)).collect();
    for row in 0..rows {
        for (column, widest) in columns.iter().zip(&mut widths) {
            *widest = (*widest).max(width(&shown(&Cell::of(column, row))));
        }
    }
    if rows == 1 && widths.iter().map(|width| width + 2).sum::<usize>() > WIDE + 2 {
        return write_one(columns, &names, out);
    }
    let mut line = |texts: &mut dyn Iterator<Item = Cow<'_, str>>| {
        let mut line = String::new();
        for ((text, &wide), is_number) in texts.zip(&widths).zip(&numbers) {
            let space = " ".repeat(wide.saturating_sub(width(&text)));
            let (before, after) = if *is_number { (space.as_str(), "") } else { ("", space.as_str()) };
            line.extend([before, &text, after, "  "]);
        }
        writeln!(out, "{}", line.trim_end())
    };
    line(&mut names.iter().map(|name| Cow::Borrowed(&**name)))?;
    line(&mut widths.iter().map(|&wide| Cow::Owned("-".repeat(wide))))?;
    for row in 0..rows {
        line(&mut columns.iter().map(|column| shown(&Cell::of(column, row)).into_owned().into()))?;
    }
    writeln!(out, "({rows} {})", if rows == 1 { "row" } else { "rows" })
}

/// One row, a column on a line; texts of several lines stay so.
fn write_one(columns: &[&Series], names: &[Cow<'_, str>], out: &mut dyn Write) -> io::Result<()> {
    let wide = names.iter().map(|name| name.chars().count()).max().unwrap_or(0);
    for (column, name) in columns.iter().zip(names) {
        let mut title = name.as_ref();
        let cell = Cell::of(column, 0);
        let text = match &cell {
            Cell::Text(text) => Cow::Borrowed(&**text),
            cell => shown(cell),
        };
        for part in text.trim_end().split('\n') {
            writeln!(out, "{}", format!("{title:wide$}  {}", shown_text(part)).trim_end())?;
            title = "";
        }
    }
    writeln!(out, "(1 row)")
}

/// A value as people read it: floats have six digits.
fn shown<'a>(cell: &'a Cell<'_>) -> Cow<'a, str> {
    match cell {
        Cell::Null => Cow::Borrowed("null"),
        Cell::Float(value) => Cow::Owned(six_digits(*value)),
        Cell::Single(value) => Cow::Owned(six_digits(f64::from(*value))),
        Cell::Text(text) => shown_text(text),
        cell => cell.plain(),
    }
}

/// A text on one line, without what a terminal would take for a command or not show: names come from other machines.
fn shown_text(text: &str) -> Cow<'_, str> {
    if text.chars().all(is_printable) {
        return Cow::Borrowed(text);
    }
    let escaped =
        text.chars().map(|c| if is_printable(c) { c.into() } else { c.escape_default().to_string() });
    Cow::Owned(escaped.collect())
}

fn six_digits(value: f64) -> String {
    let scientific = format!("{value:.5e}");
    let Some((digits, exponent)) = scientific.split_once('e') else { return scientific }; // inf, NaN
    let without_zeros = |digits: &str| match digits.contains('.') {
        true => digits.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => digits.to_owned(),
    };
    match exponent.parse::<i32>() {
        Ok(exponent @ -5..=5) => without_zeros(&format!("{value:.*}", (5 - exponent) as usize)),
        _ => format!("{}e{exponent}", without_zeros(digits)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floats_have_six_digits() {
        for (value, expected) in [
            (0.0, "0"),
            (1.0, "1"),
            (-0.5, "-0.5"),
            (13.0 / 108.0, "0.12037"),
            (2.0 / 3.0, "0.666667"),
            (0.999_999_9, "1"),
            (123_456.4, "123456"),
            (1_234_567.0, "1.23457e6"),
            (1e300, "1e300"),
            (0.000_012_345_67, "0.0000123457"),
            (1.5e-9, "1.5e-9"),
            (f64::NAN, "NaN"),
            (f64::NEG_INFINITY, "-inf"),
        ] {
            assert_eq!(six_digits(value), expected);
        }
    }
}
