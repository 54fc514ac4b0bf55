//! The database of an artefact: what is written is read again, what is damaged is seen.

use std::fs;
use std::path::Path;

use tempfile::tempdir;

use crate::*;

fn database(colours: usize) -> Database {
    let cloud = |number: u32| DatabaseCloud {
        cloud: format!("mug/mug_{number}/mug_{number}_1_1.pcd"),
        instance: format!("mug_{number}"),
        category: "mug".to_owned(),
    };
    let values =
        |bins: usize, phase: u16| (0..3 * bins as u16).map(|i| f32::from(i * 7 + phase) / 97.0).collect();
    let part = |bins| DatabasePart { centroids: values(bins, 1), deviations: values(bins, 5) };
    Database { clouds: (1..=3).map(cloud).collect(), shape: part(4), colour: part(colours) }
}

#[test]
fn a_database_is_read_as_it_was_written() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("database.parquet");
    for database in [database(2), database(0), Database::default()] {
        let digest = write_database(&file, &database).unwrap();
        assert_eq!(read_database(&file).unwrap(), (database, digest));
        assert_eq!(digest, blake3::hash(&fs::read(&file).unwrap()));
    }
}

#[test]
fn a_damaged_database_is_damage_wherever_a_bit_is_flipped() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("database.parquet");
    write_database(&file, &database(2)).unwrap();
    let sound = fs::read(&file).unwrap();
    for byte in (0..sound.len()).step_by(5) {
        let mut bytes = sound.clone();
        bytes[byte] ^= 0x10;
        fs::write(&file, bytes).unwrap();
        assert!(read_database(&file).unwrap_err().is_damage(), "byte {byte}");
    }
}

#[test]
fn parts_of_unequal_length_are_refused() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("database.parquet");
    let mut ragged = database(2);
    ragged.colour.deviations.pop();
    let mut nobodys = database(2);
    nobodys.clouds.clear();
    for wrong in [ragged, nobodys] {
        assert!(matches!(write_database(&file, &wrong), Err(Error::Row { .. })));
    }
    assert!(!file.exists());
}

/// The columns of the table are those of the file, in its order, of its kinds.
#[test]
fn the_rows_and_the_column_table_do_not_drift_apart() {
    let table = Table::new(TableName::Database, &[]).unwrap();
    let folder = tempdir().unwrap();
    let file = folder.path().join("database.parquet");
    write_database(&file, &database(2)).unwrap();
    let frame = crate::read::read_file(&file, TableName::Database).unwrap().frame;
    let expected: Vec<_> =
        table.columns.iter().map(|column| (column.name.clone(), column.kind.data_type())).collect();
    let got: Vec<_> =
        frame.columns().iter().map(|cell| (cell.name().to_string(), cell.dtype().clone())).collect();
    assert_eq!(expected, got);
}

/// A database as version 1 wrote it; the file is never written again.
#[test]
fn the_version_1_sample_is_read() {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/database-v1.parquet");
    assert_eq!(read_database(sample).unwrap().0, database(2));
}
