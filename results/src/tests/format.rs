//! The file format: damaged, foreign, older and newer files, and the committed version-1 sample.

use std::fs;
use std::path::{Path, PathBuf};

use expect_test::{Expect, expect};
use polars::prelude::*;
use tempfile::tempdir;

use super::fixture::{self, genes, population};
use crate::parquet::{decode, encode, encode_with};
use crate::{Error, Table, TableName, read_run, read_table, verify};

fn file() -> PathBuf {
    PathBuf::from("evaluations/generation-00001.parquet")
}

fn table() -> Table {
    Table::new(TableName::Evaluations, &genes()).unwrap()
}

fn frame() -> DataFrame {
    fixture::frame(TableName::Evaluations, &population(1), crate::record::Context::default())
}

/// A file of these columns under any metadata.
fn file_of(mut frame: DataFrame, version: &str, table: &str, columns: &str) -> Vec<u8> {
    let pairs = [("descry.schema_version", version), ("descry.table", table), ("descry.columns", columns)];
    let pairs = pairs.into_iter().filter(|(_, value)| !value.is_empty());
    let pairs = pairs.map(|(key, value)| (key.to_owned(), value.to_owned())).collect();
    encode_with(&mut frame, pairs, &file()).unwrap()
}

fn columns() -> String {
    serde_json::to_string(&table().columns).unwrap()
}

fn read(bytes: Vec<u8>) -> Result<DataFrame, Error> {
    decode(bytes, TableName::Evaluations, &file()).map(|content| content.frame)
}

#[track_caller]
fn refused(bytes: Vec<u8>, expected: Expect) {
    expected.assert_eq(&read(bytes).unwrap_err().to_string());
}

#[test]
fn metadata_describes_the_columns() {
    let bytes = encode(&table(), frame(), &file()).unwrap();
    let mut reader = polars_io::parquet::read::ParquetReader::new(std::io::Cursor::new(bytes));
    let metadata = reader.get_metadata().unwrap().clone();
    let value = |key: &str| {
        let mut pairs = metadata.key_value_metadata().iter().flatten();
        pairs.find(|pair| pair.key == key).and_then(|pair| pair.value.clone()).unwrap()
    };
    assert_eq!(value("descry.schema_version"), "1");
    assert_eq!(value("descry.table"), "evaluations");
    let columns: Vec<crate::Column> = serde_json::from_str(&value("descry.columns")).unwrap();
    assert_eq!(columns, table().columns);
    expect![[r#"{"name":"R1","kind":"f64","unit":"cm","nullable":true,"in_digest":true,"gene":true,"meaning":"meaning of R1"}"#]]
        .assert_eq(&serde_json::to_string(&columns[5]).unwrap());
    let codecs = metadata.row_groups.iter().flat_map(|group| group.parquet_columns());
    assert!(codecs.into_iter().all(|column| format!("{:?}", column.compression()) == "Zstd"));
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    let bytes = encode(&table(), frame(), &file()).unwrap();
    for length in 0..bytes.len() {
        let error = read(bytes[..length].to_vec()).unwrap_err();
        assert!(matches!(error, Error::Damaged { .. }), "{length}: {error}");
    }
    refused(
        bytes[..bytes.len() / 2].to_vec(),
        expect![[r#"
            evaluations/generation-00001.parquet: file is damaged or was changed: it does not begin and end as Parquet does
            restore it from a copy, or run the experiment again"#]],
    );
}

#[test]
fn one_flipped_bit_anywhere_is_noticed() {
    let bytes = encode(&table(), frame(), &file()).unwrap();
    for at in 0..bytes.len() {
        let mut flipped = bytes.clone();
        flipped[at] ^= 1 << (at % 8);
        let error = read(flipped).unwrap_err();
        assert!(matches!(error, Error::Damaged { .. } | Error::Foreign { .. }), "{at}: {error}");
    }
    let mut flipped = bytes;
    flipped[100] ^= 1;
    refused(
        flipped,
        expect![[r#"
            evaluations/generation-00001.parquet: file is damaged or was changed: its checksum is not that of its content
            restore it from a copy, or run the experiment again"#]],
    );
}

#[test]
fn a_file_that_claims_more_than_it_holds_is_refused() {
    for bytes in [&b""[..], b"PAR1", b"PAR1PAR1", b"PAR1\xff\xff\xff\xffPAR1", b"PAR1\0\0\0\0PAR1"] {
        assert!(read(bytes.to_vec()).is_err());
    }
}

#[test]
fn files_of_other_programs_are_refused() {
    let mut bytes = Vec::new();
    polars_io::parquet::write::ParquetWriter::new(&mut bytes).finish(&mut frame()).unwrap();
    refused(
        bytes,
        expect![[r#"
            evaluations/generation-00001.parquet: not a results file of descry: no descry.checksum in its metadata
            remove it from the run folder"#]],
    );
    refused(
        file_of(frame(), "", "evaluations", &columns()),
        expect![[r#"
            evaluations/generation-00001.parquet: not a results file of descry: no descry.schema_version in its metadata
            remove it from the run folder"#]],
    );
    refused(
        file_of(frame(), "1", "run", &columns()),
        expect![[r#"
            evaluations/generation-00001.parquet: expected table evaluations, got "run"
            move the file back to its folder"#]],
    );
    refused(
        file_of(frame(), "1", "evaluations", "[{}]"),
        expect![[r#"
            evaluations/generation-00001.parquet: file is damaged or was changed: its descry.columns is no list of columns: missing field `name` at line 1 column 3
            restore it from a copy, or run the experiment again"#]],
    );
}

#[test]
fn only_later_schema_versions_are_refused() {
    assert!(read(file_of(frame(), "1", "evaluations", &columns())).is_ok());
    refused(
        file_of(frame(), "2", "evaluations", &columns()),
        expect![[r#"
            evaluations/generation-00001.parquet: schema version 2 is newer than this program's 1
            update this program"#]],
    );
    for version in ["0", "one", "-1"] {
        assert!(matches!(
            read(file_of(frame(), version, "evaluations", &columns())),
            Err(Error::Damaged { .. })
        ));
    }
}

#[test]
fn a_column_that_an_older_file_lacks_is_null() {
    let older = frame().drop("attempt").unwrap().drop("parent_b").unwrap();
    let got = read(file_of(older, "1", "evaluations", &columns())).unwrap();
    assert_eq!(got.get_column_names(), frame().get_column_names());
    assert_eq!(got.column("attempt").unwrap().null_count(), 3);
    assert_eq!(got.column("attempt").unwrap().dtype(), &DataType::UInt32);
    assert!(got.drop("attempt").unwrap().equals_missing(&frame().drop("attempt").unwrap()));
}

#[test]
fn unknown_columns_are_kept_and_null_where_absent() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let mut more = frame();
    more.with_column(Column::new("later".into(), [1u32, 2, 3])).unwrap();
    let path = folder.path().join("evaluations/generation-00001.parquet");
    fs::write(path, file_of(more, "1", "evaluations", &columns())).unwrap();
    let got = read_table(folder.path(), TableName::Evaluations).unwrap();
    let later: Vec<_> = got.column("later").unwrap().u32().unwrap().iter().collect();
    assert_eq!(later, [Some(1), Some(2), Some(3), None, None, None]);
    assert_eq!(got.width(), table().columns.len() + 1);
}

fn put(frame: &mut DataFrame, column: Column) {
    frame.with_column(column).unwrap();
}

#[test]
fn columns_of_another_form_are_refused() {
    let check = |change: fn(&mut DataFrame), expected: Expect| {
        let mut changed = frame();
        change(&mut changed);
        refused(file_of(changed, "1", "evaluations", &columns()), expected);
    };
    check(
        |frame| *frame = frame.drop("fitness").unwrap(),
        expect![[r#"
            evaluations/generation-00001.parquet: column fitness: expected f64, got no such column
            read it with the program that wrote it"#]],
    );
    check(
        |frame| put(frame, Column::new("queries".into(), ["9", "9", "9"])),
        expect![[r#"
            evaluations/generation-00001.parquet: column queries: expected u32, got str
            read it with the program that wrote it"#]],
    );
    check(
        |frame| put(frame, Column::new("queries".into(), [Some(9u32), None, Some(9)])),
        expect![[r#"
            evaluations/generation-00001.parquet: column queries: expected a value in every row, got 1 nulls
            read it with the program that wrote it"#]],
    );
    check(
        |frame| put(frame, Column::new("w".into(), [Some(0.5), None, Some(f64::NAN)])),
        expect![[r#"
            evaluations/generation-00001.parquet: column w: expected a finite number, got NaN
            read it with the program that wrote it"#]],
    );
}

#[test]
fn a_table_without_files_is_named() {
    let folder = tempdir().unwrap();
    let error = read_table(folder.path(), TableName::Predictions).unwrap_err();
    assert!(matches!(error, Error::NoFiles { table: TableName::Predictions, .. }));
    let first =
        error.to_string().lines().next().unwrap().replace(&folder.path().display().to_string(), "FOLDER");
    expect!["FOLDER/predictions: no Parquet file of table predictions"].assert_eq(&first);
}

/// Files written by version 1, committed once and never written again: what they hold must stay readable, and
/// their digest must stay what it was.
#[test]
fn the_version_1_sample_is_read() {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/v1");
    for (table, rows) in [
        (TableName::Evaluations, 6),
        (TableName::Generations, 2),
        (TableName::Predictions, 5),
        (TableName::Skipped, 1),
        (TableName::Run, 1),
    ] {
        assert_eq!(read_table(&sample, table).unwrap().height(), rows, "{table}");
    }
    let finished = read_run(&sample).unwrap();
    // Files from before a column was added have nothing in it.
    assert_eq!(finished.row, crate::RunRow { grid_best_object_correct: None, ..fixture::run() });
    assert_eq!(finished.genes, genes());
    expect!["7d784a968f4c23c5dc3f396a9a261004fb9cd09c306d20cf2051c768def48b59"]
        .assert_eq(&finished.run_digest);
    let verification = verify(&sample).unwrap();
    assert!(verification.is_intact(), "{:?}", verification.problems);
}
