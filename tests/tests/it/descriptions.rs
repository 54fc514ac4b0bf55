//! Channels that take long to describe: one worker describes a shard of their clouds, the others take it from the
//! coordinator.

use std::fs;

use results::{TableName, read_table};

use crate::experiments::{Experiment, digest, free_address, shared};
use crate::process::Running;

/// A short search for structures on 176 + 176 + 40 clouds of a table, whose channels mostly take some tenths of a second.
fn experiment() -> Option<Experiment> {
    let root = shared()?.join("data/tabletop-rgbd");
    let experiment = Experiment::with("");
    let list = |split: &str, name: &str, step: usize, most: usize| {
        let all = fs::read_to_string(root.join(format!("{name}.txt"))).unwrap();
        let some: Vec<&str> = all.lines().step_by(step).take(most).collect();
        fs::write(experiment.folder().join(name), some.join("\n")).unwrap();
        format!("{split} = \"{}\"\n", experiment.path(name))
    };
    let splits = [
        list("train1", "train1", 2, 176),
        list("train2", "train2", 2, 176),
        list("validation", "validation", 5, 40),
        list("test", "unused", 1, 9),
    ];
    let toml = format!(
        "version = 1\nname = \"dear\"\nseed = 3\n[dataset]\nroot = \"{}\"\nlayout = \"uw\"\n[dataset.splits]\n{}\
         [descriptor]\nfamily = \"structure\"\nmax_bins = 300\n[search.fitness]\ncross-sequence = 1\n\
         [ga]\npopulation = 6\n[stop]\nevaluations = 15\n[results]\nbaselines = false\n\
         [coordinator]\naudit = 0\nlease_seconds = 60\n",
        root.display(),
        splits.concat()
    );
    fs::write(experiment.folder().join("exp.toml"), toml).unwrap();
    Some(experiment)
}

/// How many shards and tiles, in this order, were handed out in a run.
fn subtasks(experiment: &Experiment) -> [usize; 2] {
    let frame = read_table(experiment.path("out"), TableName::Attempts).unwrap();
    let tasks = frame.column("task").unwrap().str().unwrap().clone();
    ["description of ", "tile of "]
        .map(|kind| tasks.iter().flatten().filter(|task| task.starts_with(kind)).count())
}

#[test]
fn what_one_worker_describes_others_take_and_the_digest_is_that_of_one_worker() {
    let Some(whole) = experiment() else { return };
    let expected = digest(&whole.run("out", &["--local-workers", "1"]).expect_success());
    assert_eq!(subtasks(&whole), [0, 0], "one worker has nobody to take anything from");

    let shared = experiment().unwrap();
    let address = free_address();
    let args = shared.run_args_at("out", &address);
    let mut workers = ["one", "two"].map(|name| shared.worker(name, &address));
    let mut first = Running::start(shared.folder(), "first", "coordinator", args.clone());
    first.wait_for("generation 1/");
    first.signal("KILL");
    assert_eq!(first.wait().status.code(), None, "the fault came too late");
    let mut second = Running::start(shared.folder(), "second", "coordinator", args);
    let finished = second.wait().expect_success();
    assert_eq!(digest(&finished), expected);
    let [shards, tiles] = subtasks(&shared);
    assert!(shards > 0, "no channel was described in shards");
    assert_eq!(tiles, 0, "what is described is matched whole");
    for worker in &mut workers {
        let log = worker.wait().expect_success().stderr;
        let took = log.lines().rfind(|line| line.contains("work so far")).unwrap_or_default();
        assert!(!took.is_empty() && !took.contains("handed: 0,"), "it has taken nothing\n{log}");
    }
}
