//! Vectors and distances that another program has computed of a run's clouds, in a Parquet file of any writer.
//!
//! Nothing vouches for such a file: sizes are checked before anything is decoded, a few rows at a time are decoded on the
//! calling thread, and a panic of the decoder is an error like any other.

use std::collections::HashMap;
use std::fs;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use polars::prelude::{
    DataFrame, DataType, IntoColumn, ListChunked, NamedFrom, ParallelStrategy, PlSmallStr, PolarsResult,
    Schema, SchemaExt, SerReader, Series, StringChunked,
};
use polars_io::parquet::metadata::FileMetadataRef;
use polars_io::parquet::read::ParquetReader;
use polars_io::parquet::write::ParquetWriter;

use crate::error::Error;
use crate::file::write_whole;
use crate::record::{Context, Value};

/// Bytes of a file at most.
const MAX_BYTES: u64 = 1 << 30;
/// Numbers that are kept of a file at most: 1 GiB of them.
const MAX_NUMBERS: usize = 1 << 27;
/// Numbers and texts that are decoded at a time, about.
const AT_A_TIME: usize = 1 << 22;

/// The clouds that a file must say something about.
pub struct ForeignClouds<'a> {
    /// Paths of the queries.
    pub queries: &'a [&'a str],
    /// Paths of the database.
    pub database: &'a [&'a str],
    /// Whether another path is that of a cloud of the data set: what a file says of those is passed over.
    pub is_known: &'a dyn Fn(&str) -> bool,
}

/// What a file says.
#[derive(Clone, Debug, PartialEq)]
pub struct Foreign {
    /// BLAKE3 of its bytes, hexadecimal.
    pub digest: String,
    /// Its numbers.
    pub values: ForeignValues,
}

/// The numbers of a file.
#[derive(Clone, Debug, PartialEq)]
pub enum ForeignValues {
    /// A vector a cloud.
    Vectors {
        /// Values of each.
        length: usize,
        /// Those of the queries, then those of the database, cloud after cloud.
        values: Vec<f64>,
    },
    /// A distance a pair of clouds.
    Distances {
        /// Of each query those to the database.
        to_database: Vec<f64>,
        /// Those among the clouds of the database.
        among: Among,
    },
}

/// Distances among the clouds of a database.
#[derive(Clone, Debug, PartialEq)]
pub enum Among {
    /// The file has none of them.
    Nothing,
    /// The file has some of them only.
    Some {
        /// How many pairs are missing.
        missing: usize,
        /// The first of these.
        first: [String; 2],
    },
    /// Of each cloud those to all: of a pair the mean of both orders if both are given, 0 of a cloud to itself if that is
    /// not given.
    All(Vec<f64>),
}

/// Why a file cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {what}\n{advice}", .file.display())]
pub struct ForeignError {
    file: PathBuf,
    what: String,
    advice: String,
}

/// Reads a file with columns `cloud` and `values`, or `query`, `cloud` (or `database`) and `distance`; others are passed
/// over. Memory is that of the file and of the numbers that are kept.
///
/// # Errors
/// If it is no such file, or does not say one thing about each cloud or pair.
pub fn read_foreign(file: &Path, clouds: &ForeignClouds<'_>) -> Result<Foreign, ForeignError> {
    let source = Source::open(file)?;
    let digest = blake3::hash(&source.bytes).to_hex().to_string();
    let has = |name: &str| source.schema.contains(name);
    let places = Places::new(clouds);
    let values = match (has("values"), has("distance")) {
        (true, false) => source.vectors(&places)?,
        (false, true) => source.distances(&places)?,
        _ => {
            let names: Vec<&str> = source.schema.iter_names().map(PlSmallStr::as_str).take(20).collect();
            let what =
                format!("must have either a column values or a column distance, got {}", names.join(", "));
            return Err(source.refuse(
                what,
                "write one row a cloud with columns cloud and values, or one row a pair of clouds with columns query, cloud \
                 and distance",
            ));
        }
    };
    Ok(Foreign { digest, values })
}

/// Writes what [`read_foreign`] reads: vectors of clouds, by their paths, for programs that have their own descriptor.
///
/// # Errors
/// If the file cannot be written.
pub fn write_vectors(file: &Path, vectors: &[(&str, Vec<f32>)]) -> Result<(), Error> {
    let paths: Vec<&str> = vectors.iter().map(|(cloud, _)| *cloud).collect();
    let lists: Vec<Option<&Vec<f32>>> = vectors.iter().map(|(_, values)| Some(values)).collect();
    let mut columns = vec![Series::new("cloud".into(), paths).into_column()];
    columns.extend(Vec::<f32>::cells("values", &Context::default(), &lists)?);
    write(file, DataFrame::new(vectors.len(), columns)?)
}

/// The same of distances: query, cloud and how far they are apart.
///
/// # Errors
/// If the file cannot be written.
pub fn write_distances(file: &Path, distances: &[(&str, &str, f64)]) -> Result<(), Error> {
    let queries: Vec<&str> = distances.iter().map(|row| row.0).collect();
    let clouds: Vec<&str> = distances.iter().map(|row| row.1).collect();
    let values: Vec<f64> = distances.iter().map(|row| row.2).collect();
    let columns = vec![
        Series::new("query".into(), queries).into_column(),
        Series::new("cloud".into(), clouds).into_column(),
        Series::new("distance".into(), values).into_column(),
    ];
    write(file, DataFrame::new(distances.len(), columns)?)
}

fn write(file: &Path, mut frame: DataFrame) -> Result<(), Error> {
    let mut bytes = Vec::new();
    ParquetWriter::new(&mut bytes).finish(&mut frame)?;
    write_whole(file, &bytes)
}

/// A cloud that a file must say something about.
#[derive(Clone, Copy)]
enum Place {
    Query(usize),
    Database(usize),
}

struct Places<'a> {
    clouds: &'a ForeignClouds<'a>,
    of: HashMap<&'a str, Place>,
}

impl<'a> Places<'a> {
    fn new(clouds: &'a ForeignClouds<'a>) -> Self {
        let queries = clouds.queries.iter().enumerate().map(|(index, &path)| (path, Place::Query(index)));
        let database =
            clouds.database.iter().enumerate().map(|(index, &path)| (path, Place::Database(index)));
        Self { clouds, of: queries.chain(database).collect() }
    }
}

/// A file whose metadata are sound.
struct Source<'a> {
    file: &'a Path,
    bytes: Vec<u8>,
    metadata: FileMetadataRef,
    schema: Schema,
}

impl<'a> Source<'a> {
    fn open(file: &'a Path) -> Result<Self, ForeignError> {
        let refuse = |what: String, advice: &str| ForeignError {
            file: file.to_owned(),
            what,
            advice: advice.to_owned(),
        };
        let unreadable = |error: std::io::Error| {
            refuse(
                format!("cannot be read, got: {error}"),
                "name a Parquet file: --foreign NAME=FILE.parquet",
            )
        };
        let found = fs::metadata(file).map_err(unreadable)?;
        if !found.is_file() {
            return Err(refuse(
                "must be a file, got something else".to_owned(),
                "name a Parquet file: --foreign NAME=FILE.parquet",
            ));
        }
        if found.len() > MAX_BYTES {
            let what = format!("must have at most {MAX_BYTES} bytes, got {}", found.len());
            return Err(refuse(what, "leave out clouds that the run does not use, or write f32"));
        }
        let bytes = fs::read(file).map_err(unreadable)?;
        let metadata = guarded(|| ParquetReader::new(Cursor::new(&bytes)).get_metadata().cloned());
        let metadata = metadata.and_then(|metadata| {
            let mut metadata = (*metadata).clone();
            // Without what Arrow says of types, lists of a fixed size are lists, and texts of any kind are texts.
            metadata.key_value_metadata = None;
            let metadata = Arc::new(metadata);
            let schema = guarded(|| {
                let mut reader = ParquetReader::new(Cursor::new(&bytes));
                reader.set_metadata(Arc::clone(&metadata));
                Ok(Schema::from_arrow_schema(&*reader.schema()?))
            })?;
            Ok((metadata, schema))
        });
        let (metadata, schema) = metadata.map_err(|got| {
            refuse(format!("must be a Parquet file, got: {got}"), "write it with polars, pandas or pyarrow")
        })?;
        Ok(Self { file, bytes, metadata, schema })
    }

    fn refuse(&self, what: impl Into<String>, advice: &str) -> ForeignError {
        ForeignError { file: self.file.to_owned(), what: what.into(), advice: advice.to_owned() }
    }

    fn refuse_row(&self, row: usize, what: impl Into<String>, advice: &str) -> ForeignError {
        self.refuse(format!("row {row} (from 0): {}", what.into()), advice)
    }

    /// Refuses a column of another type.
    fn expect(
        &self,
        column: &str,
        is_right: fn(&DataType) -> bool,
        expected: &str,
    ) -> Result<(), ForeignError> {
        match self.schema.get(column) {
            Some(got) if is_right(got) => Ok(()),
            Some(got) => Err(self.refuse(
                format!("column {column}: must be {expected}, got {got}"),
                "convert it before you write the file",
            )),
            None => {
                let what = format!("column {column}: must be there and be {expected}, got none");
                Err(self.refuse(what, "write it, too"))
            }
        }
    }

    /// Decodes these columns, a few rows at a time, and calls `each` with the first row's number and the rows.
    fn rows(
        &self,
        columns: &[&str],
        mut each: impl FnMut(usize, &DataFrame) -> Result<(), ForeignError>,
    ) -> Result<(), ForeignError> {
        let chunks = self.metadata.row_groups.iter().flat_map(|group| group.parquet_columns());
        let is_wanted = |name: &str| columns.contains(&name);
        let cells: i64 = chunks
            .filter(|chunk| {
                is_wanted(chunk.descriptor().path_in_schema.first().map_or("", PlSmallStr::as_str))
            })
            .map(|chunk| chunk.num_values().max(0))
            .fold(0, i64::saturating_add);
        let (cells, rows) = (usize::try_from(cells).unwrap_or(usize::MAX), self.metadata.num_rows);
        if cells > 4 * MAX_NUMBERS {
            let what = format!("must have at most {} values, got {cells}", 4 * MAX_NUMBERS);
            return Err(self.refuse(what, "leave out clouds that the run does not use"));
        }
        let step = (AT_A_TIME / (cells / rows.max(1)).max(1)).max(1);
        let wanted = self.schema.iter_names().enumerate().filter(|(_, name)| is_wanted(name));
        let wanted: Vec<usize> = wanted.map(|(index, _)| index).collect();
        for first in (0..rows).step_by(step) {
            let frame = guarded(|| {
                let mut reader = ParquetReader::new(Cursor::new(self.bytes.as_slice()))
                    .read_parallel(ParallelStrategy::None)
                    .with_slice(Some((first, step.min(rows - first))))
                    .with_projection(Some(wanted.clone()));
                reader.set_metadata(Arc::clone(&self.metadata));
                reader.finish()
            });
            let frame = frame.map_err(|got| {
                let what = format!("rows from {first} (from 0): cannot be decoded, got: {got}");
                self.refuse(what, "write the file again")
            })?;
            each(first, &frame)?;
        }
        Ok(())
    }

    /// The place of a cloud; `None` of one that the run does not use.
    fn place(
        &self,
        places: &Places<'_>,
        row: usize,
        column: &str,
        path: Option<&str>,
    ) -> Result<Option<Place>, ForeignError> {
        let Some(path) = path else {
            return Err(self.refuse_row(
                row,
                format!("{column} must be a path, got null"),
                "leave the row out",
            ));
        };
        match places.of.get(path) {
            Some(place) => Ok(Some(*place)),
            None if (places.clouds.is_known)(path) => Ok(None),
            None => Err(self.refuse_row(
                row,
                format!("{column} must be a cloud of the data set, got {path:?}"),
                "write paths relative to the root of the data set, as column cloud of table answers has them, or leave the \
                 row out",
            )),
        }
    }

    fn vectors(&self, places: &Places<'_>) -> Result<ForeignValues, ForeignError> {
        self.expect("cloud", DataType::is_string, "text")?;
        let is_list = |got: &DataType| matches!(got, DataType::List(of) if of.is_float());
        self.expect("values", is_list, "lists of f32 or f64")?;
        let ForeignClouds { queries, database, .. } = *places.clouds;
        let clouds = queries.len() + database.len();
        let (mut length, mut values, mut seen) = (None, Vec::new(), vec![false; clouds]);
        self.rows(&["cloud", "values"], |first, frame| {
            let (paths, lists) = (text(frame, "cloud"), list(frame, "values"));
            let (paths, lists) = paths.zip(lists).ok_or_else(|| self.other_types())?;
            for at in 0..frame.height() {
                let row = first + at;
                let path = paths.get(at);
                let name = path.unwrap_or_default();
                let place = self.place(places, row, "cloud", path)?;
                let of_row = lists.get_as_series(at).and_then(|list| numbers(&list));
                let Some(of_row) = of_row else {
                    let what = format!("values of {name} must be a list, got null");
                    return Err(self.refuse_row(row, what, "write numbers, or leave the row out"));
                };
                let expected = *length.get_or_insert(of_row.len());
                if of_row.is_empty() {
                    let what = format!("values of {name} must be some, got an empty list");
                    return Err(self.refuse_row(row, what, "write numbers, or leave the row out"));
                }
                if of_row.len() != expected {
                    let what =
                        format!("values of {name} must be {expected} as in row 0, got {}", of_row.len());
                    return Err(self.refuse_row(row, what, "write as many for each cloud"));
                }
                if let Some((which, got)) = first_fault(&of_row) {
                    let what = format!("value {which} of {name} must be a finite number, got {got}");
                    return Err(self.refuse_row(row, what, "find out why, and write numbers"));
                }
                let index = match place {
                    Some(Place::Query(index)) => index,
                    Some(Place::Database(index)) => queries.len() + index,
                    None => continue,
                };
                if std::mem::replace(&mut seen[index], true) {
                    let what = format!("cloud must have one row, got another of {name}");
                    return Err(self.refuse_row(row, what, "leave one of them out"));
                }
                if values.is_empty() {
                    let wanted = clouds.saturating_mul(expected);
                    if wanted > MAX_NUMBERS {
                        let what =
                            format!("must be at most {MAX_NUMBERS} values of all clouds, got {wanted}");
                        return Err(self.refuse(what, "reduce the vectors, or write distances instead"));
                    }
                    values.resize(wanted, 0.0);
                }
                for (to, value) in values[index * expected..].iter_mut().zip(of_row) {
                    *to = value.unwrap_or_default();
                }
            }
            Ok(())
        })?;
        let mut missing = (0..clouds).filter(|&index| !seen[index]);
        if let Some(first) = missing.next() {
            let (first, more) = (queries.iter().chain(database).nth(first), missing.count());
            let what = format!(
                "must have a row for each of the {clouds} test and database clouds, got none for {}, the first of {}",
                first.unwrap_or(&""),
                more + 1
            );
            return Err(self.refuse(what, "write the rows that are missing"));
        }
        Ok(ForeignValues::Vectors { length: length.unwrap_or_default(), values })
    }

    fn distances(&self, places: &Places<'_>) -> Result<ForeignValues, ForeignError> {
        let other = match (self.schema.contains("cloud"), self.schema.contains("database")) {
            (_, false) => "cloud",
            (false, true) => "database",
            (true, true) => {
                let what = "must have one of the columns cloud and database, got both";
                return Err(self.refuse(what, "leave one of them out"));
            }
        };
        self.expect("query", DataType::is_string, "text")?;
        self.expect(other, DataType::is_string, "text")?;
        self.expect("distance", DataType::is_float, "f32 or f64")?;
        let ForeignClouds { queries, database, .. } = *places.clouds;
        let columns = database.len();
        let too_many = |got: usize, what: &str, advice| {
            self.refuse(format!("must be at most {MAX_NUMBERS} distances {what}, got {got}"), advice)
        };
        let pairs = queries.len().saturating_mul(columns);
        if pairs > MAX_NUMBERS {
            return Err(too_many(pairs, "of queries to the database", "write vectors instead"));
        }
        let (mut to_database, mut among) = (vec![f64::NAN; pairs], Vec::new());
        self.rows(&["query", other, "distance"], |first, frame| {
            let texts = text(frame, "query").zip(text(frame, other));
            let distances =
                frame.column("distance").ok().and_then(|column| numbers(column.as_materialized_series()));
            let ((from, to), distances) = texts.zip(distances).ok_or_else(|| self.other_types())?;
            for (at, distance) in distances.into_iter().enumerate() {
                let row = first + at;
                let (query, cloud) = (from.get(at), to.get(at));
                let places =
                    (self.place(places, row, "query", query)?, self.place(places, row, other, cloud)?);
                let named = || format!("{} and {}", query.unwrap_or_default(), cloud.unwrap_or_default());
                let distance = match distance {
                    Some(distance) if distance.is_finite() && distance >= 0.0 => distance,
                    got => {
                        let got = got.map_or_else(|| "null".to_owned(), |got| got.to_string());
                        let what = format!(
                            "distance of {} must be a finite number that is not negative, got {got}",
                            named()
                        );
                        return Err(self.refuse_row(
                            row,
                            what,
                            "write another, 0 for what is below it by rounding",
                        ));
                    }
                };
                let cell = match places {
                    (Some(Place::Query(query)), Some(Place::Database(cloud))) => {
                        &mut to_database[query * columns + cloud]
                    }
                    (Some(Place::Database(one)), Some(Place::Database(cloud))) => {
                        if among.is_empty() {
                            let all = columns.saturating_mul(columns);
                            if all > MAX_NUMBERS {
                                let advice = "leave them out, or write vectors instead";
                                return Err(too_many(all, "among the clouds of the database", advice));
                            }
                            among.resize(all, f64::NAN);
                        }
                        &mut among[one * columns + cloud]
                    }
                    _ => continue,
                };
                if !cell.is_nan() {
                    let what = format!("a pair must have one row, got another of {}", named());
                    return Err(self.refuse_row(row, what, "leave one of them out"));
                }
                *cell = distance;
            }
            Ok(())
        })?;
        let mut missing = to_database.iter().enumerate().filter(|(_, distance)| distance.is_nan());
        if let Some((first, _)) = missing.next() {
            let what = format!(
                "must have a row for each of the {pairs} pairs of a test and a database cloud, got none for query {} and \
                 {other} {}, the first of {}",
                queries[first / columns],
                database[first % columns],
                missing.count() + 1
            );
            return Err(self.refuse(what, "write the rows that are missing"));
        }
        Ok(ForeignValues::Distances { to_database, among: symmetric(among, database) })
    }

    fn other_types(&self) -> ForeignError {
        self.refuse("columns are of other types than its metadata say", "write the file again")
    }
}

/// What [`Among`] says, from the distances of ordered pairs, NaN where there is none.
fn symmetric(mut among: Vec<f64>, database: &[&str]) -> Among {
    if among.is_empty() {
        return Among::Nothing;
    }
    let columns = database.len();
    let (mut missing, mut first) = (0, None);
    for one in 0..columns {
        let own = &mut among[one * columns + one];
        if own.is_nan() {
            *own = 0.0;
        }
        for other in one + 1..columns {
            let places = [one * columns + other, other * columns + one];
            let given = places.map(|place| among[place]);
            let distance = match given.map(f64::is_nan) {
                [false, false] => 0.5 * (given[0] + given[1]),
                [false, true] => given[0],
                [true, false] => given[1],
                [true, true] => {
                    missing += 1;
                    first.get_or_insert([one, other]);
                    continue;
                }
            };
            places.into_iter().for_each(|place| among[place] = distance);
        }
    }
    match first {
        Some(first) => Among::Some { missing, first: first.map(|cloud| database[cloud].to_owned()) },
        None => Among::All(among),
    }
}

/// The first value that is no finite number, and what it is.
fn first_fault(values: &[Option<f64>]) -> Option<(usize, String)> {
    let fault = |value: &Option<f64>| match value {
        Some(value) if value.is_finite() => None,
        Some(value) => Some(value.to_string()),
        None => Some("null".to_owned()),
    };
    values.iter().enumerate().find_map(|(index, value)| Some((index, fault(value)?)))
}

fn text<'a>(frame: &'a DataFrame, column: &str) -> Option<&'a StringChunked> {
    frame.column(column).ok()?.str().ok()
}

fn list<'a>(frame: &'a DataFrame, column: &str) -> Option<&'a ListChunked> {
    frame.column(column).ok()?.list().ok()
}

/// Numbers of either width, which f64 holds exactly.
fn numbers(series: &Series) -> Option<Vec<Option<f64>>> {
    match series.dtype() {
        DataType::Float64 => Some(series.f64().ok()?.iter().collect()),
        DataType::Float32 => Some(series.f32().ok()?.iter().map(|value| value.map(f64::from)).collect()),
        _ => None,
    }
}

/// What polars makes of bytes that nobody vouches for, or why it makes nothing of them.
fn guarded<T>(decode: impl FnOnce() -> PolarsResult<T>) -> Result<T, String> {
    match catch_unwind(AssertUnwindSafe(decode)) {
        Ok(decoded) => {
            decoded.map_err(|error| error.to_string().lines().next().unwrap_or_default().to_owned())
        }
        Err(_) => Err("bytes that the decoder stopped at".to_owned()),
    }
}
