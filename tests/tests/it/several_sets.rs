//! Clouds of several sets: queries are compared with clouds of their own set only, and counts are weighted sums.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use results::{
    Counts, EvaluationRow, PredictionSplit, SetRow, TableName, read_comparison, read_evaluations,
    read_predictions, read_sets, read_table,
};
use serde_json::Value;

use crate::experiments::{Experiment, clouds, copy_folder, digest, repository, summary};
use crate::process::{Finished, kill_at, run};

const SPLITS: [&str; 4] = ["train1", "train2", "validation", "test"];
const SEARCH: &str = "[ga]\npopulation = 6\n[stop]\ngenerations = 3\nstagnation = \"off\"\nperfect = false\n\
    validation_patience = \"off\"\n[coordinator]\naudit = 0\n";
const STRUCTURES: &str =
    "[descriptor]\nfamily = \"structure\"\nmax_bins = 300\n[search.fitness]\ncross-sequence = 1\n";

/// The clouds of all tests as set `a`, and others of the same names as set `b`, in one manifest.
fn two_sets(more: &str) -> Experiment {
    let experiment = Experiment::with(&format!(
        "version = 1\nname = \"short\"\nseed = 5\n[dataset]\nroot = \"data\"\nlayout = \"manifest\"\n\
         manifest = \"clouds.csv\"\n{more}"
    ));
    copy_folder(clouds(), &experiment.folder().join("data/first"));
    let second = experiment.path("data/second");
    run("coordinator", ["synth", &second, "--objects", "6", "--views", "12", "--seed", "4"]).expect_success();
    let mut manifest = "path,category,instance,sequence,split,set\n".to_owned();
    // Split after split, so that the clouds of both sets alternate.
    for split in SPLITS {
        for (set, folder) in [("b", "second"), ("a", "first")] {
            let list = fs::read_to_string(experiment.path(&format!("data/{folder}/{split}.txt"))).unwrap();
            for path in list.lines() {
                let parts: Vec<&str> = path.split('/').collect();
                let [category, instance, file] = parts[..] else { panic!("{path}") };
                let sequence = file.strip_prefix(instance).unwrap().split('_').nth(1).unwrap();
                manifest += &format!("{folder}/{path},{category},{instance},{sequence},{split},{set}\n");
            }
        }
    }
    fs::write(experiment.path("data/clouds.csv"), manifest).unwrap();
    experiment
}

/// The same search on the clouds of one set alone.
fn one_set(of: &Experiment, folder: &str, more: &str) -> Experiment {
    let root = of.path(&format!("data/{folder}"));
    Experiment::with(&format!(
        "version = 1\nname = \"short\"\nseed = 5\n[dataset]\nroot = \"{root}\"\n{more}"
    ))
}

fn first_generation(folder: &str) -> Vec<EvaluationRow> {
    let rows = read_evaluations(folder).unwrap();
    rows.into_iter().filter(|row| row.generation == 1).collect()
}

fn sum(parts: &[(Counts, u32)]) -> Counts {
    let of = |count: fn(&Counts) -> u32| parts.iter().map(|(counts, weight)| weight * count(counts)).sum();
    Counts {
        object_correct: of(|counts| counts.object_correct),
        category_correct: of(|counts| counts.category_correct),
        queries: of(|counts| counts.queries),
    }
}

#[test]
fn counts_are_the_weighted_sums_of_what_each_set_has_alone() {
    for family in ["", STRUCTURES] {
        let more = format!("{SEARCH}{family}");
        let both = two_sets(&format!("{more}[search.sets]\nb = 3\n"));
        let told = summary(&both.run("out", &[]).expect_success());
        let [a, b] = ["first", "second"].map(|folder| one_set(&both, folder, &more));
        a.run("out", &[]).expect_success();
        b.run("out", &[]).expect_success();
        let [all, of_a, of_b] = [&both, &a, &b].map(|experiment| first_generation(&experiment.path("out")));
        assert_eq!(all.len(), 6);
        for ((row, a), b) in all.iter().zip(&of_a).zip(&of_b) {
            assert_eq!((&row.chromosome, &row.chromosome), (&a.chromosome, &b.chromosome));
            assert_eq!(row.counts, sum(&[(a.counts, 1), (b.counts, 3)]));
            let error = |alone: &EvaluationRow| {
                assert_eq!(alone.set_errors, None);
                (1.0 - f64::from(alone.correct()) / f64::from(alone.counts.queries)) as f32
            };
            assert_eq!(row.set_errors, Some(vec![error(a), error(b)]));
            let mean = a.margin.zip(b.margin).map(|(margin_a, margin_b)| {
                let [a, b] = [(margin_a, a), (margin_b, b)]
                    .map(|(margin, row)| margin * f64::from(row.counts.queries));
                (a + 3.0 * b) / f64::from(row.counts.queries)
            });
            assert_eq!(row.margin.is_some(), mean.is_some());
            assert!(
                row.margin.zip(mean).is_none_or(|(got, mean)| (got - mean).abs() < 1e-12),
                "{row:?} {mean:?}"
            );
        }
        check_predictions(&both, &told);
        check_each_set_alone(&both);
        let verified = run("coordinator", ["verify", &both.path("out"), "--sample", "5"]).expect_success();
        assert!(verified.stdout.contains("sound: run digest"), "{verified}");
        // The winner and its three baselines.
        assert!(verified.stdout.ends_with(", errors by set of 4 descriptors counted again\n"), "{verified}");
        let page = both.path("report.html");
        run("coordinator", ["report", &both.path("out"), "--out", &page]).expect_success();
        let html = std::fs::read_to_string(page).unwrap();
        let (_, table) = html.split_once("Errors on the test clouds of each set").expect("a table of sets");
        let (table, _) = table.split_once("</table>").unwrap();
        let rows = read_sets(both.path("out")).unwrap();
        assert_eq!(table.matches("<tr>").count(), 1 + rows.len(), "{table}");
        for row in rows {
            let error = format!("{:.2}", 100.0 * row.counts.object_error());
            assert!(
                table.contains(&row.set) && table.contains(&row.descriptor) && table.contains(&error),
                "{table}"
            );
        }
    }
}

/// Each test cloud is recognised among those of its own set, and the table of sets counts that.
fn check_predictions(both: &Experiment, told: &Value) {
    let out = both.path("out");
    let folder = |path: &str| path.split('/').next().unwrap().to_owned();
    let mut counted: BTreeMap<String, Counts> = BTreeMap::new();
    for row in read_predictions(&out, PredictionSplit::Test).unwrap() {
        assert_eq!(folder(&row.cloud), folder(&row.nearest_cloud), "{row:?}");
        let runner_up = row.runner_up.unwrap();
        assert_eq!(folder(&row.cloud), folder(&runner_up.cloud));
        let counts = counted.entry(folder(&row.cloud)).or_insert(Counts {
            object_correct: 0,
            category_correct: 0,
            queries: 0,
        });
        counts.queries += 1;
        counts.object_correct += u32::from(row.instance == row.predicted_instance);
        counts.category_correct += u32::from(row.category == row.predicted_category);
    }
    let rows = read_sets(&out).unwrap();
    let labels: Vec<&str> = rows.iter().map(|row| row.descriptor.as_str()).collect();
    let candidates = ["evolved", "paper", "global-chroma", "global-hue-saturation"];
    assert_eq!(labels, candidates.map(|label| [label; 2]).concat());
    for (row, (set, weight, folder)) in rows.iter().zip([("a", 1, "first"), ("b", 3, "second")]) {
        assert_eq!((&*row.set, row.weight, row.counts), (set, weight, counted[folder]));
    }
    assert_eq!(told["sets"].as_array().unwrap().len(), rows.len());
    let sentence = told["verdict"].as_array().unwrap().last().unwrap().as_str().unwrap();
    let errors = |row: &SetRow| row.counts.object_error();
    let worst = if errors(&rows[0]) >= errors(&rows[1]) { "a" } else { "b" };
    assert!(sentence.starts_with(&format!("highest error on {worst}: ")), "{sentence}");
}

/// A comparison on one set, and an artefact of it, have what the run has on this set.
fn check_each_set_alone(both: &Experiment) {
    let out = both.path("out");
    for (set, folder) in [("a", "first"), ("b", "second")] {
        let names = ["--descriptor", "evolved", "--descriptor", "paper", "--descriptor", "global-chroma"];
        let args = ["compare", &out, "--set", set, "--no-times", "--listen", "127.0.0.1:0"];
        run("coordinator", args.into_iter().chain(names)).expect_success();
        let compared = read_comparison(both.path(&format!("out/sets/{set}"))).unwrap();
        let counts = |label: &str| {
            let rows = read_sets(&out).unwrap();
            rows.into_iter().find(|row| row.descriptor == label && row.set == set).unwrap().counts
        };
        for row in &compared {
            assert_eq!(row.counts, counts(&row.descriptor), "{set}: {}", row.descriptor);
        }
        assert_eq!(compared.len(), 3);
        let artefact = both.path(&format!("artefact-{set}"));
        run("coordinator", ["export", &out, &artefact, "--set", set]).expect_success();
        let list = fs::read_to_string(both.path(&format!("data/{folder}/train2.txt"))).unwrap();
        let cloud = both.path(&format!("data/{folder}/{}", list.lines().next().unwrap()));
        let found = run("coordinator", ["recognise", &artefact, &cloud]).expect_success();
        assert!(found.stdout.contains("distance 0.0"), "{found}");
    }
    // The lockbox is that of the run, and its own comparison stays.
    assert_eq!(read_table(&out, TableName::Looks).unwrap().shape().0, 3);
    assert_eq!(read_comparison(&out).unwrap().len(), 4);
    let refused = run("coordinator", ["compare", &out, "--set", "c"]).expect_error();
    assert!(refused.stderr.contains("--set: must name sets of the clouds, got \"c\"\n"), "{refused}");
}

#[test]
fn a_set_of_weight_0_has_no_part_in_the_search_and_is_tested() {
    for family in ["", STRUCTURES] {
        let more = format!("{SEARCH}{family}");
        let without = two_sets(&format!("{more}[search.sets]\nb = 0\n"));
        let told = summary(&without.run("out", &[]).expect_success());
        let alone = one_set(&without, "first", &more);
        let of_a = summary(&alone.run("out", &[]).expect_success());
        let plain = |experiment: &Experiment| {
            let rows = read_evaluations(experiment.path("out")).unwrap();
            let plain = |row| EvaluationRow { computed: None, set_errors: None, ..row };
            rows.into_iter().map(plain).collect::<Vec<_>>()
        };
        assert_eq!(plain(&without), plain(&alone));
        for row in read_evaluations(without.path("out")).unwrap() {
            let error = (1.0 - f64::from(row.correct()) / f64::from(row.counts.queries)) as f32;
            assert_eq!(row.set_errors, Some(vec![error]), "of the set that has a weight");
        }
        assert_eq!(told["best"], of_a["best"]);
        let rows = read_sets(without.path("out")).unwrap();
        let [seen, unseen] = [&rows[0], &rows[1]];
        assert_eq!((&*seen.descriptor, &*seen.set, seen.weight), ("evolved", "a", 1));
        assert_eq!((&*unseen.descriptor, &*unseen.set, unseen.weight), ("evolved", "b", 0));
        assert_eq!(Value::from(seen.counts.object_error()), of_a["test_object_error"]);
        assert_eq!(unseen.counts.queries, seen.counts.queries);
    }
}

#[test]
fn workers_and_a_kill_change_no_bit() {
    let experiment = two_sets(&format!("{SEARCH}{STRUCTURES}"));
    let first = experiment.run("out", &["--local-workers", "1"]).expect_success();
    let three = experiment.run("three", &["--local-workers", "3"]).expect_success();
    assert_eq!(digest(&three), digest(&first));
    let args = experiment.run_args("killed", &["--local-workers", "1"]);
    kill_at("coordinator", args, "generation 2/");
    let resumed = run("coordinator", ["resume", &experiment.path("killed"), "--json"]).expect_success();
    assert_eq!(digest(&resumed), digest(&first));
    let rows = |out: &str| read_sets(experiment.path(out)).unwrap();
    assert_eq!((rows("three"), rows("killed")), (rows("out"), rows("out")));
    // The summary of a finished run is made from its tables.
    let again = summary(&experiment.run("out", &[]).expect_success());
    let told = summary(&first);
    assert_eq!((&again["sets"], &again["verdict"]), (&told["sets"], &told["verdict"]));
    let text = run("coordinator", ["resume", &experiment.path("out")]).expect_success().stdout;
    assert!(text.contains("test clouds of") && text.contains("highest error on "), "{text}");
}

#[test]
fn a_sweep_leaves_out_one_set_after_the_other() {
    let experiment = two_sets(&format!(
        "{SEARCH}[sweep.variants.without-a.search.sets]\na = 0\n[sweep.variants.without-b.search.sets]\nb = 0\n"
    ));
    experiment.run("out", &[]).expect_success();
    for (variant, unseen) in [("without-a", "a"), ("without-b", "b")] {
        let rows = read_sets(experiment.path(&format!("out/{variant}"))).unwrap();
        let weights: Vec<(&str, u32)> = rows[..2].iter().map(|row| (&*row.set, row.weight)).collect();
        assert_eq!(weights, ["a", "b"].map(|set| (set, u32::from(set != unseen))));
    }
}

#[test]
fn a_manifest_without_sets_is_what_it_was() {
    let experiment = two_sets(SEARCH);
    let manifest = experiment.path("data/clouds.csv");
    let text = fs::read_to_string(&manifest).unwrap();
    let of_a: Vec<&str> = text
        .lines()
        .filter(|line| !line.ends_with(",b"))
        .map(|line| line.rsplit_once(',').unwrap().0)
        .collect();
    fs::write(&manifest, of_a.join("\n")).unwrap();
    let told = summary(&experiment.run("out", &[]).expect_success());
    let alone = one_set(&experiment, "first", SEARCH);
    assert_eq!(told["best"], summary(&alone.run("out", &[]).expect_success())["best"]);
    assert!(told.get("sets").is_none() && read_sets(experiment.path("out")).unwrap().is_empty());
    // A set of all clouds is another name for none.
    let named =
        [of_a[0].to_owned() + ",set"].into_iter().chain(of_a[1..].iter().map(|row| format!("{row},a")));
    fs::write(&manifest, named.collect::<Vec<_>>().join("\n")).unwrap();
    let named = summary(&experiment.run("named", &[]).expect_success());
    assert_eq!(named["best"], told["best"]);
    assert!(named.get("sets").is_none() && read_sets(experiment.path("named")).unwrap().is_empty());
    let predictions = |out| read_table(experiment.path(out), TableName::Predictions).unwrap();
    assert!(predictions("named").equals_missing(&predictions("out")));
}

#[test]
fn sets_that_cannot_be_searched_are_refused_by_name() {
    let refused = |experiment: &Experiment, complaint: &str| {
        let finished: Finished = experiment.run("out", &[]).expect_error();
        assert!(finished.stderr.contains(complaint), "{finished}");
        assert!(!experiment.folder().join("out/run").exists());
    };
    let weights = |text: &str| two_sets(&format!("{SEARCH}[search.sets]\n{text}\n"));
    refused(&weights("c = 1"), "search.sets: must name sets of the clouds, got \"c\"\n");
    refused(&weights("a = 0\nb = 0"), "search.sets: must leave one set a weight above 0, got only zeros\n");
    refused(&weights("a = 101"), "search.sets.a: not between 0 and 100, got 101\n");
    refused(&weights("A = 1"), "search.sets: not 1 to 64 letters a-z, digits, - and _");
    let without = Experiment::new(&format!("{SEARCH}[search.sets]\na = 1\n"));
    refused(&without, "sets of these clouds are: none, as the manifest has no column set");

    let experiment = two_sets(SEARCH);
    let manifest = experiment.path("data/clouds.csv");
    let text = fs::read_to_string(&manifest).unwrap();
    let changed = |change: &dyn Fn(&str) -> String| {
        let mut lines = text.lines();
        let header = lines.next().unwrap().to_owned();
        let rows: Vec<String> = std::iter::once(header).chain(lines.map(change)).collect();
        fs::write(&manifest, rows.join("\n")).unwrap();
    };
    changed(&|row| row.strip_suffix(",b").map_or_else(|| row.to_owned(), |row| format!("{row},")));
    refused(&experiment, "clouds.csv, line 2: set expected, got nothing\n");
    changed(&|row| row.strip_suffix(",b").map_or_else(|| row.to_owned(), |row| format!("{row},../b")));
    refused(&experiment, "set of 1 to 64 of a-z");
    changed(&|row| row.replace("train1,b", "train2,b"));
    refused(&experiment, "set b: must have usable clouds in train1 and train2, got none in train1\n");

    // Validation clouds of a set without weight choose no winner.
    let only_b = weights("a = 0\n[search]\nwinner = \"validation\"");
    let rows = fs::read_to_string(only_b.path("data/clouds.csv")).unwrap();
    fs::write(only_b.path("data/clouds.csv"), rows.replace(",validation,b", ",test,b")).unwrap();
    refused(&only_b, "search.winner = \"validation\" need validation clouds, got none\n");

    fs::write(&manifest, text.clone()).unwrap();
    let exhaust = ["exhaust", &experiment.path("exp.toml"), "--listen", "127.0.0.1:0"];
    let finished = run("coordinator", exhaust).expect_error();
    assert!(finished.stderr.contains("exhaust: needs clouds of one set, got sets a, b\n"), "{finished}");
    experiment.run("done", &[]).expect_success();
    for command in ["compare", "export"] {
        let into = experiment.path("into");
        let mut args = vec![command.to_owned(), experiment.path("done")];
        args.extend((command == "export").then_some(into));
        let finished = run("coordinator", args).expect_error();
        assert!(finished.stderr.contains(": needs clouds of one set, got sets a, b\n"), "{finished}");
    }
    // Which set a cloud is of is part of the data.
    changed(&|row| if row.contains("_1_") { row.replace(",b", ",a") } else { row.to_owned() });
    let other = run("coordinator", ["verify", &experiment.path("done"), "--sample", "1"]).expect_error();
    assert!(
        other.stderr.contains("of another set: ") || other.stdout.contains("of another set: "),
        "{other}"
    );
}

#[test]
fn values_are_weighed_by_all_sets_or_by_one() {
    let both = two_sets(SEARCH);
    let [triple, none] = [3, 0].map(|weight| two_sets(&format!("{SEARCH}[search.sets]\nb = {weight}\n")));
    let alone = one_set(&both, "first", SEARCH);
    for experiment in [&both, &triple, &none, &alone] {
        experiment.run("out", &[]).expect_success();
    }
    let paper = repository().join("experiments/descriptors/paper.toml").display().to_string();
    // Without the first line, which says how many clouds there were.
    let weighed = |experiment: &Experiment, name: &str, more: &[&str]| -> String {
        let (out, file) = (experiment.path("out"), experiment.path(name));
        let args = ["weigh", &out, &file, "--structure", &paper];
        run("coordinator", args.iter().chain(more)).expect_success();
        fs::read_to_string(file).unwrap().split_once('\n').unwrap().1.to_owned()
    };
    let [all, a, b] = [("all", &[][..]), ("a", &["--set", "a"]), ("b", &["--set", "b"])]
        .map(|(name, set)| weighed(&both, name, set));
    assert_eq!(a, weighed(&alone, "a", &[]));
    assert_eq!(a, weighed(&none, "a", &[]));
    let mut different = vec![all, a, b, weighed(&triple, "all", &[])];
    different.sort_unstable();
    different.dedup();
    assert_eq!(different.len(), 4);
    let (out, file) = (both.path("out"), both.path("c"));
    let unknown = run("coordinator", ["weigh", &out, &file, "--structure", &paper, "--set", "c"]);
    assert!(unknown.expect_error().stderr.contains("--set"));
}

#[test]
fn a_run_weighs_its_winner_by_the_sets_that_have_a_weight_and_is_tested_on_all() {
    let settings =
        |weight| format!("[search]\nweigh = \"jointly\"\n{SEARCH}{STRUCTURES}[search.sets]\nb = {weight}\n");
    for weight in [3, 0] {
        let both = two_sets(&settings(weight));
        let ran = both.run("out", &[]).expect_success();
        let (out, file) = (both.path("out"), both.path("weighted.toml"));
        run("coordinator", ["weigh", &out, &file]).expect_success();
        let text = fs::read_to_string(&file).unwrap();
        let row = results::read_run(&out).unwrap().row;
        assert_eq!(row.weighted_winner.as_deref(), text.split_once('\n').map(|(_, body)| body));
        assert_eq!(row.weighted_train.unwrap().queries, row.train.queries);
        let tested: Vec<SetRow> = read_sets(&out).unwrap();
        let evolved: Vec<&SetRow> = tested.iter().filter(|row| row.descriptor == "evolved").collect();
        assert_eq!(evolved.iter().map(|row| &*row.set).collect::<Vec<_>>(), ["a", "b"]);
        // Each set alone, as compare counts it.
        for row in evolved {
            let args =
                ["compare", &out, "--set", &row.set, "--no-times", "--json", "--listen", "127.0.0.1:0"];
            run("coordinator", args.into_iter().chain(["--structure", &file])).expect_success();
            let place = Path::new(&out).join("sets").join(&row.set);
            let compared = read_comparison(place).unwrap();
            let of = |name: &str| compared.iter().find(|one| one.descriptor == name).unwrap().counts;
            assert_eq!((of("evolved"), of("weighted")), (row.counts, row.counts), "{ran}");
        }
        run("coordinator", ["verify", &out, "--sample", "2"]).expect_success();
    }
}
