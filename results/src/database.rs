//! The database of an artefact: the summaries of reference clouds written as one Parquet file.

use std::path::Path;

use artefact::{Database, DatabaseCloud, DatabasePart, DatabaseParts, MAX_CHANNELS};
use blake3::Hash;

use crate::checks::refuse;
use crate::error::Error;
use crate::file::write_whole;
use crate::parquet;
use crate::record::{Context, Value};
use crate::table_name::TableName;
use crate::tables::database::{ChannelsRow, CloudCells, DatabaseRow, PartCells};
use crate::tables::{Table, TableFile};

/// Writes the file whole or not at all, over a former one if there is one. Returns BLAKE3 of its bytes.
///
/// # Errors
/// If a part does not hold equally many values for each cloud, if there are too many channels, or if the file cannot be
/// written.
pub fn write_database(file: impl AsRef<Path>, database: &Database) -> Result<Hash, Error> {
    let file = file.as_ref();
    let table = table(database)?;
    let bytes = parquet::encode(&table.table, table.frame, file)?;
    write_whole(file, &bytes)?;
    Ok(blake3::hash(&bytes))
}

pub(crate) fn table_name(parts: &DatabaseParts) -> TableName {
    match parts {
        DatabaseParts::ShapeColour(_) => TableName::Database,
        DatabaseParts::Channels(_) => TableName::Channels,
    }
}

/// Fails if a part does not hold equally many values for each cloud, or if there are more parts than columns.
fn check(database: &Database) -> Result<(), Error> {
    let (table, clouds) = (table_name(&database.parts), database.clouds.len());
    let parts = database.parts.as_slice();
    let column = |part: usize| database.parts.name(part);
    if parts.len() > MAX_CHANNELS {
        let expected = format!("at most {MAX_CHANNELS} channels");
        return Err(refuse(table, 0, &column(MAX_CHANNELS), expected, parts.len()));
    }
    for (part, DatabasePart { centroids, deviations }) in parts.iter().enumerate() {
        for (kind, values) in [("centroid", centroids), ("deviation", deviations)] {
            if !values.len().checked_rem(clouds).map_or(values.is_empty(), |rest| rest == 0) {
                let name = format!("{}_{kind}", column(part));
                let expected = format!("as many values for each of {clouds} clouds");
                return Err(refuse(table, 0, &name, expected, values.len()));
            }
        }
    }
    Ok(())
}

/// The table, a row per cloud.
fn table(database: &Database) -> Result<TableFile, Error> {
    check(database)?;
    let clouds = database.clouds.len();
    match &database.parts {
        DatabaseParts::ShapeColour([shape, colour]) => filled(database, |index, cloud| {
            let [shape, colour] = [shape, colour].map(|part| cells(part, index, clouds));
            DatabaseRow {
                cloud,
                shape_centroid: shape.centroid,
                shape_deviation: shape.deviation,
                colour_centroid: colour.centroid,
                colour_deviation: colour.deviation,
            }
        }),
        DatabaseParts::Channels(channels) => filled(database, |index, cloud| {
            ChannelsRow::new(cloud, channels.iter().map(|part| cells(part, index, clouds)))
        }),
    }
}

fn filled<R: Value>(database: &Database, row: impl Fn(usize, CloudCells) -> R) -> Result<TableFile, Error> {
    let clouds = database.clouds.iter().cloned().map(CloudCells::from).enumerate();
    let rows: Vec<R> = clouds.map(|(index, cloud)| row(index, cloud)).collect();
    Table::new(table_name(&database.parts), &[])?.filled(&rows, Context::default())
}

/// The cells of one of so many clouds.
fn cells(part: &DatabasePart, cloud: usize, clouds: usize) -> PartCells {
    let list = |values: &[f32]| {
        let length = values.len() / clouds;
        values[cloud * length..][..length].to_vec()
    };
    PartCells { centroid: list(&part.centroids), deviation: list(&part.deviations) }
}

impl From<DatabaseCloud> for CloudCells {
    fn from(cloud: DatabaseCloud) -> Self {
        let DatabaseCloud { cloud, instance, category, sequence, addition } = cloud;
        Self { cloud, instance, category, sequence, addition }
    }
}
