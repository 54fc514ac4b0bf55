//! Writing a run folder: what comes back, what survives a crash, what is refused.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use expect_test::{Expect, expect};
use tempfile::{TempDir, tempdir};

use super::fixture::{self, frame, generation, genes, population};
use crate::record::Context;
use crate::*;

/// A file that another machine's process has left half written.
const TEMPORARY: &str = ".tmp-another.host-1-xxxxxxxxxxxx";

fn open(folder: &TempDir) -> RunFolder {
    RunFolder::create(folder.path(), &genes()).unwrap()
}

/// The message with the temporary folder's name taken out.
fn message(folder: &Path, error: &Error) -> String {
    error.to_string().replace(&folder.display().to_string(), "FOLDER")
}

#[track_caller]
fn refused<T: std::fmt::Debug>(folder: &TempDir, result: Result<T, Error>, expected: Expect) {
    expected.assert_eq(&message(folder.path(), &result.unwrap_err()));
}

fn files(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(below) = folders.pop() {
        for entry in fs::read_dir(folder.join(&below)).unwrap() {
            let entry = entry.unwrap();
            let name = below.join(entry.file_name());
            if entry.file_type().unwrap().is_dir() {
                folders.push(name);
            } else {
                found.push(name.to_str().unwrap().to_owned());
            }
        }
    }
    found.sort();
    found
}

#[test]
fn what_is_written_is_read_back() {
    let folder = tempdir().unwrap();
    let digest = fixture::write(folder.path());

    let evaluations = read_table(folder.path(), TableName::Evaluations).unwrap();
    let table = Table::new(TableName::Evaluations, &genes()).unwrap();
    let names: Vec<_> = table.columns.iter().map(|column| column.name.as_str()).collect();
    assert_eq!(evaluations.get_column_names(), names);
    let mut expected = frame(TableName::Evaluations, &population(1), Context::default());
    expected.vstack_mut(&frame(TableName::Evaluations, &population(2), Context::default())).unwrap();
    assert!(evaluations.equals_missing(&expected));

    let generations = read_table(folder.path(), TableName::Generations).unwrap();
    assert_eq!(generations.height(), 2);
    let rows_digest = generations.column("rows_digest").unwrap();
    assert!(rows_digest.str().unwrap().iter().flatten().all(|digest| digest.len() == 64));
    for number in 1..=2u32 {
        let context = fixture::context(&population(number));
        let expected = frame(TableName::Generations, &[generation(number)], context);
        let got = generations.slice(i64::from(number) - 1, 1).drop("rows_digest").unwrap();
        assert!(got.equals_missing(&expected.drop("rows_digest").unwrap()));
    }

    let predictions = read_table(folder.path(), TableName::Predictions).unwrap();
    let [validation, test] = PredictionSplit::ALL.map(|split| {
        frame(TableName::Predictions, &fixture::predictions(split), fixture::labelled(&[split.as_str()]))
    });
    assert!(predictions.equals_missing(&test.vstack(&validation).unwrap()));

    let skipped = read_table(folder.path(), TableName::Skipped).unwrap();
    assert!(skipped.equals_missing(&frame(TableName::Skipped, &fixture::skipped(), Context::default())));

    let RunLog { workers, attempts, events } = fixture::log();
    for (name, expected) in [
        (TableName::Workers, frame(TableName::Workers, &workers, Context::default())),
        (TableName::Attempts, frame(TableName::Attempts, &attempts, Context::default())),
        (TableName::Events, frame(TableName::Events, &events, Context::default())),
    ] {
        assert!(read_table(folder.path(), name).unwrap().equals_missing(&expected), "{name}");
    }

    let finished = read_run(folder.path()).unwrap();
    assert_eq!(finished, FinishedRun { row: fixture::run(), genes: genes(), run_digest: digest });
}

#[test]
fn evaluations_are_read_back_for_those_who_compute_them_again() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let written: Vec<_> = (1..=2).flat_map(population).collect();
    assert_eq!(read_evaluations(folder.path()).unwrap(), written);
    for split in PredictionSplit::ALL {
        assert_eq!(read_predictions(folder.path(), split).unwrap(), fixture::predictions(split));
    }
}

/// The query that the README shows.
#[test]
fn a_table_answers_lazy_queries() -> Result<(), Error> {
    use polars::prelude::*;
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let best = read_table(folder.path(), TableName::Evaluations)?
        .lazy()
        .sort(["object_correct"], SortMultipleOptions::default().with_order_descending(true))
        .select([col("chromosome"), col("object_error")])
        .limit(10)
        .collect()?;
    assert_eq!(best.shape(), (6, 2));
    assert_eq!(best.column("chromosome")?.str()?.get(0), Some(fixture::run().best_chromosome.as_str()));
    Ok(())
}

#[test]
fn shares_are_derived_from_counts() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let frame = read_table(folder.path(), TableName::Evaluations).unwrap();
    // Individual 1 of generation 2: 8 of 9 objects and all 9 categories right.
    let cell = |name: &str| frame.column(name).unwrap().f64().unwrap().get(4).unwrap();
    assert_eq!((cell("fitness"), cell("object_error"), cell("category_error")), (8.0 / 9.0, 1.0 / 9.0, 0.0));
}

#[test]
fn tables_without_rows_are_still_tables() {
    let folder = tempdir().unwrap();
    let out = open(&folder);
    out.write_skipped(&[]).unwrap();
    out.write_predictions(PredictionSplit::Test, &[]).unwrap();
    out.write_log(&RunLog::default()).unwrap();
    let empty = [
        TableName::Skipped,
        TableName::Predictions,
        TableName::Workers,
        TableName::Attempts,
        TableName::Events,
    ];
    for name in empty {
        let frame = read_table(folder.path(), name).unwrap();
        assert_eq!((frame.height(), frame.width()), (0, Table::new(name, &[]).unwrap().columns.len()));
    }
}

/// Some polars types panic when printed, depending on its features.
#[test]
fn every_table_can_be_printed() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    for name in TableName::RUN {
        let frame = read_table(folder.path(), name).unwrap();
        for column in frame.columns() {
            assert!(format!("{column:?}").contains(column.name().as_str()));
        }
    }
}

#[test]
fn every_file_has_its_place() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    expect![[r#"
        .lock
        attempts/attempts.parquet
        evaluations/generation-00001.parquet
        evaluations/generation-00002.parquet
        events/events.parquet
        generations/generation-00001.parquet
        generations/generation-00002.parquet
        looks/head
        looks/look-00001.parquet
        predictions/test.parquet
        predictions/validation.parquet
        run/run.parquet
        skipped/skipped.parquet
        workers/workers.parquet"#]]
    .assert_eq(&files(folder.path()).join("\n"));
}

#[test]
fn a_run_goes_on_after_a_crash_between_any_two_files() {
    let whole = tempdir().unwrap();
    let digest = fixture::write(whole.path());
    let names = [
        "evaluations/generation-00001.parquet",
        "generations/generation-00001.parquet",
        "evaluations/generation-00002.parquet",
        "generations/generation-00002.parquet",
        "predictions/validation.parquet",
        "predictions/test.parquet",
        "skipped/skipped.parquet",
    ];
    for written in 0..=names.len() {
        let folder = tempdir().unwrap();
        drop(open(&folder));
        for name in &names[..written] {
            fs::copy(whole.path().join(name), folder.path().join(name)).unwrap();
        }
        // The next file was half written when the process was killed.
        if let Some(next) = names.get(written) {
            let (table, _) = next.split_once('/').unwrap();
            fs::write(folder.path().join(table).join(TEMPORARY), b"PAR1half").unwrap();
        }
        assert!(matches!(read_run(folder.path()), Err(Error::Unfinished(_))));
        if written > 0 {
            let rows = if written < 3 { 3 } else { 6 };
            assert_eq!(read_table(folder.path(), TableName::Evaluations).unwrap().height(), rows);
        }

        let mut out = open(&folder);
        assert_eq!(out.generations(), (written as u32 / 2).min(2));
        assert!(!out.is_finished());
        assert_eq!(files(folder.path()).len(), 1 + written, "the half file is gone");
        for number in out.generations() + 1..=2 {
            out.write_generation(&population(number), &generation(number)).unwrap();
        }
        for split in PredictionSplit::ALL {
            out.write_predictions(split, &fixture::predictions(split)).unwrap();
        }
        assert_eq!(out.write_run(&fixture::run()).unwrap().to_string(), digest);
        assert!(out.is_finished());
        assert!(verify(folder.path()).unwrap().is_intact());
    }
}

#[test]
fn a_full_disk_leaves_no_file_and_says_what_to_do() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("generation-00001.parquet");
    let failed = |source| Error::io(&path, "write this file", source);
    let result = atomic::write_with(&path, |file| {
        file.write_all(b"PAR1 and so")?;
        Err(io::Error::from(io::ErrorKind::StorageFull))
    });
    let result = result.map_err(failed);
    refused(
        &folder,
        result,
        expect![[r#"
            FOLDER/generation-00001.parquet: disk is full, got: no storage space
            free some space and start the run again: it lost nothing that was acknowledged"#]],
    );
    assert!(files(folder.path()).is_empty());

    // A later failure leaves the earlier whole file.
    crate::file::write_whole(&path, b"first").unwrap();
    let result = atomic::write_with(&path, |_| Err(io::Error::from(io::ErrorKind::QuotaExceeded)));
    assert!(matches!(result.map_err(failed), Err(Error::DiskFull { .. })));
    assert_eq!(fs::read(&path).unwrap(), b"first");
    assert_eq!(files(folder.path()).len(), 1);
}

#[test]
fn a_folder_has_one_writer() {
    let folder = tempdir().unwrap();
    let first = open(&folder);
    refused(
        &folder,
        RunFolder::create(folder.path(), &genes()),
        expect![[r#"
            FOLDER: run folder is in use by another process
            wait for it to end or choose another folder"#]],
    );
    drop(first);
    open(&folder);
}

#[test]
fn a_file_in_place_of_the_folder_is_refused() {
    let folder = tempdir().unwrap();
    fs::write(folder.path().join("file"), "").unwrap();
    for run in ["file", "file/run"] {
        let path = folder.path().join(run);
        let error = RunFolder::create(&path, &genes()).unwrap_err();
        assert!(matches!(error, Error::NotAFolder(_)), "{error}");
    }
    refused(
        &folder,
        RunFolder::create(folder.path().join("file"), &genes()),
        expect![[r#"
            FOLDER/file: run folder is not a folder, got a file
            choose another folder"#]],
    );
}

#[test]
fn a_folder_without_permission_is_refused() {
    let denied = crate::folder::opening(Path::new("runs/a"), io::ErrorKind::PermissionDenied.into());
    expect![[r#"
        runs/a: run folder is not writable, got: permission denied
        change its permissions or choose another folder"#]]
    .assert_eq(&denied.to_string());
}

#[test]
fn a_finished_run_does_not_change() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let mut out = open(&folder);
    assert_eq!((out.is_finished(), out.generations()), (true, 2));
    let results = [
        out.write_generation(&population(3), &generation(3)).map(|_| ()),
        out.write_predictions(PredictionSplit::Test, &[]),
        out.write_skipped(&[]),
        out.write_run(&fixture::run()).map(|_| ()),
    ];
    for result in results {
        refused(
            &folder,
            result,
            expect![[r#"
                FOLDER: run is finished and its results do not change
                choose another folder or discard the run first"#]],
        );
    }
}

#[test]
fn discarding_removes_what_the_run_wrote_and_nothing_else() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let foreign = [
        "journal.log",
        "notes.parquet",
        "evaluations/mine.parquet",
        "evaluations/generation-1.parquet",
        "run/run.txt",
        "predictions/train.parquet",
    ];
    for name in foreign {
        fs::write(folder.path().join(name), "mine").unwrap();
    }
    fs::write(folder.path().join("run").join(TEMPORARY), "half").unwrap();
    let mut out = open(&folder);
    out.discard().unwrap();
    assert_eq!((out.is_finished(), out.generations()), (false, 0));
    let mut expected = foreign.map(str::to_owned).to_vec();
    // Looks at the test clouds were had, whatever becomes of the run.
    expected.extend([".lock", "looks/head", "looks/look-00001.parquet"].map(str::to_owned));
    expected.sort();
    assert_eq!(files(folder.path()), expected);
    out.write_generation(&population(1), &generation(1)).unwrap();
}

#[test]
fn generations_are_written_once_and_in_order() {
    let folder = tempdir().unwrap();
    let mut out = open(&folder);
    out.write_generation(&population(1), &generation(1)).unwrap();
    refused(
        &folder,
        out.write_generation(&population(1), &generation(1)),
        expect![[r#"
            generation: expected 2 next, got 1
            write generations in order, each once"#]],
    );
    assert!(matches!(
        out.write_generation(&population(2), &generation(3)),
        Err(Error::Order { expected: 2, got: 3 })
    ));
    assert!(matches!(out.write_run(&fixture::run()), Err(Error::Order { expected: 1, got: 2 })));
    assert_eq!(files(folder.path()).len(), 3);
}

#[test]
fn rows_that_cannot_be_true_are_refused() {
    let check = |change: fn(&mut Vec<EvaluationRow>, &mut GenerationRow), expected: Expect| {
        let folder = tempdir().unwrap();
        let (mut rows, mut row) = (population(1), generation(1));
        change(&mut rows, &mut row);
        let error = open(&folder).write_generation(&rows, &row).unwrap_err();
        expected.assert_eq(message(folder.path(), &error).lines().next().unwrap());
        assert_eq!(files(folder.path()), [".lock"], "nothing is written");
    };
    check(
        |rows, _| rows.clear(),
        expect!["evaluations row 0, individual: expected at least one individual, got none"],
    );
    check(|rows, _| rows.swap(0, 1), expect!["evaluations row 0, individual: expected 0, got 1"]);
    check(
        |rows, _| rows[2].chromosome.push('0'),
        expect!["evaluations row 2, chromosome: expected 6 bits 0 or 1, got 0101010"],
    );
    check(
        |rows, _| rows[0].chromosome = "01x101".into(),
        expect!["evaluations row 0, chromosome: expected 6 bits 0 or 1, got 01x101"],
    );
    check(
        |rows, _| rows[1].genes.truncate(3),
        expect!["evaluations row 1, genes: expected 4 gene values, got 3"],
    );
    check(
        |rows, _| rows[1].genes[0] = Some(8.5),
        expect!["evaluations row 1, shape_bins: expected a whole number, got 8.5"],
    );
    check(
        |rows, _| rows[1].genes[0] = Some(f64::NAN),
        expect!["evaluations row 1, shape_bins: expected a whole number, got NaN"],
    );
    check(
        |rows, _| rows[1].genes[2] = Some(f64::INFINITY),
        expect![[
            r#"FOLDER/evaluations/generation-00001.parquet: column R1: expected a finite number, got inf"#
        ]],
    );
    check(
        |rows, _| rows[1].counts.object_correct = 10,
        expect!["evaluations row 1, object_correct: expected at most 9, got 10"],
    );
    check(|rows, _| rows[1].counts.queries = 10, expect!["evaluations row 1, queries: expected 9, got 10"]);
    check(
        |rows, _| {
            rows.iter_mut()
                .for_each(|row| row.counts = Counts { object_correct: 0, category_correct: 0, queries: 0 })
        },
        expect!["evaluations row 0, queries: expected at least 1, got 0"],
    );
    check(
        |_, row| row.validation = Some(Counts { object_correct: 1, category_correct: 3, queries: 2 }),
        expect!["generations row 0, validation_category_correct: expected at most 2, got 3"],
    );
    check(
        |_, row| row.mutation_rate = f64::NAN,
        expect![[
            r#"FOLDER/generations/generation-00001.parquet: column mutation_rate: expected a finite number, got NaN"#
        ]],
    );
}

#[test]
fn predictions_come_in_query_order() {
    let folder = tempdir().unwrap();
    let mut rows = fixture::predictions(PredictionSplit::Test);
    rows[2].query = 1;
    let result = open(&folder).write_predictions(PredictionSplit::Test, &rows);
    assert!(matches!(result, Err(Error::Row { row: 2, .. })));
}

#[test]
fn what_an_ended_process_left_half_made_beside_the_tables_is_removed() {
    let folder = tempdir().unwrap();
    let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap();
    // No process has this number: it is above the largest that Linux gives.
    let abandoned = folder.path().join(format!(".tmp-{}-4194305-xxxxxxxxxxxx", host.trim()));
    fs::write(&abandoned, "half").unwrap();
    drop(open(&folder));
    assert!(!abandoned.exists());
}
