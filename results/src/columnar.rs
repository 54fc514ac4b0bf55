//! Rows of a table as columns of JSON, which other programs and pages read without Parquet.

use std::fmt::Write as _;
use std::path::Path;

use polars::prelude::{AnyValue, DataType};

use crate::columns::GeneColumn;
use crate::error::Error;
use crate::file::names;
use crate::read::{generation_file, read_file_if_any, read_whole};
use crate::table_name::TableName;
use crate::tables::TableFile;

/// Rows of a table, column by column, each cell as JSON.
///
/// A column of times whose name ends in `at` is one of milliseconds since 1970 whose name ends in `ms`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columnar {
    rows: usize,
    /// Name and cells, separated by commas.
    columns: Vec<(String, String)>,
    /// The table's genes.
    genes: Vec<GeneColumn>,
}

impl Columnar {
    /// All rows of a table in a run or grid folder; `None` if it has no file.
    ///
    /// # Errors
    /// If a file cannot be read or is damaged; the message names it.
    pub fn read(folder: &Path, table: TableName) -> Result<Option<Self>, Error> {
        read_whole(folder, table)?.map(|file| Self::of(&file)).transpose()
    }

    /// The rows of one generation of a table that has a file for each; `None` if it is not there yet.
    ///
    /// # Errors
    /// As [`Columnar::read`].
    pub fn of_generation(folder: &Path, table: TableName, generation: u32) -> Result<Option<Self>, Error> {
        Self::of_file(&folder.join(table.as_str()).join(generation_file(generation)), table)
    }

    /// The rows of one file of a table; `None` if it is not there.
    ///
    /// # Errors
    /// As [`Columnar::read`].
    pub fn of_file(file: &Path, table: TableName) -> Result<Option<Self>, Error> {
        read_file_if_any(file, table)?.map(|file| Self::of(&file)).transpose()
    }

    fn of(file: &TableFile) -> Result<Self, Error> {
        let genes = file.table.columns.iter().filter_map(|column| GeneColumn::of(column, "")).collect();
        let mut columns = Vec::new();
        for column in file.frame.columns() {
            let (mut name, mut cells) = (column.name().to_string(), String::new());
            let is_time = matches!(column.dtype(), DataType::Datetime(..));
            if is_time
                && let Some(stem) =
                    name.strip_suffix("at").filter(|stem| !stem.ends_with(char::is_alphabetic))
            {
                name = format!("{stem}ms");
            }
            let column = if is_time { column.cast(&DataType::Int64)? } else { column.clone() };
            for (row, cell) in column.as_materialized_series().iter().enumerate() {
                if row > 0 {
                    cells.push(',');
                }
                write_cell(&mut cells, &cell);
            }
            columns.push((name, cells));
        }
        Ok(Self { rows: file.frame.height(), columns, genes })
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// A column of numbers; empty if the table has no such column.
    pub fn numbers(&self, name: &str) -> Vec<Option<f64>> {
        let cells = self.columns.iter().find(|(other, _)| other == name).map_or("", |(_, cells)| cells);
        cells.split(',').filter(|cell| !cell.is_empty()).map(|cell| cell.parse().ok()).collect()
    }

    /// Whether it has a column of this name.
    pub fn has(&self, name: &str) -> bool {
        self.columns.iter().any(|(other, _)| other == name)
    }

    /// Adds a column that the table does not have, a cell for each row; what is missing at the end is null.
    pub fn add(&mut self, name: &str, cells: impl IntoIterator<Item = Option<u64>>) {
        let cells = cells.into_iter().chain(std::iter::repeat(None)).take(self.rows);
        let cells: Vec<String> =
            cells.map(|cell| cell.map_or_else(|| "null".to_owned(), |cell| cell.to_string())).collect();
        self.columns.push((name.to_owned(), cells.join(",")));
    }

    /// The table's genes.
    pub fn genes(&self) -> &[GeneColumn] {
        &self.genes
    }

    /// `{"rows": n, "columns": {name: [cells]}}` of several parts of one table, one below the other; what a part lacks
    /// is null in it.
    pub fn json<'a>(parts: impl Iterator<Item = &'a Self> + Clone) -> String {
        let rows: usize = parts.clone().map(|part| part.rows).sum();
        let mut names: Vec<&str> = Vec::new();
        for (name, _) in parts.clone().flat_map(|part| &part.columns) {
            if !names.contains(&name.as_str()) {
                names.push(name);
            }
        }
        let mut text = format!("{{\"rows\":{rows},\"columns\":{{");
        for (place, name) in names.into_iter().enumerate() {
            if place > 0 {
                text.push(',');
            }
            write_text(&mut text, name);
            text.push_str(":[");
            let mut is_first = true;
            for part in parts.clone().filter(|part| part.rows > 0) {
                if !std::mem::take(&mut is_first) {
                    text.push(',');
                }
                match part.columns.iter().find(|(other, _)| other == name) {
                    Some((_, cells)) => text.push_str(cells),
                    None => text.push_str(&vec!["null"; part.rows].join(",")),
                }
            }
            text.push(']');
        }
        text.push_str("}}");
        text
    }
}

/// How many generations of a run are written whole, from generation 1 without a gap, of which `known` are known to be.
///
/// # Errors
/// If the folder cannot be read.
pub fn complete_generations(run: &Path, known: u32) -> Result<u32, Error> {
    let names = names(&run.join(TableName::Generations.as_str()))?;
    let order = |name: &str, other: &str| (name.len(), name).cmp(&(other.len(), other));
    let is_there = |generation: u32| {
        let file = generation_file(generation);
        names.binary_search_by(|name| order(name, &file)).is_ok()
    };
    // A run that has begun again has fewer than it had.
    let first = if known == 0 || is_there(known) { known + 1 } else { 1 };
    Ok((first..).take_while(|&generation| is_there(generation)).last().unwrap_or(first - 1))
}

/// Numbers as they are, what is no number as null, everything else as text.
fn write_cell(text: &mut String, cell: &AnyValue<'_>) {
    // Writing to a String cannot fail.
    let _ = match cell {
        AnyValue::Null => write!(text, "null"),
        AnyValue::Boolean(value) => write!(text, "{value}"),
        AnyValue::UInt32(value) => write!(text, "{value}"),
        AnyValue::UInt64(value) => write!(text, "{value}"),
        AnyValue::Int64(value) => write!(text, "{value}"),
        AnyValue::Float32(value) if value.is_finite() => write!(text, "{value}"),
        AnyValue::Float64(value) if value.is_finite() => write!(text, "{value}"),
        AnyValue::Float32(_) | AnyValue::Float64(_) => write!(text, "null"),
        AnyValue::String(value) => {
            write_text(text, value);
            Ok(())
        }
        AnyValue::StringOwned(value) => {
            write_text(text, value);
            Ok(())
        }
        AnyValue::List(values) => {
            text.push('[');
            for (place, value) in values.iter().enumerate() {
                if place > 0 {
                    text.push(',');
                }
                write_cell(text, &value);
            }
            text.push(']');
            Ok(())
        }
        other => {
            write_text(text, &other.to_string());
            Ok(())
        }
    };
}

fn write_text(text: &mut String, value: &str) {
    text.push_str(&serde_json::Value::from(value).to_string());
}

#[cfg(test)]
mod tests {
    use polars::prelude::{DataFrame, IntoColumn as _, NamedFrom as _, Series, TimeUnit};

    use super::*;
    use crate::tables::Table;

    fn part(columns: Vec<Series>) -> Columnar {
        let columns: Vec<_> = columns.into_iter().map(|series| series.into_column()).collect();
        let frame = DataFrame::new(columns[0].len(), columns).unwrap();
        Columnar::of(&TableFile { table: Table::new(TableName::Events, &[]).unwrap(), frame }).unwrap()
    }

    #[test]
    fn cells_are_json_and_times_are_milliseconds() {
        let times = Series::new("joined_at".into(), [Some(5i64), None]);
        let times = times.cast(&DataType::Datetime(TimeUnit::Milliseconds, None)).unwrap();
        let part = part(vec![
            times,
            Series::new("flat".into(), [f64::NAN, 0.1]),
            Series::new("name".into(), ["</script>\n\"", "größe"]),
            Series::new(
                "values".into(),
                [Series::new("".into(), [0.5f32]), Series::new("".into(), [1.0f32, 2.0])],
            ),
        ]);
        let json: serde_json::Value = serde_json::from_str(&Columnar::json([&part].into_iter())).unwrap();
        let expected = serde_json::json!({"rows": 2, "columns": {
            "joined_ms": [5, null], "flat": [null, 0.1], "name": ["</script>\n\"", "größe"], "values": [[0.5], [1, 2]],
        }});
        assert_eq!(json, expected);
        assert_eq!(part.numbers("flat"), [None, Some(0.1)]);
        assert_eq!(part.numbers("joined_ms"), [Some(5.0), None]);
        assert_eq!(part.numbers("nothing"), []);
    }

    #[test]
    fn what_a_part_lacks_is_null_in_it() {
        let old = part(vec![Series::new("a".into(), [1u32, 2])]);
        let new = part(vec![Series::new("a".into(), [3u32]), Series::new("b".into(), [true])]);
        let none = Columnar::default();
        let json: serde_json::Value =
            serde_json::from_str(&Columnar::json([&none, &old, &new].into_iter())).unwrap();
        assert_eq!(
            json,
            serde_json::json!({"rows": 3, "columns": {"a": [1, 2, 3], "b": [null, null, true]}})
        );
        let nothing: serde_json::Value = serde_json::from_str(&Columnar::json([].iter())).unwrap();
        assert_eq!(nothing, serde_json::json!({"rows": 0, "columns": {}}));
    }

    #[test]
    fn generations_are_counted_from_the_first_without_a_gap() {
        let run = tempfile::tempdir().unwrap();
        let folder = run.path().join("generations");
        std::fs::create_dir(&folder).unwrap();
        assert_eq!(complete_generations(run.path(), 0).unwrap(), 0);
        for generation in [1, 2, 4] {
            std::fs::write(folder.join(generation_file(generation)), "").unwrap();
        }
        for known in [0, 1, 2, 9] {
            assert_eq!(complete_generations(run.path(), known).unwrap(), 2, "{known}");
        }
    }
}
