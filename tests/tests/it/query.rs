//! `coordinator query`: SQL over runs and sweeps, as a user asks it.

use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::Stdio;

use serde_json::{Value, json};

use crate::experiments::{Experiment, summary};
use crate::process::{Finished, program, run};

const SHORT: &str = "[ga]\npopulation = 5\n[stop]\ngenerations = 3\nvalidation_patience = \"off\"\n";

fn query(folders: &[&str], sql: &str, format: &str) -> Finished {
    run("coordinator", [&["query"], folders, &[sql, "--format", format]].concat())
}

#[track_caller]
fn rows(folders: &[&str], sql: &str) -> Value {
    let finished = query(folders, sql, "json").expect_success();
    serde_json::from_str(&finished.stdout).unwrap_or_else(|error| panic!("{error}: {finished}"))
}

/// Files of a folder with their sizes and times.
fn state(folder: &Path) -> Vec<String> {
    let mut state = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            state.extend(self::state(&path));
        } else {
            let metadata = fs::metadata(&path).unwrap();
            state.push(format!("{} {} {:?}", path.display(), metadata.len(), metadata.modified().unwrap()));
        }
    }
    state.sort();
    state
}

#[test]
fn a_run_answers_as_table_csv_and_json_and_stays_as_it_is() {
    let experiment = Experiment::new(SHORT);
    let summary = summary(&experiment.run("out", &[]).expect_success());
    let out = experiment.path("out");
    let before = state(out.as_ref());

    let sql = "SELECT seed, test_object_error, stop_reason, grid_best_object_correct, started_at FROM run";
    let told = &rows(&[&out], sql)[0];
    assert_eq!((&told["seed"], &told["stop_reason"]), (&json!(5), &summary["stop_reason"]));
    // Equal to the last bit: both were printed from the same number.
    assert_eq!(told["test_object_error"], summary["test_object_error"]);
    assert_eq!(told["grid_best_object_correct"], Value::Null);
    let time = told["started_at"].as_str().unwrap();
    assert!(time.starts_with("20") && &time[10..11] == "T" && time.ends_with('Z'), "{time}");

    let csv = query(&[&out], sql, "csv").expect_success();
    let (header, line) = csv.stdout.trim_end().split_once('\n').unwrap();
    assert_eq!(header, "seed,test_object_error,stop_reason,grid_best_object_correct,started_at");
    let error = summary["test_object_error"].as_f64().unwrap();
    assert_eq!(line, format!("5,{error:?},generations,,{time}"));

    let sql =
        "SELECT generation, COUNT(*) AS individuals FROM evaluations GROUP BY generation ORDER BY generation";
    let table = run("coordinator", ["query", &out, sql]).expect_success();
    let expected = "generation  individuals\n----------  -----------\n         1            5\n         2            5\n\
                    \x20        3            5\n(3 rows)\n";
    assert_eq!(table.stdout, expected);
    assert_eq!(rows(&[&out], "SELECT * FROM evaluations WHERE generation > 3"), json!([]));

    let mut command = program("coordinator");
    command.args(["query", &out, "-", "--format", "csv"]).stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut child = command.spawn().unwrap();
    child.stdin.take().unwrap().write_all(b"SELECT generations\nFROM run;\n").unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success());
    assert_eq!(String::from_utf8_lossy(&output.stdout), "generations\n3\n");

    // Without its row, it is a run that has not ended.
    fs::remove_file(Path::new(&out).join("run/run.parquet")).unwrap();
    assert_eq!(rows(&[&out], "SELECT COUNT(*) AS n FROM generations"), json!([{ "n": 3 }]));
    let refused = query(&[&out], "SELECT * FROM run", "table").expect_error();
    assert!(
        refused.stderr.contains("query: the folder does not have this table, got \"run\"\n"),
        "{refused}"
    );

    let after: Vec<String> = before.iter().filter(|file| !file.contains("/run.parquet")).cloned().collect();
    assert_eq!((state(out.as_ref()), before.len()), (after.clone(), after.len() + 1));
}

#[test]
fn a_sweep_answers_for_all_its_runs() {
    let experiment = Experiment::new(&format!("{SHORT}[sweep]\nseeds = [3, 20]\n"));
    experiment.run("out", &[]).expect_success();
    let out = experiment.path("out");
    let expected = json!([{ "run_folder": "seed-3", "seed": 3 }, { "run_folder": "seed-20", "seed": 20 }]);
    let sql = "SELECT run_folder, seed FROM run ORDER BY seed";
    assert_eq!(rows(&[&out], sql), expected);
    let members = [experiment.path("out/seed-20"), experiment.path("out/seed-3")];
    assert_eq!(rows(&[&members[0], &members[1]], sql), expected);
    let sql = "SELECT run_folder, COUNT(*) AS n FROM evaluations GROUP BY run_folder ORDER BY run_folder";
    let expected = json!([{ "run_folder": "seed-20", "n": 15 }, { "run_folder": "seed-3", "n": 15 }]);
    assert_eq!(rows(&[&out], sql), expected);
}

#[test]
fn what_cannot_be_answered_is_refused_with_advice_and_no_other_file_is_read_or_written() {
    let experiment = Experiment::new(SHORT);
    experiment.run("out", &[]).expect_success();
    let out = experiment.path("out");
    fs::write(experiment.folder().join("secret.csv"), "secret\n1\n").unwrap();
    let [secret, made] = ["secret.csv", "made"].map(|name| experiment.path(name));
    let before = state(experiment.folder());
    for (sql, message) in [
        (
            "SELECT * FROM generation",
            "unknown table, got \"generation\"\ndid you mean `generations`? tables are: ",
        ),
        (
            "SELECT fitnes FROM evaluations",
            "unknown column, got \"fitnes\"\ndid you mean `fitness`? columns are: ",
        ),
        ("SELEC 1", "query: must be one SELECT, SHOW TABLES or DESCRIBE table, got \"SELEC 1\"\n"),
        ("SELECT * FROM", "query: polars does not understand or cannot do this, got: sql parser error: "),
        ("SELECT 1; SELECT 2", "one (and only one) statement"),
        ("DROP TABLE run", "must be one SELECT"),
        (&format!("COPY run TO '{made}'"), "must be one SELECT"),
        (&format!("CREATE TABLE run AS SELECT * FROM read_csv('{secret}')"), "must be one SELECT"),
        (&format!("SELECT * INTO '{made}' FROM run"), "polars does not understand or cannot do this"),
        (&format!("SELECT * FROM read_csv('{secret}')"), "'read_csv' is not a supported table function"),
        (&format!("SELECT * FROM read_parquet('{secret}')"), "'read_parquet' is not a supported"),
        (&format!("SELECT * FROM '{secret}'"), "unknown table"),
        ("SELECT no_such_function(seed) FROM run", "unsupported function 'no_such_function'"),
        (
            &format!("SELECT seed{} FROM run", " || seed".repeat(1000)),
            "must have at most 200 of the operators",
        ),
    ] {
        let refused = query(&[&out], sql, "table").expect_error();
        assert!(refused.stderr.contains(message) && refused.stdout.is_empty(), "{message}: {refused}");
        assert!(
            refused.stderr.starts_with("error: query: ") && refused.stderr.lines().count() == 2,
            "{refused}"
        );
    }
    assert_eq!(state(experiment.folder()), before);

    let refused = query(&[&experiment.path("none")], "SELECT 1", "table").expect_error();
    assert!(refused.stderr.contains("none: no such folder\nname the folder of a run"), "{refused}");
    fs::create_dir(experiment.folder().join("empty")).unwrap();
    let refused = query(&[&experiment.path("empty")], "SELECT 1", "table").expect_error();
    assert!(refused.stderr.contains("empty: no table of a run or grid\ncheck that"), "{refused}");
    assert_eq!(query(&[&out], "SELECT 1", "xml").expect_error().status.code(), Some(2));
}
