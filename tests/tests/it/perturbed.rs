//! `coordinator compare --perturb`: the errors are those of `evaluate` on clouds that are perturbed by the library, and
//! those of the comparison where nothing is perturbed.

use std::fs;
use std::path::Path;

use descriptor::{Perturbation, pcd};
use results::{PerturbedRow, TableName, read_comparison, read_perturbed, read_table, write_vectors};
use serde_json::Value;

use crate::experiments::{Experiment, clouds, copy_folder, summary};
use crate::process::{Finished, run};

const SEARCH: &str = "[ga]\npopulation = 4\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n";
/// Seed of the experiments.
const SEED: u64 = 5;

fn compare(out: &str, more: &[&str]) -> Finished {
    let args = ["compare", out, "--listen", "127.0.0.1:0", "--no-times", "--json"];
    run("coordinator", args.into_iter().chain(more.iter().copied()))
}

fn test_clouds() -> Vec<String> {
    let list = fs::read_to_string(clouds().join("test.txt")).unwrap();
    list.lines().map(str::to_owned).collect()
}

fn looks(out: &str) -> Vec<String> {
    let frame = read_table(out, TableName::Looks).unwrap();
    let command = |row| frame.column("command").unwrap().get(row).unwrap().get_str().unwrap().to_owned();
    (0..frame.height()).map(command).collect()
}

fn perturbed(kind: Perturbation, strength: f64, path: &str) -> descriptor::Cloud {
    let bytes = fs::read(clouds().join(path)).unwrap();
    kind.apply(strength, &pcd::read(&bytes).unwrap(), SEED, blake3::hash(&bytes).as_bytes())
}

#[test]
fn errors_are_those_of_the_perturbed_clouds_as_files() {
    let experiment = Experiment::new(SEARCH);
    experiment.run("out", &[]).expect_success();
    let out = experiment.path("out");
    let named = [
        "--descriptor",
        "evolved",
        "--descriptor",
        "paper",
        "--recogniser",
        "nearest",
        "--recogniser",
        "projection",
    ];
    let told = summary(
        &compare(&out, &[&named[..], &["--perturb", "light,noise", "--perturb", "occlusion"]].concat())
            .expect_success(),
    );
    assert_eq!(looks(&out), ["run", "compare --perturb noise,occlusion,light"]);
    let (rows, comparison) = (read_perturbed(&out).unwrap(), read_comparison(&out).unwrap());
    let kinds = [Perturbation::Noise, Perturbation::Occlusion, Perturbation::Light];
    let expected: Vec<(&str, &str, f64)> = ["evolved", "evolved-projection", "paper", "paper-projection"]
        .into_iter()
        .flat_map(|label| kinds.map(|kind| (label, kind)))
        .flat_map(|(label, kind)| {
            std::iter::once(0.0).chain(kind.strengths()).map(move |strength| (label, kind.name(), strength))
        })
        .collect();
    let found: Vec<(&str, &str, f64)> =
        rows.iter().map(|row| (row.descriptor.as_str(), row.kind.as_str(), row.strength)).collect();
    assert_eq!(found, expected);
    // A strength of nothing is the comparison itself.
    for row in rows.iter().filter(|row| row.strength == 0.0) {
        let as_it_is = comparison.iter().find(|one| one.descriptor == row.descriptor).unwrap();
        assert_eq!((row.counts, row.unusable), (as_it_is.counts, 0), "{row:?}");
        assert_eq!(row.object_wilson, as_it_is.object_wilson);
    }
    let in_json = told["perturbed"].as_array().unwrap();
    assert_eq!(in_json.len(), rows.len());
    for (json, row) in in_json.iter().zip(&rows) {
        assert_eq!(json["object_wrong"], row.counts.queries - row.counts.object_correct);
        assert_eq!(json["unusable"], row.unusable);
        let [low, high] = row.object_bootstrap;
        assert!(low <= row.counts.object_error() && row.counts.object_error() <= high, "{row:?}");
    }

    // The same clouds as files.
    let data = experiment.folder().join("data");
    copy_folder(clouds(), &data);
    for (kind, strength) in [(kinds[0], 2.0), (kinds[1], 60.0), (kinds[2], 100.0)] {
        for path in test_clouds() {
            let bytes = pcd::write(&perturbed(kind, strength, &path), pcd::DataEncoding::Binary);
            fs::write(data.join(&path), bytes).unwrap();
        }
        let lists = ["--query", "test.txt", "--database", "train1.txt", "train2.txt", "validation.txt"];
        let args = ["evaluate", "--data", data.to_str().unwrap(), "--json"];
        let evaluated = summary(&run("coordinator", args.into_iter().chain(lists)).expect_success());
        let row = rows.iter().find(|row| {
            (row.descriptor.as_str(), row.kind.as_str(), row.strength) == ("paper", kind.name(), strength)
        });
        let counts = row.unwrap().counts;
        let unusable = row.unwrap().unusable;
        let wrong = |correct: u32| counts.queries - correct - unusable;
        assert_eq!(evaluated["queries"], counts.queries - unusable, "{kind:?}\n{evaluated}");
        assert_eq!(evaluated["object_wrong"], wrong(counts.object_correct), "{kind:?}\n{evaluated}");
        assert_eq!(evaluated["category_wrong"], wrong(counts.category_correct), "{kind:?}");
    }

    // What is there stays, is not computed again, and others are added.
    let more = compare(&out, &[&named[..], &["--perturb", "noise,density"]].concat()).expect_success();
    assert!(more.stderr.contains("clouds under density"), "{more}");
    assert!(!more.stderr.contains("clouds under noise"), "{more}");
    let of_kind = |rows: &[PerturbedRow], kind: Perturbation| -> Vec<PerturbedRow> {
        rows.iter().filter(|row| row.kind == kind.name()).cloned().collect()
    };
    let now = read_perturbed(&out).unwrap();
    assert_eq!(now.len(), rows.len() + 4 * 5);
    for kind in kinds {
        assert_eq!(of_kind(&now, kind), of_kind(&rows, kind));
    }
    let cloud = test_clouds()[0].clone();
    let values: Vec<(&str, Vec<f32>)> = vec![(cloud.as_str(), vec![1.0])];
    write_vectors(Path::new(&experiment.path("too-few.parquet")), &values).unwrap();
    let refused = format!("few={}", experiment.path("too-few.parquet"));
    compare(&out, &["--foreign", &refused, "--perturb", "noise"]).expect_error();
    let plain = compare(&out, &["--descriptor", "shotcolor"]).expect_success();
    assert_eq!(summary(&plain)["perturbed"].as_array().unwrap().len(), now.len());
    assert_eq!(read_perturbed(&out).unwrap(), now);

    let report = experiment.path("report.html");
    run("coordinator", ["report", &out, "--out", &report]).expect_success();
    assert!(fs::read_to_string(report).unwrap().contains("comparison-perturbed"));
    let query = "SELECT count(*) AS rows FROM perturbed WHERE kind = 'noise'";
    let asked = run("coordinator", ["query", &out, query]).expect_success();
    assert!(asked.stdout.contains("20"), "{asked}");
    compare(&out, &["--descriptor", "paper", "--replace"]).expect_success();
    assert_eq!(read_perturbed(&out).unwrap(), []);
}

#[test]
fn clouds_that_become_unusable_are_wrong_and_counted() {
    let points = |path: &str| pcd::read(&fs::read(clouds().join(path)).unwrap()).unwrap().len();
    let paths = test_clouds();
    // So many that removing most of the points of some clouds leaves too few.
    let mut left: Vec<usize> = paths.iter().map(|path| points(path) * 12 / 100).collect();
    left.sort_unstable();
    let least = left[left.len() / 2];
    let experiment = Experiment::new(&format!("{SEARCH}[preprocess]\nmin_points = {least}\n"));
    experiment.run("out", &[]).expect_success();
    let out = experiment.path("out");
    let named = ["--descriptor", "evolved", "--perturb", "density"];
    let told = summary(&compare(&out, &named).expect_success());
    let used = read_comparison(&out).unwrap()[0].counts.queries;
    for row in read_perturbed(&out).unwrap() {
        let too_few = |path: &&String| perturbed(Perturbation::Density, row.strength, path).len() < least;
        let expected = paths.iter().filter(too_few).count() as u32;
        assert_eq!((row.counts.queries, row.unusable), (used, expected), "{row:?}");
        assert!(row.counts.object_correct + row.unusable <= row.counts.queries);
    }
    let last = told["perturbed"].as_array().unwrap().last().unwrap();
    assert!(last["unusable"].as_u64().unwrap() > 0, "{last}");

    let colourless = Experiment::new(&format!("{SEARCH}[descriptor]\ncolour = false\n"));
    colourless.run("out", &[]).expect_success();
    let out = colourless.path("out");
    let refused = compare(&out, &["--perturb", "noise,light"]).expect_error();
    assert!(refused.stderr.contains("--perturb light: needs colours, got clouds without"), "{refused}");
    assert_eq!(looks(&out), ["run"]);
    assert_eq!(compare(&out, &["--perturb", "wind"]).expect_error().status.code(), Some(2));
    let told: Value = summary(&compare(&out, &["--perturb", "noise"]).expect_success());
    assert_eq!(told["perturbed"].as_array().unwrap().len(), 5);
}
