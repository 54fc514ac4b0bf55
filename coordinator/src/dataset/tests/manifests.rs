//! Manifests in Parquet: the same data set as from CSV, and the message of each bad one.

use std::fs::{self, File};
use std::path::Path;
use std::sync::Arc;

use descriptor::Preprocess;
use expect_test::{Expect, expect};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;

use super::super::{Dataset, DatasetError, DatasetSettings, Layout, SPLITS, Wanted};
use super::Fixture;

/// Cells of a column; `None` is null.
enum Cells<'a> {
    Text(Vec<Option<&'a str>>),
    Whole(Vec<Option<i64>>),
    Real(Vec<Option<f64>>),
}

/// Writes a table as another program does.
fn write(file: &Path, columns: &[(&str, Cells<'_>)]) {
    let field = |(name, cells): &(&str, Cells<'_>)| match cells {
        Cells::Text(_) => format!("optional binary {name} (UTF8);"),
        Cells::Whole(_) => format!("optional int64 {name};"),
        Cells::Real(_) => format!("optional double {name};"),
    };
    let fields: String = columns.iter().map(field).collect();
    let schema = Arc::new(parse_message_type(&format!("message table {{ {fields} }}")).unwrap());
    let mut writer = SerializedFileWriter::new(File::create(file).unwrap(), schema, Arc::default()).unwrap();
    let mut group = writer.next_row_group().unwrap();
    fn there<T>(cells: &[Option<T>]) -> Vec<i16> {
        cells.iter().map(|cell| i16::from(cell.is_some())).collect()
    }
    for (_, cells) in columns {
        let mut column = group.next_column().unwrap().unwrap();
        match cells {
            Cells::Text(cells) => {
                let values: Vec<ByteArray> = cells.iter().flatten().map(|&text| text.into()).collect();
                column.typed::<ByteArrayType>().write_batch(&values, Some(&there(cells)), None).unwrap();
            }
            Cells::Whole(cells) => {
                let values: Vec<i64> = cells.iter().flatten().copied().collect();
                column.typed::<Int64Type>().write_batch(&values, Some(&there(cells)), None).unwrap();
            }
            Cells::Real(cells) => {
                let values: Vec<f64> = cells.iter().flatten().copied().collect();
                column.typed::<DoubleType>().write_batch(&values, Some(&there(cells)), None).unwrap();
            }
        }
        column.close().unwrap();
    }
    group.close().unwrap();
    writer.close().unwrap();
}

fn text<const N: usize>(cells: [&'static str; N]) -> Cells<'static> {
    Cells::Text(cells.into_iter().map(|cell| Some(cell).filter(|cell| !cell.is_empty())).collect())
}

fn fixture() -> Fixture {
    let mut fixture = Fixture::empty();
    for split in SPLITS {
        fixture.cloud(&format!("{split}.pcd"));
    }
    fixture
}

fn load(fixture: &Fixture, manifest: &str) -> Result<Dataset, DatasetError> {
    let layout = Layout::Manifest { file: fixture.root().join(manifest) };
    let settings = DatasetSettings { layout, ..fixture.manifest_settings() };
    Dataset::load(&settings, &Preprocess::default(), Wanted::All, None)
}

#[test]
fn the_cells_of_a_csv_give_the_same_data_set_as_parquet() {
    let fixture = fixture();
    fixture.write(
        "clouds.csv",
        "path,note,category,instance,sequence,split,set\n\
         train1.pcd,a,fruit,pear,1,train1,day\n train2.pcd ,b,fruit,pear,,train2,day\n\
         validation.pcd,c,fruit,pear,-2,validation,night\ntest.pcd,d,fruit,pear,3,test,day\n",
    );
    let columns = [
        ("path", text(["train1.pcd", " train2.pcd ", "validation.pcd", "test.pcd"])),
        ("note", Cells::Real(vec![Some(0.5), None, Some(f64::NAN), Some(1.0)])),
        ("category", text(["fruit"; 4])),
        ("instance", text(["pear"; 4])),
        ("sequence", Cells::Whole(vec![Some(1), None, Some(-2), Some(3)])),
        ("split", text(SPLITS)),
        ("set", text(["day", "day", "night", "day"])),
    ];
    // The content says what it is, or else the name.
    for manifest in ["clouds.parquet", "clouds"] {
        write(&fixture.root().join(manifest), &columns);
        let (by_csv, by_parquet) = (load(&fixture, "clouds.csv").unwrap(), load(&fixture, manifest).unwrap());
        assert_eq!(by_csv, by_parquet);
        assert_eq!(by_csv.clouds.sequences.len(), 3);
    }
}

fn check(columns: &[(&str, Cells<'_>)], expected: Expect) {
    let fixture = fixture();
    write(&fixture.root().join("clouds.parquet"), columns);
    expected.assert_eq(&fixture.text(&load(&fixture, "clouds.parquet").unwrap_err()));
}

#[test]
fn manifests_in_parquet_that_cannot_be_used() {
    check(
        &[("path", text(["test.pcd"])), ("label", text(["pear"]))],
        expect![[r#"
        clouds.parquet: column category expected, got path,label
        write CSV or Parquet with the columns path, category and instance, and sequence, split and set if wanted"#]],
    );
    let labels = || [("category", text(["fruit"; 2])), ("instance", text(["pear"; 2]))];
    let with = |more: (&'static str, Cells<'static>)| {
        let path = ("path", text(["test.pcd", "train1.pcd"]));
        let mut columns = vec![path, more];
        columns.extend(labels());
        columns
    };
    check(
        &with(("sequence", Cells::Real(vec![Some(1.0), None]))),
        expect![[r#"
            clouds.parquet: text or whole numbers in column sequence expected, got numbers with fractions
            write CSV or Parquet with the columns path, category and instance, and sequence, split and set if wanted"#]],
    );
    check(
        &with(("set", text(["day", ""]))),
        expect![[r#"
        clouds.parquet, row 1 (from 0): set expected, got nothing
        fill the field: every cloud needs a path, a category and an instance, and a set where there is such a column"#]],
    );
    check(
        &with(("split", text(["test", "te\nst"]))),
        expect![[r#"
        clouds.parquet, row 1 (from 0): split without control characters expected, got te\nst
        write CSV or Parquet with the columns path, category and instance, and sequence, split and set if wanted"#]],
    );
    let mut columns = vec![("path", text(["test.pcd", "./test.pcd"]))];
    columns.extend(labels());
    check(
        &columns,
        expect![[r#"
        clouds.parquet, row 1 (from 0): each cloud once expected, got test.pcd again after clouds.parquet, row 0 (from 0)
        remove one of the two"#]],
    );
}

#[test]
fn a_file_with_the_name_of_parquet_that_is_none() {
    let fixture = fixture();
    fixture.write("clouds.parquet", "path,category,instance\ntest.pcd,fruit,pear\n");
    expect![[r#"
        clouds.parquet: sound Parquet file expected, got Parquet error: Invalid Parquet file. Corrupt footer
        write CSV or Parquet with the columns path, category and instance, and sequence, split and set if wanted"#]].assert_eq(&fixture.text(&load(&fixture, "clouds.parquet").unwrap_err()));
    let file = fixture.root().join("cut");
    write(&file, &[("path", text(["test.pcd"]))]);
    let whole = fs::read(&file).unwrap();
    for keep in 0..whole.len() {
        fs::write(&file, [&whole[..keep], b"PAR1"].concat()).unwrap();
        load(&fixture, "cut").unwrap_err();
    }
}
