//! Looks at the test clouds of a run by commands that need no run: noted where `--run` names it.

use std::fs;
use std::path::Path;

use results::{RunFolder, read_looks};
use serde_json::Value;

use crate::experiments::{Experiment, clouds};
use crate::process::{Finished, run};

const SEARCH: &str = "[ga]\npopulation = 4\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n\
    [results]\nbaselines = false\n";

/// A finished run and its artefact.
fn exported() -> (Experiment, [String; 2]) {
    let experiment = Experiment::new(SEARCH);
    experiment.run("out", &[]).expect_success();
    let places = ["out", "artefact"].map(|name| experiment.path(name));
    run("coordinator", ["export", &places[0], &places[1]]).expect_success();
    (experiment, places)
}

/// Each look at the run: its command and its reason.
fn looks(run: &str) -> Vec<[String; 2]> {
    read_looks(run).unwrap().into_iter().map(|look| [look.command, look.reason]).collect()
}

fn test_clouds(finished: Finished) -> Value {
    let told: Value = serde_json::from_str(&finished.expect_success().stdout).unwrap();
    told["test_clouds"].clone()
}

fn lines(list: &str) -> Vec<String> {
    fs::read_to_string(clouds().join(list)).unwrap().lines().map(str::to_owned).collect()
}

#[test]
fn measurements_on_test_clouds_are_noted_in_the_run() {
    let (experiment, [out, artefact]) = exported();
    let data = clouds().display().to_string();
    let assess = |list: &str, more: &[&str]| {
        let args = ["assess", &artefact, "--data", &data, "--query", list];
        run("coordinator", args.into_iter().chain(more.iter().copied()))
    };
    let before = looks(&out);
    assert_eq!(before.len(), 1);

    // Without the run nobody knows, and clouds that are none of its test clouds are no look.
    assert_eq!(test_clouds(assess("test.txt", &["--json"])), Value::Null);
    let other = experiment.path("other");
    run("coordinator", ["synth", &other, "--objects", "2", "--views", "8", "--seed", "9"]).expect_success();
    let elsewhere = |more: &[&str]| {
        let args = ["assess", &artefact, "--data", &other, "--query", "test.txt", "--run", &out];
        run("coordinator", args.into_iter().chain(more.iter().copied()))
    };
    assert_eq!(test_clouds(elsewhere(&["--json"])), 0);
    let told = elsewhere(&[]).expect_success().stdout;
    assert!(told.contains("\nlook          none noted: no cloud is a test cloud of "), "{told}");
    assert_eq!(looks(&out), before);
    // What the artefact holds says nothing of other clouds.
    let held = assess("validation.txt", &[]).expect_error();
    let [first, ..] = &lines("validation.txt")[..] else { panic!("no validation clouds") };
    let said = format!("such as {first}: the artefact holds it as {first}\nchoose other lists");
    assert!(held.stderr.contains(&said), "{held}");

    let asked = assess("test.txt", &["--run", &out, "--reason", "bounds", "--json"]);
    assert_eq!(test_clouds(asked), lines("test.txt").len());
    assert_eq!(looks(&out)[1..], [["assess", "bounds"].map(str::to_owned)]);

    // A test cloud is one under any name, on either side.
    let copies = experiment.path("copies");
    let copy = |cloud: &str, category: &str| {
        let path = format!("{category}/{category}_1/copy.pcd");
        let place = Path::new(&copies).join(&path);
        fs::create_dir_all(place.parent().unwrap()).unwrap();
        fs::copy(clouds().join(cloud), place).unwrap();
        fs::write(format!("{copies}/{category}.txt"), path).unwrap();
    };
    copy(&lines("train1.txt")[0], "mug");
    copy(&lines("test.txt")[0], "can");
    let evaluate = |[query, database]: [&str; 2], more: &[&str]| {
        let lists = ["--data", &copies, "--query", query, "--database", database, "--run", &out];
        run("coordinator", ["evaluate"].into_iter().chain(lists).chain(more.iter().copied()))
    };
    assert_eq!(test_clouds(evaluate(["mug.txt", "can.txt"], &["--json"])), 1);
    let told = evaluate(["can.txt", "mug.txt"], &[]).expect_success().stdout;
    let told = told.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(
        told.contains(&format!("look noted in table looks of {out}: 1 of these clouds are its test clouds")),
        "{told}"
    );
    let evaluated = ["evaluate", "measurement on given clouds"].map(str::to_owned);
    assert_eq!(looks(&out)[2..], [evaluated.clone(), evaluated]);
    run("coordinator", ["verify", &out, "--sample", "0"]).expect_success();
}

#[test]
fn a_look_that_cannot_be_noted_is_not_taken() {
    let (experiment, [out, artefact]) = exported();
    let data = clouds().display().to_string();
    let refused = |folder: &str, complaint: &str| {
        let args = ["assess", &artefact, "--data", &data, "--query", "test.txt", "--run", folder];
        let refused = run("coordinator", args).expect_error();
        assert!(refused.stderr.contains(complaint) && refused.stdout.is_empty(), "{complaint}: {refused}");
        let args = ["evaluate", "--data", &data, "--query", "test.txt", "--database", "train1.txt"];
        let nearest = experiment.path("nearest.txt");
        let more = ["--nearest", &nearest, "--run", folder];
        let refused = run("coordinator", args.into_iter().chain(more)).expect_error();
        assert!(!Path::new(&nearest).exists(), "nothing is measured");
        assert!(refused.stderr.contains(complaint) && refused.stdout.is_empty(), "{complaint}: {refused}");
    };
    refused(&experiment.path("nowhere"), "nowhere: no such run folder");
    refused(&artefact, "run.parquet");
    // Without the run's own list its test clouds would pass for others.
    let list = format!("{out}/clouds.tsv");
    let listed = fs::read_to_string(&list).unwrap();
    fs::write(&list, listed.replace("test\t", "validation\t")).unwrap();
    assert!(fs::read_to_string(&list).unwrap() != listed);
    refused(&out, "clouds.tsv must be the list of the run's clouds, got another or none");
    fs::remove_file(&list).unwrap();
    refused(&out, "clouds.tsv must be the list of the run's clouds, got another or none");
    assert_eq!(looks(&out).len(), 1);
    let args = ["assess", &artefact, "--data", &data, "--query", "test.txt", "--reason", "none"];
    let refused = run("coordinator", args).expect_error();
    assert!(refused.stderr.contains("--run <RUN>"), "{refused}");
}

#[test]
fn commands_at_once_note_their_looks_in_turn_and_wait_for_nobody_for_long() {
    let (experiment, [out, _]) = exported();
    let data = clouds().display().to_string();
    let structure = experiment.path("my colours.toml");
    fs::copy(format!("{}/../experiments/descriptors/chroma.toml", env!("CARGO_MANIFEST_DIR")), &structure)
        .unwrap();
    let lists = ["evaluate", "--data", &data, "--query", "test.txt", "--database", "train1.txt"];
    let evaluate = |more: &[&str]| {
        let look = ["--structure", &structure, "--run", &out];
        run("coordinator", lists.into_iter().chain(look).chain(more.iter().copied()))
    };
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| evaluate(&[]).expect_success());
        }
    });
    let noted = read_looks(&out).unwrap();
    let labels: Vec<_> = noted[1..].iter().map(|look| (&*look.command, &*look.descriptors)).collect();
    assert_eq!(labels, [("evaluate", "my_colours.toml"); 4]);

    // Whoever holds the folder for long is not waited for, and nothing is measured.
    let held = RunFolder::create(&out, &[]).unwrap();
    let nearest = experiment.path("nearest.txt");
    let refused = evaluate(&["--nearest", &nearest]).expect_error();
    assert!(refused.stderr.contains("run folder is in use by another process"), "{refused}");
    assert!(!Path::new(&nearest).exists());
    drop(held);

    // It is noted before: what fails afterwards has been asked.
    evaluate(&["--nearest", &experiment.path("nowhere/nearest.txt")]).expect_error();
    assert_eq!(looks(&out).len(), 6);

    // Where it cannot be noted, nothing is measured.
    fs::remove_dir_all(format!("{out}/looks")).unwrap();
    fs::write(format!("{out}/looks"), "").unwrap();
    let refused = evaluate(&["--nearest", &nearest]).expect_error();
    assert!(refused.stderr.contains("looks") && !Path::new(&nearest).exists(), "{refused}");
}
