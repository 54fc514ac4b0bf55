//! Clouds that a protocol of fitness cannot match: what is refused before a search, and what is said of queries left out.

use std::fs;

use descriptor::pcd::{self, DataEncoding};
use serde_json::Value;

use crate::experiments::{Experiment, summary};
use crate::leaks::square;
use crate::process::{Finished, run};

/// An experiment on clouds `object/sequence/frame` of these splits, with these lines of `[dataset]` and sections after it.
fn experiment(dataset: &str, clouds: [&[&str]; 4], sections: &str) -> Experiment {
    let toml = format!("version = 1\n[dataset]\nroot = \"data\"\n{dataset}\n{sections}");
    let experiment = Experiment::with(&toml);
    let (data, mut number) = (experiment.folder().join("data"), 0);
    for (split, clouds) in ["train1", "train2", "validation", "test"].into_iter().zip(clouds) {
        let mut list = String::new();
        for cloud in clouds {
            number += 1;
            let (object, frame) = cloud.split_once('/').unwrap();
            let folder = format!("tile/tile_{object}");
            fs::create_dir_all(data.join(&folder)).unwrap();
            let path = format!("{folder}/tile_{object}_{}.pcd", frame.replace('/', "_"));
            let cloud = square([0.0; 3], number);
            fs::write(data.join(&path), pcd::write(&cloud, DataEncoding::Binary)).unwrap();
            list += &format!("{path}\n");
        }
        fs::write(data.join(format!("{split}.txt")), list).unwrap();
    }
    experiment
}

const ACROSS: &str = "[search.fitness]\ncross-sequence = 1\n";

/// That `check` and `run` refuse it in the same words, and that no folder is made.
fn refused(experiment: &Experiment) -> String {
    let checked = run("coordinator", ["check", &experiment.path("exp.toml")]).expect_error();
    let ran = experiment.run("out", &[]).expect_error();
    let error = |finished: &Finished| {
        let lines = finished.stderr.lines().skip_while(|line| !line.starts_with("error: "));
        lines.collect::<Vec<_>>().join("\n")
    };
    assert_eq!(error(&checked), error(&ran));
    assert!(!experiment.folder().join("out").exists(), "{ran}");
    error(&checked)
}

#[test]
fn clouds_without_sequences_are_not_matched_across_them() {
    let clouds: [&[&str]; 4] = [&["1/1/1", "2/1/1"], &["1/2/1", "2/2/1"], &["1/3/1"], &["2/3/1"]];
    let unnamed = experiment("layout = \"folders\"", clouds, ACROSS);
    assert_eq!(
        refused(&unnamed),
        "error: search.fitness.cross-sequence: needs the sequence of every cloud, got 5 without one, the first of them \
         tile/tile_1/tile_1_1_1.pcd\nname sequences in a manifest's column, use layout = \"uw\", or write \
         [search.fitness] leave-one-out = 1"
    );
    let named = experiment("layout = \"uw\"", clouds, ACROSS);
    run("coordinator", ["check", &named.path("exp.toml")]).expect_success();
}

#[test]
fn training_clouds_of_one_sequence_are_not_matched_across_sequences() {
    let clouds: [&[&str]; 4] = [&["1/1/1", "2/1/1"], &["1/1/2", "2/1/2"], &["1/2/1"], &["2/2/1"]];
    assert_eq!(
        refused(&experiment("layout = \"uw\"", clouds, ACROSS)),
        "error: search.fitness.cross-sequence: needs objects with training clouds that may be matched with each other, \
         got none\nadd clouds, in several sequences for cross-sequence, or write [search.fitness] split = 1"
    );
}

/// Without the check, a search would end with a validation that counts nothing, which no table holds.
#[test]
fn validation_clouds_must_be_of_other_sequences_than_the_training_clouds_of_their_object() {
    let clouds: [&[&str]; 4] =
        [&["1/1/1", "2/1/1"], &["2/2/1", "1/1/2"], &["1/1/3", "1/1/4"], &["2/3/1", "1/3/1"]];
    for sections in [
        ACROSS.to_owned(),
        format!("{ACROSS}[search]\nwinner = \"fitness\"\n[stop]\nvalidation_patience = \"off\"\n"),
        format!("[descriptor]\nfamily = \"structure\"\n{ACROSS}"),
    ] {
        assert_eq!(
            refused(&experiment("layout = \"uw\"", clouds, &sections)),
            "error: search.fitness: needs validation clouds of objects with training clouds that they may be matched with, \
             got none of 2\ngive the validation split clouds of other sequences than the training clouds \
             of their objects, or write [search.fitness] split = 1",
            "{sections}"
        );
    }
}

#[test]
fn validation_clouds_must_be_of_trained_objects_where_each_query_must_have_an_answer() {
    let clouds: [&[&str]; 4] = [&["1/1/1", "2/1/1"], &["2/2/1", "1/1/2"], &["3/1/1"], &["1/3/1"]];
    let fitness = "[search.fitness]\nleave-one-out = 1\n";
    assert_eq!(
        refused(&experiment("layout = \"uw\"", clouds, fitness)),
        "error: search.fitness: needs validation clouds of objects with training clouds that they may be matched with, got \
         none of 1\ngive the validation split clouds of objects that the training splits have, too"
    );
    // Where all queries are counted, they are wrong ones.
    let split = experiment("layout = \"uw\"", clouds, "");
    let checked = run("coordinator", ["check", &split.path("exp.toml")]).expect_success();
    assert!(checked.stderr.contains("the object error of validation cannot be below 100.00 %"), "{checked}");
}

#[test]
fn one_protocol_that_can_match_validation_clouds_is_enough() {
    let clouds: [&[&str]; 4] = [&["1/1/1", "2/1/1"], &["2/2/1", "1/2/2"], &["1/1/3", "1/2/4"], &["2/3/1"]];
    let only_first = [clouds[0], clouds[1], &["3/1/1", "1/1/3"], clouds[3]];
    for (clouds, not_counted) in [(clouds, None), (only_first, Some("1 of 2 clouds of validation"))] {
        let both = experiment("layout = \"uw\"", clouds, "[search.fitness]\nsplit = 1\ncross-sequence = 1\n");
        let checked = run("coordinator", ["check", &both.path("exp.toml")]).expect_success();
        match not_counted {
            Some(said) => assert!(checked.stderr.contains(said), "{checked}"),
            None => assert!(!checked.stderr.contains("validation are not counted"), "{checked}"),
        }
    }
}

#[test]
fn clouds_that_are_not_counted_are_counted_in_words_and_bound_no_error() {
    // The third object has one cloud, the validation cloud of the first no training cloud of another sequence.
    let clouds: [&[&str]; 4] =
        [&["1/1/1", "2/1/1", "3/1/1"], &["1/1/2", "2/2/1"], &["1/1/3", "2/3/1"], &["2/4/1"]];
    let experiment = experiment("layout = \"uw\"", clouds, ACROSS);
    let checked = run("coordinator", ["check", &experiment.path("exp.toml")]).expect_success();
    for said in [
        "fitness cross-sequence: 3 of 5 clouds of train1 and train2 are not counted",
        "fitness cross-sequence: 1 of 2 clouds of validation are not counted",
    ] {
        assert!(checked.stderr.contains(said), "{checked}");
    }
    // Who is not counted is not wrong: no error has a lower bound.
    assert!(!checked.stderr.contains("cannot be below"), "{checked}");
}

#[test]
fn categories_of_one_object_are_recognised_as_the_objects_are() {
    let toml = "[descriptor]\nfamily = \"structure\"\nmax_bins = 300\n[search.fitness]\ncross-sequence = 1\n\
        objective = \"category\"\n[ga]\npopulation = 4\nelite = 1\n[stop]\nevaluations = 8\n[results]\nbaselines = false\n";
    let experiment = Experiment::with(&format!("version = 1\n[dataset]\nroot = \"data\"\n{toml}"));
    let data = experiment.folder().join("data");
    run("coordinator", ["synth", &experiment.path("data"), "--objects", "3", "--views", "8"])
        .expect_success();
    // They are of one category: here each is of its own.
    for list in ["train1", "train2", "validation", "test"].map(|name| data.join(format!("{name}.txt"))) {
        let own_category = |line: &str| {
            let [category, object, frame] = line.split('/').collect::<Vec<_>>().try_into().unwrap();
            let [from, to] =
                [category, &format!("kind_{object}")].map(|category| data.join(category).join(object));
            fs::create_dir_all(&to).unwrap();
            fs::rename(from.join(frame), to.join(frame)).unwrap();
            format!("kind_{object}/{object}/{frame}\n")
        };
        let lines: String = fs::read_to_string(&list).unwrap().lines().map(own_category).collect();
        fs::write(&list, lines).unwrap();
    }
    let told = summary(&experiment.run("out", &[]).expect_success());
    for [object, category] in [
        ["train_error", "train_category_error"],
        ["validation_error", "validation_category_error"],
        ["test_object_error", "test_category_error"],
    ] {
        let error = |key: &str| told[key].as_f64().unwrap();
        assert_eq!(error(object), error(category), "{told}");
    }
}

#[test]
fn a_search_for_categories_is_reported_by_them() {
    let search = "[ga]\npopulation = 4\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n\
        [search.fitness]\nsplit = 1\nobjective = \"category\"\n";
    let experiment = Experiment::new(search);
    let told = summary(&experiment.run("out", &[]).expect_success());
    let verdict = told["verdict"].as_array().unwrap();
    assert!(!verdict.is_empty());
    // All clouds of the synthetic set are of a category of their own kind, whatever the object.
    for sentence in verdict {
        let sentence = sentence.as_str().unwrap();
        assert!(sentence.contains(" taken for another category"), "{sentence}");
    }
    let told = run("coordinator", ["run", &experiment.path("exp.toml"), "--out", &experiment.path("out")]);
    let told = told.expect_success().stdout;
    let mut titles = told.lines().filter(|line| line.starts_with("on test clouds "));
    assert!(titles.next().is_some_and(|title| title.contains(" category error ")), "{told}");
    run("coordinator", ["report", &experiment.path("out")]).expect_success();
    let report = fs::read_to_string(experiment.path("out/report/report.html")).unwrap();
    assert!(report.contains("Error of category recognition in each generation"));
    assert!(report.contains("category error"));
}

#[test]
fn intervals_are_of_as_many_clouds_as_queries_are_worth() {
    let search = "[ga]\npopulation = 4\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n[results]\n\
        baselines = false\n[search.fitness]\n";
    let told = |name: &str, fitness: &str| {
        let experiment = Experiment::new(&format!("{search}{fitness}"));
        let told = summary(&experiment.run(name, &[]).expect_success());
        let text = run("coordinator", ["run", &experiment.path("exp.toml"), "--out", &experiment.path(name)]);
        (told, text.expect_success().stdout)
    };
    let intervals =
        |told: &Value| ["train", "validation"].map(|split| told[format!("{split}_error_interval")].clone());
    let ((once, _), (often, text)) =
        (told("once", "cross-sequence = 1\n"), told("often", "cross-sequence = 100\n"));
    let queries = |told: &Value| told["train_queries"].as_f64().unwrap();
    assert_eq!(queries(&often), 100.0 * queries(&once));
    assert_eq!(often["train_error"], once["train_error"]);
    assert_eq!(intervals(&often), intervals(&once));
    assert_eq!(
        (&once["train_effective"], often["train_effective"].as_f64()),
        (&Value::Null, Some(queries(&once)))
    );
    let worth = format!("train: {} queries are worth {} clouds\n", queries(&often), queries(&once));
    assert!(text.contains(&worth), "{text}");

    // Clouds of train1 count twice: worth more than those of train1 alone, and fewer than there are.
    let (both, _) = told("both", "split = 1\ncross-sequence = 1\n");
    let worth = both["train_effective"].as_f64().unwrap();
    assert!(worth < queries(&once) && worth > queries(&both) - queries(&once), "{both}");
    let width = |told: &Value| {
        let [low, high] = [0, 1].map(|end| told["train_error_interval"][end].as_f64().unwrap());
        high - low
    };
    let too_narrow = {
        let wrong = (both["train_error"].as_f64().unwrap() * queries(&both)).round() as u32;
        let [low, high] = results::wilson(wrong, queries(&both) as u32);
        high - low
    };
    assert!(width(&both) > too_narrow, "{both}");
}
