//! The database of an artefact: the summaries of reference clouds as one Parquet file, read on the calling thread.

use std::fs;
use std::path::Path;

use blake3::Hash;
use polars::prelude::{
    DataFrame, DataType, Float32Type, IntoColumn, IntoSeries, ListBuilderTrait, ListPrimitiveChunkedBuilder,
    ParallelStrategy,
};

use crate::cells::Cells;
use crate::columns::Column;
use crate::columns::ColumnKind::{F32List, Text};
use crate::error::Error;
use crate::file::write_whole;
use crate::frame::{Cell, assemble, cells, refuse};
use crate::parquet;
use crate::tables::{Table, TableName};

/// What a reference cloud shows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DatabaseCloud {
    /// Its path below the data root.
    pub cloud: String,
    /// Its object.
    pub instance: String,
    /// Its category.
    pub category: String,
}

/// One part of the descriptor (shape or colour) of all reference clouds: shares, cloud after cloud, equally many of
/// each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DatabasePart {
    /// Means over the keypoints, bin by bin.
    pub centroids: Vec<f32>,
    /// Standard deviations over the keypoints, bin by bin.
    pub deviations: Vec<f32>,
}

/// The reference clouds of an artefact.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Database {
    /// What they show; of equally near ones the first counts.
    pub clouds: Vec<DatabaseCloud>,
    /// Their shape.
    pub shape: DatabasePart,
    /// Their colour; no values where the descriptor has no colour.
    pub colour: DatabasePart,
}

/// The columns of table `database`.
pub(crate) fn columns() -> Vec<Column> {
    vec![
        Column::new("cloud", Text, "", "path below the data root"),
        Column::new("instance", Text, "", "the cloud's object"),
        Column::new("category", Text, "", "the cloud's category"),
        Column::new(
            "shape_centroid",
            F32List,
            "share",
            "mean of the keypoints' shape histograms: the bins of the disk up to 180 degrees, then those of the ring",
        ),
        Column::new("shape_deviation", F32List, "share", "their standard deviation (N - 1), bin by bin"),
        Column::new(
            "colour_centroid",
            F32List,
            "share",
            "mean of the keypoints' colour histograms: the m x m bins of the disk (hue by hue), then those of the ring; empty without colour",
        ),
        Column::new("colour_deviation", F32List, "share", "their standard deviation (N - 1), bin by bin"),
    ]
}

impl Database {
    /// The lists by column, in the order of the table.
    fn lists(&self) -> [(&'static str, &[f32]); 4] {
        [
            ("shape_centroid", &self.shape.centroids),
            ("shape_deviation", &self.shape.deviations),
            ("colour_centroid", &self.colour.centroids),
            ("colour_deviation", &self.colour.deviations),
        ]
    }
}

pub(crate) fn frame(database: &Database) -> Result<DataFrame, Error> {
    let clouds = &database.clouds;
    let mut columns = vec![
        cells("cloud", clouds.iter().map(|row| row.cloud.as_str())),
        cells("instance", clouds.iter().map(|row| row.instance.as_str())),
        cells("category", clouds.iter().map(|row| row.category.as_str())),
    ];
    for (name, values) in database.lists() {
        let fits = values.len().checked_rem(clouds.len()).map_or(values.is_empty(), |rest| rest == 0);
        if !fits {
            let expected = format!("as many values for each of {} clouds", clouds.len());
            return Err(refuse(TableName::Database, 0, name, expected, values.len()));
        }
        columns.push(lists(name, values, clouds.len()));
    }
    assemble(clouds.len(), columns)
}

/// A column of `rows` lists of equal length.
fn lists(name: &str, values: &[f32], rows: usize) -> Cell {
    let mut lists =
        ListPrimitiveChunkedBuilder::<Float32Type>::new(name.into(), rows, values.len(), DataType::Float32);
    let length = values.len() / rows.max(1);
    for row in 0..rows {
        lists.append_slice(&values[row * length..][..length]);
    }
    lists.finish().into_series().into_column()
}

/// The values of such a column, one list after the other; `Err` says what is wrong.
fn values(frame: &DataFrame, name: &str) -> Result<Result<Vec<f32>, String>, Error> {
    let lists = frame.column(name)?.list()?.rechunk();
    let mut lengths = lists.downcast_iter().flat_map(|lists| lists.offsets().lengths());
    let first = lengths.next().unwrap_or(0);
    if let Some(other) = lengths.find(|&length| length != first) {
        return Ok(Err(format!("its lists {name} must be of one length, got {first} and {other}")));
    }
    let inner = lists.get_inner();
    let values = inner.f32()?;
    if values.null_count() > 0 {
        return Ok(Err(format!("its lists {name} must have no nulls, got {}", values.null_count())));
    }
    Ok(match values.iter().flatten().find(|value| !value.is_finite()) {
        Some(value) => Err(format!("its lists {name} must hold finite numbers, got {value}")),
        None => Ok(values.into_no_null_iter().collect()),
    })
}

/// Writes the file whole or not at all, over a former one if there is one. Returns BLAKE3 of its bytes.
///
/// # Errors
/// If a part does not hold equally many values for each cloud, or if the file cannot be written.
pub fn write_database(file: impl AsRef<Path>, database: &Database) -> Result<Hash, Error> {
    let file = file.as_ref();
    let bytes = parquet::encode(&Table::new(TableName::Database, &[])?, frame(database)?, file)?;
    write_whole(file, &bytes)?;
    Ok(blake3::hash(&bytes))
}

/// Reads the file on this thread alone. Also BLAKE3 of its bytes.
///
/// # Errors
/// If the file cannot be read, is no database, or is damaged.
pub fn read_database(file: impl AsRef<Path>) -> Result<(Database, Hash), Error> {
    let file = file.as_ref();
    let bytes = fs::read(file).map_err(|source| Error::io(file, "read this file", source))?;
    let digest = blake3::hash(&bytes);
    // Threads would cost a program that recognises one cloud more than they give.
    let content = parquet::decode_with(ParallelStrategy::None, bytes, TableName::Database, file)?;
    let frame = &content.frame;
    let damaged = |what: String| Error::Damaged { file: file.to_owned(), what };
    let mut clouds = Vec::with_capacity(frame.height());
    for row in 0..frame.height() {
        let cells = Cells { frame, row };
        clouds.push(DatabaseCloud {
            cloud: cells.need("cloud", Cells::text)?,
            instance: cells.need("instance", Cells::text)?,
            category: cells.need("category", Cells::text)?,
        });
    }
    let part = |[centroids, deviations]: [&str; 2]| -> Result<DatabasePart, Error> {
        Ok(DatabasePart {
            centroids: values(frame, centroids)?.map_err(damaged)?,
            deviations: values(frame, deviations)?.map_err(damaged)?,
        })
    };
    let shape = part(["shape_centroid", "shape_deviation"])?;
    let colour = part(["colour_centroid", "colour_deviation"])?;
    Ok((Database { clouds, shape, colour }, digest))
}
