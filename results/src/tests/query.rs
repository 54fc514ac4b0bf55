//! SQL over run and grid folders.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use tempfile::tempdir;

use super::fixture::{self, generation, genes, population, predictions};
use crate::*;

fn sample() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/v1")
}

#[track_caller]
fn written(folders: &[&Path], sql: &str, format: AnswerFormat) -> String {
    let answer = query(folders, sql).unwrap_or_else(|error| panic!("{error}"));
    let mut bytes = Vec::new();
    answer.write(format, &mut bytes).unwrap();
    String::from_utf8(bytes).unwrap()
}

#[track_caller]
fn rows(folders: &[&Path], sql: &str) -> Value {
    serde_json::from_str(&written(folders, sql, AnswerFormat::Json)).unwrap()
}

#[track_caller]
fn refused(folder: &Path, sql: &str) -> QueryError {
    match query(&[folder], sql) {
        Ok(answer) => panic!("{sql}: {:?}", answer.frame()),
        Err(error) => error,
    }
}

/// Expected values come from the rows that were written, not from the tables.
#[test]
fn a_question_is_answered_from_the_rows_that_were_written() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let all: Vec<EvaluationRow> = (1..=2).flat_map(population).collect();
    let right: u32 = all.iter().map(|row| row.counts.object_correct).sum();
    let answer = rows(&[folder.path()], "SELECT COUNT(*) AS n, SUM(object_correct) AS c FROM evaluations");
    assert_eq!(answer, json!([{ "n": all.len(), "c": right }]));

    let wrong =
        predictions(PredictionSplit::Test).into_iter().filter(|row| row.instance != row.predicted_instance);
    let wrong: Vec<Value> =
        wrong.map(|row| json!({ "cloud": row.cloud, "distance": row.distance })).collect();
    let sql =
        "SELECT cloud, distance FROM predictions WHERE split = 'test' AND NOT correct_object ORDER BY query";
    assert_eq!(rows(&[folder.path()], sql), Value::Array(wrong));

    // The winner's parents: a table joined with itself and with another.
    let sql = "WITH child AS (SELECT generation - 1 AS before, parent_a AS a, parent_b AS b FROM evaluations \
               JOIN run ON generation = winner_generation AND individual = winner_individual) \
               SELECT individual FROM evaluations JOIN child ON generation = before \
               WHERE individual = a OR individual = b ORDER BY individual";
    let run = fixture::run();
    let winner = fixture::individual(run.winner_generation, run.winner_individual);
    let mut parents: Vec<u32> = [winner.parent_a, winner.parent_b].into_iter().flatten().collect();
    parents.sort_unstable();
    let expected: Vec<Value> = parents.iter().map(|parent| json!({ "individual": parent })).collect();
    assert_eq!(rows(&[folder.path()], sql), Value::Array(expected));
}

#[test]
fn numbers_come_back_as_they_were_written_in_csv_and_json() {
    let folder = tempdir().unwrap();
    let mut out = RunFolder::create(folder.path(), &genes()).unwrap();
    let seconds = [0.1 + 0.2, 1e-300, 5e-324, 1.797_693_134_862_315_7e308, 0.0, -0.0, 1.0 / 3.0];
    for (number, seconds) in (1..).zip(seconds) {
        let mut individuals = population(number.min(2));
        individuals.iter_mut().for_each(|individual| individual.generation = number);
        out.write_generation(&individuals, &GenerationRow { seconds, ..generation(number) }).unwrap();
    }
    let sql = "SELECT seconds, validation_queries FROM generations ORDER BY generation";
    // serde_json reads floats only nearly right.
    let json = written(&[folder.path()], sql, AnswerFormat::Json);
    let json: Vec<(&str, &str)> = json
        .lines()
        .filter_map(|line| line.strip_prefix("{\"seconds\":")?.split_once(",\"validation_queries\":"))
        .collect();
    let text = written(&[folder.path()], sql, AnswerFormat::Csv);
    let mut csv = csv::Reader::from_reader(text.as_bytes());
    assert_eq!(csv.headers().unwrap(), vec!["seconds", "validation_queries"]);
    let records: Vec<csv::StringRecord> = csv.records().collect::<Result<_, _>>().unwrap();
    assert_eq!(records.len(), seconds.len());
    for (row, seconds) in seconds.iter().enumerate() {
        assert_eq!(records[row][0].parse::<f64>().unwrap().to_bits(), seconds.to_bits());
        assert_eq!(json[row].0.parse::<f64>().unwrap().to_bits(), seconds.to_bits());
    }
    // NULL, and a number.
    assert_eq!((&records[0][1], json[0].1), ("", "null},"));
    assert_eq!((&records[1][1], json[1].1), ("2", "2},"));
}

#[test]
fn times_are_iso_8601_durations_seconds_and_large_integers_whole() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let sql = "SELECT started_at, finished_at - started_at AS took, seed, 0.0 / 0 AS none, CAST(started_at AS DATE) \
               AS day FROM run";
    assert_eq!(
        rows(&[folder.path()], sql),
        json!([{
            "started_at": "2023-11-14T22:13:20.123Z", "took": 5.333, "seed": u64::MAX, "none": null,
            "day": "2023-11-14",
        }])
    );
    assert_eq!(
        written(&[folder.path()], sql, AnswerFormat::Csv),
        "started_at,took,seed,none,day\n2023-11-14T22:13:20.123Z,5.333,18446744073709551615,NaN,2023-11-14\n"
    );
    let sql = "SELECT ARRAY_AGG(generation) AS all FROM generations";
    assert_eq!(rows(&[folder.path()], sql), json!([{ "all": [1, 2] }]));
    assert_eq!(written(&[folder.path()], sql, AnswerFormat::Csv), "all\n\"[1,2]\"\n");
}

#[test]
fn no_text_of_a_csv_is_a_formula_and_numbers_stay_numbers() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    for (text, expected) in [
        ("=1+1", "'=1+1"),
        ("+1", "'+1"),
        ("-2+3", "'-2+3"),
        ("@SUM(A1)", "'@SUM(A1)"),
        ("\t=1", "'\t=1"),
        ("\r=1", "'\r=1"),
        ("\n=1", "'\n=1"),
        ("\u{ff1d}1", "'\u{ff1d}1"),
        ("=HYPERLINK(\"http://example.org\",\"a, b\")", "'=HYPERLINK(\"http://example.org\",\"a, b\")"),
        ("mug=1", "mug=1"),
        ("1-1", "1-1"),
        ("", ""),
    ] {
        let sql = format!("SELECT '{text}' AS text, -1.5 AS float, -7 AS whole FROM run");
        let csv = written(&[folder.path()], &sql, AnswerFormat::Csv);
        let mut reader = csv::Reader::from_reader(csv.as_bytes());
        let record = reader.records().next().unwrap().unwrap();
        assert_eq!(record, vec![expected, "-1.5", "-7"], "{csv}");
        // JSON is for programs, and exact.
        assert_eq!(rows(&[folder.path()], &sql)[0]["text"], json!(text));
    }
    let header =
        written(&[folder.path()], "SELECT generation AS \"=1+1\" FROM generations", AnswerFormat::Csv);
    assert!(header.starts_with("'=1+1\n1\n"), "{header}");
}

#[test]
fn a_table_for_people_cuts_nothing_off_and_obeys_no_name() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let sql = "SELECT worker, departure, answers, 2.0 / 3 AS share FROM workers ORDER BY worker";
    let expected = "worker  departure  answers     share\n------  ---------  -------  --------\n\
                    first   lost             3  0.666667\nsecond  null          null  0.666667\n(2 rows)\n";
    assert_eq!(written(&[folder.path()], sql, AnswerFormat::Table), expected);
    let sql = "SELECT chromosome FROM evaluations WHERE generation > 2";
    let expected = "chromosome\n----------\n(0 rows)\n";
    assert_eq!(written(&[folder.path()], sql, AnswerFormat::Table), expected);
    assert_eq!(written(&[folder.path()], sql, AnswerFormat::Json), "[]\n");
    assert_eq!(written(&[folder.path()], sql, AnswerFormat::Csv), "chromosome\n");
    let text = written(&[folder.path()], "SELECT '\u{1b}[31mred\n' AS a, 1 AS b", AnswerFormat::Table);
    assert!(text.contains("\\u{1b}[31mred\\n") && !text.contains('\u{1b}'), "{text}");
    // A row of forty columns is a column a line, its texts whole.
    let text = written(&[folder.path()], "SELECT * FROM run", AnswerFormat::Table);
    assert!(text.contains("\nseed                             18446744073709551615\n"), "{text}");
    assert!(
        text.contains(
            "resolved_toml                    version = 1\n                                 seed = "
        ),
        "{text}"
    );
    assert_eq!(text.lines().filter(|line| line.starts_with("run_digest ")).count(), 1);
}

#[test]
fn only_the_tables_that_a_query_names_are_read_and_those_are_verified() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let file = folder.path().join("evaluations/generation-00002.parquet");
    let mut bytes = fs::read(&file).unwrap();
    bytes[100] ^= 1;
    fs::write(&file, bytes).unwrap();
    assert_eq!(rows(&[folder.path()], "SELECT COUNT(*) AS n FROM generations"), json!([{ "n": 2 }]));
    let error = refused(folder.path(), "SELECT 1 FROM evaluations").to_string();
    assert!(error.contains("generation-00002.parquet: file is damaged or was changed"), "{error}");
}

#[test]
fn an_unfinished_run_has_the_tables_that_are_there() {
    let folder = tempdir().unwrap();
    let mut out = RunFolder::create(folder.path(), &genes()).unwrap();
    assert!(matches!(refused(folder.path(), "SHOW TABLES"), QueryError::NoTables(_)));
    out.write_generation(&population(1), &generation(1)).unwrap();
    let there = rows(&[folder.path()], "SHOW TABLES");
    let names: Vec<&Value> = there.as_array().unwrap().iter().map(|row| &row["name"]).collect();
    assert_eq!(names, ["evaluations", "generations"]);
    match refused(folder.path(), "SELECT * FROM run") {
        QueryError::Table { got, known: true, there } => {
            assert_eq!((got.as_str(), there.len()), ("run", 2));
        }
        error => panic!("{error}"),
    }
    assert!(matches!(refused(folder.path(), "DESCRIBE cells"), QueryError::Table { known: true, .. }));
    assert!(matches!(refused(folder.path(), "DESCRIBE runs"), QueryError::Table { known: false, .. }));
}

#[test]
fn several_folders_say_whose_row_it_is_and_older_files_lack_nothing_but_values() {
    let sweep = tempdir().unwrap();
    for name in ["seed-1", "seed-2", "seed-10"] {
        fixture::write(&sweep.path().join(name));
    }
    fs::remove_file(sweep.path().join("seed-2/run/run.parquet")).unwrap();
    fs::create_dir_all(sweep.path().join("not a run/evaluations")).unwrap();
    let sql = "SELECT run_folder, COUNT(*) AS n FROM evaluations GROUP BY run_folder ORDER BY run_folder";
    let expected = json!([
        { "run_folder": "seed-1", "n": 6 }, { "run_folder": "seed-10", "n": 6 }, { "run_folder": "seed-2", "n": 6 },
    ]);
    assert_eq!(rows(&[sweep.path()], sql), expected);
    assert_eq!(
        rows(&[sweep.path(), &sweep.path().join("seed-2"), sweep.path()], sql),
        expected,
        "named twice"
    );
    let expected =
        json!([{ "run_folder": "seed-1", "seed": u64::MAX }, { "run_folder": "seed-10", "seed": u64::MAX }]);
    assert_eq!(
        rows(&[sweep.path()], "SELECT run_folder, seed FROM run"),
        expected,
        "in order of the folders"
    );
    let first = rows(&[sweep.path()], "SELECT * FROM generations LIMIT 1");
    assert_eq!(first[0].as_object().unwrap().keys().next().unwrap(), "run_folder");

    // One folder has the column if it is asked for.
    let one = sweep.path().join("seed-1");
    assert_eq!(rows(&[&one], "SELECT DISTINCT run_folder FROM run"), json!([{ "run_folder": "seed-1" }]));
    let first = rows(&[&one], "SELECT * FROM generations LIMIT 1");
    assert_eq!(first[0].as_object().unwrap().keys().next().unwrap(), "generation");

    // The sample of version 1 knows no regret.
    let old = rows(&[&sample(), &one], "SELECT run_folder, grid_best_object_correct AS g FROM run");
    assert_eq!(old, json!([{ "run_folder": "v1", "g": null }, { "run_folder": "seed-1", "g": 9 }]));
    assert!(matches!(query(&[sweep.path().join("none")], "SELECT 1"), Err(QueryError::NoFolder(_))));
}

#[test]
fn a_grid_is_asked_like_a_run_and_a_table_of_the_statement_is_not_taken_for_one_of_the_folder() {
    let folder = tempdir().unwrap();
    let out = GridFolder::create(folder.path(), &genes()).unwrap();
    for (name, correct) in [("a", vec![3, 5]), ("b", vec![4])] {
        let genes = genes().iter().map(|_| vec![Some(1.0); correct.len()]).collect();
        let points = CellPoints {
            genes,
            object_correct: correct,
            worker_id: Some("ab".to_owned()),
            principal: None,
            seconded: None,
            basis: None,
        };
        out.write_cell(name, &points).unwrap();
    }
    let answer = rows(&[folder.path()], "SELECT COUNT(*) AS n, MAX(object_correct) AS most FROM cells");
    assert_eq!(answer, json!([{ "n": 3, "most": 5 }]));
    let answer = rows(
        &[folder.path()],
        "SELECT object_correct FROM cells WHERE object_correct > 3 ORDER BY 1 LIMIT 1",
    );
    assert_eq!(answer, json!([{ "object_correct": 4 }]));
    let limited = rows(&[folder.path()], "SELECT object_correct AS c FROM cells LIMIT 2");
    assert_eq!(limited, json!([{ "c": 3 }, { "c": 5 }]));
    // polars would take the folder's table.
    let answer = rows(&[folder.path()], "WITH cells AS (SELECT 1 AS one) SELECT * FROM cells");
    assert_eq!(answer, json!([{ "one": 1 }]));
    let error = refused(folder.path(), "WITH cells AS (SELECT * FROM cells LIMIT 1) SELECT * FROM cells");
    assert!(matches!(error, QueryError::Defined(name) if name == "cells"));
}

#[test]
fn describe_tells_what_the_file_says_of_its_columns() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let rows = rows(&[folder.path()], "DESCRIBE evaluations");
    let table = Table::new(TableName::Evaluations, &genes()).unwrap();
    let expected: Vec<Value> = table
        .columns
        .iter()
        .map(|column| {
            json!({
                "column": column.name, "kind": column.kind.name(), "unit": column.unit, "nullable": column.nullable,
                "in_digest": column.in_digest, "meaning": column.meaning,
            })
        })
        .collect();
    assert_eq!(rows, Value::Array(expected));
}

#[test]
fn what_is_no_question_is_refused_and_nothing_else_is_read() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let other = folder.path().join("run/run.parquet").display().to_string();
    for sql in [
        "DROP TABLE run",
        "DELETE FROM run",
        "TRUNCATE TABLE run",
        "INSERT INTO run VALUES (1)",
        "UPDATE run SET seed = 1",
        "CREATE TABLE mine AS SELECT * FROM run",
        "COPY run TO 'run.csv'",
        "ATTACH 'run.db'",
        "",
    ] {
        assert!(matches!(refused(folder.path(), sql), QueryError::Statement(_)), "{sql}");
    }
    for sql in [
        "SELECT 1; DROP TABLE run".to_owned(),
        "WITH a AS (SELECT 1) DELETE FROM run".to_owned(),
        "SELECT * INTO mine FROM run".to_owned(),
        format!("SELECT * FROM read_parquet('{other}')"),
        "SELECT * FROM read_csv('Cargo.toml')".to_owned(),
        "SELECT * FROM read_ipc('Cargo.toml')".to_owned(),
        "SELECT * FROM read_json('Cargo.toml')".to_owned(),
        "SELECT * FROM parquet_scan('Cargo.toml')".to_owned(),
        "SELECT".to_owned(),
        "SELECT no_such_function(1)".to_owned(),
    ] {
        assert!(matches!(refused(folder.path(), &sql), QueryError::Polars { .. }), "{sql}");
    }
    for table in [format!("'{other}'"), format!("\"{other}\""), "\"../run\"".to_owned()] {
        let error = refused(folder.path(), &format!("SELECT * FROM {table}"));
        assert!(matches!(error, QueryError::Table { known: false, .. }), "{table}: {error}");
    }
}

#[test]
fn unknown_columns_are_named_with_those_that_there_are() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    for sql in [
        "SELECT fitnes FROM evaluations",
        "SELECT e.fitnes FROM evaluations AS e",
        "SELECT generation FROM evaluations WHERE fitnes > 0.5",
        "SELECT MAX(fitnes) FROM evaluations GROUP BY generation",
        "SELECT generation FROM evaluations ORDER BY fitnes",
    ] {
        match refused(folder.path(), sql) {
            QueryError::Column { got, there, elsewhere } => {
                assert_eq!(got, "fitnes", "{sql}");
                assert!(there.iter().any(|name| name == "fitness") && there.len() > 15, "{sql}: {there:?}");
                assert_eq!(elsewhere, Vec::<String>::new(), "{sql}");
            }
            error => panic!("{sql}: {error}"),
        }
    }
}

#[test]
fn statements_that_are_too_long_or_too_deep_end_in_an_error() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let long = format!("SELECT '{}'", "x".repeat(LONGEST_QUERY));
    assert!(matches!(refused(folder.path(), &long), QueryError::TooLong { .. }));
    let deep = format!("SELECT m{} FROM evaluations", " || m".repeat(500));
    assert!(matches!(refused(folder.path(), &deep), QueryError::TooDeep { count: 500, .. }));
    let deep = format!("SELECT {}1{}", "(".repeat(5000), ")".repeat(5000));
    assert!(matches!(refused(folder.path(), &deep), QueryError::Polars { .. }));
    // As deep as it may be, and as long: every operator is one level.
    let most = format!("SELECT chromosome{} AS c FROM evaluations LIMIT 1", "||chromosome".repeat(200));
    assert_eq!(rows(&[folder.path()], &most)[0]["c"].as_str().unwrap().len(), 201 * 6);
    // Longer ones take polars long, and end as well.
    let long = format!("SELECT (individual{}) AS c FROM evaluations LIMIT 1", " < 1".repeat(1000));
    assert!(query(&[folder.path()], &long).is_ok());
}

#[test]
fn a_column_of_another_table_or_of_an_earlier_select_is_told_as_such() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let column = |sql: &str| match refused(folder.path(), sql) {
        QueryError::Column { got, there, elsewhere } => (got, there, elsewhere),
        error => panic!("{sql}: {error}"),
    };
    let (got, there, elsewhere) = column("SELECT best_fitness FROM run");
    assert_eq!((got.as_str(), elsewhere), ("best_fitness", vec!["generations".to_owned()]));
    assert!(there.iter().any(|name| name == "seed") && there.iter().all(|name| name != "best_fitness"));
    let (got, there, _) =
        column("WITH a AS (SELECT generation AS gen FROM generations) SELECT generation FROM a");
    assert_eq!((got.as_str(), there), ("generation", vec!["gen".to_owned()]));
    let (_, there, _) = column("SELECT run_foldr FROM generations");
    assert!(there.iter().any(|name| name == "run_folder"));
    let error = refused(folder.path(), "SELECT x.R1 FROM evaluations AS e");
    assert!(matches!(&error, QueryError::Alias(alias) if alias == "x"), "{error}");
}

#[test]
fn a_select_inside_is_answered_or_refused_in_words() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    for sql in [
        "SELECT * FROM evaluations WHERE fitness = (SELECT MAX(fitness) FROM evaluations)",
        "SELECT * FROM evaluations WHERE fitness > (SELECT AVG(fitness) FROM evaluations)",
        "SELECT generation, (SELECT MAX(fitness) FROM evaluations) AS best FROM generations",
        "SELECT generation FROM generations WHERE EXISTS (SELECT 1 FROM run)",
        "SELECT generation FROM generations WHERE NOT EXISTS (SELECT 1 FROM run)",
        "SELECT generation FROM generations WHERE generation > ALL (SELECT generation FROM evaluations)",
        "SELECT generation FROM generations WHERE generation IN (SELECT generation, individual FROM evaluations)",
        "SELECT generation FROM generations ORDER BY (SELECT 1)",
    ] {
        let error = refused(folder.path(), sql);
        assert!(matches!(error, QueryError::Subquery), "{sql}: {error}");
    }
    // The advice, and the places that are left.
    let best = "SELECT MAX(fitness) AS best FROM evaluations";
    let joined =
        format!("SELECT e.fitness FROM evaluations AS e CROSS JOIN ({best}) AS b WHERE e.fitness = b.best");
    let expected = rows(&[folder.path()], &best.replace("best", "fitness"));
    for sql in [
        joined,
        format!("SELECT fitness FROM evaluations WHERE fitness IN ({best})"),
        format!("WITH b AS ({best}) SELECT e.fitness FROM evaluations e JOIN b ON e.fitness = b.best"),
    ] {
        assert_eq!(rows(&[folder.path()], &sql)[0], expected[0], "{sql}");
    }
}

#[test]
fn what_polars_says_stays_short() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let error = refused(folder.path(), "SELECT MAX(fitness) FROM evaluations HAVING MAX(fitness) > 1");
    assert!(matches!(error, QueryError::Polars { .. }) && error.to_string().lines().count() == 2, "{error}");
    assert!(error.to_string().len() < 400, "{error}");
}
