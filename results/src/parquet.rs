//! One table file as bytes: Parquet with the columns described in its metadata, under a checksum of all bytes.
//!
//! The checksum (`descry.checksum`) is BLAKE3 over the whole file with the checksum's own 64 digits read as zeros.
//! It is checked before anything is decoded: the Parquet decoder trusts lengths that it reads and may panic or
//! allocate without bound on a damaged file, and a flipped bit in a value would not be noticed at all.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use polars::prelude::{DataFrame, ParallelStrategy, PlSmallStr, PolarsError, SerReader};
#[cfg(feature = "sql")]
use polars::prelude::{Field, Schema, SchemaExt};
use polars_io::parquet::metadata::FileMetadataRef;
use polars_io::parquet::read::ParquetReader;
use polars_io::parquet::write::{KeyValueMetadata, ParquetCompression, ParquetWriter};

use crate::columns::{Column, GeneColumn};
use crate::conform::{Mismatch, conform};
use crate::error::Error;
use crate::table_name::TableName;
use crate::tables::{Table, TableFile, gene_prefix};

/// Version of the column table. Readers accept this and earlier ones.
pub const SCHEMA_VERSION: u32 = 1;

const VERSION_KEY: &str = "descry.schema_version";
const TABLE_KEY: &str = "descry.table";
const COLUMNS_KEY: &str = "descry.columns";
const CHECKSUM_KEY: &str = "descry.checksum";

const MAGIC: &[u8] = b"PAR1";
const DIGITS: usize = 64;
const BLANK: [u8; DIGITS] = [b'0'; DIGITS];

/// The file that holds `frame`, which must be of that table. `file` names it in errors.
pub(crate) fn encode(table: &Table, frame: DataFrame, file: &Path) -> Result<Vec<u8>, Error> {
    let mut frame = conform(table, frame)?.map_err(|mismatch| column_error(file, mismatch))?;
    let columns = serde_json::to_string(&table.columns).map_err(|error| Error::Damaged {
        file: file.to_owned(),
        what: format!("cannot describe its columns: {error}"),
    })?;
    encode_with(
        &mut frame,
        vec![
            (VERSION_KEY.to_owned(), SCHEMA_VERSION.to_string()),
            (TABLE_KEY.to_owned(), table.name.to_string()),
            (COLUMNS_KEY.to_owned(), columns),
        ],
        file,
    )
}

/// Any frame under any metadata, with its checksum.
pub(crate) fn encode_with(
    frame: &mut DataFrame,
    mut metadata: Vec<(String, String)>,
    file: &Path,
) -> Result<Vec<u8>, Error> {
    metadata.push((CHECKSUM_KEY.to_owned(), String::from_utf8_lossy(&BLANK).into_owned()));
    let mut bytes = Vec::new();
    ParquetWriter::new(&mut bytes)
        .with_compression(ParquetCompression::Zstd(None))
        .with_key_value_metadata(Some(KeyValueMetadata::from_static(metadata)))
        .finish(frame)?;
    let at = checksum_position(&bytes, file)?;
    let checksum = blake3::hash(&bytes).to_hex();
    bytes[at..at + DIGITS].copy_from_slice(checksum.as_bytes());
    Ok(bytes)
}

/// Position of the checksum's digits. Thrift writes a text after its field header (0x18) and length, and the
/// metadata follows everything else of the footer that could repeat the key.
fn checksum_position(bytes: &[u8], file: &Path) -> Result<usize, Error> {
    let damaged = |what: &str| Error::Damaged { file: file.to_owned(), what: what.to_owned() };
    let Some(body) = bytes.strip_suffix(MAGIC).filter(|body| body.starts_with(MAGIC)) else {
        return Err(damaged("it does not begin and end as Parquet does"));
    };
    let footer = body.split_last_chunk().and_then(|(body, length)| {
        let start = body.len().checked_sub(u32::from_le_bytes(*length) as usize)?;
        Some((start, &body[start..]))
    });
    let Some((start, footer)) = footer else {
        return Err(damaged("its footer is longer than the file"));
    };
    let needle = [CHECKSUM_KEY.as_bytes(), &[0x18, DIGITS as u8]].concat();
    let at = footer.windows(needle.len()).rposition(|window| window == needle);
    let at = at.map(|at| start + at + needle.len()).filter(|at| at + DIGITS <= start + footer.len());
    at.ok_or(Error::Foreign { file: file.to_owned(), key: CHECKSUM_KEY })
}

/// Reads a file of table `expected` with polars' threads. `file` names it in errors.
pub(crate) fn decode(bytes: Vec<u8>, expected: TableName, file: &Path) -> Result<TableFile, Error> {
    decode_with(ParallelStrategy::Auto, bytes, &[expected], file)
}

/// As [`decode`], of one of several tables and on as many threads as the strategy takes.
pub(crate) fn decode_with(
    threads: ParallelStrategy,
    bytes: Vec<u8>,
    expected: &[TableName],
    file: &Path,
) -> Result<TableFile, Error> {
    let mut verified = VerifiedFile::open(bytes, expected, file)?;
    verified.threads = threads;
    let frame = verified.frame(None)?;
    Ok(TableFile { table: verified.table, frame })
}

/// A file whose checksum and metadata have been checked; its columns can be decoded one by one.
#[derive(Debug)]
pub(crate) struct VerifiedFile {
    bytes: Vec<u8>,
    metadata: FileMetadataRef,
    threads: ParallelStrategy,
    /// Its table, with the genes that the file has.
    pub table: Table,
    /// Names it in errors.
    pub file: PathBuf,
}

impl VerifiedFile {
    /// Verifies the checksum, then reads the metadata, which must name one of the expected tables.
    pub(crate) fn open(mut bytes: Vec<u8>, expected: &[TableName], file: &Path) -> Result<Self, Error> {
        let damaged = |what: String| Error::Damaged { file: file.to_owned(), what };
        let at = checksum_position(&bytes, file)?;
        let recorded = bytes[at..at + DIGITS].to_vec();
        bytes[at..at + DIGITS].copy_from_slice(&BLANK);
        if blake3::hash(&bytes).to_hex().as_bytes() != recorded {
            return Err(damaged("its checksum is not that of its content".to_owned()));
        }

        let mut reader = ParquetReader::new(Cursor::new(&bytes));
        let metadata = reader.get_metadata().map_err(|error| damaged(error.to_string()))?.clone();
        let value = |key: &'static str| {
            let pairs = metadata.key_value_metadata().iter().flatten();
            let value = pairs.filter(|pair| pair.key == key).find_map(|pair| pair.value.as_deref());
            value.ok_or(Error::Foreign { file: file.to_owned(), key })
        };
        match value(VERSION_KEY)?.parse::<u32>() {
            Ok(version) if (1..=SCHEMA_VERSION).contains(&version) => {}
            Ok(got) if got > SCHEMA_VERSION => {
                return Err(Error::Newer { file: file.to_owned(), got, supported: SCHEMA_VERSION });
            }
            _ => return Err(damaged(format!("its {VERSION_KEY} is no version"))),
        }
        let got = value(TABLE_KEY)?;
        let Some(&name) = expected.iter().find(|table| table.as_str() == got) else {
            let expected: Vec<&str> = expected.iter().map(|table| table.as_str()).collect();
            let (file, expected, got) = (file.to_owned(), expected.join(" or "), got.to_owned());
            return Err(Error::WrongTable { file, expected, got });
        };
        let columns: Vec<Column> = serde_json::from_str(value(COLUMNS_KEY)?)
            .map_err(|error| damaged(format!("its {COLUMNS_KEY} is no list of columns: {error}")))?;
        let prefix = gene_prefix(name);
        let genes: Vec<GeneColumn> =
            columns.iter().filter_map(|column| GeneColumn::of(column, prefix.as_ref()?)).collect();
        let table = Table::new(name, &genes)?;
        drop(reader);
        let threads = ParallelStrategy::Auto;
        Ok(Self { bytes, metadata, threads, table, file: file.to_owned() })
    }

    fn reader(&self) -> ParquetReader<Cursor<&[u8]>> {
        let reader = ParquetReader::new(Cursor::new(self.bytes.as_slice()));
        let mut reader = reader.read_parallel(self.threads);
        reader.set_metadata(self.metadata.clone());
        reader
    }

    fn damaged(&self, error: PolarsError) -> Error {
        Error::Damaged { file: self.file.clone(), what: error.to_string() }
    }

    /// Number of rows.
    #[cfg(feature = "sql")]
    pub(crate) fn height(&self) -> usize {
        self.metadata.num_rows
    }

    /// The columns of [`VerifiedFile::frame`], in its order: those of the table, then unknown ones.
    #[cfg(feature = "sql")]
    pub(crate) fn schema(&self) -> Result<Schema, Error> {
        let found = self.reader().schema().map_err(|error| self.damaged(error))?;
        let columns = self.table.columns.iter();
        let mut schema: Schema =
            columns.map(|column| Field::new(column.key(), column.kind.data_type())).collect();
        for (name, data_type) in Schema::from_arrow_schema(&found) {
            if !schema.contains(&name) {
                schema.insert(name, data_type);
            }
        }
        Ok(schema)
    }

    /// The rows: of all columns, or of those among `columns` that there are, in the order of the whole.
    pub(crate) fn frame(&self, columns: Option<&[PlSmallStr]>) -> Result<DataFrame, Error> {
        let wanted = |name: &str| columns.is_none_or(|columns| columns.iter().any(|column| column == name));
        let mut reader = self.reader();
        let found = reader.schema().map_err(|error| self.damaged(error))?;
        let indices = found.iter_names().enumerate().filter(|(_, name)| wanted(name));
        let indices = columns.map(|_| indices.map(|(index, _)| index).collect());
        let frame = reader.with_projection(indices).finish().map_err(|error| self.damaged(error))?;
        let mut table = self.table.clone();
        table.columns.retain(|column| wanted(&column.name));
        conform(&table, frame)?.map_err(|mismatch| column_error(&self.file, mismatch))
    }
}

fn column_error(file: &Path, mismatch: Mismatch) -> Error {
    let Mismatch { column, expected, got } = mismatch;
    Error::Column { file: file.to_owned(), column, expected, got }
}
