//! The check that every frame passes before it is written and after it is read: the table's columns, kinds and nulls.

use polars::prelude::DataFrame;

use crate::columns::ColumnKind;
use crate::error::Error;
use crate::record::Cells;
use crate::tables::Table;

/// What is wrong with a column of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Mismatch {
    pub column: String,
    pub expected: String,
    pub got: String,
}

/// Brings a frame into the table's form: its columns in order, then unknown ones. A missing nullable column (a file
/// from before the column was added) becomes null. Refuses other types, nulls where none may be, and floats that
/// are not finite.
pub(crate) fn conform(table: &Table, frame: DataFrame) -> Result<Result<DataFrame, Mismatch>, Error> {
    let height = frame.height();
    let mut columns = Vec::with_capacity(table.columns.len());
    for column in &table.columns {
        let mismatch = |expected: &str, got: String| Mismatch {
            column: column.name.clone(),
            expected: expected.to_owned(),
            got,
        };
        let data_type = column.kind.data_type();
        let cells = match frame.column(&column.name) {
            Ok(cells) => cells.clone(),
            Err(_) if column.nullable => Cells::full_null(column.key(), height, &data_type),
            Err(_) => return Ok(Err(mismatch(column.kind.name(), "no such column".to_owned()))),
        };
        if *cells.dtype() != data_type {
            return Ok(Err(mismatch(column.kind.name(), cells.dtype().to_string())));
        }
        if !column.nullable && cells.null_count() > 0 {
            return Ok(Err(mismatch("a value in every row", format!("{} nulls", cells.null_count()))));
        }
        let infinite = match column.kind {
            ColumnKind::F64 => cells.f64()?.iter().flatten().find(|value| !value.is_finite()),
            ColumnKind::F32 => cells.f32()?.iter().flatten().find(|value| !value.is_finite()).map(f64::from),
            _ => None,
        };
        if let Some(value) = infinite {
            return Ok(Err(mismatch("a finite number", value.to_string())));
        }
        columns.push(cells);
    }
    columns.extend(frame.columns().iter().filter(|cells| table.column(cells.name()).is_none()).cloned());
    Ok(Ok(DataFrame::new(height, columns)?))
}
