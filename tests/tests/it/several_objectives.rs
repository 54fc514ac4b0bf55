//! NSGA-II end to end: one front whatever happens to the coordinator and its workers, and what is made of its points.

use std::fs;

use results::{FrontRow, TableName, read_front, read_table};

use crate::experiments::{Experiment, digest, summary};
use crate::process::{Running, run};

const STRUCTURES: &str = "[descriptor]\nfamily = \"structure\"\nmax_bins = 300\n[search]\nmethod = \"nsga2\"\n\
    [ga]\npopulation = 8\n[stop]\nevaluations = 60\n[coordinator]\naudit = 0\n[results]\nbaselines = false\n";

const DISK_RING: &str = "[search]\nmethod = \"nsga2\"\nobjectives = [\"size\", \"error\"]\n[ga]\npopulation = 8\n\
    [stop]\ngenerations = 8\nvalidation_patience = \"off\"\n[coordinator]\naudit = 0\n";

/// The rows of a front are what none of the others dominates, in order of their errors and each validated.
fn check_front(front: &[FrontRow], objectives: fn(&FrontRow) -> [u64; 3]) {
    assert!(front.len() > 1, "{front:?}");
    for (number, row) in (1..).zip(front) {
        assert_eq!(row.point, number);
        assert!(row.validation.is_some());
        let nowhere_better =
            |other: &FrontRow| objectives(other).iter().zip(objectives(row)).all(|(a, b)| *a <= b);
        assert_eq!(front.iter().filter(|other| nowhere_better(other)).count(), 1, "{row:?} {front:?}");
    }
    assert!(front.is_sorted_by_key(|row| row.train.queries - row.train.object_correct));
    assert_eq!(front.iter().filter(|row| row.winner).count(), 1);
    let fewest = front.iter().map(|row| row.validation.unwrap().object_correct).max();
    let winner = front.iter().find(|row| row.winner).unwrap();
    assert_eq!(winner.validation.map(|counts| counts.object_correct), fewest);
}

/// The hypervolume of each generation.
fn hypervolumes(folder: &str) -> Vec<Option<f64>> {
    let frame = read_table(folder, TableName::Generations).unwrap();
    frame.column("hypervolume").unwrap().f64().unwrap().iter().collect()
}

#[test]
fn a_front_is_the_same_with_one_worker_or_three_and_after_a_kill_and_its_points_can_be_taken_away() {
    let experiment = Experiment::new(STRUCTURES);
    let first = experiment.run("out", &["--local-workers", "1"]).expect_success();
    let three = experiment.run("three", &["--local-workers", "3"]).expect_success();
    assert_eq!(digest(&three), digest(&first));

    let args = experiment.run_args("killed", &["--local-workers", "1"]);
    let mut running = Running::start(experiment.folder(), "killed-log", "coordinator", args);
    running.wait_for("generation 2/");
    running.signal("KILL");
    assert_eq!(running.wait().status.code(), None, "the fault came too late");
    let resumed = run("coordinator", ["resume", &experiment.path("killed"), "--json"]).expect_success();
    assert!(resumed.stderr.contains("unfinished, goes on with"), "{resumed}");
    assert_eq!(digest(&resumed), digest(&first));

    let [out, three, killed] = ["out", "three", "killed"].map(|name| experiment.path(name));
    let front = read_front(&out).unwrap();
    for folder in [&three, &killed] {
        assert_eq!(read_front(folder).unwrap(), front);
    }
    check_front(&front, |row| [u64::from(row.train.queries - row.train.object_correct), row.cost, row.size]);
    let volumes: Vec<f64> = hypervolumes(&out).into_iter().map(Option::unwrap).collect();
    assert!(volumes.len() > 3 && volumes.is_sorted() && volumes[0] < *volumes.last().unwrap(), "{volumes:?}");
    let verified = run("coordinator", ["verify", &killed]).expect_success();
    assert!(verified.stdout.contains("sound: run digest"), "{verified}");
    let found = format!(", front of {} points found again\n", front.len());
    assert!(verified.stdout.ends_with(&found), "{verified}");

    // What is printed, again as often as it is asked for.
    let printed = summary(&first);
    let points = printed["front"].as_array().unwrap();
    assert_eq!(points.len(), front.len());
    assert_eq!(summary(&experiment.run("out", &[]).expect_success())["front"], printed["front"]);
    let args: Vec<String> =
        experiment.run_args("out", &[]).into_iter().filter(|arg| arg != "--json").collect();
    let text = run("coordinator", args).expect_success().stdout;
    for mark in ["front         point", "  winner\n", " within one interval of the best\n"] {
        assert!(text.contains(mark), "{mark}: {text}");
    }

    let last = front.last().unwrap().point.to_string();
    let artefact = experiment.path("artefact");
    run("coordinator", ["export", &out, &artefact, "--point", &last]).expect_success();
    assert!(
        fs::read_to_string(format!("{artefact}/README.md"))
            .unwrap()
            .contains(&format!("point {last} of the front"))
    );
    let recognised = run("coordinator", ["recognise", &artefact, &format!("{artefact}/example.pcd")]);
    assert!(recognised.expect_success().stdout.contains("distance 0."));

    let compare = ["compare", &out, "--listen", "127.0.0.1:0", "--descriptor", "evolved", "--no-times"];
    let compared =
        run("coordinator", compare.into_iter().chain(["--point", "1", "--point", &last])).expect_success();
    let labels = read_table(&out, TableName::Comparison).unwrap();
    let labels: Vec<String> =
        labels.column("descriptor").unwrap().str().unwrap().iter().flatten().map(str::to_owned).collect();
    assert_eq!(labels, ["evolved".to_owned(), "point-1".to_owned(), format!("point-{last}")], "{compared}");

    let beyond = (front.len() + 1).to_string();
    for refused in [
        run("coordinator", ["export", &out, &experiment.path("none"), "--point", &beyond]),
        run("coordinator", compare.into_iter().chain(["--point", "0"])),
    ] {
        let refused = refused.expect_error();
        let range = format!("point must be 1 to {}, got ", front.len());
        assert!(refused.stderr.contains(&range), "{refused}");
    }
}

#[test]
fn two_objectives_of_plain_genes_make_a_front_of_these_and_other_methods_none() {
    let experiment = Experiment::new(DISK_RING);
    let ran = summary(&experiment.run("out", &[]).expect_success());
    let out = experiment.path("out");
    let front = read_front(&out).unwrap();
    check_front(&front, |row| [u64::from(row.train.queries - row.train.object_correct), 0, row.size]);
    assert_eq!(ran["winner_generation"], front.iter().find(|row| row.winner).unwrap().generation);
    let verified = run("coordinator", ["verify", &out]).expect_success();
    assert!(verified.stdout.contains("sound: run digest"), "{verified}");
    let found = format!(", front of {} points found again\n", front.len());
    assert!(verified.stdout.ends_with(&found), "{verified}");
    run("coordinator", ["report", &out]).expect_success();
    for figure in ["front", "hypervolume"] {
        let svg = fs::read_to_string(format!("{out}/report/{figure}.svg")).unwrap();
        assert!(svg.contains("<svg") && svg.len() > 2000, "{figure}: {svg}");
    }

    let plain =
        Experiment::new("[ga]\npopulation = 6\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n");
    let ran = summary(&plain.run("out", &[]).expect_success());
    let out = plain.path("out");
    assert!(ran["front"].is_null() && hypervolumes(&out).iter().all(Option::is_none));
    assert_eq!(read_front(&out).unwrap(), []);
    let refused = run("coordinator", ["export", &out, &plain.path("none"), "--point", "1"]).expect_error();
    assert!(refused.stderr.contains("must be a run with a front"), "{refused}");
}

#[test]
fn what_no_search_minimises_is_refused_by_name() {
    let refused = |search: &str, complaint: &str| {
        let experiment = Experiment::new(&format!("[search]\n{search}\n"));
        let finished = run("coordinator", ["check", &experiment.path("exp.toml")]).expect_error();
        assert!(finished.stderr.contains(complaint), "{finished}");
    };
    let several = "method = \"nsga2\"\nobjectives";
    refused(&format!("{several} = [\"error\", \"speed\"]"), "search.objectives: unknown word, got \"speed\"");
    refused(
        &format!("{several} = [\"error\"]"),
        "search.objectives: method nsga2 needs two or three, got [\"error\"]",
    );
    refused(&format!("{several} = [\"cost\", \"size\"]"), "search.objectives: \"error\" must be among them");
    refused("objectives = [\"error\", \"size\"]", "search.objectives: method ga has one, \"error\", got");
}
