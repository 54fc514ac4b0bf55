//! Structures go the same way as descriptors of genes, under every protocol of fitness: whole, in pieces, audited,
//! killed, cold and warm, with one worker and several. A model of the fitness chooses the children, so that generations
//! rest on all results before.

use results::{TableName, read_evaluations, read_table};

use crate::experiments::{Experiment, clouds, digest, summary};
use crate::process::{Running, run};

const SEARCH: &str = "[descriptor]\nfamily = \"structure\"\nmax_bins = 300\n\
    [ga]\npopulation = 8\npreselection = 3\n[stop]\nevaluations = 24\n";

/// The search under a fitness, with settings of the coordinator.
fn experiment(fitness: &str, coordinator: &str) -> Experiment {
    Experiment::new(&format!("{SEARCH}[search.fitness]\n{fitness}\n[coordinator]\n{coordinator}\n"))
}

/// Texts in a column of a run's table.
fn texts(folder: &str, table: TableName, column: &str) -> Vec<String> {
    let frame = read_table(folder, table).unwrap();
    let texts = frame.column(column).unwrap().str().unwrap().clone();
    texts.iter().flatten().map(str::to_owned).collect()
}

#[test]
fn a_run_is_the_same_whole_in_pieces_audited_killed_and_warm() {
    let fitness = "cross-sequence = 2\nleave-one-out = 1";
    let whole = experiment(fitness, "pieces = 1\naudit = 0");
    let cache = whole.path("cache");
    let first = whole.run("out", &["--local-workers", "1", "--cache", &cache]).expect_success();
    let expected = digest(&first);

    let cut = experiment(fitness, "pieces = 3\naudit = 0");
    let finished = cut.run("out", &["--local-workers", "2"]).expect_success();
    assert_eq!(digest(&finished), expected);
    let tasks = texts(&cut.path("out"), TableName::Attempts, "task");
    for kind in ["description of ", "tile of ", "scale of "] {
        assert!(tasks.iter().any(|task| task.starts_with(kind)), "{kind}: {tasks:?}");
    }

    let audited = experiment(fitness, "audit = 1.0");
    let finished = audited.run("out", &["--local-workers", "3"]).expect_success();
    assert_eq!(digest(&finished), expected);
    // Workers of the coordinator's own process have one vote: hedges are compared, and nothing else.
    let ends = texts(&audited.path("out"), TableName::Attempts, "end");
    assert!(ends.iter().all(|end| end != "disagreed"), "{ends:?}");

    let killed = experiment(fitness, "audit = 0");
    let args = killed.run_args("out", &["--local-workers", "1"]);
    let mut running = Running::start(killed.folder(), "killed", "coordinator", args);
    running.wait_for("generation 2/");
    running.signal("KILL");
    assert_eq!(running.wait().status.code(), None, "the fault came too late");
    let resumed = run("coordinator", ["resume", &killed.path("out"), "--json"]).expect_success();
    assert!(resumed.stderr.contains("unfinished, goes on with"), "{resumed}");
    assert_eq!(digest(&resumed), expected);

    let again = whole.run("again", &["--local-workers", "1", "--cache", &cache]).expect_success();
    assert_eq!(digest(&again), expected);
    for folder in [whole.path("out"), cut.path("out"), killed.path("out")] {
        let verified = run("coordinator", ["verify", &folder]).expect_success();
        assert!(verified.stdout.contains("sound: run digest"), "{verified}");
    }
}

#[test]
fn every_protocol_and_objective_gives_a_digest_of_its_own_whatever_the_workers() {
    let mut digests = Vec::new();
    for fitness in [
        "split = 1",
        "split = 1\nmargin = true",
        "cross-sequence = 1",
        "leave-one-out = 1\nobjective = \"category\"",
    ] {
        let one = experiment(fitness, "pieces = 1\naudit = 0");
        let three = experiment(fitness, "pieces = 2\naudit = 0");
        let expected = digest(&one.run("out", &["--local-workers", "1"]).expect_success());
        assert_eq!(
            digest(&three.run("out", &["--local-workers", "3"]).expect_success()),
            expected,
            "{fitness}"
        );
        let verified = run("coordinator", ["verify", &one.path("out")]).expect_success();
        assert!(verified.stdout.contains("sound: run digest"), "{verified}");
        digests.push(expected.to_string());
    }
    digests.sort_unstable();
    digests.dedup();
    assert_eq!(digests.len(), 4);
}

#[test]
fn tables_hold_genes_and_margins_and_other_commands_know_the_family() {
    let experiment = experiment("cross-sequence = 1", "audit = 0\n[results]\nbaselines = false");
    let checked = run("coordinator", ["check", &experiment.path("exp.toml")]).expect_success();
    assert!(checked.stdout.contains("204 bits"), "{checked}");
    let ran = summary(&experiment.run("out", &[]).expect_success());
    let out = experiment.path("out");
    let rows = read_evaluations(&out).unwrap();
    assert!(rows.iter().all(|row| row.genes.len() == 60 && row.margin.is_some()), "{:?}", rows[0]);
    assert!(rows.iter().any(|row| row.genes.iter().any(Option::is_none)), "inactive slots have no genes");
    assert!(ran["best"]["s1_pairs"].is_u64(), "{ran}");

    run("coordinator", ["report", &out, "--out", &experiment.path("report")]).expect_success();
    let args = [
        "compare",
        &out,
        "--listen",
        "127.0.0.1:0",
        "--descriptor",
        "evolved",
        "--descriptor",
        "paper",
        "--json",
    ];
    run("coordinator", args).expect_success();
    let kinds = texts(&out, TableName::Comparison, "kind");
    assert_eq!(kinds, ["structure", "disk-ring"]);
}

#[test]
fn what_cannot_be_searched_or_asked_says_so() {
    let refused = |toml: &str, complaint: &str| {
        let experiment = Experiment::new(toml);
        let finished = run("coordinator", ["check", &experiment.path("exp.toml")]).expect_error();
        assert!(finished.stderr.contains(complaint), "{finished}");
    };
    let structure = "[descriptor]\nfamily = \"structure\"\n";
    refused(
        &format!("{structure}max_bins = 100\n"),
        "descriptor.max_bins: must be at least 216 for 4 slots, got 100\n",
    );
    refused(&format!("{structure}slots = 5\n"), "descriptor.slots: must be 1 to 4, got 5\n");
    refused(
        &format!("{structure}[preprocess]\nleaf_cm = 2.0\n"),
        "preprocess.leaf_cm: not for family structure",
    );
    refused(
        &format!("{structure}[descriptor.genes]\nR1 = 1.0\n"),
        "descriptor.genes: family structure has none",
    );
    refused("[descriptor]\nmax_bins = 500\n", "descriptor.max_bins: no key of family disk-ring, got it\n");
    refused("[search.fitness]\nsplit = 0\n", "search.fitness: no protocol with a weight above 0");
    refused("[search.fitness]\nsplit = 101\n", "search.fitness.split: not between 0 and 100, got 101\n");

    let data = clouds().display().to_string();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("one.toml").display().to_string();
    let channel = "version = 1\n[[channel]]\npairs = \"cloud\"\nfeatures = [\"hew 8\"]\nradius_cm = 12.0\n";
    std::fs::write(&file, channel).unwrap();
    let args = ["evaluate", "--data", &data, "--query", "test.txt", "--database", "train1.txt"];
    let finished = run("coordinator", args.into_iter().chain(["--structure", &file])).expect_error();
    assert!(finished.stderr.contains("one.toml: channel 1: features: "), "{finished}");
}
