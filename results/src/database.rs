//! The database of an artefact: the summaries of reference clouds as one Parquet file, read on the calling thread.

use std::fs;
use std::path::Path;

use blake3::Hash;
use polars::prelude::ParallelStrategy;

use crate::checks::refuse;
use crate::error::Error;
use crate::file::write_whole;
use crate::parquet;
use crate::record::Context;
use crate::table_name::TableName;
use crate::tables::Table;
use crate::tables::database::{DatabaseCloud, DatabaseRow};

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
    /// What they show. The first of equally near clouds counts.
    pub clouds: Vec<DatabaseCloud>,
    /// Their shape.
    pub shape: DatabasePart,
    /// Their colour; no values where the descriptor has no colour.
    pub colour: DatabasePart,
}

impl Database {
    /// A row per cloud. Fails if a part does not hold equally many values for each cloud.
    fn rows(&self) -> Result<Vec<DatabaseRow>, Error> {
        let (height, Self { clouds, shape, colour }) = (self.clouds.len(), self);
        for (name, values) in [
            ("shape_centroid", &shape.centroids),
            ("shape_deviation", &shape.deviations),
            ("colour_centroid", &colour.centroids),
            ("colour_deviation", &colour.deviations),
        ] {
            if !values.len().checked_rem(height).map_or(values.is_empty(), |rest| rest == 0) {
                let expected = format!("as many values for each of {height} clouds");
                return Err(refuse(TableName::Database, 0, name, expected, values.len()));
            }
        }
        let list = |values: &[f32], row: usize| {
            let length = values.len() / height;
            values[row * length..][..length].to_vec()
        };
        let row = |(row, cloud): (usize, &DatabaseCloud)| DatabaseRow {
            cloud: cloud.clone(),
            shape_centroid: list(&shape.centroids, row),
            shape_deviation: list(&shape.deviations, row),
            colour_centroid: list(&colour.centroids, row),
            colour_deviation: list(&colour.deviations, row),
        };
        Ok(clouds.iter().enumerate().map(row).collect())
    }
}

/// Adds a cloud's values to those of the clouds before it; `Err` says what is wrong with them.
fn append(values: &mut Vec<f32>, list: &[f32], clouds: usize, name: &str) -> Result<(), String> {
    let length = values.len().checked_div(clouds).unwrap_or(list.len());
    if list.len() != length {
        return Err(format!("its lists {name} must be of one length, got {length} and {}", list.len()));
    }
    if let Some(value) = list.iter().find(|value| !value.is_finite()) {
        return Err(format!("its lists {name} must hold finite numbers, got {value}"));
    }
    values.extend_from_slice(list);
    Ok(())
}

/// Writes the file whole or not at all, over a former one if there is one. Returns BLAKE3 of its bytes.
///
/// # Errors
/// If a part does not hold equally many values for each cloud, or if the file cannot be written.
pub fn write_database(file: impl AsRef<Path>, database: &Database) -> Result<Hash, Error> {
    let file = file.as_ref();
    let table = Table::new(TableName::Database, &[])?.filled(&database.rows()?, Context::default())?;
    let bytes = parquet::encode(&table.table, table.frame, file)?;
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
    // A program that recognises one cloud would wait longer for threads than they save.
    let content = parquet::decode_with(ParallelStrategy::None, bytes, TableName::Database, file)?;
    let mut database = Database::default();
    for (clouds, row) in content.rows::<DatabaseRow>()?.into_iter().enumerate() {
        let Database { shape, colour, .. } = &mut database;
        for (values, list, name) in [
            (&mut shape.centroids, &row.shape_centroid, "shape_centroid"),
            (&mut shape.deviations, &row.shape_deviation, "shape_deviation"),
            (&mut colour.centroids, &row.colour_centroid, "colour_centroid"),
            (&mut colour.deviations, &row.colour_deviation, "colour_deviation"),
        ] {
            append(values, list, clouds, name)
                .map_err(|what| Error::Damaged { file: file.to_owned(), what })?;
        }
        database.clouds.push(row.cloud);
    }
    Ok((database, digest))
}
