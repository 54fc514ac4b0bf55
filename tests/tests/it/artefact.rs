//! Artefacts: what is taken away from a run answers as the run did.

use std::fs;
use std::path::Path;
use std::process::Stdio;

use results::{PredictionRow, PredictionSplit};
use serde_json::Value;

use crate::experiments::{Experiment, clouds};
use crate::process::{Finished, finish, program, run};

const SHORT: &str = "[ga]\npopulation = 6\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n";

/// Recognises clouds of the data root, named as in its lists.
fn recognise(root: &Path, artefact: &str, clouds: &[&str], options: &[&str]) -> Finished {
    let mut command = program("coordinator");
    finish(command.current_dir(root).args(["recognise", artefact]).args(clouds).args(options))
}

/// Values of one answer as JSON has them: equal texts are equal floats.
fn as_json(row: &PredictionRow) -> [(&'static str, Value); 7] {
    let runner_up = row.runner_up.as_ref();
    [
        ("cloud", row.cloud.clone().into()),
        ("nearest_cloud", row.nearest_cloud.clone().into()),
        ("predicted_instance", row.predicted_instance.clone().into()),
        ("predicted_category", row.predicted_category.clone().into()),
        ("distance", row.distance.into()),
        ("runner_up_cloud", runner_up.map(|other| other.cloud.clone()).into()),
        ("runner_up_distance", runner_up.map(|other| other.distance).into()),
    ]
}

/// An artefact's answers to all test clouds are the run's predictions, bit for bit.
#[track_caller]
fn check_answers(run: &str, root: &Path, artefact: &str) {
    let predictions = results::read_predictions(run, PredictionSplit::Test).unwrap();
    assert!(predictions.len() > 10);
    let queries: Vec<&str> = predictions.iter().map(|row| row.cloud.as_str()).collect();
    let finished = recognise(root, artefact, &queries, &["--json"]).expect_success();
    let lines: Vec<&str> = finished.stdout.lines().collect();
    assert_eq!(lines.len(), predictions.len(), "{finished}");
    for (row, line) in predictions.iter().zip(lines) {
        for (key, expected) in as_json(row) {
            // As text: reading a float from JSON may round it.
            let expected = format!("\"{key}\":{expected}");
            assert!(line.contains(&(expected.clone() + ",")), "no {expected} in {line}");
        }
    }
}

#[test]
fn an_artefact_answers_as_its_run_did_with_and_without_colour() {
    let colourless = format!("{SHORT}[descriptor]\ncolour = false\n");
    for more in [SHORT, &colourless] {
        let experiment = Experiment::new(more);
        experiment.run("out", &[]).expect_success();
        let (out, artefact) = (experiment.path("out"), experiment.path("below/artefact"));
        let exported = run("coordinator", ["export", &out, &artefact]).expect_success();
        assert!(exported.stdout.contains(&format!("coordinator recognise {artefact}")), "{exported}");
        check_answers(&out, clouds(), &artefact);
        // Nothing else is made, and nothing of the run or its data is needed.
        assert_eq!(fs::read_dir(experiment.path("below")).unwrap().count(), 1);
        assert_eq!(fs::read_dir(&artefact).unwrap().count(), 5);
        // It is replaced by another, and the paper's descriptor answers, too.
        run("coordinator", ["export", &out, &artefact, "--descriptor", "paper"]).expect_success();
        let example = format!("{artefact}/example.pcd");
        let answer = run("coordinator", ["recognise", &artefact, &example, "--json"]).expect_success();
        let vector: Value =
            serde_json::from_str(&fs::read_to_string(format!("{artefact}/test-vector.json")).unwrap())
                .unwrap();
        let answer: Value = serde_json::from_str(&answer.stdout).unwrap();
        for key in ["predicted_instance", "nearest_cloud", "distance", "runner_up_distance"] {
            assert_eq!(answer[key], vector[key], "{key}");
        }
        let readme = fs::read_to_string(format!("{artefact}/README.md")).unwrap();
        assert!(readme.contains("Not measured"), "{readme}");
    }
}

#[test]
fn clouds_are_answered_one_by_one_and_those_without_an_answer_are_named() {
    let experiment = Experiment::new(SHORT);
    experiment.run("out", &[]).expect_success();
    let (out, artefact) = (experiment.path("out"), experiment.path("artefact"));
    run("coordinator", ["export", &out, &artefact]).expect_success();
    let readme = fs::read_to_string(format!("{artefact}/README.md")).unwrap();
    assert!(readme.contains("95 % interval"), "{readme}");

    let good = results::read_predictions(&out, PredictionSplit::Test).unwrap().remove(0);
    let (broken, empty) = (experiment.path("broken.pcd"), experiment.path("empty.pcd"));
    fs::write(&broken, "FIELDS x y").unwrap();
    fs::write(&empty, "FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 0\nHEIGHT 1\nPOINTS 0\nDATA ascii\n").unwrap();
    let names = [broken.as_str(), "not there.pcd", &good.cloud, &empty];
    let answered = recognise(clouds(), &artefact, &names, &["--top", "3", "--times"]).expect_error();
    assert_eq!(answered.status.code(), Some(1));
    let answer = format!("{}: {} ({})", good.cloud, good.predicted_instance, good.predicted_category);
    assert!(answered.stdout.starts_with(&answer), "{answered}");
    // The answer, three objects, the times.
    assert_eq!(answered.stdout.lines().count(), 5, "{answered}");
    for (name, reason) in [
        (&*broken, "header"),
        ("not there.pcd", "cannot be read"),
        (&empty, "fewer than 10 usable points, got 0"),
    ] {
        let said = answered.stderr.lines().find(|line| line.starts_with(&format!("error: {name}: ")));
        assert!(said.is_some_and(|line| line.contains(reason)), "{name}: {answered}");
    }

    let input = fs::File::open(clouds().join(&good.cloud)).unwrap();
    let mut command = program("coordinator");
    let piped =
        finish(command.args(["recognise", &artefact, "-"]).stdin(Stdio::from(input))).expect_success();
    assert!(piped.stdout.starts_with(&answer.replace(&good.cloud, "-")), "{piped}");
}

#[test]
fn what_cannot_be_taken_away_is_refused_and_nothing_is_lost() {
    let experiment = Experiment::with(&format!("version = 1\n[dataset]\nroot = \"data\"\n{SHORT}"));
    let data = experiment.path("data");
    run("coordinator", ["synth", &data, "--objects", "2", "--views", "6"]).expect_success();
    let (out, artefact) = (experiment.path("out"), experiment.path("artefact"));
    let refused = |args: &[&str], complaint: &str| {
        let refused = run("coordinator", [&["export"], args].concat()).expect_error();
        let (first, advice) =
            refused.stderr.trim_end().split_once('\n').unwrap_or_else(|| panic!("{refused}"));
        assert!(first.contains(complaint) && !advice.is_empty(), "{complaint}: {refused}");
    };
    refused(&[&out, &artefact], "no such run folder");
    fs::create_dir(&out).unwrap();
    refused(&[&out, &artefact], "run is not finished");
    experiment.run("out", &[]).expect_success();

    // Somebody else's folder, or file.
    let occupied = experiment.path("occupied");
    fs::create_dir(&occupied).unwrap();
    fs::write(format!("{occupied}/README.md"), "mine").unwrap();
    fs::write(format!("{occupied}/thesis.tex"), "mine").unwrap();
    refused(&[&out, &occupied], "must be a new folder or an artefact, got a folder with thesis.tex");
    assert_eq!(fs::read_dir(&occupied).unwrap().count(), 2);
    refused(&[&out, &experiment.path("exp.toml")], "must be a new folder or an artefact, got a file");

    run("coordinator", ["export", &out, &artefact]).expect_success();
    let settings = fs::read_to_string(format!("{artefact}/descriptor.toml")).unwrap();

    // The data set may move, but not change.
    let moved = experiment.path("moved");
    fs::rename(&data, &moved).unwrap();
    refused(&[&out, &artefact], "data");
    run("coordinator", ["export", &out, &artefact, "--data", &moved]).expect_success();
    let list = fs::read_to_string(format!("{moved}/train1.txt")).unwrap();
    let (first, last) = (list.lines().next().unwrap(), list.lines().next_back().unwrap());
    fs::copy(Path::new(&moved).join(last), Path::new(&moved).join(first)).unwrap();
    refused(&[&out, &artefact, "--data", &moved], "data digest must be");

    // Nor may the run.
    let generation = Path::new(&out).join("generations/generation-00001.parquet");
    let mut bytes = fs::read(&generation).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&generation, bytes).unwrap();
    refused(&[&out, &artefact, "--data", &moved], "run must be sound");
    assert_eq!(fs::read_to_string(format!("{artefact}/descriptor.toml")).unwrap(), settings);
}

#[test]
fn a_sweep_has_no_one_winner() {
    let sweep = Experiment::new(&format!("{SHORT}[sweep]\nseeds = [1, 2]\n"));
    sweep.run("out", &[]).expect_success();
    let (out, artefact) = (sweep.path("out"), sweep.path("artefact"));
    let refused = run("coordinator", ["export", &out, &artefact]).expect_error();
    assert!(refused.stderr.contains("must be one run, got a sweep of 2"), "{refused}");
    let member = format!("{out}/seed-2");
    run("coordinator", ["export", &member, &artefact]).expect_success();
    check_answers(&member, clouds(), &artefact);
}
