//! Sweeps: several runs over one set of workers, each the same as alone.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

use crate::experiments::Experiment;
use crate::process::{Finished, Running, kill_at, program, run};

/// Two variants of a search in a small space: their runs meet the same descriptors often.
const SEARCH: &str = "[ga]\npopulation = 8\n[stop]\ngenerations = 6\nstagnation = \"off\"\n\
    validation_patience = \"off\"\n[descriptor.genes]\nshape_bins = { min = 8, max = 11 }\nm = 3\nR1 = 1.0\nR2 = 2.5\n\
    w = { min = 0.0, max = 1.0, step = 0.1 }\n[coordinator]\naudit = 0\n";

const SEEDS: &str = "[sweep]\nseeds = \"1..3\"\n";

const VARIANTS: &str =
    "[sweep.variants.small]\nga.population = 4\n[sweep.variants.blind]\nsearch.method = \"random\"\n";

/// The summaries of a sweep's members by name.
#[track_caller]
fn members(finished: &Finished) -> BTreeMap<String, Value> {
    let summary = |line: &str| {
        let value: Value = serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {finished}"));
        (value["member"].as_str().unwrap().to_owned(), value)
    };
    finished.stdout.lines().map(summary).collect()
}

fn digests(finished: &Finished) -> BTreeMap<String, Value> {
    members(finished).into_iter().map(|(name, summary)| (name, summary["run_digest"].clone())).collect()
}

/// Run digests of the members, each run alone; `more` is what a variant has in place of the experiment's.
fn alone(seeds: &[u64], search: &str, name: impl Fn(u64) -> String) -> BTreeMap<String, Value> {
    let experiment = Experiment::new(search);
    let digest = |&seed: &u64| {
        let finished = experiment.run(&name(seed), &["--seed", &seed.to_string()]).expect_success();
        (name(seed), crate::experiments::summary(&finished)["run_digest"].clone())
    };
    seeds.iter().map(digest).collect()
}

#[test]
fn each_run_of_a_sweep_is_what_it_is_alone_and_what_two_of_them_ask_is_computed_once() {
    let experiment = Experiment::new(&format!("{SEARCH}{SEEDS}"));
    let mut coordinator = Running::start(
        experiment.folder(),
        "coordinator",
        "coordinator",
        experiment.run_args("out", &["--local-workers", "0"]),
    );
    let address = coordinator.join_address();
    let mut command = program("worker");
    command
        .args(["--coordinator", &address, "--name", "one", "--no-cache"])
        .env("DESCRY_LOG", "worker=debug");
    let worker = Running::spawn(experiment.folder(), "worker", command);
    let finished = coordinator.wait().expect_success();
    let expected = alone(&[1, 2, 3], SEARCH, |seed| format!("seed-{seed}"));
    assert_eq!(digests(&finished), expected, "{finished}");
    let computed: u64 =
        members(&finished).values().map(|summary| summary["evaluations_computed"].as_u64().unwrap()).sum();
    let begun = worker.log().lines().filter(|line| line.ends_with(": begun")).count() as u64;
    // Although the measures at the end of each run come on top of what its search computed.
    assert!(begun < computed, "{begun} of {computed}");
    let verified = run("coordinator", ["verify", &experiment.path("out"), "--sample", "2"]).expect_success();
    assert_eq!(verified.stdout.matches("\nsound: run digest").count(), 3, "{verified}");
    let again = experiment.run("out", &[]).expect_success();
    assert_eq!(digests(&again), expected);
    assert!(again.stderr.contains("this sweep is finished"), "{again}");
}

#[test]
fn a_sweep_that_is_killed_goes_on_and_its_variants_are_what_they_are_alone() {
    let experiment = Experiment::new(&format!("{SEARCH}{SEEDS}{VARIANTS}"));
    let args = experiment.run_args("out", &["--local-workers", "1"]);
    kill_at("coordinator", args, "small-seed-2: generation 2/6");
    let out = experiment.path("out");
    let member = run("coordinator", ["resume", &format!("{out}/small-seed-1")]).expect_error();
    assert!(member.stderr.contains(&format!("go on with the sweep: coordinator resume {out}\n")), "{member}");
    let args = ["resume", &out, "--listen", "127.0.0.1:0", "--local-workers", "2", "--json"];
    let finished = run("coordinator", args).expect_success();
    assert!(finished.stderr.contains("unfinished, goes on with the"), "{finished}");
    let small = SEARCH.replace("population = 8", "population = 4");
    let blind = format!("[search]\nmethod = \"random\"\n{SEARCH}");
    let mut expected = alone(&[1, 2, 3], &small, |seed| format!("small-seed-{seed}"));
    expected.extend(alone(&[1, 2, 3], &blind, |seed| format!("blind-seed-{seed}")));
    assert_eq!(digests(&finished), expected, "{finished}");
}

/// Jobs of a run that a worker answered, as its table of attempts has them.
fn answered(folder: &str) -> BTreeSet<u64> {
    let attempts = results::read_table(folder, results::TableName::Attempts).unwrap();
    let jobs = attempts.column("job").unwrap().u64().unwrap().clone();
    let ends = attempts.column("end").unwrap().str().unwrap().clone();
    let answered = jobs.iter().zip(ends.iter()).filter(|(_, end)| *end == Some("answered"));
    answered.map(|(job, _)| job.unwrap()).collect()
}

#[test]
fn terminal_tables_and_a_file_of_events_follow_a_sweep_each_for_itself() {
    let experiment = Experiment::new(&format!("{SEARCH}{SEEDS}"));
    let file = experiment.path("events.jsonl");
    let finished = experiment.run("out", &["--local-workers", "2", "--events", &file]).expect_success();
    let text = std::fs::read_to_string(&file).unwrap();
    let events: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let sequences: Vec<u64> = events.iter().map(|event| event["sequence"].as_u64().unwrap()).collect();
    assert!(sequences.is_sorted_by(|one, next| one < next), "{sequences:?}");
    let of_kind = |kind: &str| events.iter().filter(|event| event["event"] == kind).collect::<Vec<&Value>>();
    assert_eq!(of_kind("joined").len(), 2, "{text}");
    for joined in of_kind("joined") {
        let line = format!("worker {}: joined,", joined["label"].as_str().unwrap());
        assert_eq!(finished.stderr.matches(&line).count(), 1, "{line} {finished}");
    }
    let attempts = of_kind("attempt").into_iter();
    let in_file = attempts.filter(|attempt| attempt["end"] == "answered");
    let in_file: BTreeSet<u64> = in_file.map(|attempt| attempt["job"].as_u64().unwrap()).collect();
    let members = members(&finished).into_keys().map(|name| experiment.path(&format!("out/{name}")));
    let in_tables: BTreeSet<u64> = members.flat_map(|folder| answered(&folder)).collect();
    assert!(!in_file.is_empty());
    assert_eq!(in_file, in_tables);

    let folder = experiment.path("out");
    let refused = experiment.run("other", &["--fresh", "--events", &folder]).expect_error();
    assert!(refused.stderr.contains(&format!("--events {folder}: cannot be written, got")), "{refused}");
}

#[test]
fn a_sweep_refuses_a_seed_of_its_own_and_the_folder_of_another() {
    let experiment = Experiment::new(&format!("{SEARCH}{SEEDS}"));
    let refused = experiment.run("out", &["--seed", "4"]).expect_error();
    assert!(refused.stderr.contains("--seed: a sweep names the seeds of its runs, got 4"), "{refused}");
    experiment.run("out", &[]).expect_success();
    let toml = experiment.path("exp.toml");
    let text = std::fs::read_to_string(&toml).unwrap().replace("1..3", "1..4");
    std::fs::write(&toml, text).unwrap();
    let refused = experiment.run("out", &[]).expect_error();
    assert!(refused.stderr.contains("- seeds = [1, 2, 3]\n  + seeds = [1, 2, 3, 4]"), "{refused}");
}
