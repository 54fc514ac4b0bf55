//! Rows `recognise` and `named`: one cloud named by an artefact, from the program's start to its end, and in a program
//! that has named others.

use std::time::Instant;

use serde_json::Value;

use crate::Bench;
use crate::peer::Work;
use crate::programs::{self, program};
use crate::runs::Place;
use tests::benches::household::section;
use tests::benches::table::{Row, Samples, time};

/// Clouds that are asked for, one a program.
const CLOUDS: usize = 20;

/// Stages that the program tells.
const STAGES: [&str; 5] = ["read", "keypoints", "normals", "describe", "match"];

/// Measures the row if it is wanted.
pub fn measure(bench: &mut Bench) {
    if !bench.wants(&["recognise", "named"]) {
        return;
    }
    let mut place = Place::new();
    let short = bench.household.experiment(|experiment| {
        section(experiment, "stop").insert("generations".to_owned(), 1.into());
    });
    let experiment = place.write("short.toml", &short);
    let cache = place.fresh("cache");
    let run = place.coordinator(&experiment, &cache, &[]).finish().json();
    let artefact = place.fresh("artefact").display().to_string();
    let run = run["out"].as_str().unwrap();
    let cache = cache.display().to_string();
    programs::run("coordinator", ["export", run, &artefact, "--descriptor", "paper", "--cache", &cache]);

    if bench.wants(&["named"]) {
        measure_named(bench, &artefact);
    }
    if !bench.wants(&["recognise"]) {
        return;
    }
    let (mut whole, mut without) = (Samples::default(), Samples::default());
    let mut stages = STAGES.map(|_| Samples::default());
    for cloud in bench.household.listed(&["test.txt"]).iter().take(CLOUDS) {
        let cloud = bench.household.root.join(cloud).display().to_string();
        let seconds = |args: &[&str]| {
            let mut command = program("coordinator");
            command.args(args);
            let started = Instant::now();
            let output = command.output().unwrap();
            assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
            (started.elapsed().as_secs_f64(), String::from_utf8_lossy(&output.stdout).into_owned())
        };
        let (took, answer) = seconds(&["recognise", &artefact, &cloud, "--json", "--times"]);
        whole.push(took);
        without.push(seconds(&["--version"]).0);
        let answer: Value = serde_json::from_str(&answer).unwrap();
        for (stage, name) in stages.iter_mut().zip(STAGES) {
            stage.push(answer["seconds"][name].as_f64().unwrap());
        }
    }
    let stages: Vec<String> =
        STAGES.iter().zip(&stages).map(|(name, stage)| format!("{name} {}", time(stage.median()))).collect();
    bench.table.add(Row {
        name: "recognise",
        what: "one cloud named by an artefact of 943 reference clouds, from the program's start to its end, one thread"
            .to_owned(),
        own: whole,
        peer: None,
        notes: vec![
            format!("of the cloud: {}", stages.join(", ")),
            format!("a program that only says its version: {}", time(without.median())),
        ],
    });
}

/// From file to name, cloud by cloud, in one program; beside what PCL takes to describe one, from file to histograms.
fn measure_named(bench: &mut Bench, artefact: &str) {
    let clouds: Vec<String> = bench
        .household
        .listed(&["test.txt"])
        .iter()
        .map(|cloud| bench.household.root.join(cloud).display().to_string())
        .collect();
    let mut own = Samples::default();
    for _ in 0..bench.repetitions {
        bench.peer.run(Work::Test);
        let mut command = program("coordinator");
        let output =
            command.args(["recognise", artefact, "--json", "--times"]).args(&clouds).output().unwrap();
        assert!(output.status.success(), "recognise: {}", String::from_utf8_lossy(&output.stderr));
        let answers = String::from_utf8_lossy(&output.stdout).into_owned();
        assert_eq!(answers.lines().count(), clouds.len());
        // The first clouds come from a program that is still warming up.
        for answer in answers.lines().skip(CLOUDS) {
            let answer: Value = serde_json::from_str(answer).unwrap();
            own.push(answer["seconds"]["total"].as_f64().unwrap());
        }
    }
    let notes = vec![match bench.peer.described(Work::Test) {
        Some(seconds) => {
            format!("PCL describes one in {}, {:.1} times as long", time(seconds), seconds / own.median())
        }
        None => "without PCL".to_owned(),
    }];
    bench.table.add(Row {
        name: "named",
        what: "one cloud named by the same artefact, from file to name, in a program that has named others, one thread"
            .to_owned(),
        own,
        peer: None,
        notes,
    });
}
