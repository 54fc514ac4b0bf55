//! `coordinator compare`: the tables against each other and against what they are defined by, and bad input.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use results::{TableName, read_run, read_table};
use serde_json::Value;

use crate::experiments::{Experiment, begun, clouds, copy_folder, free_address, repository, summary};
use crate::process::{Finished, Running, kill_at, run};

/// A short search without a comparison at its end.
const SEARCH: &str = "[ga]\npopulation = 4\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n\
    [results]\nbaselines = false\n";
const LABELS: [&str; 12] = [
    "evolved",
    "evolved-l1",
    "paper",
    "paper-l1",
    "pfhrgb",
    "pfhrgb-l1",
    "shotcolor",
    "shotcolor-l1",
    "global-chroma",
    "global-chroma-l1",
    "global-hue-saturation",
    "global-hue-saturation-l1",
];

fn compare(run_folder: &str, more: &[&str]) -> Finished {
    let args = ["compare", run_folder, "--listen", "127.0.0.1:0", "--json"];
    run("coordinator", args.into_iter().chain(more.iter().copied()))
}

/// A cell that was read.
#[derive(Clone, Debug, PartialEq)]
enum Cell {
    Number(f64),
    Text(String),
    Null,
}

/// Rows of a table by column.
#[derive(Clone, Debug, PartialEq)]
struct Rows(BTreeMap<String, Vec<Cell>>);

impl Rows {
    fn read(folder: &str, table: TableName) -> Self {
        let frame = read_table(folder, table).unwrap();
        let cell = |column: &str, row: usize| {
            let value = frame.column(column).unwrap().get(row).unwrap();
            let number = value.extract::<f64>().map(Cell::Number);
            let text = value.get_str().map(|text| Cell::Text(text.to_owned()));
            text.or(number).unwrap_or(Cell::Null)
        };
        let names = frame.get_column_names();
        let cells = |name: &str| (0..frame.height()).map(|row| cell(name, row)).collect();
        Self(names.into_iter().map(|name| (name.to_string(), cells(name))).collect())
    }

    fn height(&self) -> usize {
        self.0.values().next().map_or(0, Vec::len)
    }

    /// Rows with this text in this column, which is left out.
    fn of(&self, column: &str, value: &str) -> Self {
        let kept: Vec<usize> =
            (0..self.height()).filter(|&row| self.0[column][row] == Cell::Text(value.to_owned())).collect();
        let others = self.0.iter().filter(|(name, _)| *name != column);
        Self(
            others
                .map(|(name, cells)| (name.clone(), kept.iter().map(|&row| cells[row].clone()).collect()))
                .collect(),
        )
    }

    /// Numbers of a column, those that are there.
    fn numbers(&self, column: &str) -> Vec<f64> {
        let number = |cell: &Cell| if let Cell::Number(number) = cell { Some(*number) } else { None };
        self.0[column].iter().filter_map(number).collect()
    }

    /// Texts of a column, those that are there.
    fn texts(&self, column: &str) -> Vec<String> {
        let text = |cell: &Cell| if let Cell::Text(text) = cell { Some(text.clone()) } else { None };
        self.0[column].iter().filter_map(text).collect()
    }
}

#[test]
fn objects_that_the_database_does_not_have_are_compared_by_their_category() {
    // As leave-instance-out leaves them: no test cloud shows an object of the database.
    let folder = Experiment::with("");
    let data = folder.path("data");
    run("coordinator", ["synth", &data, "--objects", "4", "--views", "8"]).expect_success();
    let lists = ["train1", "train2", "validation", "test"].map(|list| format!("{data}/{list}.txt"));
    let clouds = lists.each_ref().map(|list| fs::read_to_string(list).unwrap());
    let object_of = |cloud: &str| cloud.rsplit_once('/').unwrap().0.to_owned();
    let left_out = object_of(clouds[3].lines().next().unwrap());
    for (place, (list, clouds)) in lists.iter().zip(&clouds).enumerate() {
        let kept = clouds.lines().filter(|cloud| (object_of(cloud) == left_out) == (place == 3));
        fs::write(list, kept.map(|cloud| format!("{cloud}\n")).collect::<String>()).unwrap();
    }
    let dataset = format!("version = 1\nname = \"short\"\nseed = 5\n[dataset]\nroot = \"{data}\"\n");
    fs::write(folder.path("exp.toml"), dataset + SEARCH).unwrap();
    folder.run("out", &[]).expect_success();
    let out = folder.path("out");
    compare(&out, &["--no-times"]).expect_success();
    let [distances, _, curves, _, comparison] = TableName::COMPARISON.map(|table| Rows::read(&out, table));
    assert_eq!(comparison.numbers("object_error"), [1.0; 6]);
    assert_eq!((comparison.numbers("area"), comparison.numbers("nearest_area")), (vec![], vec![0.0; 6]));
    assert_eq!(BTreeSet::from_iter(curves.texts("curve")), BTreeSet::from(["nearest".to_owned()]));
    assert!(distances.height() > 0);
    run("coordinator", ["report", &out]).expect_success();
}

#[test]
fn the_tables_of_a_comparison_follow_from_the_distances() {
    let experiment = Experiment::new(SEARCH);
    let ran = experiment.run("out", &[]).expect_success();
    let out = experiment.path("out");
    let told: Value = summary(&compare(
        &out,
        &["--distance", "l1", "--distance", "chi2", "--radius-cm", "2.5", "--reason", "table 1"],
    ));
    let [distances, answers, curves, pairs, comparison] =
        TableName::COMPARISON.map(|table| Rows::read(&out, table));

    // The run is what it was, and both looks at its test clouds are told.
    assert_eq!(read_run(&out).unwrap().run_digest, summary(&ran)["run_digest"]);
    run("coordinator", ["verify", &out, "--sample", "2"]).expect_success();
    let looks = Rows::read(&out, TableName::Looks);
    assert_eq!(looks.texts("command"), ["run", "compare"]);
    assert_eq!(looks.texts("reason")[1], "table 1");
    assert_eq!(looks.texts("descriptors")[1].split(' ').collect::<Vec<_>>(), LABELS);
    assert_eq!(told["looks"], 2);

    // The run's own final test, bit for bit.
    let expected = Rows::read(&out, TableName::Predictions).of("split", "test");
    assert_eq!(answers.of("descriptor", "evolved"), expected);

    assert_eq!(comparison.texts("descriptor"), LABELS);
    let mut objects = BTreeMap::new();
    let (instances, clouds) = (expected.texts("instance"), expected.texts("cloud"));
    for (row, label) in LABELS.into_iter().enumerate() {
        let own = distances.of("descriptor", label);
        let answered = answers.of("descriptor", label);
        let (queries, databases, values) =
            (own.numbers("query"), own.numbers("database"), own.numbers("distance"));
        // The nearest cloud is the one with the smallest distance (tables keep it as f32), the first on ties.
        let mut nearest: BTreeMap<u32, (f64, u32)> = BTreeMap::new();
        for ((query, database), value) in queries.iter().zip(&databases).zip(&values) {
            let best = nearest.entry(*query as u32).or_insert((*value, *database as u32));
            if value < &best.0 {
                *best = (*value, *database as u32);
            }
        }
        let got = answered.numbers("distance");
        assert_eq!(got.len(), nearest.len());
        for (got, (expected, _)) in got.iter().zip(nearest.values()) {
            assert_eq!(f64::from(*got as f32), *expected, "{label}");
        }
        // Which object a database cloud shows follows from the answers that name it.
        let wrong =
            answered.texts("predicted_instance").iter().zip(&instances).filter(|(a, b)| a != b).count();
        let count = comparison.numbers("queries")[row] - comparison.numbers("object_correct")[row];
        assert_eq!((count as usize, answered.texts("cloud")), (wrong, clouds.clone()), "{label}");
        objects.insert(label, answered.texts("predicted_instance"));

        // Recall and precision, counted anew at some thresholds.
        let relevant_of = |query: f64, database: f64| relevant(&instances, &experiment, query, database);
        let curve = curves.of("descriptor", label).of("curve", "all");
        let (thresholds, accepted, found, recall, miss) = (
            curve.numbers("distance"),
            curve.numbers("accepted"),
            curve.numbers("relevant_accepted"),
            curve.numbers("recall"),
            curve.numbers("one_minus_precision"),
        );
        let judged: Vec<(f64, bool)> = queries
            .iter()
            .zip(&databases)
            .zip(&values)
            .map(|((query, database), value)| (*value, relevant_of(*query, *database)))
            .collect();
        let all = judged.iter().filter(|pair| pair.1).count() as f64;
        assert!(thresholds.is_sorted_by(|a, b| a < b), "one point a distinct distance");
        for place in [0, thresholds.len() / 3, thresholds.len() - 1] {
            let within: Vec<_> =
                judged.iter().filter(|pair| pair.0 <= f64::from(thresholds[place] as f32)).collect();
            let right = within.iter().filter(|pair| pair.1).count() as f64;
            // Distances of the paper's kind that differ as f64 may be equal as f32: only then there may be more.
            assert!((within.len() as f64 - accepted[place]).abs() <= 1.0, "{label} {place}");
            assert!((right - found[place]).abs() <= 1.0, "{label} {place}");
            assert_eq!(recall[place], found[place] / all);
            assert_eq!(miss[place], (accepted[place] - found[place]) / accepted[place]);
        }
        assert_eq!((*accepted.last().unwrap(), *found.last().unwrap()), (judged.len() as f64, all));
        // The area, over again from the points.
        let mut area = 0.0;
        for place in 0..recall.len() {
            let before = if place == 0 { 0.0 } else { recall[place - 1] };
            area += (recall[place] - before) * (1.0 - miss[place]);
        }
        assert!((area - comparison.numbers("area")[row]).abs() < 1e-9);
    }

    // Every pair once a level, with the counts that follow from the answers.
    let level = pairs.of("level", "object");
    assert_eq!(level.height(), LABELS.len() * (LABELS.len() - 1) / 2);
    let (a, b) = (level.texts("descriptor_a"), level.texts("descriptor_b"));
    assert_eq!(a.iter().zip(&b).collect::<BTreeSet<_>>().len(), level.height());
    for (row, (a, b)) in a.iter().zip(&b).enumerate() {
        let right =
            |label: &str| objects[label].iter().zip(&instances).map(|(a, b)| a == b).collect::<Vec<_>>();
        let (a, b) = (right(a), right(b));
        let only_a = a.iter().zip(&b).filter(|(a, b)| **a && !**b).count() as f64;
        let only_b = a.iter().zip(&b).filter(|(a, b)| !**a && **b).count() as f64;
        assert_eq!((level.numbers("only_a")[row], level.numbers("only_b")[row]), (only_a, only_b));
        let difference = (only_b - only_a) / a.len() as f64;
        assert!((level.numbers("error_difference")[row] - difference).abs() < 1e-12);
        assert!(level.numbers("p_adjusted")[row] >= level.numbers("p_value")[row]);
    }

    // Sizes of Table 1, times, and all of it in the JSON.
    assert_eq!(
        comparison.numbers("size")[2..],
        [248., 248., 250., 250., 1344., 1344., 144., 144., 256., 256.]
    );
    assert_eq!(comparison.numbers("seconds_total").len(), LABELS.len());
    assert!(comparison.texts("note").iter().any(|note| note.contains("1353")));
    let errors: Vec<f64> = told["descriptors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|row| row["object_error"].as_f64().unwrap())
        .collect();
    assert_eq!(errors, comparison.numbers("object_error"));
}

/// Whether a query and a database cloud show the same object, by the lists of the data set.
fn relevant(instances: &[String], experiment: &Experiment, query: f64, database: f64) -> bool {
    thread_local! {
        static SHOWN: std::cell::OnceCell<Vec<String>> = const { std::cell::OnceCell::new() };
    }
    let listed = || {
        let toml = fs::read_to_string(experiment.folder().join("exp.toml")).unwrap();
        let root =
            toml.lines().find_map(|line| line.strip_prefix("root = \"")).unwrap().trim_end_matches('"');
        let lists = ["train1", "train2", "validation"]
            .map(|name| fs::read_to_string(format!("{root}/{name}.txt")).unwrap());
        lists.concat().lines().map(|path| path.split('/').nth(1).unwrap().to_owned()).collect()
    };
    SHOWN.with(|shown| shown.get_or_init(listed)[database as usize] == instances[query as usize])
}

#[test]
fn workers_elsewhere_give_the_same_tables_and_the_experiment_is_run_first() {
    let experiment = Experiment::new(&format!("{SEARCH}dir = \"runs\"\n"));
    let toml = experiment.path("exp.toml");
    let here = compare(&toml, &["--no-times"]).expect_success();
    let told = summary(&here);
    let out = told["run"].as_str().unwrap().to_owned();
    assert!(here.stderr.contains("generation 2/2"), "{here}");
    let read = |table| Rows::read(&out, table);
    let first = TableName::COMPARISON.map(read);
    assert_eq!((first[4].numbers("seconds_total"), first[4].height()), (vec![], 6));

    let args = ["compare", &out, "--no-times", "--json", "--listen", "127.0.0.1:0", "--local-workers", "0"];
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let workers = ["a", "b"].map(|name| experiment.worker(name, &address));
    let elsewhere = summary(&coordinator.wait().expect_success());
    drop(workers);
    assert_eq!(elsewhere["looks"], 3);
    assert_eq!(elsewhere["descriptors"], told["descriptors"]);
    for (table, first) in TableName::COMPARISON.into_iter().zip(first) {
        assert!(read(table) == first, "{table}");
    }
}

#[test]
fn what_cannot_be_compared_is_refused_before_anybody_looks() {
    let experiment = Experiment::new(SEARCH);
    let refused = |subject: &str, more: &[&str], what: &str| {
        let finished = compare(subject, more).expect_error();
        assert!(finished.stderr.contains(what), "{finished}");
    };
    refused(&experiment.path("none"), &[], "no such run folder");
    fs::create_dir(experiment.path("empty")).unwrap();
    refused(&experiment.path("empty"), &[], "empty");
    experiment.run("out", &[]).expect_success();
    let out = experiment.path("out");
    refused(&out, &["--radius-cm", "0"], "--radius-cm: must be from 0.0001 to 100");
    refused(&out, &["--radius-cm", "1e300"], "--radius-cm: must be from 0.0001 to 100");
    refused(&out, &["--data", "/nowhere"], "nowhere");
    assert_eq!(compare(&out, &["--descriptor", "fpfh"]).expect_error().status.code(), Some(2));
    let looks = || Rows::read(&out, TableName::Looks).height();
    assert_eq!(looks(), 1);
    // So small a region has no point in it.
    refused(&out, &["--descriptor", "pfhrgb", "--radius-cm", "0.0001", "--no-times"], "pfhrgb: ");
    assert_eq!(looks(), 2);
    assert!(read_table(&out, TableName::Comparison).is_err());

    let colourless = Experiment::new(&format!("{SEARCH}[descriptor]\ncolour = false\n"));
    colourless.run("out", &[]).expect_success();
    let out = colourless.path("out");
    refused(&out, &["--descriptor", "shotcolor"], "--descriptor shotcolor: needs colours");
    refused(&out, &["--structure", &structure("chroma")], "descriptor chroma: needs colours");
    let alone = compare(&out, &["--no-times"]).expect_success();
    assert!(alone.stderr.contains("are left out"), "{alone}");
    assert_eq!(Rows::read(&out, TableName::Comparison).texts("descriptor"), ["evolved"]);
    assert_eq!(Rows::read(&out, TableName::Pairs).height(), 0);
}

#[test]
fn the_papers_descriptor_is_compared_with_any_search_space() {
    let genes = "[descriptor.genes]\nshape_bins = { min = 9, max = 33, step = 8 }\nR1 = { min = 0.7, max = 1.1, step = 0.2 }\n";
    let experiment = Experiment::new(&format!("{SEARCH}{genes}"));
    experiment.run("out", &[]).expect_success();
    let told = summary(&compare(&experiment.path("out"), &["--descriptor", "paper"]).expect_success());
    assert_eq!(told["descriptors"][0]["parameters"], "shape_bins=60 m=8 R1=1.3 cm R2=3.6 cm w=0.67");
}

/// A structure file that is shipped.
fn structure(name: &str) -> String {
    repository().join(format!("experiments/descriptors/{name}.toml")).display().to_string()
}

#[test]
fn structures_and_winners_of_other_runs_stand_in_one_table() {
    let search = "[descriptor]\nfamily = \"structure\"\n[ga]\npopulation = 6\n[stop]\nevaluations = 12\n\
        [results]\nbaselines = false\n";
    let experiment = Experiment::new(search);
    experiment.run("out", &[]).expect_success();
    let random = Experiment::new(&format!("{SEARCH}[search]\nmethod = \"random\"\n"));
    let winner = summary(&random.run("out", &[]).expect_success());
    let (out, random) = (experiment.path("out"), format!("random={}", random.path("out")));
    let (chroma, paper) = (structure("chroma"), format!("by-hand={}", structure("paper")));
    let named = ["--descriptor", "evolved", "--descriptor", "paper"];
    let given = ["--structure", &paper, "--structure", &chroma, "--with-run", &random];
    let told = summary(&compare(&out, &[&named[..], &given].concat()).expect_success());

    let labels = ["evolved", "paper", "by-hand", "chroma", "random"];
    let comparison = Rows::read(&out, TableName::Comparison);
    assert_eq!(comparison.texts("descriptor"), labels);
    assert_eq!(comparison.texts("kind"), ["structure", "disk-ring", "structure", "structure", "disk-ring"]);
    assert_eq!(comparison.numbers("seconds_total").len(), labels.len());
    let answers = Rows::read(&out, TableName::Answers);
    let nearest = |label: &str| answers.of("descriptor", label).texts("nearest_cloud");
    // The paper's descriptor, whichever way it is written.
    assert_eq!(nearest("by-hand"), nearest("paper"));
    // What `evaluate` finds.
    let (data, file) = (clouds().display().to_string(), experiment.path("nearest.txt"));
    let lists = ["--query", "test.txt", "--database", "train1.txt", "train2.txt", "validation.txt"];
    let evaluate = ["evaluate", "--data", &data, "--structure", &chroma, "--nearest", &file];
    run("coordinator", evaluate.into_iter().chain(lists)).expect_success();
    let found = fs::read_to_string(&file).unwrap();
    let found: Vec<&str> = found.lines().map(|line| line.split(' ').nth(1).unwrap()).collect();
    assert_eq!(nearest("chroma"), found);
    // What the other run found of its winner.
    let row = |label: &str| {
        let rows = told["descriptors"].as_array().unwrap();
        rows.iter().find(|row| row["descriptor"] == label).unwrap().clone()
    };
    assert_eq!(row("random")["object_error"], winner["test_object_error"]);
    // Stages add up.
    let seconds = row("chroma")["seconds"].clone();
    let stages: f64 =
        ["keypoints", "normals", "describe"].map(|stage| seconds[stage].as_f64().unwrap()).iter().sum();
    assert!((seconds["signatures"].as_f64().unwrap() - stages).abs() < 1e-9, "{seconds}");
    assert_eq!(row("chroma")["keypoints_per_cloud"], Value::Null);

    // They stay, without being given again, and so do their times.
    let before = tables(&out);
    compare(&out, &["--descriptor", "paper"]).expect_success();
    assert!(tables(&out) == before);

    let looks = || Rows::read(&out, TableName::Looks).height();
    let looked = looks();
    let refused = |more: &[&str], what: &str| {
        let finished = compare(&out, more).expect_error();
        assert!(finished.stderr.contains(what), "{what}\n{finished}");
    };
    let other = format!("chroma={}", structure("hue-saturation"));
    refused(&["--structure", &other], "table comparison: chroma must be of keypoint-neighbour c1 12");
    refused(
        &["--structure", &structure("paper")],
        "name must be none of evolved, paper, pfhrgb, shotcolor, global-chroma and global-hue-saturation",
    );
    refused(&["--structure", "/nowhere/chroma.toml"], "/nowhere/chroma.toml: cannot be read");
    refused(&["--with-run", "/nowhere"], "/nowhere");
    let prepared = Experiment::new(&format!("{SEARCH}[preprocess]\nleaf_cm = 3.0\n"));
    prepared.run("out", &[]).expect_success();
    refused(&["--with-run", &prepared.path("out")], "must be of leaf_cm = 2, ");
    let fewer = Experiment::with("");
    copy_folder(clouds(), &fewer.folder().join("data"));
    let list = fewer.path("data/test.txt");
    let listed = fs::read_to_string(&list).unwrap();
    fs::write(&list, listed.trim_end().rsplit_once('\n').unwrap().0).unwrap();
    let toml =
        format!("version = 1\nname = \"fewer\"\n[dataset]\nroot = \"{}\"\n{SEARCH}", fewer.path("data"));
    fs::write(fewer.folder().join("exp.toml"), toml).unwrap();
    fewer.run("out", &[]).expect_success();
    refused(&["--with-run", &fewer.path("out")], "must be of data digest ");
    assert_eq!(looks(), looked);
}

/// Files of this kind in a cache.
fn entries(cache: &str, kind: &str) -> BTreeSet<PathBuf> {
    fn below(folder: &Path, found: &mut BTreeSet<PathBuf>) {
        for entry in fs::read_dir(folder).into_iter().flatten() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                below(&path, found);
            } else {
                found.insert(path);
            }
        }
    }
    let mut found = BTreeSet::new();
    below(Path::new(cache), &mut found);
    // Beside them may lie what a kill has left half written.
    let is_whole = |path: &Path| path.file_name().is_some_and(|name| name.len() == 64);
    found.retain(|path| path.components().any(|part| part.as_os_str() == kind) && is_whole(path));
    found
}

/// The tables of a comparison.
fn tables(out: &str) -> [Rows; 5] {
    TableName::COMPARISON.map(|table| Rows::read(out, table))
}

#[test]
fn a_comparison_that_is_killed_asks_only_for_the_descriptions_that_are_missing() {
    const KIND: &str = "descriptions";
    // None of those that are there is described again only to check it.
    let experiment = Experiment::new(&format!("{SEARCH}[coordinator]\naudit = 0.0\n"));
    experiment.run("out", &[]).expect_success();
    let (out, undisturbed, cache) =
        (experiment.path("out"), experiment.path("undisturbed"), experiment.path("kept"));
    copy_folder(Path::new(&out), Path::new(&undisturbed));
    compare(&undisturbed, &["--no-times", "--no-cache"]).expect_success();
    assert_eq!(entries(&cache, KIND), BTreeSet::new());

    let address = free_address();
    let args = ["compare", &out, "--no-times", "--json", "--listen", &address, "--cache", &cache];
    let with = |workers: &'static str| args.into_iter().chain(["--local-workers", workers]);
    // What its own process has described is kept at once: nobody has to confirm it.
    kill_at("coordinator", with("1"), "described ");
    let there = entries(&cache, KIND);
    assert!(!there.is_empty());
    assert!(read_table(&out, TableName::Comparison).is_err());

    // One of those that are there is damaged.
    let damaged = there.first().unwrap();
    let sound = fs::read(damaged).unwrap();
    fs::write(damaged, &sound[..sound.len() - 1]).unwrap();
    let mut coordinator = Running::start(experiment.folder(), "again", "coordinator", with("0"));
    let mut worker = experiment.worker("second", &address);
    let again = coordinator.wait().expect_success();
    worker.signal("TERM");
    let described = begun(&worker.wait().expect_success().stderr).values().sum::<usize>();
    assert!(again.stderr.contains("descriptions are there already"), "{again}");
    assert!(again.stderr.contains("is truncated, making it again"), "{again}");
    assert!(tables(&out) == tables(&undisturbed));
    // What a newcomer has said that nobody could audit is nothing for the next to go on with.
    assert_eq!(entries(&cache, KIND).len(), there.len() - 1);
    run("coordinator", with("1")).expect_success();
    let all = entries(&cache, KIND);
    let missing = all.len() - (there.len() - 1);
    assert!(missing > 1, "the fault came too late: {} of {}", there.len(), all.len());
    assert_eq!(described, missing, "{again}");
    assert_ne!(fs::read(damaged).unwrap(), sound[..sound.len() - 1], "it was made again");
    assert!(tables(&out) == tables(&undisturbed));

    // All is there: nobody is needed.
    let alone = run("coordinator", with("0")).expect_success();
    assert!(!alone.stderr.contains("waiting for a worker"), "{alone}");
    assert!(tables(&out) == tables(&undisturbed));
}

#[test]
fn comparisons_add_up_to_one_of_all_their_descriptors_and_keep_times() {
    let experiment = Experiment::new(SEARCH);
    experiment.run("out", &[]).expect_success();
    let (out, at_once) = (experiment.path("out"), experiment.path("at-once"));
    copy_folder(Path::new(&out), Path::new(&at_once));
    let radius = ["--radius-cm", "2.5"];
    let named = |names: &[&'static str]| -> Vec<&str> {
        names.iter().flat_map(|&name| ["--descriptor", name]).chain(radius).collect()
    };
    compare(&at_once, &[&named(&["evolved", "paper", "pfhrgb", "shotcolor"])[..], &["--no-times"]].concat())
        .expect_success();

    let distances = ["--distance", "l1", "--distance", "chi2"];
    let first = compare(&out, &[&named(&["evolved", "shotcolor"])[..], &distances].concat()).expect_success();
    // Each descriptor is described once, whatever the distances.
    assert_eq!(first.stderr.matches("measuring ").count(), 2, "{first}");
    let seconds = |out: &str| {
        let comparison = Rows::read(out, TableName::Comparison);
        let labels = comparison.texts("descriptor");
        let cells = ["read", "keypoints", "normals", "describe", "match", "total"]
            .map(|stage| comparison.0[&format!("seconds_{stage}")].clone());
        let of = |row: usize| cells.each_ref().map(|stage| stage[row].clone());
        labels.into_iter().enumerate().map(|(row, label)| (label, of(row))).collect::<BTreeMap<_, _>>()
    };
    let measured = seconds(&out);
    assert_eq!(measured["evolved"][..4], measured["evolved-l1"][..4]);
    assert!(measured.values().flatten().all(|cell| matches!(cell, Cell::Number(_))), "{measured:?}");

    // A refused one leaves everything as it is.
    let before = tables(&out);
    let refused = compare(&out, &["--descriptor", "pfhrgb", "--radius-cm", "3"]).expect_error();
    assert!(
        refused.stderr.contains("shotcolor must be of radius=2.5 cm as before, got radius=3 cm"),
        "{refused}"
    );
    assert!(tables(&out) == before);

    // Without a radius it is the table's. Times that are there are not measured again.
    let added = compare(&out, &["--descriptor", "pfhrgb", "--descriptor", "paper", "--no-times"]);
    let told = summary(&added.expect_success());
    assert_eq!(told["descriptors"].as_array().unwrap().len(), 6);
    let more = compare(&out, &["--descriptor", "paper", "--descriptor", "evolved"]).expect_success();
    assert!(
        more.stderr.contains("measuring paper: ") && !more.stderr.contains("measuring evolved"),
        "{more}"
    );
    assert!(more.stderr.contains("clouds under paper"), "{more}");
    let after = seconds(&out);
    for (label, times) in &measured {
        assert_eq!(after[label], *times, "{label}");
    }
    assert!(matches!(after["paper"][5], Cell::Number(_)), "{after:?}");
    assert_eq!(after["pfhrgb"][5], Cell::Null);

    // One call with the same descriptors under the same distances, times and what is counted with them aside.
    let all_chi2 = ["evolved", "paper", "pfhrgb", "shotcolor"];
    let [distances, answers, curves, _, comparison] = tables(&out);
    let [one_distances, one_answers, one_curves, _, one_comparison] = tables(&at_once);
    for label in all_chi2 {
        assert!(distances.of("descriptor", label) == one_distances.of("descriptor", label), "{label}");
        assert!(answers.of("descriptor", label) == one_answers.of("descriptor", label), "{label}");
        assert!(curves.of("descriptor", label) == one_curves.of("descriptor", label), "{label}");
        let untimed = |rows: &Rows| {
            let mut row = rows.of("descriptor", label);
            row.0.retain(|name, _| {
                !name.starts_with("seconds_") && !["hardware", "keypoints_per_cloud"].contains(&name.as_str())
            });
            row
        };
        assert_eq!(untimed(&comparison), untimed(&one_comparison), "{label}");
    }

    // Begun anew, with fewer; then the rest: all tables are those of one call.
    compare(&out, &[&named(&["paper", "shotcolor"])[..], &["--no-times", "--replace"]].concat())
        .expect_success();
    assert_eq!(Rows::read(&out, TableName::Comparison).texts("descriptor"), ["paper", "shotcolor"]);
    assert_eq!(Rows::read(&out, TableName::Answers).texts("descriptor").first().unwrap(), "paper");
    compare(&out, &["--descriptor", "pfhrgb", "--descriptor", "evolved", "--no-times"]).expect_success();
    assert!(tables(&out) == tables(&at_once));
}
