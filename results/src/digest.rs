//! The run digest: BLAKE3 over exactly the cells whose columns are marked `in_digest`.
//!
//! Tables must have passed `conform`: columns in table order, of their kinds.
//!
//! A tree of hashes, so that one generation at a time is read and a changed one can be named:
//! run digest = H(run row, H(rows of generation 1), …, H(rows of generation n), H(predictions)), and H(front) after it
//! where there is one.
//! A table's content is its name, its number of rows and, in key order, every row: each digest column that is not
//! null as length-prefixed name, kind and value, then an empty name. A null cell is left out, so that a nullable
//! column added later leaves the digests of older runs as they are.

use blake3::{Hash, Hasher};
use polars::prelude::{AnyValue, DataFrame, PolarsError};

use crate::columns::{Column, ColumnKind};
use crate::error::Error;
use crate::tables::{Table, TableFile};

/// Digest of one generation: its `evaluations` and its row of `generations`.
pub(crate) fn generation_rows(evaluations: &TableFile, generation: &TableFile) -> Result<Hash, Error> {
    let mut hasher = Hasher::new_derive_key("descry generation rows v1");
    content(&mut hasher, evaluations)?;
    content(&mut hasher, generation)?;
    Ok(hasher.finalize())
}

/// Digest of the predictions, all files of the table in any order.
pub(crate) fn predictions(files: &[TableFile]) -> Result<Hash, Error> {
    let mut hasher = Hasher::new_derive_key("descry predictions v1");
    // Validation and test are separate files; their order in the folder must not matter.
    let mut digests = Vec::new();
    for rows in files {
        let mut file = Hasher::new_derive_key("descry predictions of one file v1");
        content(&mut file, rows)?;
        digests.push(file.finalize());
    }
    digests.sort_by(|a, b| a.as_bytes().cmp(b.as_bytes()));
    for digest in digests {
        hasher.update(digest.as_bytes());
    }
    Ok(hasher.finalize())
}

/// Digest of the front.
pub(crate) fn front(rows: &TableFile) -> Result<Hash, Error> {
    let mut hasher = Hasher::new_derive_key("descry front v1");
    content(&mut hasher, rows)?;
    Ok(hasher.finalize())
}

/// Digest of a run: its row, its generations from 1, its predictions and its front, if it has one.
pub(crate) fn run(
    row: &TableFile,
    generations: &[Hash],
    predictions: Hash,
    front: Option<Hash>,
) -> Result<Hash, Error> {
    let mut hasher = Hasher::new_derive_key("descry run digest v1");
    content(&mut hasher, row)?;
    hasher.update(&(generations.len() as u64).to_le_bytes());
    for digest in generations {
        hasher.update(digest.as_bytes());
    }
    hasher.update(predictions.as_bytes());
    if let Some(front) = front {
        hasher.update(front.as_bytes());
    }
    Ok(hasher.finalize())
}

/// Digest of all cells of a table of one row but that of column `without`, in the order of the columns' names; null cells
/// are left out, so that a nullable column added later leaves older rows as they are.
pub(crate) fn cells(row: &TableFile, without: &str) -> Result<Hash, Error> {
    let mut hasher = Hasher::new_derive_key("descry cells of a row v1");
    let mut columns: Vec<_> = row.frame.columns().iter().filter(|cells| cells.name() != without).collect();
    columns.sort_by(|a, b| a.name().cmp(b.name()));
    for cells in columns {
        let (kind, bytes) = match cells.get(0)? {
            AnyValue::Null => continue,
            AnyValue::UInt32(number) => ("u", u64::from(number).to_le_bytes().to_vec()),
            AnyValue::UInt64(number) => ("u", number.to_le_bytes().to_vec()),
            AnyValue::Boolean(flag) => ("b", vec![u8::from(flag)]),
            AnyValue::Float64(number) => ("f", number.to_bits().to_le_bytes().to_vec()),
            AnyValue::Datetime(milliseconds, ..) => ("t", milliseconds.to_le_bytes().to_vec()),
            other => match other.get_str() {
                Some(text) => ("s", text.as_bytes().to_vec()),
                // Of a column that only a later release knows.
                None => ("o", format!("{other:?}").into_bytes()),
            },
        };
        text(&mut hasher, cells.name());
        text(&mut hasher, kind);
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(&bytes);
    }
    Ok(hasher.finalize())
}

fn content(hasher: &mut Hasher, TableFile { table, frame }: &TableFile) -> Result<(), Error> {
    text(hasher, table.name.as_str());
    hasher.update(&(frame.height() as u64).to_le_bytes());
    let mut cells = Vec::new();
    for column in table.columns.iter().filter(|column| column.in_digest) {
        cells.push((column, frame.column(&column.name)?));
    }
    for row in key_order(table, frame)? {
        for (column, cell) in &cells {
            value(hasher, column, cell.get(row)?)?;
        }
        text(hasher, "");
    }
    Ok(())
}

/// Row indices in the order of the table's key. Keys are texts and u32; equal keys keep the file's order.
fn key_order(table: &Table, frame: &DataFrame) -> Result<Vec<usize>, Error> {
    let mut keys: Vec<Vec<(String, u32)>> = vec![Vec::new(); frame.height()];
    for name in table.key {
        let cell = frame.column(name)?;
        for (row, key) in keys.iter_mut().enumerate() {
            key.push(match cell.get(row)? {
                AnyValue::UInt32(number) => (String::new(), number),
                other => (other.get_str().unwrap_or_default().to_owned(), 0),
            });
        }
    }
    let mut order: Vec<usize> = (0..frame.height()).collect();
    order.sort_by(|&a, &b| keys[a].cmp(&keys[b]));
    Ok(order)
}

fn text(hasher: &mut Hasher, text: &str) {
    hasher.update(&(text.len() as u64).to_le_bytes());
    hasher.update(text.as_bytes());
}

fn value(hasher: &mut Hasher, column: &Column, value: AnyValue) -> Result<(), Error> {
    if value.is_null() {
        return Ok(());
    }
    text(hasher, &column.name);
    match (column.kind, value) {
        (ColumnKind::U32, AnyValue::UInt32(number)) => {
            hasher.update(b"u");
            hasher.update(&u64::from(number).to_le_bytes());
        }
        (ColumnKind::U64, AnyValue::UInt64(number)) => {
            hasher.update(b"u");
            hasher.update(&number.to_le_bytes());
        }
        (ColumnKind::F64, AnyValue::Float64(number)) => {
            hasher.update(b"f");
            hasher.update(&number.to_bits().to_le_bytes());
        }
        (ColumnKind::Bool, AnyValue::Boolean(flag)) => {
            hasher.update(b"b");
            hasher.update(&[u8::from(flag)]);
        }
        (ColumnKind::Timestamp, AnyValue::Datetime(milliseconds, ..)) => {
            hasher.update(b"t");
            hasher.update(&milliseconds.to_le_bytes());
        }
        (ColumnKind::Text, other) => {
            hasher.update(b"s");
            text(hasher, other.get_str().unwrap_or_default());
        }
        (kind, other) => {
            let (expected, got) = (kind.name(), other.dtype());
            let message = format!("column {}: expected {expected}, got {got}", column.name);
            return Err(Error::Frame(PolarsError::SchemaMismatch(message.into())));
        }
    }
    Ok(())
}
