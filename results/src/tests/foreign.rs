//! Files of other programs: what is read of them, and what each bad one is told.

use std::fs;
use std::path::Path;

use polars::prelude::{Column, DataFrame, DataType, IntoColumn, NamedFrom, Series, df};
use polars_io::parquet::write::{ParquetCompression, ParquetWriter};
use tempfile::tempdir;

use crate::*;

const QUERIES: [&str; 2] = ["cup/cup_2.pcd", "box/box_2.pcd"];
const DATABASE: [&str; 3] = ["cup/cup_1.pcd", "box/box_1.pcd", "box/box_3.pcd"];
const UNUSED: &str = "box/box_9.pcd";

fn read(file: &Path) -> Result<Foreign, ForeignError> {
    let is_known = |path: &str| path == UNUSED;
    read_foreign(file, &ForeignClouds { queries: &QUERIES, database: &DATABASE, is_known: &is_known })
}

fn all() -> impl Iterator<Item = &'static str> {
    QUERIES.into_iter().chain(DATABASE)
}

fn write(file: &Path, mut frame: DataFrame, compression: ParquetCompression) {
    let out = fs::File::create(file).unwrap();
    let writer = ParquetWriter::new(out).with_compression(compression).with_row_group_size(Some(2));
    writer.finish(&mut frame).unwrap();
}

/// Of each cloud a list; `None` is null.
fn lists(values: &[Option<Vec<Option<f64>>>]) -> Column {
    let lists: Vec<Option<Series>> =
        values.iter().map(|list| list.as_ref().map(|list| Series::new("".into(), list))).collect();
    let column = Series::new("values".into(), lists);
    column.cast(&DataType::List(Box::new(DataType::Float64))).unwrap().into_column()
}

/// The vector of the cloud in this row.
fn vector(row: usize) -> Vec<f64> {
    vec![row as f64, 0.5, -1.0 / 3.0]
}

fn vectors() -> Vec<Option<Vec<Option<f64>>>> {
    (0..5).map(|row| Some(vector(row).into_iter().map(Some).collect())).collect()
}

fn frame(clouds: &[&str], values: Column) -> DataFrame {
    DataFrame::new(clouds.len(), vec![Series::new("cloud".into(), clouds).into_column(), values]).unwrap()
}

#[test]
fn vectors_come_in_the_order_of_the_clouds_whatever_that_of_the_rows_and_however_written() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("vectors.parquet");
    // From the last to the first, with a cloud that the run does not use and a column that nobody asked for.
    let mut clouds: Vec<&str> = all().collect();
    clouds.reverse();
    clouds.insert(2, UNUSED);
    let mut values = vectors();
    values.reverse();
    values.insert(2, values[0].clone());
    let mut content = frame(&clouds, lists(&values));
    content.with_column(Series::new("index".into(), (0..6).collect::<Vec<i64>>()).into_column()).unwrap();
    let expected: Vec<f64> = (0..5).flat_map(vector).collect();
    for compression in
        [ParquetCompression::Snappy, ParquetCompression::Zstd(None), ParquetCompression::Uncompressed]
    {
        write(&file, content.clone(), compression);
        let found = read(&file).unwrap();
        assert_eq!(found.digest, blake3::hash(&fs::read(&file).unwrap()).to_hex().as_str());
        assert_eq!(found.values, ForeignValues::Vectors { length: 3, values: expected.clone() });
    }
    let narrow =
        content.column("values").unwrap().cast(&DataType::List(Box::new(DataType::Float32))).unwrap();
    content.with_column(narrow).unwrap();
    write(&file, content, ParquetCompression::Snappy);
    let ForeignValues::Vectors { values, .. } = read(&file).unwrap().values else { panic!("vectors") };
    assert_eq!(values, expected.iter().map(|&value| f64::from(value as f32)).collect::<Vec<_>>());

    let of_rust: Vec<(&str, Vec<f32>)> = all().map(|cloud| (cloud, vec![0.25, 4.0])).collect();
    write_vectors(&file, &of_rust).unwrap();
    let values = [0.25, 4.0].repeat(5);
    assert_eq!(read(&file).unwrap().values, ForeignValues::Vectors { length: 2, values });
}

#[test]
fn distances_come_query_by_query_and_those_of_the_database_are_made_symmetric() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("distances.parquet");
    let distance = |query: usize, cloud: usize| (10 * query + cloud) as f64;
    let mut rows: Vec<(&str, &str, f64)> = Vec::new();
    for (query, asked) in QUERIES.into_iter().enumerate().rev() {
        for (cloud, known) in DATABASE.into_iter().enumerate() {
            rows.push((asked, known, distance(query, cloud)));
        }
    }
    let to_database: Vec<f64> = vec![0.0, 1.0, 2.0, 10.0, 11.0, 12.0];
    let read_rows = |rows: &[(&str, &str, f64)]| {
        write_distances(&file, rows).unwrap();
        match read(&file).unwrap().values {
            ForeignValues::Distances { to_database: found, among } => {
                assert_eq!(found, to_database);
                among
            }
            other => panic!("{other:?}"),
        }
    };
    // What is said of other clouds is passed over.
    rows.extend([(UNUSED, DATABASE[0], 1.0), (QUERIES[0], UNUSED, 1.0), (QUERIES[0], QUERIES[1], 1.0)]);
    assert_eq!(read_rows(&rows), Among::Nothing);
    rows.push((DATABASE[1], DATABASE[0], 7.0));
    let first = [DATABASE[0], DATABASE[2]].map(str::to_owned);
    assert_eq!(read_rows(&rows), Among::Some { missing: 2, first });
    rows.extend([(DATABASE[0], DATABASE[2], 3.0), (DATABASE[2], DATABASE[0], 4.0)]);
    rows.extend([(DATABASE[1], DATABASE[2], 5.0), (DATABASE[2], DATABASE[2], 0.0)]);
    assert_eq!(read_rows(&rows), Among::All(vec![0.0, 7.0, 3.5, 7.0, 0.0, 5.0, 3.5, 5.0, 0.0]));
}

/// What is said of a file.
fn told(file: &Path) -> String {
    read(file).unwrap_err().to_string().replace(&file.display().to_string(), "FILE")
}

#[test]
fn a_bad_file_is_refused_by_name_with_the_row_and_what_to_do() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("bad.parquet");
    let refused = |content: DataFrame, what: &str| {
        write(&file, content, ParquetCompression::Snappy);
        let told = told(&file);
        let (first, advice) = told.split_once('\n').unwrap();
        assert!(first.starts_with("FILE: ") && first.contains(what), "{what}\n{told}");
        assert!(!advice.is_empty() && !advice.contains('\n'), "{told}");
    };
    let clouds: Vec<&str> = all().collect();
    let with = |row: usize, list: Option<Vec<Option<f64>>>| {
        let mut values = vectors();
        values[row] = list;
        frame(&clouds, lists(&values))
    };
    let numbers = |values: [f64; 3]| Some(values.map(Some).to_vec());
    refused(with(3, None), "row 3 (from 0): values of box/box_1.pcd must be a list, got null");
    refused(with(3, Some(vec![])), "row 3 (from 0): values of box/box_1.pcd must be some, got an empty list");
    refused(with(0, Some(vec![])), "row 0 (from 0): values of cup/cup_2.pcd must be some, got an empty list");
    refused(
        with(3, Some(vec![Some(1.0)])),
        "row 3 (from 0): values of box/box_1.pcd must be 3 as in row 0, got 1",
    );
    refused(
        with(4, numbers([0.0, f64::NAN, 0.0])),
        "row 4 (from 0): value 1 of box/box_3.pcd must be a finite number, got NaN",
    );
    refused(
        with(1, numbers([f64::INFINITY, 0.0, 0.0])),
        "value 0 of box/box_2.pcd must be a finite number, got inf",
    );
    refused(
        with(1, Some(vec![None, Some(0.0), Some(0.0)])),
        "value 0 of box/box_2.pcd must be a finite number, got null",
    );
    let renamed = |row: usize, name: &'static str| {
        let mut clouds = clouds.clone();
        clouds[row] = name;
        frame(&clouds, lists(&vectors()))
    };
    refused(
        renamed(1, "cup/cup_2.pcd"),
        "row 1 (from 0): cloud must have one row, got another of cup/cup_2.pcd",
    );
    refused(
        renamed(2, "/data/cup/cup_1.pcd"),
        "row 2 (from 0): cloud must be a cloud of the data set, got \"/data/cup/cup_1.pcd\"",
    );
    refused(
        renamed(2, UNUSED),
        "each of the 5 test and database clouds, got none for cup/cup_1.pcd, the first of 1",
    );
    refused(frame(&clouds, lists(&vectors())).head(Some(3)), "got none for box/box_1.pcd, the first of 2");
    refused(frame(&clouds, lists(&vectors())).head(Some(0)), "got none for cup/cup_2.pcd, the first of 5");
    let mut nulls = frame(&clouds, lists(&vectors()));
    nulls
        .with_column(Series::new("cloud".into(), [None, Some("a")].repeat(3)[..5].to_vec()).into_column())
        .unwrap();
    refused(nulls, "row 0 (from 0): cloud must be a path, got null");

    let numbers: Vec<i64> = (0..5).collect();
    let text: Vec<String> = (0..6).map(|number: i64| number.to_string()).collect();
    refused(df!("cloud" => &numbers, "values" => &numbers).unwrap(), "column cloud: must be text, got i64");
    refused(
        df!("cloud" => &clouds, "values" => &numbers).unwrap(),
        "column values: must be lists of f32 or f64, got i64",
    );
    refused(df!("values" => &numbers).unwrap(), "column cloud: must be there and be text, got none");
    refused(
        df!("cloud" => &clouds).unwrap(),
        "must have either a column values or a column distance, got cloud",
    );
    refused(df!("values" => &numbers, "distance" => &numbers).unwrap(), "must have either");
    let pairs = |distance: Column| {
        let query: Vec<&str> = QUERIES.into_iter().flat_map(|query| [query; 3]).collect();
        let cloud: Vec<&str> = DATABASE.repeat(2);
        let mut frame = df!("query" => &query, "database" => &cloud).unwrap();
        frame.with_column(distance).unwrap();
        frame
    };
    let distances = |values: [Option<f64>; 6]| Series::new("distance".into(), values.to_vec()).into_column();
    let sound = [Some(1.0); 6];
    write(&file, pairs(distances(sound)), ParquetCompression::Snappy);
    read(&file).unwrap();
    let other = |row: usize, value: Option<f64>| {
        let mut values = sound;
        values[row] = value;
        pairs(distances(values))
    };
    refused(
        other(4, None),
        "row 4 (from 0): distance of box/box_2.pcd and box/box_1.pcd must be a finite number that is not negative, got null",
    );
    refused(other(4, Some(f64::NAN)), "got NaN");
    refused(other(4, Some(f64::NEG_INFINITY)), "got -inf");
    refused(other(4, Some(-1.0)), "got -1");
    refused(
        pairs(distances(sound)).head(Some(4)),
        "each of the 6 pairs of a test and a database cloud, got none for query box/box_2.pcd and database box/box_1.pcd, the first of 2",
    );
    let twice = pairs(distances(sound)).vstack(&pairs(distances(sound)).head(Some(1))).unwrap();
    refused(
        twice,
        "row 6 (from 0): a pair must have one row, got another of cup/cup_2.pcd and cup/cup_1.pcd",
    );
    refused(
        pairs(Series::new("distance".into(), &text).into_column()),
        "column distance: must be f32 or f64, got str",
    );
    let mut both = pairs(distances(sound));
    both.with_column(Series::new("cloud".into(), ["a"; 6]).into_column()).unwrap();
    refused(both, "must have one of the columns cloud and database, got both");
}

#[test]
fn what_is_no_parquet_file_is_refused_wherever_it_is_damaged() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("other.parquet");
    assert!(told(&file).starts_with("FILE: cannot be read, got: "));
    assert!(told(folder.path()).starts_with("FILE: must be a file, got something else\n"));
    for content in
        ["", "PAR1", "cloud,values\na,1\n", "PAR1\u{1}\u{2}PAR1", "PAR1aaaa\u{7f}\u{7f}\u{7f}\u{7f}PAR1"]
    {
        fs::write(&file, content).unwrap();
        assert!(told(&file).starts_with("FILE: must be a Parquet file, got: "), "{}", told(&file));
    }
    // A file that was cut off.
    let clouds: Vec<&str> = all().collect();
    write(&file, frame(&clouds, lists(&vectors())), ParquetCompression::Uncompressed);
    let sound = fs::read(&file).unwrap();
    for length in (0..sound.len()).step_by(7) {
        fs::write(&file, &sound[..length]).unwrap();
        told(&file);
    }
}
