//! The exhaustive search: the same grid whatever happens to coordinator, workers and files, and what runs make of it.

use std::fs;
use std::path::Path;
use std::process::Command;

use coordinator::run::rows::gene_columns;
use descriptor::{GeneTable, SearchSpace};
use results::{GridFolder, TableName};
use serde_json::Value;

use crate::experiments::{Experiment, clouds, summary};
use crate::process::{Finished, kill_at, run};

/// Nine cells of 20 descriptors.
const SMALL: &str = "[results]\ndir = \"runs\"\n[descriptor.genes]\nshape_bins = { min = 8, max = 20, step = 12 }\n\
    m = { min = 3, max = 4, step = 1 }\nR1 = { min = 0.5, max = 1.0, step = 0.25 }\n\
    R2 = { min = 2.1, max = 3.1, step = 0.5 }\nw = { min = 0.0, max = 1.0, step = 0.25 }\n";

fn args(experiment: &Experiment, out: Option<&str>, more: &[&str]) -> Vec<String> {
    let mut args = vec!["exhaust".to_owned(), experiment.path("exp.toml")];
    if let Some(out) = out {
        args.extend(["--out".to_owned(), experiment.path(out)]);
    }
    args.extend(["--listen", "127.0.0.1:0", "--json"].map(str::to_owned));
    args.extend(more.iter().map(|&arg| arg.to_owned()));
    args
}

fn exhaust(experiment: &Experiment, out: &str, more: &[&str]) -> Finished {
    run("coordinator", args(experiment, Some(out), more))
}

fn number(summary: &Value, key: &str) -> u64 {
    summary[key].as_u64().unwrap_or_else(|| panic!("{key}: {summary}"))
}

#[test]
fn the_grid_is_the_same_with_one_worker_with_four_and_after_a_kill() {
    // Many cells, so that the kill comes in the middle.
    let experiment = Experiment::new(
        "[descriptor.genes]\nshape_bins = { min = 8, max = 64, step = 28 }\nm = { min = 3, max = 4, step = 1 }\n\
         w = { min = 0.0, max = 1.0, step = 0.5 }\n",
    );
    let one = summary(&exhaust(&experiment, "one", &["--local-workers", "1"]).expect_success());
    assert_eq!((number(&one, "cells"), number(&one, "descriptors")), (480, 480 * 3 * 2 * 3));
    let four = summary(&exhaust(&experiment, "four", &["--local-workers", "4"]).expect_success());
    assert_eq!(four["grid_digest"], one["grid_digest"]);

    let arguments = args(&experiment, Some("killed"), &["--local-workers", "1"]);
    kill_at("coordinator", &arguments, "cell 5/480");
    let again = run("coordinator", &arguments).expect_success();
    let resumed = summary(&again);
    assert!(number(&resumed, "cells_found") >= 5, "{again}");
    assert_eq!(number(&resumed, "cells_found") + number(&resumed, "cells_computed"), 480);
    assert_eq!(resumed["grid_digest"], one["grid_digest"]);
    for table in TableName::GRID.into_iter().filter(|table| *table != TableName::Grid) {
        let read = |out: &str| {
            let frame = results::read_table(experiment.path(out), table).unwrap();
            frame.drop_many(["worker_id"]) // another at each start
        };
        assert!(read("killed").equals_missing(&read("one")), "{table}");
    }
}

#[test]
fn a_damaged_cell_is_computed_again_and_a_finished_grid_is_shown_again() {
    let experiment = Experiment::new(SMALL);
    let whole = summary(&exhaust(&experiment, "out", &[]).expect_success());
    let again = exhaust(&experiment, "out", &[]).expect_success();
    assert!(again.stderr.contains("this grid is finished"), "{again}");
    assert_eq!(summary(&again), whole);

    let folder = Path::new(&experiment.path("out")).to_owned();
    fs::remove_file(folder.join("grid/grid.parquet")).unwrap();
    let cells = folder.join("cells");
    // One flipped, one cut, one under another's name, one gone, one a pipe.
    let flipped = cells.join("cell-5000-21000.parquet");
    let mut bytes = fs::read(&flipped).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&flipped, &bytes).unwrap();
    fs::write(cells.join("cell-5000-26000.parquet"), &bytes[..middle]).unwrap();
    fs::copy(cells.join("cell-10000-31000.parquet"), cells.join("cell-7500-21000.parquet")).unwrap();
    fs::remove_file(cells.join("cell-7500-26000.parquet")).unwrap();
    let pipe = cells.join("cell-7500-31000.parquet");
    fs::remove_file(&pipe).unwrap();
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let repaired = exhaust(&experiment, "out", &[]).expect_success();
    assert_eq!(repaired.stderr.matches("is computed again").count(), 4, "{repaired}");
    let repaired = summary(&repaired);
    assert_eq!((number(&repaired, "cells_computed"), number(&repaired, "cells_found")), (5, 4));
    assert_eq!(repaired["grid_digest"], whole["grid_digest"]);
}

#[test]
fn a_finished_grid_that_was_damaged_is_made_whole_again() {
    let experiment = Experiment::new(SMALL);
    let whole = summary(&exhaust(&experiment, "out", &[]).expect_success());
    let folder = Path::new(&experiment.path("out")).to_owned();

    fs::remove_file(folder.join("cells/cell-5000-21000.parquet")).unwrap();
    let repaired = exhaust(&experiment, "out", &[]).expect_success();
    assert!(repaired.stderr.contains("1 cells of the finished grid are gone"), "{repaired}");
    let repaired = summary(&repaired);
    assert_eq!((number(&repaired, "cells_computed"), number(&repaired, "cells_found")), (1, 8));
    assert_eq!(repaired["grid_digest"], whole["grid_digest"]);

    let best = folder.join("best/best.parquet");
    let bytes = fs::read(&best).unwrap();
    fs::write(&best, [bytes.as_slice(), b"x"].concat()).unwrap();
    let repaired = summary(&exhaust(&experiment, "out", &[]).expect_success());
    assert_eq!((number(&repaired, "cells_computed"), number(&repaired, "cells_found")), (0, 9));
    assert_eq!(repaired["grid_digest"], whole["grid_digest"]);
    assert_eq!(fs::read(&best).unwrap(), bytes);
}

#[test]
fn another_grid_and_a_run_are_refused_in_a_grids_folder() {
    let experiment = Experiment::new(SMALL);
    exhaust(&experiment, "out", &[]).expect_success();
    let toml = fs::read_to_string(experiment.path("exp.toml")).unwrap();
    fs::write(experiment.path("exp.toml"), toml.replace("max = 20", "max = 32")).unwrap();
    let refused = exhaust(&experiment, "out", &[]).expect_error();
    assert!(refused.stderr.contains("  - shape_bins = { min = 8, max = 20, step = 12 }"), "{refused}");
    let refused = experiment.run("out", &[]).expect_error();
    assert!(refused.stderr.contains("holds another search"), "{refused}");
    // A pipe where the folder says what it holds: nobody waits for it.
    let search = experiment.path("out/search.toml");
    fs::remove_file(&search).unwrap();
    assert!(Command::new("mkfifo").arg(&search).status().unwrap().success());
    let refused = experiment.run("out", &[]).expect_error();
    assert!(
        refused.stderr.contains("search.toml: cannot be used, got something that is no file"),
        "{refused}"
    );
    let toml = toml.replace("max = 20, step = 12", "max = 64, step = 1");
    let toml = toml.replace("w = { min = 0.0, max = 1.0, step = 0.25 }", "w = { step = 0.00002 }");
    fs::write(experiment.path("exp.toml"), toml).unwrap();
    let refused = exhaust(&experiment, "large", &[]).expect_error();
    assert!(refused.stderr.contains("grid must have at most"), "{refused}");
    assert!(!Path::new(&experiment.path("large")).exists());
}

#[test]
fn counts_are_those_of_the_evaluator() {
    let experiment = Experiment::new(SMALL);
    exhaust(&experiment, "out", &[]).expect_success();
    let cells = results::read_table(experiment.path("out"), TableName::Cells).unwrap();
    assert_eq!(cells.height(), 9 * 20);
    let genes = ["shape_bins", "m", "R1", "R2", "w"];
    for row in (0..cells.height()).step_by(7) {
        let mut args = vec!["evaluate".to_owned(), "--json".to_owned()];
        args.extend(["--data".to_owned(), clouds().display().to_string()]);
        args.extend(["--query", "train1.txt", "--database", "train2.txt"].map(str::to_owned));
        for gene in genes {
            let value = cells.column(gene).unwrap().get(row).unwrap();
            args.extend(["--set".to_owned(), format!("{gene}={value}")]);
        }
        let evaluated = summary(&run("coordinator", &args).expect_success());
        let expected = number(&evaluated, "queries") - number(&evaluated, "object_wrong");
        let count = cells.column("object_correct").unwrap().u32().unwrap().get(row).unwrap();
        assert_eq!(u64::from(count), expected, "{args:?}");
    }
}

#[test]
fn a_sample_of_counts_is_computed_again_and_a_wrong_one_is_named() {
    let experiment = Experiment::new(SMALL);
    let first = exhaust(&experiment, "out", &["--sample", "30"]).expect_success();
    assert_eq!(summary(&first)["recomputed"], 30);
    assert_eq!(summary(&first)["problems"], serde_json::json!([]));
    let again = exhaust(&experiment, "out", &["--sample", "1000"]).expect_success();
    assert_eq!(summary(&again)["recomputed"], 180);

    // All cells are there and no table is: as after a kill at the very end.
    for table in ["grid/grid.parquet", "best/best.parquet"] {
        fs::remove_file(Path::new(&experiment.path("out")).join(table)).unwrap();
        let whole = exhaust(&experiment, "out", &["--sample", "20"]).expect_success();
        assert!(whole.stderr.contains("9 of 9 cells are there already"), "{whole}");
        assert_eq!(summary(&whole)["recomputed"], 20);
    }
    let far = exhaust(&experiment, "out", &["--sample", "1000001"]).expect_error();
    assert!(far.stderr.contains("1000001"), "{far}");

    let expected = miscount(&experiment.path("out"));
    let wrong = exhaust(&experiment, "out", &["--sample", "1000"]);
    assert_eq!(wrong.status.code(), Some(1), "{wrong}");
    let problems = summary(&wrong)["problems"].as_array().unwrap().clone();
    assert_eq!(problems.len(), 1, "{problems:?}");
    assert!(
        problems[0].as_str().unwrap().contains(&format!("the grid has {expected}, got {}", expected - 1))
    );
}

/// Adds one to a count in a cell, which is then as its own program writes it, and returns that.
fn miscount(out: &str) -> u32 {
    let cells = results::read_table(out, TableName::Cells).unwrap();
    let [disk, ring] =
        ["R1", "R2"].map(|gene| cells.column(gene).unwrap().get(0).unwrap().try_extract::<f64>().unwrap());
    let name = format!("{}-{}", disk * 10_000.0, ring * 10_000.0);
    let folder = GridFolder::create(out, &gene_columns(&SearchSpace::DiskRing(GeneTable::paper()))).unwrap();
    let mut points = folder.read_cell(&name).unwrap().unwrap();
    points.object_correct[3] += 1;
    folder.write_cell(&name, &points).unwrap();
    points.object_correct[3]
}

#[test]
fn a_wrong_cell_of_an_earlier_start_is_found_and_all_of_whoever_counted_it_are_counted_again() {
    let experiment = Experiment::new(&format!("{SMALL}[coordinator]\naudit = 1.0\n"));
    let right = summary(&exhaust(&experiment, "out", &[]).expect_success());
    miscount(&experiment.path("out"));
    fs::remove_file(Path::new(&experiment.path("out")).join("grid/grid.parquet")).unwrap();
    let cured = exhaust(&experiment, "out", &[]).expect_success();
    assert!(cured.stderr.contains("9 cells that were in doubt are computed again"), "{cured}");
    assert_eq!(summary(&cured)["grid_digest"], right["grid_digest"]);
    assert_eq!(summary(&cured)["cells_computed"], 9);
}

#[test]
fn the_test_split_is_not_needed() {
    let experiment =
        Experiment::with(&format!("version = 1\nname = \"untested\"\n[dataset]\nroot = \"data\"\n{SMALL}"));
    let data = experiment.path("data");
    run("coordinator", ["synth", &data, "--objects", "4", "--views", "8", "--seed", "2"]).expect_success();
    let before = summary(&exhaust(&experiment, "before", &[]).expect_success());
    for split in ["test.txt", "validation.txt"] {
        let list = Path::new(&data).join(split);
        for cloud in fs::read_to_string(&list).unwrap().lines() {
            fs::remove_file(Path::new(&data).join(cloud)).unwrap();
        }
        fs::remove_file(list).unwrap();
    }
    let after = summary(&exhaust(&experiment, "after", &[]).expect_success());
    assert_eq!(after["grid_key"], before["grid_key"]);
    assert_eq!(after["grid_digest"], before["grid_digest"]);
    experiment.run("run", &[]).expect_error();
}

#[test]
fn runs_report_their_regret_once_the_grid_is_known() {
    // A space of its own: what other tests know of theirs is of no use here.
    let space = SMALL.replace("max = 20, step = 12", "max = 22, step = 14");
    let experiment = Experiment::new(&format!(
        "{space}[ga]\npopulation = 4\n[stop]\ngenerations = 3\nvalidation_patience = \"off\"\n"
    ));
    let first = summary(&experiment.run("ga", &["--seed", "6"]).expect_success());
    assert_eq!(first["regret"], Value::Null);
    let grid = summary(&run("coordinator", args(&experiment, None, &[])).expect_success());
    assert!(grid["out"].as_str().unwrap().contains("/runs/short-grid-"), "{grid}");

    let best = number(&grid, "best_object_correct");
    let regret = |run: &Value| {
        let wrong = run["train_error"].as_f64().unwrap() * run["train_queries"].as_f64().unwrap();
        (wrong - (number(&grid, "queries") - best) as f64) / run["train_queries"].as_f64().unwrap()
    };
    for (out, seed) in [("ga", "6"), ("other", "7")] {
        let run = summary(&experiment.run(out, &["--seed", seed]).expect_success());
        assert_eq!(number(&run, "grid_best_object_correct"), best);
        assert!((run["regret"].as_f64().unwrap() - regret(&run)).abs() < 1e-9, "{run}");
    }
    run("coordinator", ["verify", &experiment.path("other"), "--sample", "2"]).expect_success();
    let text = run(
        "coordinator",
        ["run", &experiment.path("exp.toml"), "--out", &experiment.path("other"), "--seed", "7"],
    );
    assert!(text.expect_success().stdout.contains("the best of all 180 descriptors has"));

    let toml = fs::read_to_string(experiment.path("exp.toml")).unwrap();
    let with = |method: &str| {
        fs::write(experiment.path("exp.toml"), format!("{toml}[search]\nmethod = \"{method}\"\n")).unwrap();
        summary(&experiment.run(method, &[]).expect_success())
    };
    let all = with("exhaustive");
    assert_eq!((&all["stop_reason"], number(&all, "generations")), (&"exhaustive".into(), 1));
    assert_eq!((&all["best"], all["regret"].as_f64()), (&grid["best"], Some(0.0)));
    assert!(all["test_object_error"].is_number(), "{all}");

    // By another fitness the grid knows no best, and does not find it.
    let other = with("ga\"\n[search.fitness]\nsplit = 1\nobjective = \"category");
    assert_eq!((&other["regret"], &other["grid_best_object_correct"]), (&Value::Null, &Value::Null));
    let refused = "error: search.fitness: an exhaustive search counts objects of train1 among those of train2, got split = 1, \
        objective = \"category\"\n";
    let exhausted = run("coordinator", args(&experiment, None, &[])).expect_error();
    assert!(exhausted.stderr.contains(refused), "{exhausted}");
    fs::write(
        experiment.path("exp.toml"),
        format!("{toml}[search]\nmethod = \"exhaustive\"\n[search.fitness]\nleave-one-out = 1\n"),
    )
    .unwrap();
    let exhausted = experiment.run("exhaustive-leave-one-out", &[]).expect_error();
    assert!(exhausted.stderr.contains("got leave-one-out = 1\nremove [search.fitness]"), "{exhausted}");
    assert!(!Path::new(&experiment.path("exhaustive-leave-one-out")).exists());

    let random = with("random");
    assert_eq!(number(&random, "grid_best_object_correct"), best);
    let frame = results::read_table(experiment.path("random"), TableName::Evaluations).unwrap();
    assert_eq!(frame.column("parent_a").unwrap().null_count(), 12);
    run("coordinator", ["verify", &experiment.path("random"), "--sample", "2"]).expect_success();
}
