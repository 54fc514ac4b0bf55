//! The database of an artefact: the summaries of reference clouds as one Parquet file, read on the calling thread.

use std::path::Path;

use blake3::Hash;
use polars::prelude::ParallelStrategy;

use crate::checks::refuse;
use crate::error::Error;
use crate::file::write_whole;
use crate::parquet;
use crate::read::read_bytes;
use crate::record::{Context, Value};
use crate::table_name::TableName;
use crate::tables::database::{ChannelsRow, DatabaseCloud, DatabaseRow, PartCells};
use crate::tables::{Table, TableFile};

/// One part of the descriptor of all reference clouds: shares, cloud after cloud, equally many of each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DatabasePart {
    /// Means over the rows, value by value.
    pub centroids: Vec<f32>,
    /// Standard deviations over the rows, value by value; none in a part that has one row a cloud.
    pub deviations: Vec<f32>,
}

/// The parts of a descriptor; which they are decides on the table.
#[derive(Clone, Debug, PartialEq)]
pub enum DatabaseParts {
    /// Shape and colour, the latter without values where the descriptor has none: table [`TableName::Database`].
    ShapeColour([DatabasePart; 2]),
    /// Channels, at most eight: table [`TableName::Channels`].
    Channels(Vec<DatabasePart>),
}

/// The reference clouds of an artefact.
#[derive(Clone, Debug, PartialEq)]
pub struct Database {
    /// What they show. The first of equally near clouds counts.
    pub clouds: Vec<DatabaseCloud>,
    /// Their summaries.
    pub parts: DatabaseParts,
}

impl DatabasePart {
    /// The cells of one of so many clouds.
    fn cells(&self, cloud: usize, clouds: usize) -> PartCells {
        let list = |values: &[f32]| {
            let length = values.len() / clouds;
            values[cloud * length..][..length].to_vec()
        };
        PartCells { centroid: list(&self.centroids), deviation: list(&self.deviations) }
    }

    /// Adds a cloud's cells to those of the clouds before it; `Err` says what is wrong with them.
    fn append(&mut self, cells: &PartCells, clouds: usize, name: &str) -> Result<(), String> {
        for (values, list, kind) in [
            (&mut self.centroids, &cells.centroid, "centroid"),
            (&mut self.deviations, &cells.deviation, "deviation"),
        ] {
            let (length, got) = (values.len().checked_div(clouds).unwrap_or(list.len()), list.len());
            if got != length {
                return Err(format!("its lists {name}_{kind} must be of one length, got {length} and {got}"));
            }
            if let Some(value) = list.iter().find(|value| !value.is_finite()) {
                return Err(format!("its lists {name}_{kind} must hold finite numbers, got {value}"));
            }
            values.extend_from_slice(list);
        }
        Ok(())
    }
}

impl DatabaseParts {
    pub(crate) fn table(&self) -> TableName {
        match self {
            Self::ShapeColour(_) => TableName::Database,
            Self::Channels(_) => TableName::Channels,
        }
    }

    fn as_slice(&self) -> &[DatabasePart] {
        match self {
            Self::ShapeColour(parts) => parts,
            Self::Channels(channels) => channels,
        }
    }
}

/// What the columns of a part begin with.
fn part_name(table: TableName, part: usize) -> String {
    match (table, part) {
        (TableName::Channels, _) => format!("channel_{}", part + 1),
        (_, 0) => "shape".to_owned(),
        (..) => "colour".to_owned(),
    }
}

impl Database {
    /// Fails if a part does not hold equally many values for each cloud, or if there are more parts than columns.
    fn check(&self) -> Result<(), Error> {
        let (table, clouds, parts) = (self.parts.table(), self.clouds.len(), self.parts.as_slice());
        if parts.len() > ChannelsRow::CHANNELS {
            let expected = format!("at most {} channels", ChannelsRow::CHANNELS);
            return Err(refuse(table, 0, &part_name(table, ChannelsRow::CHANNELS), expected, parts.len()));
        }
        for (part, DatabasePart { centroids, deviations }) in parts.iter().enumerate() {
            for (kind, values) in [("centroid", centroids), ("deviation", deviations)] {
                if !values.len().checked_rem(clouds).map_or(values.is_empty(), |rest| rest == 0) {
                    let name = format!("{}_{kind}", part_name(table, part));
                    let expected = format!("as many values for each of {clouds} clouds");
                    return Err(refuse(table, 0, &name, expected, values.len()));
                }
            }
        }
        Ok(())
    }

    /// The table, a row per cloud.
    fn table(&self) -> Result<TableFile, Error> {
        self.check()?;
        let clouds = self.clouds.len();
        match &self.parts {
            DatabaseParts::ShapeColour([shape, colour]) => self.filled(|index, cloud| {
                let [shape, colour] = [shape, colour].map(|part| part.cells(index, clouds));
                DatabaseRow {
                    cloud,
                    shape_centroid: shape.centroid,
                    shape_deviation: shape.deviation,
                    colour_centroid: colour.centroid,
                    colour_deviation: colour.deviation,
                }
            }),
            DatabaseParts::Channels(channels) => self.filled(|index, cloud| {
                ChannelsRow::new(cloud, channels.iter().map(|part| part.cells(index, clouds)))
            }),
        }
    }

    fn filled<R: Value>(&self, row: impl Fn(usize, DatabaseCloud) -> R) -> Result<TableFile, Error> {
        let clouds = self.clouds.iter().cloned().enumerate();
        let rows: Vec<R> = clouds.map(|(index, cloud)| row(index, cloud)).collect();
        Table::new(self.parts.table(), &[])?.filled(&rows, Context::default())
    }

    /// Undoes [`Database::table`]. `file` names it in errors.
    fn of_table(content: &TableFile, file: &Path) -> Result<Self, Error> {
        let damaged = |what| Error::Damaged { file: file.to_owned(), what };
        if content.table.name == TableName::Channels {
            let rows: Vec<_> =
                content.rows::<ChannelsRow>()?.into_iter().map(ChannelsRow::into_channels).collect();
            let channels = rows.first().map_or(0, |(_, cells)| cells.iter().flatten().count());
            let mut parts = vec![DatabasePart::default(); channels];
            let clouds = gathered(rows, &mut parts, TableName::Channels).map_err(damaged)?;
            return Ok(Self { clouds, parts: DatabaseParts::Channels(parts) });
        }
        let rows = content.rows::<DatabaseRow>()?.into_iter().map(|row| {
            let shape = PartCells { centroid: row.shape_centroid, deviation: row.shape_deviation };
            let colour = PartCells { centroid: row.colour_centroid, deviation: row.colour_deviation };
            (row.cloud, [Some(shape), Some(colour)])
        });
        let mut parts = [DatabasePart::default(), DatabasePart::default()];
        let clouds = gathered(rows, &mut parts, TableName::Database).map_err(damaged)?;
        Ok(Self { clouds, parts: DatabaseParts::ShapeColour(parts) })
    }
}

/// Adds the cells of all rows to the parts, of which each row must have all and no other. Returns what the clouds show;
/// `Err` says what is wrong.
fn gathered<const PARTS: usize>(
    rows: impl IntoIterator<Item = (DatabaseCloud, [Option<PartCells>; PARTS])>,
    parts: &mut [DatabasePart],
    table: TableName,
) -> Result<Vec<DatabaseCloud>, String> {
    let names: Vec<String> = (0..parts.len()).map(|part| part_name(table, part)).collect();
    let mut clouds = Vec::new();
    for (cloud, cells) in rows {
        if !cells.iter().enumerate().all(|(part, cells)| cells.is_some() == (part < parts.len())) {
            return Err(format!("its clouds must all have channels 1 to {}, got others", parts.len()));
        }
        for ((part, cells), name) in parts.iter_mut().zip(cells.iter().flatten()).zip(&names) {
            part.append(cells, clouds.len(), name)?;
        }
        clouds.push(cloud);
    }
    Ok(clouds)
}

/// Writes the file whole or not at all, over a former one if there is one. Returns BLAKE3 of its bytes.
///
/// # Errors
/// If a part does not hold equally many values for each cloud, if there are too many channels, or if the file cannot be
/// written.
pub fn write_database(file: impl AsRef<Path>, database: &Database) -> Result<Hash, Error> {
    let file = file.as_ref();
    let table = database.table()?;
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
    let bytes = read_bytes(file)?;
    let digest = blake3::hash(&bytes);
    // A program that recognises one cloud would wait longer for threads than they save.
    let content = parquet::decode_with(ParallelStrategy::None, bytes, &TableName::ARTEFACT, file)?;
    Ok((Database::of_table(&content, file)?, digest))
}
