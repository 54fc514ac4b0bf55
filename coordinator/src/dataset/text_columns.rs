//! Columns of text in a Parquet file of any program.
//!
//! Nothing vouches for such a file: texts are counted as they are read, and a panic of the decoder is an error like any
//! other.

use std::panic::{AssertUnwindSafe, catch_unwind};

use artefact::parquet_column::read_values;
use bytes::Bytes;
use parquet::basic::{ConvertedType, LogicalType, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::schema::types::{ColumnDescPtr, ColumnDescriptor};

/// Bytes of texts that are kept at most: a few bytes of a dictionary may be as many texts as there are rows.
const MAX_TEXT_BYTES: usize = 1 << 30;

/// Columns as text.
pub(super) struct TextColumns<const N: usize> {
    /// The cells of each column that was asked for, row by row, empty for null; `None` where there is no such column.
    pub columns: [Option<Vec<String>>; N],
    /// Names of all columns of the file.
    pub names: Vec<String>,
}

/// What must be in a file, and what is there instead.
pub(super) struct Unusable {
    pub expected: String,
    pub got: String,
}

impl From<ParquetError> for Unusable {
    fn from(error: ParquetError) -> Self {
        let got = error.to_string().lines().next().unwrap_or_default().to_owned();
        Self { expected: "sound Parquet file expected".to_owned(), got }
    }
}

/// Reads columns of text or whole numbers.
pub(super) fn read<const N: usize>(bytes: Vec<u8>, wanted: [&str; N]) -> Result<TextColumns<N>, Unusable> {
    catch_unwind(AssertUnwindSafe(|| decode(bytes, wanted)))
        .unwrap_or_else(|_| Err(ParquetError::General("bytes that the decoder stopped at".to_owned()).into()))
}

fn decode<const N: usize>(bytes: Vec<u8>, wanted: [&str; N]) -> Result<TextColumns<N>, Unusable> {
    let file = SerializedFileReader::new(Bytes::from(bytes))?;
    let schema = file.metadata().file_metadata().schema_descr_ptr();
    let name = |leaf: &ColumnDescPtr| leaf.path().parts().first().cloned().unwrap_or_default();
    let names: Vec<String> = schema.columns().iter().map(name).collect();
    let (mut columns, mut kept) = ([const { None }; N], 0);
    for (column, title) in columns.iter_mut().zip(wanted) {
        let Some(position) = names.iter().position(|name| name == title) else { continue };
        let leaf = schema.column(position);
        if !is_text(&leaf) && !is_whole(&leaf) {
            return Err(Unusable {
                expected: format!("text or whole numbers in column {title} expected"),
                got: other_kind(&leaf),
            });
        }
        let mut cells = Cells { leaf, texts: Vec::new(), kept };
        for group in 0..file.num_row_groups() {
            cells.read(file.get_row_group(group)?.get_column_reader(position)?)?;
        }
        kept = cells.kept;
        *column = Some(cells.texts);
    }
    let rows = |column: &Option<Vec<String>>| column.as_ref().map(Vec::len);
    let mut lengths = columns.iter().filter_map(rows);
    let first = lengths.next();
    if let Some(other) = lengths.find(|&length| Some(length) != first) {
        let got = format!("{} rows and {other}", first.unwrap_or_default());
        return Err(Unusable { expected: "columns of one length expected".to_owned(), got });
    }
    Ok(TextColumns { columns, names })
}

fn is_text(leaf: &ColumnDescriptor) -> bool {
    let is_said = matches!(leaf.logical_type_ref(), Some(LogicalType::String))
        || leaf.converted_type() == ConvertedType::UTF8;
    is_said && leaf.physical_type() == Physical::BYTE_ARRAY && leaf.max_rep_level() == 0
}

fn is_whole(leaf: &ColumnDescriptor) -> bool {
    let is_number = match leaf.logical_type_ref() {
        Some(logical) => matches!(logical, LogicalType::Integer(_)),
        None => leaf.converted_type() == ConvertedType::NONE,
    };
    is_number
        && matches!(leaf.physical_type(), Physical::INT32 | Physical::INT64)
        && leaf.max_rep_level() == 0
}

fn is_unsigned(leaf: &ColumnDescriptor) -> bool {
    matches!(leaf.logical_type_ref(), Some(LogicalType::Integer(integer)) if !integer.is_signed)
}

/// What a column holds that is neither.
fn other_kind(leaf: &ColumnDescriptor) -> String {
    match (leaf.physical_type(), leaf.max_rep_level()) {
        (_, 1..) => "lists".to_owned(),
        (Physical::FLOAT | Physical::DOUBLE, _) => "numbers with fractions".to_owned(),
        (Physical::BOOLEAN, _) => "truth values".to_owned(),
        (physical, _) => format!("{physical} of another meaning"),
    }
}

/// The rows of a column as far as they have been read.
struct Cells {
    leaf: ColumnDescPtr,
    texts: Vec<String>,
    /// Bytes of these and of earlier columns.
    kept: usize,
}

impl Cells {
    fn read(&mut self, reader: ColumnReader) -> Result<(), Unusable> {
        let is_unsigned = is_unsigned(&self.leaf);
        match reader {
            ColumnReader::ByteArrayColumnReader(reader) => {
                self.rows(reader, |text| Ok(text.as_utf8()?.to_owned()))
            }
            ColumnReader::Int32ColumnReader(reader) if is_unsigned => {
                self.rows(reader, |number| Ok(number.cast_unsigned().to_string()))
            }
            ColumnReader::Int32ColumnReader(reader) => self.rows(reader, |number| Ok(number.to_string())),
            ColumnReader::Int64ColumnReader(reader) if is_unsigned => {
                self.rows(reader, |number| Ok(number.cast_unsigned().to_string()))
            }
            ColumnReader::Int64ColumnReader(reader) => self.rows(reader, |number| Ok(number.to_string())),
            _ => Err(ParquetError::General("pages of another type than the column".to_owned()).into()),
        }
    }

    fn rows<D: DataType>(
        &mut self,
        reader: ColumnReaderImpl<D>,
        text: impl Fn(&D::T) -> Result<String, ParquetError>,
    ) -> Result<(), Unusable> {
        let short = || ParquetError::General("fewer values than rows".to_owned()).into();
        read_values(reader, self.leaf.max_def_level(), short, |value| {
            let cell = value.map(&text).transpose()?.unwrap_or_default();
            self.kept += size_of::<String>() + cell.len();
            if self.kept > MAX_TEXT_BYTES {
                let expected = format!("at most {MAX_TEXT_BYTES} bytes of texts expected");
                return Err(Unusable { expected, got: "more".to_owned() });
            }
            self.texts.push(cell);
            Ok(())
        })
    }
}

/// Whether bytes are a table in which texts are found.
pub(crate) fn reads_texts(bytes: &[u8]) -> bool {
    read(bytes.to_vec(), ["path", "category", "sequence"]).is_ok()
}
