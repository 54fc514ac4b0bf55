//! Weights of values: learned from the training clouds of a run, by it or afterwards, and taken wherever a structure is.

use std::fs;

use serde_json::Value;

use crate::experiments::{Experiment, clouds, digest, repository, summary};
use crate::process::{Finished, finish, kill_at, narrower_vectors, program, run};

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

/// Weights from the run itself, and those of `weigh`, on one search.
fn weighing() -> Experiment {
    Experiment::new(&format!("[search]\nweigh = \"jointly\"\n{STRUCTURES}"))
}

#[test]
fn a_run_weighs_its_winner_as_weigh_does_and_is_tested_with_the_weights() {
    let (plain, experiment) = (Experiment::new(STRUCTURES), weighing());
    let without = plain.run("out", &[]).expect_success();
    let with = experiment.run("out", &[]).expect_success();
    let (out, file, plain_file) =
        (experiment.path("out"), experiment.path("weighted.toml"), plain.path("weighted.toml"));
    run("coordinator", ["weigh", &out, &file]).expect_success();
    run("coordinator", ["weigh", &plain.path("out"), &plain_file]).expect_success();
    let text = fs::read_to_string(&file).unwrap();
    assert_eq!(fs::read_to_string(&plain_file).unwrap(), text);

    let [row, unweighted] = [&out, &plain.path("out")].map(|run| results::read_run(run).unwrap().row);
    let (_, body) = text.split_once('\n').unwrap();
    assert_eq!(row.weighted_winner.as_deref(), Some(body));
    assert_eq!((unweighted.weighted_winner, unweighted.weighted_train), (None, None));
    // What the search has found is the same, and only the test is not.
    assert_eq!(
        (&row.best_genes, row.train, row.validation),
        (&unweighted.best_genes, unweighted.train, unweighted.validation)
    );
    assert_ne!(digest(&with), digest(&without));
    let train = row.weighted_train.unwrap();
    assert_eq!(train.queries, row.train.queries);
    assert_eq!(summary(&with)["weighted_train_error"], train.object_error());
    assert_eq!(summary(&without)["weighted_train_error"], Value::Null);

    let wide = evaluated(&experiment, &file, None);
    let tested: Vec<String> = results::read_predictions(&out, results::PredictionSplit::Test)
        .unwrap()
        .iter()
        .map(|row| format!("{} {}", row.cloud, row.nearest_cloud))
        .collect();
    let of_file: Vec<String> =
        wide.lines().map(|line| line.split(' ').take(2).collect::<Vec<_>>().join(" ")).collect();
    assert_eq!(tested, of_file);

    // Everything that shows or takes the winner takes it with its weights.
    let shown = run("coordinator", experiment.run_args("out", &[]).iter().filter(|arg| *arg != "--json"));
    let shown = shown.expect_success().stdout;
    assert!(shown.contains("values weighted") && shown.contains("train weighed "), "{shown}");
    let page = experiment.path("report.html");
    run("coordinator", ["report", &out, "--out", &page]).expect_success();
    let html = fs::read_to_string(page).unwrap();
    assert!(html.contains("values weighted") && html.contains("training, weighed"));
    let artefact = experiment.path("artefact");
    let export = |more: &[&str]| {
        let args = ["export", &out, &artefact].into_iter().chain(more.iter().copied());
        run("coordinator", args).expect_success().stdout
    };
    assert!(!export(&[]).contains("note "));
    assert!(fs::read_to_string(format!("{artefact}/descriptor.toml")).unwrap().contains("value_weights"));
    // Weights that were learned jointly mislead whatever learns from the same clouds, and nothing else.
    assert!(export(&["--recogniser", "kernel-ridge"]).contains("--how separately"));
    assert!(!export(&["--recogniser", "kernel-ridge", "--structure", &file]).contains("note "));
    let args = ["compare", &out, "--no-times", "--structure", &file, "--listen", "127.0.0.1:0"];
    let compared = run("coordinator", args.into_iter().chain(["--descriptor", "evolved"])).expect_success();
    let wrong = |name: &str| {
        let row = compared.stdout.lines().find(|line| line.split_whitespace().next() == Some(name)).unwrap();
        row.split_whitespace().nth(3).map(str::to_owned)
    };
    assert_eq!(wrong("evolved"), wrong("weighted"));
    let test = row.test.unwrap();
    assert_eq!(wrong("evolved"), Some((test.queries - test.object_correct).to_string()));
    let verified = run("coordinator", ["verify", &out, "--sample", "3"]).expect_success();
    assert!(verified.stdout.ends_with(", weights of the winner's values learned again\n"), "{verified}");
}

#[test]
fn a_run_that_weighs_has_one_digest_whoever_works_and_wherever_it_was_killed() {
    let first = weighing();
    let expected = digest(&first.run("out", &["--local-workers", "1"]).expect_success());

    let cut = Experiment::new(&format!(
        "[search]\nweigh = \"jointly\"\n[coordinator]\npieces = 3\naudit = 1.0\n{STRUCTURES}"
    ));
    assert_eq!(digest(&cut.run("out", &["--local-workers", "3"]).expect_success()), expected);
    for vectors in narrower_vectors() {
        let mut narrower = program("coordinator");
        narrower.env("DESCRY_VECTORS", vectors).args(first.run_args(vectors, &["--no-cache"]));
        assert_eq!(digest(&finish(&mut narrower).expect_success()), expected, "{vectors}");
    }

    let args = first.run_args("killed", &["--local-workers", "1"]);
    kill_at("coordinator", args, "weighing the values of the winner");
    let resumed = run("coordinator", ["resume", &first.path("killed"), "--json"]).expect_success();
    assert_eq!(digest(&resumed), expected);

    let sweep = Experiment::new(&format!(
        "{STRUCTURES}[sweep.variants.plain]\nsearch.weigh = \"off\"\n[sweep.variants.weighed]\nsearch.weigh = \"jointly\"\n"
    ));
    let swept = sweep.run("out", &[]).expect_success();
    let weighed = |name: &str| {
        let row = results::read_run(sweep.folder().join("out").join(name)).unwrap().row;
        row.weighted_winner.is_some()
    };
    assert!(!weighed("plain") && weighed("weighed"), "{swept}");
    let shown = run("coordinator", sweep.run_args("out", &[]).iter().filter(|arg| *arg != "--json"));
    let shown = shown.expect_success().stdout;
    // A name stands above its line where both are too wide.
    let cells = |name: &str| -> Vec<&str> {
        let mut lines = shown.lines().skip_while(|line| *line != name).skip(1);
        lines.next().unwrap_or_default().split("  ").map(str::trim).filter(|cell| !cell.is_empty()).collect()
    };
    let place = cells("run").iter().position(|title| *title == "train weighed");
    let place = place.unwrap_or_else(|| panic!("{shown}"));
    assert_eq!(cells("plain")[place], "-", "{shown}");
    assert!(cells("weighed")[place].ends_with(" %"), "{shown}");
}

/// Writes the row of a finished run again, with digests that fit: as if it was honest but for what is changed.
fn forge(out: &str, change: impl FnOnce(&mut results::RunRow)) -> Result<(), results::Error> {
    let results::FinishedRun { mut row, genes, .. } = results::read_run(out).unwrap();
    change(&mut row);
    let file = format!("{out}/run/run.parquet");
    let kept = fs::read(&file).unwrap();
    fs::remove_file(&file).unwrap();
    let written = results::RunFolder::create(out, &genes).unwrap().write_run(&row);
    if written.is_err() {
        fs::write(&file, kept).unwrap();
    }
    written.map(|_| ())
}

#[track_caller]
fn not_sound(out: &str, complaint: &str) {
    run("coordinator", ["verify", out, "--sample", "0"]).expect_success();
    let verified = run("coordinator", ["verify", out, "--sample", "1"]).expect_error();
    assert!(verified.stdout.contains(complaint) && verified.stdout.contains("NOT sound"), "{verified}");
}

#[test]
fn weights_that_the_clouds_do_not_teach_are_found_by_verify() {
    let experiment = weighing();
    experiment.run("out", &[]).expect_success();
    let out = experiment.path("out");
    let honest = results::read_run(&out).unwrap().row;
    let text = honest.weighted_winner.clone().unwrap();

    let (before, rest) = text.split_once("value_weights = [").unwrap();
    let (weights, after) = rest.split_once(']').unwrap();
    let mut weights: Vec<f64> = weights.split(',').filter_map(|weight| weight.trim().parse().ok()).collect();
    // Not the largest, which must be 1.
    let place = weights.iter().position(|&weight| weight < 1.0).unwrap();
    weights[place] = if weights[place] < 0.5 { 0.5 } else { 0.25 };
    let other = format!("{before}value_weights = {weights:?}{after}");
    forge(&out, |row| row.weighted_winner = Some(other)).unwrap();
    not_sound(&out, &format!("weight of value {}: expected ", place + 1));

    let right = honest.weighted_train.unwrap();
    let mut counts = right;
    counts.object_correct -= 1;
    forge(&out, |row| (row.weighted_winner, row.weighted_train) = (Some(text.clone()), Some(counts)))
        .unwrap();
    let said = |objects: u32| format!("{objects} objects and ");
    not_sound(&out, &format!("run: weighted_train: expected {}", said(right.object_correct)));

    forge(&out, |row| row.weighted_train = Some(right)).unwrap();
    run("coordinator", ["verify", &out, "--sample", "1"]).expect_success();
    // Neither without the other, nor of other clouds.
    forge(&out, |row| row.weighted_train = None).unwrap_err();
    forge(&out, |row| row.weighted_winner = None).unwrap_err();
    counts.queries += 1;
    forge(&out, |row| row.weighted_train = Some(counts)).unwrap_err();
    forge(&out, |row| (row.weighted_winner, row.weighted_train) = (None, None)).unwrap();
    not_sound(&out, "run: weighted_winner: expected one, got none");
}

/// Whoever takes the winner says what is wrong with it.
#[test]
fn weights_of_another_structure_are_no_winner() {
    let experiment = weighing();
    experiment.run("out", &[]).expect_success();
    let out = experiment.path("out");
    let text = results::read_run(&out).unwrap().row.weighted_winner.unwrap();
    let one =
        "version = 1\n[[channel]]\npairs = \"cloud\"\nfeatures = [\"d 2\"]\nradius_cm = 9\nweight = 1.0\n";
    let rescaled = text.replacen("\nweight = ", "\nscale = \"none\"\nweight = ", 1);
    for (forged, difference) in [
        (one, "channels: expected "),
        (&rescaled, ", unscaled, "),
        ("no structure", "expected a structure, got something else"),
    ] {
        forge(&out, |row| row.weighted_winner = Some(forged.to_owned())).unwrap();
        let complaint = "weighted_winner must be the structure of the best genes with weights for its values";
        let (artefact, page) = (experiment.path("artefact"), experiment.path("report.html"));
        refused(run("coordinator", ["export", &out, &artefact]), complaint);
        refused(run("coordinator", ["compare", &out, "--listen", "127.0.0.1:0"]), complaint);
        run("coordinator", ["report", &out, "--out", &page]).expect_success();
        assert!(fs::read_to_string(&page).unwrap().contains(complaint));
        not_sound(&out, difference);
    }
}

#[test]
fn a_run_weighs_separately_where_it_is_asked_to_and_weigh_does_as_the_run() {
    let settings = format!("[search]\nweigh = \"separately\"\n{STRUCTURES}");
    let (experiment, jointly) = (Experiment::new(&settings), weighing());
    let finished = experiment.run("out", &[]).expect_success();
    assert_ne!(digest(&finished), digest(&jointly.run("out", &[]).expect_success()));
    let out = experiment.path("out");
    let weigh = |out: &str, name: &str, how: &[&str]| {
        let file = experiment.path(name);
        run("coordinator", ["weigh", out, &file].iter().chain(how)).expect_success();
        let text = fs::read_to_string(file).unwrap();
        text.split_once('\n').unwrap().1.to_owned()
    };
    let winner = |out: &str| results::read_run(out).unwrap().row.weighted_winner.unwrap();
    let separately = weigh(&out, "default.toml", &[]);
    assert_eq!(separately, winner(&out));
    let together = weigh(&out, "jointly.toml", &["--how", "jointly"]);
    assert_eq!(together, winner(&jointly.path("out")));
    assert_ne!(together, separately);
    assert_eq!(weigh(&jointly.path("out"), "separately.toml", &["--how", "separately"]), separately);
    run("coordinator", ["verify", &out, "--sample", "1"]).expect_success();
}

/// Whatever searched.
#[test]
fn winners_of_every_kind_of_search_are_weighed() {
    let by = |more: &str| format!("[descriptor]\nfamily = \"structure\"\nmax_bins = 300\n{more}");
    let search = "[ga]\npopulation = 8\n[stop]\ngenerations = 3\n[search]\nweigh = \"jointly\"\n";
    for (settings, args) in [
        (by(&format!("members = 2\n{search}")), &[][..]),
        (by(&format!("{search}method = \"nsga2\"\nobjectives = [\"error\", \"size\"]\n")), &[]),
        (by(&format!("{search}winner = \"validation\"\n")), &[]),
        (by(search), &["--control"]),
    ] {
        let experiment = Experiment::new(&settings);
        let finished = experiment.run("out", args).expect_success();
        let out = experiment.path("out");
        let row = results::read_run(&out).unwrap().row;
        assert_eq!(row.weighted_train.unwrap().queries, row.train.queries, "{settings}{finished}");
        let verified = run("coordinator", ["verify", &out, "--sample", "1"]).expect_success();
        assert!(verified.stdout.ends_with(", weights of the winner's values learned again\n"), "{verified}");
    }
}

/// Shares of two bins differ by as much: neither tells more, the winner stays as it was, and is weighed all the same.
#[test]
fn structures_by_hand_are_weighed_and_one_of_two_equal_values_stays_as_it_is() {
    for (features, is_changed) in [("\"d 2\"", false), ("\"hue 4\"", true)] {
        let channel = format!(
            "[search]\nweigh = \"jointly\"\n[search.fitness]\ncross-sequence = 1\n[descriptor]\nfamily = \"structure\"\n\
             [[descriptor.channel]]\npairs = \"cloud\"\nfeatures = [{features}]\nradius_cm = 9\nmetric = \"l1\"\nweight = 1.0\n"
        );
        let experiment = Experiment::new(&channel);
        experiment.run("out", &["--local-workers", "1"]).expect_success();
        let out = experiment.path("out");
        let row = results::read_run(&out).unwrap().row;
        let text = row.weighted_winner.unwrap();
        assert_eq!(text.contains("value_weights"), is_changed, "{text}");
        assert_eq!(row.weighted_train.unwrap().queries, row.train.queries);
        if !is_changed {
            assert_eq!(row.weighted_train, Some(row.train));
        }
        let verified = run("coordinator", ["verify", &out, "--sample", "1"]).expect_success();
        assert!(verified.stdout.starts_with("sound: "), "{verified}");
    }
}

#[test]
fn whoever_weighs_jointly_for_a_recogniser_that_learns_is_told_of_the_other_way() {
    for (how, method, is_told) in [
        ("jointly", "kernel-ridge", true),
        ("jointly", "nearest", false),
        ("separately", "kernel-ridge", false),
    ] {
        let experiment = Experiment::new(&format!(
            "[search]\nweigh = \"{how}\"\n[recognition]\nmethod = \"{method}\"\n{STRUCTURES}"
        ));
        let checked = run("coordinator", ["check", &experiment.path("exp.toml")]).expect_success();
        let note =
            format!("search.weigh: \"separately\" is likely to suit recognition.method = \"{method}\"");
        assert_eq!(checked.stderr.contains(&note), is_told, "{how} {method}: {checked}");
    }
}

#[test]
fn a_run_that_could_not_weigh_is_refused_before_it_begins() {
    for (settings, complaint) in [
        ("[search]\nweigh = \"jointly\"\n", "search.weigh: needs structures, got family disk-ring"),
        (
            "[search]\nweigh = \"jointly\"\n[descriptor]\nfamily = \"structure\"\nmax_bins = 501\n",
            "search.weigh: needs descriptor.max_bins of at most 500, got 501",
        ),
        ("[search]\nweigh = 1\n[descriptor]\nfamily = \"structure\"\n", "weigh"),
    ] {
        let experiment = Experiment::new(settings);
        refused(experiment.run("out", &[]), complaint);
        assert!(!fs::exists(experiment.path("out")).unwrap(), "{settings}");
    }
    let without = listed_with(
        |_| false,
        "[search]\nweigh = \"jointly\"\n[search.fitness]\nleave-one-out = 1\n[descriptor]\nfamily = \"structure\"\n",
    );
    for command in [vec!["run", "--out"], vec!["check"]] {
        let toml = without.path("listed.toml");
        let out = without.path("out");
        let args: Vec<&str> = match &command[..] {
            ["check"] => vec!["check", &toml],
            _ => vec!["run", &toml, "--out", &out, "--listen", "127.0.0.1:0"],
        };
        refused(
            run("coordinator", args),
            "search.weigh: clouds: an object seen in two sequences expected, got none",
        );
    }
    assert!(!fs::exists(without.path("out")).unwrap());
}

/// A finished run on the clouds of all tests by a manifest in which a cloud has a sequence if its object is one of those.
fn listed(has_sequence: fn(&str) -> bool) -> Experiment {
    let experiment = listed_with(has_sequence, "");
    let (toml, out) = (experiment.path("listed.toml"), experiment.path("out"));
    run("coordinator", ["run", &toml, "--out", &out, "--listen", "127.0.0.1:0"]).expect_success();
    experiment
}

/// The experiment of such a run, `listed.toml`, with more settings.
fn listed_with(has_sequence: fn(&str) -> bool, more: &str) -> Experiment {
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
         [ga]\npopulation = 6\n[stop]\ngenerations = 2\n{more}"
    );
    fs::write(&toml, text).unwrap();
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
