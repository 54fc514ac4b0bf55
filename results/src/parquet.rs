//! One table file as bytes: Parquet with the columns described in its metadata, under a checksum of all bytes, which is
//! checked before anything is decoded: the decoder may panic or allocate without bound on a damaged file.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use artefact::metadata::{
    BLANK, CHECKSUM_KEY, COLUMNS_KEY, MetadataError, SCHEMA_VERSION, TABLE_KEY, VERSION_KEY, check,
    check_version, seal,
};
use polars::prelude::{DataFrame, PlSmallStr, PolarsError, SerReader};
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
    metadata.push((CHECKSUM_KEY.to_owned(), BLANK.to_owned()));
    let mut bytes = Vec::new();
    ParquetWriter::new(&mut bytes)
        .with_compression(ParquetCompression::Zstd(None))
        .with_key_value_metadata(Some(KeyValueMetadata::from_static(metadata)))
        .finish(frame)?;
    seal(&mut bytes).map_err(|error| metadata_error(file, error))?;
    Ok(bytes)
}

/// Why the metadata of this file cannot be believed.
fn metadata_error(file: &Path, error: MetadataError) -> Error {
    let file = file.to_owned();
    match error {
        MetadataError::Damaged(what) => Error::Damaged { file, what },
        MetadataError::Missing(key) => Error::Foreign { file, key },
        MetadataError::Newer(got) => Error::Newer { file, got, supported: SCHEMA_VERSION },
    }
}

/// Reads a file of table `expected`. `file` names it in errors.
pub(crate) fn decode(bytes: Vec<u8>, expected: TableName, file: &Path) -> Result<TableFile, Error> {
    let verified = VerifiedFile::open(bytes, expected, file)?;
    let frame = verified.frame(None)?;
    Ok(TableFile { table: verified.table, frame })
}

/// A file whose checksum and metadata have been checked; its columns can be decoded one by one.
#[derive(Debug)]
pub(crate) struct VerifiedFile {
    bytes: Vec<u8>,
    metadata: FileMetadataRef,
    /// Its table, with the genes that the file has.
    pub table: Table,
    /// Names it in errors.
    pub file: PathBuf,
}

impl VerifiedFile {
    /// Verifies the checksum, then reads the metadata, which must name the expected table.
    pub(crate) fn open(mut bytes: Vec<u8>, expected: TableName, file: &Path) -> Result<Self, Error> {
        let damaged = |what: String| Error::Damaged { file: file.to_owned(), what };
        check(&mut bytes).map_err(|error| metadata_error(file, error))?;

        let mut reader = ParquetReader::new(Cursor::new(&bytes));
        let metadata = reader.get_metadata().map_err(|error| damaged(error.to_string()))?.clone();
        let value = |key: &'static str| {
            let pairs = metadata.key_value_metadata().iter().flatten();
            let value = pairs.filter(|pair| pair.key == key).find_map(|pair| pair.value.as_deref());
            value.ok_or(Error::Foreign { file: file.to_owned(), key })
        };
        check_version(value(VERSION_KEY)?).map_err(|error| metadata_error(file, error))?;
        let got = value(TABLE_KEY)?;
        if got != expected.as_str() {
            let (file, expected, got) = (file.to_owned(), expected.to_string(), got.to_owned());
            return Err(Error::WrongTable { file, expected, got });
        }
        let columns: Vec<Column> = serde_json::from_str(value(COLUMNS_KEY)?)
            .map_err(|error| damaged(format!("its {COLUMNS_KEY} is no list of columns: {error}")))?;
        let prefix = gene_prefix(expected);
        let genes: Vec<GeneColumn> =
            columns.iter().filter_map(|column| GeneColumn::of(column, prefix.as_ref()?)).collect();
        let table = Table::new(expected, &genes)?;
        drop(reader);
        Ok(Self { bytes, metadata, table, file: file.to_owned() })
    }

    fn reader(&self) -> ParquetReader<Cursor<&[u8]>> {
        let mut reader = ParquetReader::new(Cursor::new(self.bytes.as_slice()));
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
