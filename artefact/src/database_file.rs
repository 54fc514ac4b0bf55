//! The file of the database, read: Parquet, without polars and on the calling thread.

use std::fs;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use blake3::Hash;
use bytes::Bytes;
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::schema::types::{ColumnDescPtr, ColumnDescriptor};

use crate::database::{Database, DatabaseCloud, DatabasePart, DatabaseParts, MAX_CHANNELS};
use crate::metadata::{self, MetadataError, SCHEMA_VERSION, TABLE_KEY, VERSION_KEY};
use crate::parquet_column::{BATCH, read_values};

/// Why a database cannot be read. Messages name the file first and say what to do on a second line.
#[derive(Debug, thiserror::Error)]
pub enum DatabaseError {
    /// The file system.
    #[error("{}: cannot read this file, got: {source}\ncheck that it is there and that the disk works", .file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Bytes that are not what was written.
    #[error("{}: file is damaged or was changed: {what}\nrestore it from a copy, or run the experiment again", .file.display())]
    Damaged {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A sound Parquet file of another program.
    #[error("{}: not a results file of descry: no {key} in its metadata\nremove it from the run folder", .file.display())]
    Foreign {
        /// The file.
        file: PathBuf,
        /// What it lacks.
        key: &'static str,
    },
    /// A file of a later version of this program.
    #[error("{}: schema version {got} is newer than this program's {SCHEMA_VERSION}\nupdate this program", .file.display())]
    Newer {
        /// The file.
        file: PathBuf,
        /// Its version.
        got: u32,
    },
    /// Another table.
    #[error("{}: expected table database or channels, got {got:?}\nmove the file back to its folder", .file.display())]
    WrongTable {
        /// The file.
        file: PathBuf,
        /// Its table.
        got: String,
    },
    /// A column that breaks the promise that columns are only added.
    #[error("{}: column {column}: expected {expected}, got {got}\nread it with the program that wrote it", .file.display())]
    Column {
        /// The file.
        file: PathBuf,
        /// Its column.
        column: String,
        /// What it should be.
        expected: String,
        /// What it is.
        got: String,
    },
}

impl DatabaseError {
    /// Whether the file's content is at fault, so that writing it anew would help.
    pub fn is_damage(&self) -> bool {
        !matches!(self, Self::Io { .. } | Self::Newer { .. })
    }
}

/// Most values of one column: the lists of 65 536 clouds, each with 4096 values. A few bytes can claim any number.
const MAX_VALUES: usize = 1 << 28;

/// Most rows: 16 times the clouds whose lists fit. A column that is not there is as many nulls.
const MAX_ROWS: usize = 1 << 20;

const TEXT: &str = "text";
const U32: &str = "u32";
const LIST: &str = "list of f32";

/// Reads the file on this thread alone. Also BLAKE3 of its bytes.
///
/// # Errors
/// If the file cannot be read, is no database, or is damaged.
pub fn read_database(file: impl AsRef<Path>) -> Result<(Database, Hash), DatabaseError> {
    let file = file.as_ref();
    let bytes = read(file)?;
    let digest = blake3::hash(&bytes);
    Ok((decode_database(bytes, file)?, digest))
}

/// The bytes of the file.
///
/// # Errors
/// If it cannot be read, or is no file.
pub(crate) fn read(file: &Path) -> Result<Vec<u8>, DatabaseError> {
    let failed = |source| DatabaseError::Io { file: file.to_owned(), source };
    if !fs::metadata(file).map_err(failed)?.is_file() {
        // Reading a pipe would block.
        return Err(DatabaseError::Damaged { file: file.to_owned(), what: "it is no file".to_owned() });
    }
    fs::read(file).map_err(failed)
}

/// Reads the bytes of such a file, which `file` names in errors. Whoever can write them can write their checksum, too, so a
/// panic of the decoder is an error like any other.
///
/// # Errors
/// As [`read_database`].
pub fn decode_database(bytes: Vec<u8>, file: &Path) -> Result<Database, DatabaseError> {
    catch_unwind(AssertUnwindSafe(|| Table::open(bytes, file)?.database())).unwrap_or_else(|_| {
        let what = "it has bytes that the decoder stopped at".to_owned();
        Err(DatabaseError::Damaged { file: file.to_owned(), what })
    })
}

/// A file whose checksum and metadata have been checked.
struct Table<'a> {
    file: &'a Path,
    reader: SerializedFileReader<Bytes>,
    rows: usize,
    has_channels: bool,
}

impl<'a> Table<'a> {
    fn open(mut bytes: Vec<u8>, file: &'a Path) -> Result<Self, DatabaseError> {
        let wrong = |error: MetadataError| {
            let file = file.to_owned();
            match error {
                MetadataError::Damaged(what) => DatabaseError::Damaged { file, what },
                MetadataError::Missing(key) => DatabaseError::Foreign { file, key },
                MetadataError::Newer(got) => DatabaseError::Newer { file, got },
            }
        };
        metadata::check(&mut bytes).map_err(wrong)?;
        let damaged = |what: String| DatabaseError::Damaged { file: file.to_owned(), what };
        let reader =
            SerializedFileReader::new(Bytes::from(bytes)).map_err(|error| damaged(error.to_string()))?;
        let content = reader.metadata().file_metadata();
        let value = |key: &'static str| {
            let mut pairs = content.key_value_metadata().into_iter().flatten();
            let value = pairs.find(|pair| pair.key == key).and_then(|pair| pair.value.as_deref());
            value.ok_or(DatabaseError::Foreign { file: file.to_owned(), key })
        };
        metadata::check_version(value(VERSION_KEY)?).map_err(wrong)?;
        let has_channels = match value(TABLE_KEY)? {
            "database" => false,
            "channels" => true,
            other => {
                return Err(DatabaseError::WrongTable { file: file.to_owned(), got: other.to_owned() });
            }
        };
        let rows =
            usize::try_from(content.num_rows()).ok().filter(|&rows| rows <= MAX_ROWS).ok_or_else(|| {
                damaged(format!("it must have at most {MAX_ROWS} rows, got {}", content.num_rows()))
            })?;
        Ok(Self { file, reader, rows, has_channels })
    }

    fn damaged(&self, what: impl ToString) -> DatabaseError {
        DatabaseError::Damaged { file: self.file.to_owned(), what: what.to_string() }
    }

    fn mismatch(&self, column: &str, expected: &str, got: String) -> DatabaseError {
        let (file, column, expected) = (self.file.to_owned(), column.to_owned(), expected.to_owned());
        DatabaseError::Column { file, column, expected, got }
    }

    fn database(&self) -> Result<Database, DatabaseError> {
        let required = |column: &str| self.column(column, TEXT, true, Cells::text);
        let [clouds, instances, categories] =
            [required("cloud")?, required("instance")?, required("category")?];
        let sequences = self.column("sequence", TEXT, false, Cells::text)?;
        let additions = self.column("addition", U32, false, Cells::number)?;
        // None of the first three is null.
        let names = clouds.into_iter().flatten().zip(instances.into_iter().flatten());
        let names = names.zip(categories.into_iter().flatten());
        let clouds = names.zip(sequences.into_iter().zip(additions)).map(
            |(((cloud, instance), category), (sequence, addition))| DatabaseCloud {
                cloud,
                instance,
                category,
                sequence,
                addition,
            },
        );
        let clouds = clouds.collect();
        let parts = if self.has_channels {
            DatabaseParts::Channels(self.channels()?)
        } else {
            let part = |name: &str| self.joined(name, self.lists(name, true)?);
            DatabaseParts::ShapeColour([part("shape")?, part("colour")?])
        };
        Ok(Database { clouds, parts })
    }

    /// The first channels, which all clouds have, and no other.
    fn channels(&self) -> Result<Vec<DatabasePart>, DatabaseError> {
        let name = |channel: usize| format!("channel_{}", channel + 1);
        let cells = (0..MAX_CHANNELS)
            .map(|channel| self.lists(&name(channel), false))
            .collect::<Result<Vec<PartLists>, _>>()?;
        let has = |lists: &PartLists, row: usize| lists.iter().all(|lists| lists[row].is_some());
        let channels = cells.iter().filter(|lists| self.rows > 0 && has(lists, 0)).count();
        for row in 0..self.rows {
            if !cells.iter().enumerate().all(|(channel, lists)| has(lists, row) == (channel < channels)) {
                let what = format!("its clouds must all have channels 1 to {channels}, got others");
                return Err(self.damaged(what));
            }
        }
        let parts = cells.into_iter().take(channels).enumerate();
        parts.map(|(channel, lists)| self.joined(&name(channel), lists)).collect()
    }

    /// Centroids and deviations of a part.
    fn lists(&self, name: &str, is_required: bool) -> Result<PartLists, DatabaseError> {
        let lists = |kind: &str| self.column(&format!("{name}_{kind}"), LIST, is_required, Cells::lists);
        Ok([lists("centroid")?, lists("deviation")?])
    }

    /// One cloud after the other.
    fn joined(&self, name: &str, [centroids, deviations]: PartLists) -> Result<DatabasePart, DatabaseError> {
        let join = |lists: Vec<Option<Vec<f32>>>, kind: &str| {
            let lists: Vec<Vec<f32>> = lists.into_iter().flatten().collect();
            let length = lists.first().map_or(0, Vec::len);
            if let Some(other) = lists.iter().find(|list| list.len() != length) {
                let got = other.len();
                return Err(self.damaged(format!(
                    "its lists {name}_{kind} must be of one length, got {length} and {got}"
                )));
            }
            if let Some(value) = lists.iter().flatten().find(|value| !value.is_finite()) {
                let what = format!("its lists {name}_{kind} must hold finite numbers, got {value}");
                return Err(self.damaged(what));
            }
            Ok(lists.concat())
        };
        Ok(DatabasePart {
            centroids: join(centroids, "centroid")?,
            deviations: join(deviations, "deviation")?,
        })
    }

    /// The cells of a column, one a row: all are null where the file is older than the column, none in a column that is
    /// required.
    fn column<T: Clone>(
        &self,
        column: &str,
        kind: &str,
        is_required: bool,
        read: impl Fn(&mut Cells<T>, ColumnReader) -> Result<(), ReadError>,
    ) -> Result<Vec<Option<T>>, DatabaseError> {
        let schema = self.reader.metadata().file_metadata().schema_descr();
        let is_it = |leaf: &ColumnDescPtr| leaf.path().parts().first().is_some_and(|name| name == column);
        let Some(position) = schema.columns().iter().position(is_it) else {
            if is_required {
                return Err(self.mismatch(column, kind, "no such column".to_owned()));
            }
            return Ok(vec![None; self.rows]);
        };
        let leaf = schema.column(position);
        let got = kind_of(&leaf);
        if got != kind {
            return Err(self.mismatch(column, kind, got.to_owned()));
        }
        let mut cells = Cells { leaf, rows: Vec::new(), values: 0 };
        for group in 0..self.reader.num_row_groups() {
            let reader = self.reader.get_row_group(group).and_then(|group| group.get_column_reader(position));
            let reader = reader.map_err(|error| self.damaged(error))?;
            read(&mut cells, reader).map_err(|error| self.damaged(error.0))?;
        }
        let (got, rows) = (cells.rows.len(), self.rows);
        if got != rows {
            return Err(self.damaged(format!("its column {column} has {got} rows instead of {rows}")));
        }
        match cells.rows.iter().filter(|cell| cell.is_none()).count() {
            nulls if is_required && nulls > 0 => {
                Err(self.mismatch(column, "a value in every row", format!("{nulls} nulls")))
            }
            _ => Ok(cells.rows),
        }
    }
}

/// Centroids and deviations, one list a cloud.
type PartLists = [Vec<Option<Vec<f32>>>; 2];

/// What is wrong with a column's pages.
struct ReadError(String);

impl ReadError {
    fn kind() -> Self {
        Self("its pages are not of the column's type".to_owned())
    }
}

impl From<ParquetError> for ReadError {
    fn from(error: ParquetError) -> Self {
        Self(error.to_string())
    }
}

/// What a column holds, in the words of the column table.
fn kind_of(leaf: &ColumnDescriptor) -> &'static str {
    let is_unsigned = matches!(leaf.logical_type_ref(), Some(LogicalType::Integer(integer)) if integer.bit_width == 32 && !integer.is_signed);
    match (leaf.physical_type(), leaf.max_rep_level()) {
        (Physical::BYTE_ARRAY, 0) if matches!(leaf.logical_type_ref(), Some(LogicalType::String)) => TEXT,
        (Physical::INT32, 0) if is_unsigned => U32,
        (Physical::FLOAT, 1) => LIST,
        (Physical::BOOLEAN, 0) => "bool",
        (Physical::INT32 | Physical::INT64, 0) => "another integer",
        (Physical::FLOAT, 0) => "f32",
        (Physical::DOUBLE, 0) => "f64",
        _ => "another type",
    }
}

/// The rows of a column as far as they have been read.
struct Cells<T> {
    leaf: ColumnDescPtr,
    rows: Vec<Option<T>>,
    values: usize,
}

impl<T> Cells<T> {
    /// Counts values; `Err` if a file claims more than any database has.
    fn count(&mut self, levels: usize) -> Result<(), ReadError> {
        self.values += levels;
        if self.values > MAX_VALUES {
            return Err(ReadError(format!("one of its columns has more than {MAX_VALUES} values")));
        }
        Ok(())
    }

    fn scalars<D: DataType>(
        &mut self,
        reader: ColumnReaderImpl<D>,
        value: impl Fn(&D::T) -> Result<T, ParquetError>,
    ) -> Result<(), ReadError> {
        read_values(reader, self.leaf.max_def_level(), ReadError::kind, |cell| {
            self.count(1)?;
            self.rows.push(cell.map(&value).transpose()?);
            Ok(())
        })
    }
}

impl Cells<String> {
    fn text(&mut self, reader: ColumnReader) -> Result<(), ReadError> {
        let ColumnReader::ByteArrayColumnReader(reader) = reader else { return Err(ReadError::kind()) };
        self.scalars(reader, |value| Ok(value.as_utf8()?.to_owned()))
    }
}

impl Cells<u32> {
    fn number(&mut self, reader: ColumnReader) -> Result<(), ReadError> {
        let ColumnReader::Int32ColumnReader(reader) = reader else { return Err(ReadError::kind()) };
        // Parquet keeps unsigned numbers in the bits of signed ones.
        self.scalars(reader, |value| Ok(value.cast_unsigned()))
    }
}

impl Cells<Vec<f32>> {
    /// A list that may be null holds elements that may be.
    fn lists(&mut self, reader: ColumnReader) -> Result<(), ReadError> {
        let ColumnReader::FloatColumnReader(mut reader) = reader else { return Err(ReadError::kind()) };
        let most = self.leaf.max_def_level();
        let element = self.leaf.self_type().get_basic_info();
        let is_optional = element.has_repetition() && element.repetition() == Repetition::OPTIONAL;
        // Levels below that of an element that is there, null or not: of an empty list, and of a null one.
        let there = most - i16::from(is_optional);
        loop {
            let (mut definitions, mut repetitions, mut values) = (Vec::new(), Vec::new(), Vec::new());
            let (rows, ..) =
                reader.read_records(BATCH, Some(&mut definitions), Some(&mut repetitions), &mut values)?;
            if rows == 0 {
                return Ok(());
            }
            self.count(definitions.len())?;
            let mut values = values.into_iter();
            for (definition, repetition) in definitions.into_iter().zip(repetitions) {
                if repetition == 0 {
                    self.rows.push((definition + 1 >= there).then(Vec::new));
                }
                if definition < there {
                    continue;
                }
                // A null inside a list is no finite number either: whoever checks the values finds both.
                let value =
                    if definition == most { values.next().ok_or_else(ReadError::kind)? } else { f32::NAN };
                let Some(Some(list)) = self.rows.last_mut() else { return Err(ReadError::kind()) };
                list.push(value);
            }
        }
    }
}
