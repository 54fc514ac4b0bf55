//! `coordinator compare`: the tables against each other and against what they are defined by, and bad input.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use results::{TableName, read_run, read_table};
use serde_json::Value;

use crate::experiments::{Experiment, summary};
use crate::process::{Finished, Running, run};

const SEARCH: &str = "[ga]\npopulation = 4\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n";
const LABELS: [&str; 8] =
    ["evolved", "evolved-l1", "paper", "paper-l1", "pfhrgb", "pfhrgb-l1", "shotcolor", "shotcolor-l1"];

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
    assert_eq!(comparison.numbers("size")[2..], [248., 248., 250., 250., 1344., 1344.]);
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
    let experiment = Experiment::new(&format!("{SEARCH}[results]\ndir = \"runs\"\n"));
    let toml = experiment.path("exp.toml");
    let here = compare(&toml, &["--no-times"]).expect_success();
    let told = summary(&here);
    let out = told["run"].as_str().unwrap().to_owned();
    assert!(here.stderr.contains("generation 2/2"), "{here}");
    let read = |table| Rows::read(&out, table);
    let first = TableName::COMPARISON.map(read);
    assert_eq!((first[4].numbers("seconds_total"), first[4].height()), (vec![], 4));

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
