//! Manifests: a row a cloud, from CSV or Parquet, with the same cells and the same checks.

use std::path::Path;

use super::error::{DatasetError, Place};
use super::file::read_file;
use super::labelled::Labelled;
use super::root::{Root, text_of, unreadable};
use super::text_columns::{self, TextColumns, Unusable};
use crate::names::is_name;

/// The columns that are read; the first three must be there.
const COLUMNS: [&str; 6] = ["path", "category", "instance", "sequence", "split", "set"];
const NEEDED: usize = 3;

/// How Parquet begins, and ends.
const MAGIC: &[u8] = b"PAR1";

/// A manifest's cells, without blanks around them.
struct Table {
    /// Whether a column is there, in the order of [`COLUMNS`].
    has: [bool; COLUMNS.len()],
    /// Of each row its cells, empty where there is nothing.
    rows: Vec<(Place, [String; COLUMNS.len()])>,
}

/// The clouds of a manifest, by row.
pub(super) fn read(file: &Path, root: &Root) -> Result<Vec<Labelled>, DatasetError> {
    let bytes = read_file(file).map_err(|reason| unreadable(file, reason))?;
    let is_named_so = file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("parquet"));
    let table = if is_named_so || bytes.starts_with(MAGIC) && bytes.ends_with(MAGIC) {
        from_parquet(file, bytes)?
    } else {
        from_csv(file, bytes)?
    };
    table.rows.into_iter().map(|(place, cells)| labelled(table.has, &place, cells, root)).collect()
}

/// What a row says, checked.
fn labelled(
    has: [bool; COLUMNS.len()],
    place: &Place,
    cells: [String; COLUMNS.len()],
    root: &Root,
) -> Result<Labelled, DatasetError> {
    for (column, cell) in COLUMNS.into_iter().zip(&cells) {
        if cell.chars().any(char::is_control) {
            return Err(DatasetError::Manifest {
                place: place.clone(),
                expected: format!("{column} without control characters expected"),
                got: cell.escape_debug().to_string(),
            });
        }
    }
    let has_set = has[COLUMNS.len() - 1];
    let [path, category, instance, sequence, split, set] = cells;
    let needed = |cell: String, column| match cell.is_empty() {
        true => Err(DatasetError::EmptyField { place: place.clone(), column }),
        false => Ok(cell),
    };
    let optional = |cell: String| Some(cell).filter(|cell| !cell.is_empty());
    let path = needed(path, "path")?;
    Ok(Labelled {
        category: needed(category, "category")?,
        instance: needed(instance, "instance")?,
        sequence: optional(sequence),
        split: optional(split),
        // Of a cloud without one nobody knows what it may be compared with.
        set: if has_set { Some(set_name(needed(set, "set")?, place)?) } else { None },
        located: root.locate(&path, place)?,
        place: place.clone(),
    })
}

/// A name of a set, which is a key of experiments and the name of a folder, too.
fn set_name(name: String, place: &Place) -> Result<String, DatasetError> {
    if is_name(&name) {
        return Ok(name);
    }
    Err(DatasetError::Manifest {
        place: place.clone(),
        expected: "set of 1 to 64 of a-z, 0-9, - and _, not beginning with -, expected".to_owned(),
        got: name,
    })
}

/// Refuses a table without a needed column.
fn check_columns(has: [bool; COLUMNS.len()], place: Place, titles: &[&str]) -> Result<(), DatasetError> {
    match COLUMNS.into_iter().zip(has).take(NEEDED).find(|&(_, has)| !has) {
        Some((column, _)) => {
            let (expected, got) = (format!("column {column} expected"), titles.join(","));
            Err(DatasetError::Manifest { place, expected, got })
        }
        None => Ok(()),
    }
}

fn from_csv(file: &Path, bytes: Vec<u8>) -> Result<Table, DatasetError> {
    let text = text_of(file, bytes)?;
    let at = |line| Place::Line { file: file.to_owned(), line };
    let broken = |error: csv::Error| DatasetError::Manifest {
        place: at(error.position().map_or(1, csv::Position::line)),
        expected: "CSV with the same number of fields in each row expected".to_owned(),
        got: error.to_string(),
    };
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let header = reader.headers().map_err(broken)?.clone();
    let mut of_column = [None; COLUMNS.len()];
    for (column, name) in COLUMNS.into_iter().enumerate() {
        let mut found = (0..header.len()).filter(|&index| header[index] == *name);
        of_column[column] = found.next();
        if found.next().is_some() {
            return Err(DatasetError::Manifest {
                place: at(1),
                expected: "each column once expected".to_owned(),
                got: format!("{name} twice"),
            });
        }
    }
    let has = of_column.map(|index| index.is_some());
    check_columns(has, at(1), &header.iter().collect::<Vec<_>>())?;
    let row = |record: Result<csv::StringRecord, csv::Error>| {
        let record = record.map_err(broken)?;
        let cell = |index: Option<usize>| index.and_then(|index| record.get(index)).unwrap_or_default();
        let place = at(record.position().map_or(1, csv::Position::line));
        Ok((place, of_column.map(|index| cell(index).to_owned())))
    };
    Ok(Table { has, rows: reader.records().map(row).collect::<Result<_, _>>()? })
}

fn from_parquet(file: &Path, bytes: Vec<u8>) -> Result<Table, DatasetError> {
    let whole = || Place::File { file: file.to_owned() };
    let TextColumns { mut columns, names } = text_columns::read(bytes, COLUMNS)
        .map_err(|Unusable { expected, got }| DatasetError::Manifest { place: whole(), expected, got })?;
    let has = columns.each_ref().map(Option::is_some);
    check_columns(has, whole(), &names.iter().map(String::as_str).collect::<Vec<_>>())?;
    let length = columns[0].as_ref().map_or(0, Vec::len);
    let rows = (0..length).map(|row| {
        let place = Place::Row { file: file.to_owned(), row: row as u64 };
        let cell = |cells: &mut Option<Vec<String>>| match cells {
            Some(cells) => std::mem::take(&mut cells[row]).trim().to_owned(),
            None => String::new(),
        };
        (place, columns.each_mut().map(cell))
    });
    Ok(Table { has, rows: rows.collect() })
}
