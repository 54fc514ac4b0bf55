//! One changed cell: whether the run digest changes and whether verification names it.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use blake3::Hasher;
use expect_test::expect;
use polars::prelude::{Column, DataFrame, DataType, IntoColumn, NamedFrom, Series};
use tempfile::tempdir;

use super::fixture::{self, genes};
use crate::parquet::encode;
use crate::read::{read_file, table_files};
use crate::record::{Context, Value};
use crate::tables::TableFile;
use crate::{Error, RunFolder, TableName, run_digest, verify};

/// Rewrites a file, checksum and all, with its frame changed.
pub fn rewrite(file: &Path, table: TableName, change: impl FnOnce(&mut TableFile)) {
    let mut content = read_file(file, table).unwrap();
    change(&mut content);
    fs::write(file, encode(&content.table, content.frame, file).unwrap()).unwrap();
}

/// The column with the cell in `row` replaced by another value of its kind.
fn altered(column: &Column, row: usize) -> Column {
    let name = column.name().clone();
    macro_rules! replace {
        ($cells:expr, $change:expr) => {
            Column::new(
                name,
                $cells
                    .iter()
                    .enumerate()
                    .map(|(at, cell)| if at == row { cell.map($change) } else { cell })
                    .collect::<Vec<_>>(),
            )
        };
    }
    match column.dtype() {
        DataType::UInt32 => replace!(column.u32().unwrap(), |number: u32| number + 1),
        DataType::UInt64 => replace!(column.u64().unwrap(), |number: u64| number - 1),
        DataType::Float64 => replace!(column.f64().unwrap(), f64::next_up),
        DataType::Boolean => replace!(column.bool().unwrap(), |flag: bool| !flag),
        DataType::String => {
            let cells = column.str().unwrap().iter().enumerate();
            let text = |(at, cell): (usize, Option<&str>)| {
                cell.map(|cell| format!("{cell}{}", if at == row { "0" } else { "" }))
            };
            Column::new(name, cells.map(text).collect::<Vec<_>>())
        }
        DataType::List(_) => {
            let frame = DataFrame::new(column.len(), vec![column.clone()]).unwrap();
            let mut lists = Vec::<f32>::read(&name, &frame, &[]).unwrap();
            lists[row].iter_mut().flatten().for_each(|number| *number = number.next_up());
            let lists: Vec<_> = lists.iter().map(Option::as_ref).collect();
            Vec::cells(&name, &Context::default(), &lists).unwrap().remove(0)
        }
        other => {
            let cells = column.cast(&DataType::Int64).unwrap();
            replace!(cells.i64().unwrap(), |time: i64| time + 1).cast(other).unwrap()
        }
    }
}

/// The column with the cell in `row` changed from null to a value or back.
fn nulled(column: &Column, row: usize) -> Column {
    let rows = column.len();
    let null = Column::full_null(column.name().clone(), 1, column.dtype());
    let one = Series::new(column.name().clone(), ["1"]);
    // No text is a time.
    let one = if column.dtype().is_temporal() { one.cast(&DataType::Int64).unwrap() } else { one };
    let one = one.cast(column.dtype()).unwrap().into_column();
    let mut cell = if column.get(row).unwrap().is_null() { one } else { null };
    let mut whole = column.slice(0, row);
    cell.append(&column.slice(row as i64 + 1, rows - row - 1)).unwrap();
    whole.append(&cell).unwrap();
    whole
}

/// Every cell change of every table: table, column, file, row, whether from or to null.
fn each_change(run: &Path, check: impl FnMut(TableName, &crate::Column, &Path, usize, bool)) {
    each_change_of(&TableName::RUN, run, check);
}

/// Every cell change of these tables.
pub fn each_change_of(
    tables: &[TableName],
    run: &Path,
    mut check: impl FnMut(TableName, &crate::Column, &Path, usize, bool),
) {
    for &name in tables {
        for file in table_files(run, name).unwrap() {
            let content = read_file(&file, name).unwrap();
            for column in &content.table.columns {
                for row in 0..content.frame.height() {
                    let null = content.frame.column(&column.name).unwrap().get(row).unwrap().is_null();
                    if !null {
                        check(name, column, &file, row, false);
                    }
                    if column.nullable {
                        check(name, column, &file, row, true);
                    }
                }
            }
        }
    }
}

pub fn change(file: &Path, name: TableName, column: &str, row: usize, null: bool) {
    rewrite(file, name, |content| {
        let cells = content.frame.column(column).unwrap();
        let cells = if null { nulled(cells, row) } else { altered(cells, row) };
        content.frame.with_column(cells).unwrap();
    });
}

#[test]
fn any_covered_cell_changes_the_run_digest_and_no_other_does() {
    let folder = tempdir().unwrap();
    let digest = fixture::write(folder.path());
    assert_eq!(run_digest(folder.path()).unwrap().to_string(), digest);
    let mut covered = 0;
    each_change(folder.path(), |name, column, file, row, null| {
        // What the digest is computed over, not what it says.
        if (name, column.name.as_str()) == (TableName::Run, "generations") {
            return;
        }
        let before = fs::read(file).unwrap();
        change(file, name, &column.name, row, null);
        let changed = run_digest(folder.path()).unwrap().to_string() != digest;
        fs::write(file, before).unwrap();
        assert_eq!(changed, column.in_digest, "{name}.{} row {row}, null {null}", column.name);
        covered += u32::from(changed);
    });
    // 11 digest columns of 6 individuals alone, without the changes to and from null.
    assert!(covered > 66);
    assert_eq!(run_digest(folder.path()).unwrap().to_string(), digest);
}

#[test]
fn verification_notices_every_changed_cell() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let mut unnoticed: BTreeMap<String, u32> = BTreeMap::new();
    each_change(folder.path(), |name, column, file, row, null| {
        let before = fs::read(file).unwrap();
        change(file, name, &column.name, row, null);
        let problems = verify(folder.path()).map(|verification| verification.problems);
        fs::write(file, before).unwrap();
        let noticed = problems.is_err() || problems.is_ok_and(|problems| !problems.is_empty());
        assert!(noticed || !column.in_digest, "{name}.{} row {row}, null {null}", column.name);
        if !noticed {
            *unnoticed.entry(format!("{name}.{}", column.name)).or_default() += 1;
        }
    });
    assert_eq!(unnoticed, BTreeMap::new());
}

#[test]
fn verification_names_the_generation_and_the_table() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let mut report = String::new();
    let mut check = |file: &str, column: &str, row| {
        let (table, _) = file.split_once('/').unwrap();
        let name = TableName::RUN.into_iter().find(|name| name.as_str() == table).unwrap();
        let file = folder.path().join(file);
        let before = fs::read(&file).unwrap();
        change(&file, name, column, row, false);
        report += &format!("# {table}.{column}\n");
        for problem in verify(folder.path()).unwrap().problems {
            let problem = problem.to_string();
            // What it is of depends on the bytes that the writer of Parquet makes.
            let row = "run: digest of its row";
            report += &format!("{}\n", if problem.starts_with(row) { row } else { &problem });
        }
        fs::write(file, before).unwrap();
    };
    check("evaluations/generation-00002.parquet", "R1", 2);
    check("evaluations/generation-00001.parquet", "fitness", 0);
    check("generations/generation-00001.parquet", "mutation_rate", 0);
    check("predictions/test.parquet", "distance", 1);
    check("run/run.parquet", "stop_reason", 0);
    check("run/run.parquet", "test_object_correct", 0);
    check("run/run.parquet", "generations", 0);
    // Digests differ with every change of the fixture; their first digits are enough to tell them apart.
    let report: Vec<String> =
        report.lines().map(|line| line.replace(&folder.path().display().to_string(), "FOLDER")).collect();
    let short = |word: &str| {
        if word.trim_end_matches(',').len() == 64 { word[..8].to_owned() } else { word.to_owned() }
    };
    let report: Vec<String> =
        report.iter().map(|line| line.split(' ').map(short).collect::<Vec<_>>().join(" ")).collect();
    expect![[r#"
        # evaluations.R1
        generation 2: digest of its rows: expected 207fba89 got 3d092cff
        run: run digest: expected 7d784a96 got 53d8351c
        # evaluations.fitness
        evaluations, generation 1, row 0: fitness: expected 0.5555555555555556, got 0.5555555555555557
        # generations.mutation_rate
        generation 1: digest of its rows: expected 453478f9 got 924420ee
        run: run digest: expected 7d784a96 got 9749425d
        # predictions.distance
        predictions: digest: expected a95bb75f got f50acd7d
        run: run digest: expected 7d784a96 got 11f96cd7
        # run.stop_reason
        run: run digest: expected 7d784a96 got b33183d0
        # run.test_object_correct
        run, row 0: test_object_correct: expected 2, got 3
        run, row 0: test_object_error: expected 0.0, got 0.3333333333333333
        # run.generations
        FOLDER/evaluations/generation-00003.parquet: cannot read this file, got: No such file or directory (os error 2)
        check that it is there and that the disk works
        run: digest of its row"#]].assert_eq(&report.join("\n"));
}

#[test]
fn verification_reports_damaged_missing_and_surplus_files() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let path = |name: &str| folder.path().join(name);
    fs::write(path("evaluations/generation-00001.parquet"), b"PAR1").unwrap();
    fs::remove_file(path("generations/generation-00002.parquet")).unwrap();
    fs::copy(path("predictions/test.parquet"), path("evaluations/generation-00003.parquet")).unwrap();
    fs::write(path("skipped/skipped.parquet"), b"").unwrap();
    let verification = verify(folder.path()).unwrap();
    assert_eq!(verification.computed_run_digest, None);
    let problems: Vec<String> = verification.problems.iter().map(ToString::to_string).collect();
    let problems = problems.join("\n").replace(&folder.path().display().to_string(), "FOLDER");
    expect![[r#"
        FOLDER/evaluations/generation-00003.parquet: the run has no such part
        remove the file
        FOLDER/evaluations/generation-00001.parquet: file is damaged or was changed: it does not begin and end as Parquet does
        restore it from a copy, or run the experiment again
        FOLDER/generations/generation-00002.parquet: cannot read this file, got: No such file or directory (os error 2)
        check that it is there and that the disk works
        FOLDER/skipped/skipped.parquet: file is damaged or was changed: it does not begin and end as Parquet does
        restore it from a copy, or run the experiment again"#]].assert_eq(&problems);
    assert!(run_digest(folder.path()).is_err());
}

#[test]
fn an_unfinished_run_cannot_be_verified() {
    let folder = tempdir().unwrap();
    RunFolder::create(folder.path(), &genes()).unwrap();
    assert!(matches!(verify(folder.path()), Err(Error::Unfinished(_))));
}

#[test]
fn the_order_of_rows_in_a_file_does_not_matter() {
    let folder = tempdir().unwrap();
    let digest = fixture::write(folder.path());
    for (table, file) in [
        (TableName::Evaluations, "evaluations/generation-00002.parquet"),
        (TableName::Predictions, "predictions/test.parquet"),
    ] {
        rewrite(&folder.path().join(file), table, |content| content.frame = content.frame.reverse());
    }
    assert_eq!(run_digest(folder.path()).unwrap().to_string(), digest);
}

#[test]
fn a_gene_taken_out_of_the_metadata_changes_the_digest() {
    let folder = tempdir().unwrap();
    let digest = fixture::write(folder.path());
    rewrite(&folder.path().join("evaluations/generation-00001.parquet"), TableName::Evaluations, |content| {
        for column in content.table.columns.iter_mut().filter(|column| column.name == "w") {
            column.gene = false;
        }
    });
    assert_ne!(run_digest(folder.path()).unwrap().to_string(), digest);
}

/// The encoding written out by hand, as the digest's documentation has it.
#[test]
fn the_digest_of_a_generation_is_that_of_its_documented_encoding() {
    fn text(bytes: &mut Vec<u8>, text: &str) {
        bytes.extend((text.len() as u64).to_le_bytes());
        bytes.extend(text.as_bytes());
    }
    fn number(bytes: &mut Vec<u8>, name: &str, number: u64) {
        text(bytes, name);
        bytes.push(b'u');
        bytes.extend(number.to_le_bytes());
    }
    fn float(bytes: &mut Vec<u8>, name: &str, float: f64) {
        text(bytes, name);
        bytes.push(b'f');
        bytes.extend(float.to_bits().to_le_bytes());
    }
    let mut bytes = Vec::new();
    text(&mut bytes, "evaluations");
    bytes.extend(3u64.to_le_bytes());
    for row in fixture::population(2) {
        number(&mut bytes, "generation", 2);
        number(&mut bytes, "individual", row.individual.into());
        text(&mut bytes, "chromosome");
        bytes.push(b's');
        text(&mut bytes, &row.chromosome);
        number(&mut bytes, "shape_bins", row.genes[0].unwrap() as u64);
        float(&mut bytes, "R1", row.genes[2].unwrap());
        float(&mut bytes, "w", row.genes[3].unwrap());
        number(&mut bytes, "object_correct", row.counts.object_correct.into());
        number(&mut bytes, "category_correct", row.counts.category_correct.into());
        for (name, parent) in ["parent_a", "parent_b"].iter().zip([row.parent_a, row.parent_b]) {
            if let Some(parent) = parent {
                number(&mut bytes, name, parent.into());
            }
        }
        text(&mut bytes, "");
    }
    text(&mut bytes, "generations");
    bytes.extend(1u64.to_le_bytes());
    number(&mut bytes, "generation", 2);
    number(&mut bytes, "validation_object_correct", 1);
    number(&mut bytes, "validation_category_correct", 2);
    number(&mut bytes, "validation_queries", 2);
    float(&mut bytes, "mutation_rate", 0.4 * 0.97);
    text(&mut bytes, "");
    let expected = Hasher::new_derive_key("descry generation rows v1").update(&bytes).finalize();

    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let read = |table: TableName| {
        let file: PathBuf = table_files(folder.path(), table).unwrap().remove(1);
        read_file(&file, table).unwrap()
    };
    let (evaluations, generations) = (read(TableName::Evaluations), read(TableName::Generations));
    assert_eq!(digest_of(&evaluations, &generations), expected);
    let recorded = generations.frame.column("rows_digest").unwrap().str().unwrap().get(0).unwrap().to_owned();
    assert_eq!(recorded, expected.to_string());
}

fn digest_of(evaluations: &TableFile, generations: &TableFile) -> blake3::Hash {
    crate::digest::generation_rows(evaluations, generations).unwrap()
}
