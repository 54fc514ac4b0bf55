//! Reading a column of single values, row by row, from Parquet whose writer nobody vouches for.

use parquet::column::reader::ColumnReaderImpl;
use parquet::data_type::DataType;
use parquet::errors::ParquetError;

/// Rows that are decoded at a time.
pub(crate) const BATCH: usize = 1 << 12;

/// Calls `each` with the value of each row, or `None` where it is null, as long as it takes them. `most` is the column's
/// maximum definition level.
///
/// # Errors
/// Those of the decoder and of `each`, and `short` if there are fewer values than the rows say.
pub fn read_values<D: DataType, E: From<ParquetError>>(
    mut reader: ColumnReaderImpl<D>,
    most: i16,
    short: impl Fn() -> E,
    mut each: impl FnMut(Option<&D::T>) -> Result<(), E>,
) -> Result<(), E> {
    loop {
        let (mut levels, mut values) = (Vec::new(), Vec::new());
        let (rows, ..) = reader.read_records(BATCH, Some(&mut levels), None, &mut values)?;
        if rows == 0 {
            return Ok(());
        }
        if most == 0 {
            levels = vec![0; rows];
        }
        let mut values = values.iter();
        for level in levels {
            let value = if level == most { Some(values.next().ok_or_else(&short)?) } else { None };
            each(value)?;
        }
    }
}
