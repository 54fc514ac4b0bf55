//! Weights of values: learned from the training clouds of a run, and taken wherever a structure is.

use std::fs;

use serde_json::Value;

use crate::experiments::{Experiment, clouds, repository};
use crate::process::{Finished, finish, program, run};

const STRUCTURES: &str = "[descriptor]\nfamily = \"structure\"\nmax_bins = 300\n\
    [ga]\npopulation = 8\n[stop]\nevaluations = 24\n[search.fitness]\ncross-sequence = 1\n";

/// The nearest cloud and its distance, of each test cloud, with the widest vectors or these.
fn evaluated(experiment: &Experiment, structure: &str, vectors: Option<&str>) -> String {
    let (data, nearest) = (clouds().display().to_string(), experiment.path("nearest.txt"));
    let lists = ["--query", "test.txt", "--database", "train1.txt", "train2.txt", "validation.txt"];
    let args = ["evaluate", "--data", &data, "--nearest", &nearest, "--structure", structure];
    let mut command = program("coordinator");
    command.envs(vectors.map(|vectors| ("DESCRY_VECTORS", vectors))).args(args).args(lists);
    finish(&mut command).expect_success();
    fs::read_to_string(nearest).unwrap()
}

#[test]
fn weights_of_a_runs_winner_are_the_same_on_all_vectors_and_taken_by_evaluate_compare_and_export() {
    let experiment = Experiment::new(STRUCTURES);
    experiment.run("out", &[]).expect_success();
    let (out, file, again) =
        (experiment.path("out"), experiment.path("weighted.toml"), experiment.path("again.toml"));
    let weighed = run("coordinator", ["weigh", &out, &file]).expect_success();
    let text = fs::read_to_string(&file).unwrap();
    assert!(text.contains("value_weights = ["), "{text}");
    // Without weights, the run itself has counted the same clouds.
    let train = results::read_run(&out).unwrap().row.train;
    let expected = format!("{:.2} % without weights, ", 100.0 * train.object_error());
    assert!(weighed.stdout.contains(&expected), "{expected}{weighed}");

    let mut scalar = program("coordinator");
    finish(scalar.env("DESCRY_VECTORS", "baseline").args(["weigh", &out, &again])).expect_success();
    assert_eq!(fs::read_to_string(&again).unwrap(), text);

    let wide = evaluated(&experiment, &file, None);
    assert_eq!(evaluated(&experiment, &file, Some("baseline")), wide);
    let artefact = experiment.path("artefact");
    run("coordinator", ["export", &out, &artefact, "--structure", &file]).expect_success();
    let queries: Vec<&str> = wide.lines().filter_map(|line| line.split(' ').next()).collect();
    let mut recognise = program("coordinator");
    recognise.current_dir(clouds()).args(["recognise", &artefact, "--json"]).args(&queries);
    let answers = finish(&mut recognise).expect_success();
    assert!(queries.len() > 10);
    let wrong = answers.stdout.lines().zip(&queries).filter(|(answer, query)| {
        let answer: Value = serde_json::from_str(answer).unwrap();
        answer["nearest_cloud"].as_str().unwrap().split('/').nth(1) != query.split('/').nth(1)
    });
    let wrong = wrong.count().to_string();

    let args = ["compare", &out, "--no-times", "--descriptor", "evolved", "--structure", &file];
    let listen = ["--listen", "127.0.0.1:0"];
    let compared = run("coordinator", args.into_iter().chain(listen)).expect_success();
    let row = compared.stdout.lines().find(|line| line.starts_with("weighted ")).unwrap();
    assert_eq!(row.split_whitespace().nth(3), Some(wrong.as_str()), "{compared}");
}

#[track_caller]
fn refused(finished: Finished, complaint: &str) {
    let finished = finished.expect_error();
    assert!(finished.stderr.contains(complaint), "{finished}");
    assert!(finished.stderr.trim_end().lines().count() > 1, "{finished}");
}

#[test]
fn what_cannot_be_weighed_is_refused_and_nothing_is_written() {
    let experiment = Experiment::new("[ga]\npopulation = 6\n[stop]\ngenerations = 2\n");
    experiment.run("out", &[]).expect_success();
    let (out, file) = (experiment.path("out"), experiment.path("weighted.toml"));
    let weigh = |more: &[&str]| run("coordinator", ["weigh", &out, &file].iter().chain(more));
    refused(weigh(&[]), "values of a structure expected, got those of disk-ring");
    refused(weigh(&["--point", "1"]), "front");
    let paper = repository().join("experiments/descriptors/paper.toml").display().to_string();
    let nowhere = experiment.path("nowhere/weighted.toml");
    refused(run("coordinator", ["weigh", &out, &nowhere, "--structure", &paper]), "cannot be written");
    refused(run("coordinator", ["weigh", &nowhere, &file]), "nowhere");
    assert!(!fs::exists(&file).unwrap());

    weigh(&["--structure", &paper]).expect_success();
    let text = fs::read_to_string(&file).unwrap();
    refused(weigh(&["--structure", &paper]), "must be a new file, got one that exists");
    let again = experiment.path("again.toml");
    let weighed_twice = run("coordinator", ["weigh", &out, &again, "--structure", &file]);
    refused(weighed_twice, "values without weights expected, got some with");
    // Cut short by hand.
    let (before, _) = text.split_once("value_weights = [").unwrap();
    let cut = format!("{before}value_weights = [1, 0.5]\n");
    fs::write(&again, cut).unwrap();
    let data = clouds().display().to_string();
    let args = ["evaluate", "--data", &data, "--query", "test.txt", "--database", "train1.txt"];
    let evaluated = run("coordinator", args.into_iter().chain(["--structure", &again]));
    refused(evaluated, "again.toml: channel 1: value_weights: there must be ");
    assert_eq!(fs::read_to_string(&file).unwrap(), text);
}

/// A finished run on the clouds of all tests by a manifest in which a cloud has a sequence if its object is one of those.
fn listed(has_sequence: fn(&str) -> bool) -> Experiment {
    let experiment = Experiment::with("");
    let mut manifest = "path,category,instance,sequence,split\n".to_owned();
    for split in ["train1", "train2", "validation", "test"] {
        for path in fs::read_to_string(clouds().join(format!("{split}.txt"))).unwrap().lines() {
            let names: Vec<&str> = path.split('/').collect();
            let [category, object, file] = names[..] else { panic!("{path}") };
            let sequence = file.strip_prefix(object).unwrap().split('_').nth(1).unwrap();
            let sequence = if has_sequence(object) { sequence } else { "" };
            manifest += &format!("{path},{category},{object},{sequence},{split}\n");
        }
    }
    let (list, toml) = (experiment.path("clouds.csv"), experiment.path("listed.toml"));
    fs::write(&list, manifest).unwrap();
    let root = clouds().display();
    let text = format!(
        "version = 1\n[dataset]\nroot = \"{root}\"\nlayout = \"manifest\"\nmanifest = \"{list}\"\n\
         [ga]\npopulation = 6\n[stop]\ngenerations = 2\n"
    );
    fs::write(&toml, text).unwrap();
    run("coordinator", ["run", &toml, "--out", &experiment.path("out"), "--listen", "127.0.0.1:0"])
        .expect_success();
    experiment
}

#[test]
fn clouds_without_sequences_teach_no_weights() {
    let paper = repository().join("experiments/descriptors/paper.toml").display().to_string();
    let weigh = |experiment: &Experiment| {
        let (out, file) = (experiment.path("out"), experiment.path("weighted.toml"));
        run("coordinator", ["weigh", &out, &file, "--structure", &paper])
    };
    let without = listed(|_| false);
    refused(weigh(&without), "an object seen in two sequences expected, got none");
    assert!(!fs::exists(without.path("weighted.toml")).unwrap());

    // Of six objects with as many clouds each, of which one has no sequences.
    let weighed = weigh(&listed(|object| object != "mug_1")).expect_success();
    let told = weighed.stdout.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(told.contains("with them: 30 of 36 training clouds"), "{weighed}");
}
