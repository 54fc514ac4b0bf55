//! Another family than the paper's goes the same way: run, resume, sweep, pieces, audit, remembered counts, tables and
//! `verify` know no gene.

use std::collections::BTreeSet;

use results::{TableName, read_evaluations, read_table};

use crate::experiments::{Experiment, clouds, digest, summary};
use crate::process::{Running, run};

/// A small search with validations; its 31 descriptors are met again.
const SEARCH: &str = "[descriptor]\nfamily = \"global-hue\"\n[descriptor.genes]\nbins = { min = 4, max = 64, step = 2 }\n\
    [ga]\npopulation = 6\n[stop]\ngenerations = 6\nstagnation = \"off\"\nperfect = false\nvalidation_patience = 6\n";

fn experiment(coordinator: &str) -> Experiment {
    Experiment::new(&format!("{SEARCH}[coordinator]\n{coordinator}\n"))
}

/// Texts in a column of a run's table.
fn texts(folder: &str, table: TableName, column: &str) -> Vec<String> {
    let frame = read_table(folder, table).unwrap();
    let texts = frame.column(column).unwrap().str().unwrap().clone();
    texts.iter().flatten().map(str::to_owned).collect()
}

#[test]
fn a_run_is_the_same_whole_in_pieces_audited_killed_remembered_and_in_a_sweep() {
    let whole = experiment("pieces = 1\naudit = 0");
    let cache = whole.path("cache");
    let first = whole.run("out", &["--local-workers", "1", "--cache", &cache]).expect_success();
    let expected = digest(&first);

    let cut = experiment("pieces = 3\naudit = 0");
    let finished = cut.run("out", &["--local-workers", "2"]).expect_success();
    assert_eq!(digest(&finished), expected);
    let tasks = texts(&cut.path("out"), TableName::Attempts, "task");
    for kind in ["description of ", "tile of "] {
        assert!(tasks.iter().any(|task| task.starts_with(kind) && task.contains("global-hue")), "{tasks:?}");
    }

    let audited = experiment("audit = 1.0");
    let finished = audited.run("out", &["--local-workers", "3"]).expect_success();
    assert_eq!(digest(&finished), expected);
    // Workers of the coordinator's own process have one vote: hedges are compared, and nothing else.
    let ends = texts(&audited.path("out"), TableName::Attempts, "end");
    assert!(ends.iter().all(|end| end != "disagreed"), "{ends:?}");

    let killed = experiment("audit = 0");
    let mut running = Running::start(
        killed.folder(),
        "killed",
        "coordinator",
        killed.run_args("out", &["--local-workers", "1"]),
    );
    running.wait_for("generation 2/6");
    running.signal("KILL");
    assert_eq!(running.wait().status.code(), None, "the fault came too late");
    let resumed = run("coordinator", ["resume", &killed.path("out"), "--json"]).expect_success();
    assert!(resumed.stderr.contains("unfinished, goes on with"), "{resumed}");
    assert_eq!(digest(&resumed), expected);

    let again = summary(&whole.run("again", &["--cache", &cache]).expect_success());
    assert_eq!((&again["run_digest"], &again["evaluations_computed"]), (&expected, &0.into()));

    let sweep = Experiment::new(&format!("{SEARCH}[sweep]\nseeds = [5, 6]\n"));
    let members = sweep.run("out", &["--local-workers", "2"]).expect_success();
    let of_seed_5 = members.stdout.lines().find(|line| line.contains("\"seed-5\"")).unwrap();
    assert_eq!(serde_json::from_str::<serde_json::Value>(of_seed_5).unwrap()["run_digest"], expected);
    let other = whole.run("other", &["--seed", "6", "--no-cache"]).expect_success();
    assert!(members.stdout.contains(digest(&other).as_str().unwrap()) && digest(&other) != expected);

    for folder in [whole.path("out"), killed.path("out"), sweep.path("out")] {
        let verified = run("coordinator", ["verify", &folder]).expect_success();
        assert!(verified.stdout.contains("sound: run digest"), "{verified}");
    }
}

#[test]
fn tables_have_the_familys_genes_and_the_counts_that_evaluate_finds() {
    let experiment = Experiment::new(&format!("{SEARCH}[results]\nbaselines = false\n"));
    let checked = run("coordinator", ["check", &experiment.path("exp.toml")]).expect_success();
    assert!(checked.stdout.contains("31 descriptors, 5 bits"), "{checked}");
    let ran = summary(&experiment.run("out", &[]).expect_success());
    let out = experiment.path("out");
    let frame = read_table(&out, TableName::Evaluations).unwrap();
    let names: BTreeSet<&str> = frame.get_column_names().into_iter().map(|name| name.as_str()).collect();
    assert!(names.contains("bins") && !names.contains("shape_bins") && !names.contains("R1"), "{names:?}");
    assert!(ran["best"]["bins"].is_u64() && ran["best"].as_object().unwrap().len() == 1, "{ran}");

    let rows = read_evaluations(&out).unwrap();
    let data = clouds().display().to_string();
    for row in [&rows[0], &rows[rows.len() / 2], rows.last().unwrap()] {
        let [Some(bins)] = row.genes[..] else { panic!("{row:?}") };
        let set = format!("bins={bins}");
        let args =
            ["evaluate", "--data", &data, "--query", "train1.txt", "--database", "train2.txt", "--json"];
        let evaluated =
            run("coordinator", args.into_iter().chain(["--descriptor", "global-hue", "--set", &set]));
        let evaluated = summary(&evaluated.expect_success());
        let wrong = |correct: u32| row.counts.queries - correct;
        assert_eq!(evaluated["descriptor"]["bins"].as_f64(), Some(bins));
        assert_eq!(evaluated["object_wrong"], wrong(row.counts.object_correct), "{evaluated}");
        assert_eq!(evaluated["category_wrong"], wrong(row.counts.category_correct), "{evaluated}");
    }

    run("coordinator", ["report", &out, "--out", &experiment.path("report")]).expect_success();
    let args = ["compare", &out, "--listen", "127.0.0.1:0", "--no-times", "--json"];
    let compared = run("coordinator", args).expect_success();
    let kinds = texts(&out, TableName::Comparison, "kind");
    let baselines = ["disk-ring", "pfhrgb", "shotcolor", "structure", "structure"];
    assert_eq!((&kinds[0][..], &kinds[1..]), ("global-hue", &baselines.map(str::to_owned)[..]), "{compared}");
}

#[test]
fn what_only_the_papers_family_can_do_says_so() {
    let refused = |toml: &str, command: &str, complaint: &str| {
        let experiment = Experiment::new(toml);
        let finished = run("coordinator", [command, &experiment.path("exp.toml")]).expect_error();
        assert!(finished.stderr.contains(complaint), "{finished}");
    };
    refused(SEARCH, "exhaust", "descriptor.family: an exhaustive search needs disk-ring, got global-hue\n");
    let exhaustive = format!("{SEARCH}[search]\nmethod = \"exhaustive\"\n");
    refused(&exhaustive, "run", "descriptor.family: an exhaustive search needs disk-ring, got global-hue\n");
    let experiment = Experiment::new(SEARCH);
    experiment.run("out", &[]).expect_success();
    let export = ["export", &experiment.path("out"), &experiment.path("artefact")];
    let finished = run("coordinator", export).expect_error();
    assert!(
        finished.stderr.contains("holds a descriptor of disk-ring or structure, got one of global-hue\n")
    );
    let paper = export.into_iter().chain(["--descriptor", "paper"]);
    run("coordinator", paper).expect_success();
}
