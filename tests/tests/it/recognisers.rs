//! Recognisers that learn from the labels of the database: in comparisons, by any workers, in artefacts, and what they
//! refuse.

use std::fs;

use results::{TableName, read_table};
use serde_json::Value;

use crate::experiments::{Experiment, clouds, summary};
use crate::process::{Finished, Running, finish, program, run};

const SEARCH: &str = "[ga]\npopulation = 4\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n\
    [results]\nbaselines = false\n";
const ALL: [&str; 6] =
    ["--recogniser", "nearest", "--recogniser", "kernel-ridge", "--recogniser", "projection"];
const LABELS: [&str; 6] = [
    "evolved",
    "evolved-projection",
    "evolved-kernel-ridge",
    "paper",
    "paper-projection",
    "paper-kernel-ridge",
];

fn compare(run_folder: &str, more: &[&str]) -> Finished {
    let args = ["compare", run_folder, "--listen", "127.0.0.1:0", "--no-times", "--json"];
    let two = ["--descriptor", "evolved", "--descriptor", "paper"];
    run("coordinator", args.into_iter().chain(two).chain(more.iter().copied()))
}

fn texts(folder: &str, table: TableName, column: &str) -> Vec<String> {
    let frame = read_table(folder, table).unwrap();
    let column = frame.column(column).unwrap();
    let text = |row| column.get(row).unwrap().get_str().map(str::to_owned);
    (0..frame.height()).filter_map(text).collect()
}

fn row<'a>(told: &'a Value, label: &str) -> &'a Value {
    let rows = told["descriptors"].as_array().unwrap();
    rows.iter().find(|row| row["descriptor"] == label).unwrap()
}

#[test]
fn learned_recognisers_stand_beside_the_nearest_cloud_whoever_describes() {
    let experiment = Experiment::new(SEARCH);
    experiment.run("out", &[]).expect_success();
    let out = experiment.path("out");
    let nearest = summary(&compare(&out, &[]).expect_success());
    let told = summary(&compare(&out, &ALL).expect_success());
    assert_eq!(texts(&out, TableName::Comparison, "descriptor"), LABELS);
    for label in ["evolved", "paper"] {
        assert_eq!(row(&told, label), row(&nearest, label), "the nearest cloud is what it was");
        assert_eq!(row(&told, label)["settings"], Value::Null);
    }
    // Each answer names a cloud of the object that it names, and the counts are those of the answers.
    let [labels, shown, named, cloud] = ["descriptor", "instance", "predicted_instance", "nearest_cloud"]
        .map(|column| texts(&out, TableName::Answers, column));
    assert!(named.iter().zip(&cloud).all(|(named, cloud)| cloud.contains(&format!("/{named}/"))));
    let objects: std::collections::BTreeSet<&String> = shown.iter().collect();
    for label in LABELS {
        let of_label = || (0..labels.len()).filter(|&place| labels[place] == label);
        let wrong = of_label().filter(|&place| shown[place] != named[place]).count();
        let row = row(&told, label);
        assert_eq!((row["object_wrong"].as_u64(), of_label().count()), (Some(wrong as u64), shown.len() / 6));
        let learned = ["projection", "kernel-ridge"].into_iter().find(|method| label.ends_with(method));
        assert_eq!(row["recogniser"], learned.unwrap_or("nearest"));
        match learned {
            Some("projection") => {
                assert_eq!(row["cloud_size"], objects.len() - 1, "{row}");
                assert!(row["settings"].as_str().unwrap().contains("shrinkage"));
            }
            Some(_) => assert!(row["settings"].as_str().unwrap().contains("kernel width")),
            None => continue,
        }
        let inside = row["database_error"].as_f64().unwrap();
        assert!((0.0..1.0).contains(&inside), "{row}");
    }

    // Added to the table by a comparison that does not ask for them, from descriptions that others make.
    let args = [
        "compare",
        &out,
        "--no-times",
        "--json",
        "--listen",
        "127.0.0.1:0",
        "--local-workers",
        "0",
        "--no-cache",
    ];
    let more = ["--descriptor", "evolved", "--distance", "l1", "--recogniser", "projection"];
    let mut coordinator =
        Running::start(experiment.folder(), "coordinator", "coordinator", args.into_iter().chain(more));
    let address = coordinator.join_address();
    let workers = ["a", "b"].map(|name| experiment.worker(name, &address));
    let elsewhere = summary(&coordinator.wait().expect_success());
    drop(workers);
    for label in LABELS {
        assert_eq!(row(&elsewhere, label), row(&told, label));
    }
    assert_eq!(row(&elsewhere, "evolved-l1-projection")["distance"], "l1");
    run("coordinator", ["verify", &out, "--sample", "2"]).expect_success();
}

#[test]
fn what_nothing_can_be_learned_from_is_refused_by_name() {
    let experiment = Experiment::new(SEARCH);
    experiment.run("out", &[]).expect_success();
    let out = experiment.path("out");
    assert_eq!(compare(&out, &["--recogniser", "svm"]).expect_error().status.code(), Some(2));
    let structure = experiment.path("chroma.toml");
    let channel = "[[channel]]\npairs = \"cloud\"\nfeatures = [\"hue 6\"]\nradius_cm = 9\n";
    fs::write(&structure, format!("version = 1\n{channel}")).unwrap();
    let named = format!("chroma-projection={structure}");
    let refused = compare(&out, &["--structure", &named]).expect_error();
    assert!(refused.stderr.contains("must not end in the name of a set distance or recogniser"), "{refused}");
    // A channel without a pair is all zeros: objects cannot be told apart by it.
    let nothing = "[[channel]]\npairs = \"cloud\"\nfeatures = [\"d 3\"]\nradius_cm = 0.001\n";
    fs::write(&structure, format!("version = 1\n{nothing}")).unwrap();
    let refused = compare(&out, &["--structure", &structure, "--recogniser", "projection"]).expect_error();
    assert!(
        refused
            .stderr
            .contains("chroma-projection: database: clouds with different signatures expected, got none"),
        "{refused}"
    );
}

/// A search for structures.
const STRUCTURES: &str = "[descriptor]\nfamily = \"structure\"\nmax_bins = 300\n[ga]\npopulation = 6\n\
    [stop]\nevaluations = 12\n[search.fitness]\ncross-sequence = 1\n";

#[test]
fn artefacts_that_learn_answer_as_the_comparison_did_in_another_process() {
    for more in [SEARCH, STRUCTURES] {
        let experiment = Experiment::new(more);
        experiment.run("out", &[]).expect_success();
        let (out, artefact) = (experiment.path("out"), experiment.path("artefact"));
        let told = summary(&compare(&out, &ALL).expect_success());
        let [labels, shown, named, nearest, second] =
            ["descriptor", "cloud", "predicted_instance", "nearest_cloud", "runner_up_cloud"]
                .map(|column| texts(&out, TableName::Answers, column));
        let frame = read_table(&out, TableName::Answers).unwrap();
        let distance = frame.column("distance").unwrap().f64().unwrap();
        for method in ["projection", "kernel-ridge"] {
            let exported =
                run("coordinator", ["export", &out, &artefact, "--recogniser", method]).expect_success();
            let label = format!("evolved-{method}");
            let settings = row(&told, &label)["settings"].as_str().unwrap();
            assert!(exported.stdout.contains(&format!("recogniser    {method}: {settings}\n")), "{exported}");
            let of_label: Vec<usize> = (0..labels.len()).filter(|&place| labels[place] == label).collect();
            let mut command = program("coordinator");
            let queries = of_label.iter().map(|&place| &shown[place]);
            command.current_dir(clouds()).args(["recognise", &artefact, "--json"]).args(queries);
            let answers = finish(&mut command).expect_success();
            assert_eq!(answers.stdout.lines().count(), of_label.len());
            for (&place, line) in of_label.iter().zip(answers.stdout.lines()) {
                for expected in [
                    format!("\"cloud\":\"{}\",", shown[place]),
                    format!("\"predicted_instance\":\"{}\",", named[place]),
                    format!("\"nearest_cloud\":\"{}\",", nearest[place]),
                    format!("\"runner_up_cloud\":\"{}\",", second[place]),
                    // As text: equal texts are equal floats.
                    format!("\"distance\":{},", Value::from(distance.get(place).unwrap())),
                ] {
                    assert!(line.contains(&expected), "no {expected} in {line}");
                }
            }
            let readme = fs::read_to_string(format!("{artefact}/README.md")).unwrap();
            assert!(
                readme.contains("Not measured") && readme.contains(&format!("by `{method}` (")),
                "{readme}"
            );
        }
        // Settings that were changed by hand are none that it was made with.
        let file = format!("{artefact}/descriptor.toml");
        let text = fs::read_to_string(&file).unwrap();
        let width = text.lines().find(|line| line.starts_with("width = ")).unwrap();
        fs::write(&file, text.replace(width, "width = 2.0")).unwrap();
        let example = format!("{artefact}/example.pcd");
        let refused = run("coordinator", ["recognise", &artefact, &example]).expect_error();
        assert!(refused.stderr.contains("digest"), "{refused}");
    }
}
