//! The database of an artefact: what is written is read again, what is damaged is seen.

use std::fs;
use std::path::Path;

use polars::prelude::{DataType, IntoColumn, NamedFrom, Series};
use tempfile::tempdir;

use crate::parquet::{encode, encode_with};
use crate::*;
use artefact::{Database, DatabaseCloud, DatabasePart, DatabaseParts, read_database};

fn clouds() -> Vec<DatabaseCloud> {
    let cloud = |number: u32| DatabaseCloud {
        cloud: format!("mug/mug_{number}/mug_{number}_1_1.pcd"),
        instance: format!("mug_{number}"),
        category: "mug".to_owned(),
        sequence: (number > 1).then(|| number.to_string()),
        addition: (number > 2).then_some(number),
    };
    (1..=3).map(cloud).collect()
}

fn values(bins: usize, phase: u16) -> Vec<f32> {
    (0..3 * bins as u16).map(|i| f32::from(i * 7 + phase) / 97.0).collect()
}

fn part(bins: usize) -> DatabasePart {
    DatabasePart { centroids: values(bins, 1), deviations: values(bins, 5) }
}

fn database(colours: usize) -> Database {
    Database { clouds: clouds(), parts: DatabaseParts::ShapeColour([part(4), part(colours)]) }
}

/// Every second channel has no deviations.
fn channels(count: usize) -> Database {
    let channel = |index: usize| match index % 2 {
        0 => part(index + 2),
        _ => DatabasePart { deviations: Vec::new(), ..part(index + 2) },
    };
    Database { clouds: clouds(), parts: DatabaseParts::Channels((0..count).map(channel).collect()) }
}

/// As artefacts of earlier releases have it.
fn earlier(mut database: Database) -> Database {
    for cloud in &mut database.clouds {
        (cloud.sequence, cloud.addition) = (None, None);
    }
    database
}

fn nobody(parts: DatabaseParts) -> Database {
    Database { clouds: Vec::new(), parts }
}

#[test]
fn a_database_is_read_as_it_was_written() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("database.parquet");
    let empty = nobody(DatabaseParts::ShapeColour([DatabasePart::default(), DatabasePart::default()]));
    let shape_colour = [database(2), database(0), empty];
    let by_channel = (0..=8).map(channels).chain([nobody(DatabaseParts::Channels(Vec::new()))]);
    for database in shape_colour.into_iter().chain(by_channel) {
        let digest = write_database(&file, &database).unwrap();
        assert_eq!(read_database(&file).unwrap(), (database, digest));
        assert_eq!(digest, blake3::hash(&fs::read(&file).unwrap()));
    }
}

/// Artefacts of earlier releases have no column for sequences and additions.
#[test]
fn a_database_without_the_later_columns_is_read() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("database.parquet");
    for database in [database(2), channels(3)] {
        write_database(&file, &database).unwrap();
        let content = crate::read::read_file(&file, crate::database::table_name(&database.parts)).unwrap();
        let mut frame = content.frame.drop("sequence").unwrap().drop("addition").unwrap();
        let metadata = [
            ("descry.schema_version", "1".to_owned()),
            ("descry.table", content.table.name.to_string()),
            ("descry.columns", "[]".to_owned()),
        ];
        let metadata = metadata.map(|(key, value)| (key.to_owned(), value)).to_vec();
        fs::write(&file, encode_with(&mut frame, metadata, &file).unwrap()).unwrap();
        assert_eq!(read_database(&file).unwrap().0, earlier(database));
    }
}

#[test]
fn a_damaged_database_is_damage_wherever_a_bit_is_flipped() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("database.parquet");
    for database in [database(2), channels(2)] {
        write_database(&file, &database).unwrap();
        let sound = fs::read(&file).unwrap();
        for byte in (0..sound.len()).step_by(5) {
            let mut bytes = sound.clone();
            bytes[byte] ^= 0x10;
            fs::write(&file, bytes).unwrap();
            assert!(read_database(&file).unwrap_err().is_damage(), "byte {byte}");
        }
    }
}

#[test]
fn parts_of_unequal_length_and_too_many_channels_are_refused() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("database.parquet");
    let ragged = || DatabasePart { centroids: values(4, 1)[1..].to_vec(), ..part(4) };
    let with = |parts| Database { clouds: clouds(), parts };
    for wrong in [
        with(DatabaseParts::ShapeColour([part(4), ragged()])),
        with(DatabaseParts::Channels(vec![part(4), ragged()])),
        nobody(DatabaseParts::ShapeColour([part(4), part(2)])),
        nobody(DatabaseParts::Channels(vec![part(4)])),
        channels(9),
    ] {
        assert!(matches!(write_database(&file, &wrong), Err(Error::Row { .. })), "{wrong:?}");
    }
    assert!(!file.exists());
}

/// Rows that this program never writes, under a sound checksum.
#[test]
fn channels_that_are_not_those_of_every_cloud_are_damage() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("database.parquet");
    let complaint = |change: &dyn Fn(&Series) -> Series| {
        write_database(&file, &channels(3)).unwrap();
        let content = crate::read::read_file(&file, TableName::Channels).unwrap();
        let mut frame = content.frame;
        let column = frame.column("channel_2_centroid").unwrap().as_materialized_series().clone();
        frame.with_column(change(&column).into_column()).unwrap();
        fs::write(&file, encode(&content.table, frame, &file).unwrap()).unwrap();
        let error = read_database(&file).unwrap_err();
        assert!(error.is_damage(), "{error}");
        error.to_string()
    };
    let nulls = |column: &Series| Series::full_null(column.name().clone(), column.len(), column.dtype());
    let said = complaint(&nulls);
    assert!(said.contains("its clouds must all have channels 1 to 2, got others"), "{said}");
    let said = complaint(&|column| {
        let mut changed = column.slice(0, 2);
        changed.append(&nulls(&column.slice(0, 1))).unwrap();
        changed
    });
    assert!(said.contains("its clouds must all have channels 1 to 3, got others"), "{said}");
    let said = complaint(&|column| {
        let mut changed = column.slice(0, 2);
        let longer = Series::new("".into(), [Series::new("".into(), [0.5f32; 7])]);
        changed.append(&longer.cast(&DataType::List(Box::new(DataType::Float32))).unwrap()).unwrap();
        changed
    });
    assert!(said.contains("its lists channel_2_centroid must be of one length, got 3 and 7"), "{said}");
}

#[test]
fn a_table_of_a_run_is_no_database() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("database.parquet");
    let look = super::fixture::frame(TableName::Looks, &[super::fixture::look()], Default::default());
    let table = Table::new(TableName::Looks, &[]).unwrap();
    fs::write(&file, encode(&table, look, &file).unwrap()).unwrap();
    let said = read_database(&file).unwrap_err().to_string();
    assert!(said.contains("expected table database or channels, got \"looks\""), "{said}");
}

/// The columns of the table are those of the file, in its order, of its kinds.
#[test]
fn the_rows_and_the_column_table_do_not_drift_apart() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("database.parquet");
    for (name, database) in [(TableName::Database, database(2)), (TableName::Channels, channels(2))] {
        let table = Table::new(name, &[]).unwrap();
        write_database(&file, &database).unwrap();
        let frame = crate::read::read_file(&file, name).unwrap().frame;
        let expected: Vec<_> =
            table.columns.iter().map(|column| (column.name.clone(), column.kind.data_type())).collect();
        let got: Vec<_> =
            frame.columns().iter().map(|cell| (cell.name().to_string(), cell.dtype().clone())).collect();
        assert_eq!(expected, got);
    }
}

/// A database as version 1 wrote it; the file is never written again.
#[test]
fn the_version_1_sample_is_read() {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/database-v1.parquet");
    assert_eq!(read_database(sample).unwrap().0, earlier(database(2)));
}
