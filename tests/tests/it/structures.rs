//! Structures go the same way as descriptors of genes, under every protocol of fitness: whole, in pieces, audited,
//! killed, cold and warm, with one worker and several. Where a model of the fitness chooses the children, generations
//! rest on all results before. Members evolve side by side.

use results::{EvaluationRow, TableName, read_evaluations, read_table};

use crate::experiments::{Experiment, clouds, digest, summary};
use crate::process::{kill_at, run};

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
    kill_at("coordinator", args, "generation 2/");
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
        let expected = digest(&one.run("out", &["--local-workers", "1"]).expect_success());
        let several = experiment(fitness, "pieces = 2\naudit = 0");
        let ten = several.run("out", &["--local-workers", "10"]).expect_success();
        assert_eq!(digest(&ten), expected, "{fitness}, ten workers");
        kill_at("coordinator", several.run_args("killed", &["--local-workers", "10"]), "generation 1/");
        let resumed = run("coordinator", ["resume", &several.path("killed"), "--json"]).expect_success();
        assert!(resumed.stderr.contains("unfinished, goes on with"), "{fitness}: {resumed}");
        assert_eq!(digest(&resumed), expected, "{fitness}, killed");
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
fn members_evolve_side_by_side_within_their_shares_and_are_joined() {
    members_are_joined("");
}

#[test]
fn members_whose_operators_keep_channels_are_joined_likewise() {
    members_are_joined("crossover = \"any-slots\"\nmutation = \"slot\"\n");
}

fn members_are_joined(operators: &str) {
    let toml = format!(
        "[descriptor]\nfamily = \"structure\"\nmembers = 3\nmax_bins = 480\nmax_cost = 900_000\n\
         [ga]\npopulation = 5\nelite = 1\n{operators}[search]\nwinner = \"fitness\"\n[stop]\nevaluations = 60\n"
    );
    let whole = Experiment::new(&format!("{toml}[coordinator]\npieces = 1\naudit = 0\n"));
    let ran = whole.run("out", &["--local-workers", "1"]).expect_success();
    let out = whole.path("out");
    let generations = read_evaluations(&out).unwrap().into_iter().fold(Vec::new(), |mut all, row| {
        all.resize_with(all.len().max(row.generation as usize), Vec::new);
        all[row.generation as usize - 1].push(row);
        all
    });
    assert!(generations.len() > 2 && generations[0].len() == 15, "{} generations", generations.len());
    // In the chromosome each member has the bits of its two slots.
    let part = |row: &EvaluationRow, member: usize| row.chromosome[member * 102..][..102].to_owned();
    let mut members = 0;
    for pair in generations.windows(2) {
        let first = usize::from(pair[0].len() == 16);
        for member in 0..3 {
            let own = &pair[0][first + member * 5..][..5];
            for row in own {
                let none = "0".repeat(102);
                assert!((0..3).all(|other| other == member || part(row, other) == none), "{row:?}");
                let is_active = |slot: &&[Option<f64>]| slot[0] == Some(1.0);
                assert!((1..=2).contains(&row.genes.chunks(15).filter(is_active).count()), "{row:?}");
                members += usize::from(row.computed.is_some());
            }
            let best = own.iter().rev().max_by(|a, b| {
                let of = |row: &EvaluationRow| (row.counts.object_correct, row.margin.unwrap());
                of(a).partial_cmp(&of(b)).unwrap()
            });
            assert_eq!(part(&pair[1][0], member), part(best.unwrap(), member));
        }
    }
    assert!(members > 20, "{members} were affordable");
    let joined = &generations[1][0];
    assert!(joined.genes.len() == 90 && joined.parent_a.is_none() && joined.counts.object_correct > 0);

    let several = Experiment::new(&format!("{toml}[coordinator]\npieces = 2\naudit = 0.5\n"));
    let args = several.run_args("out", &["--local-workers", "3"]);
    kill_at("coordinator", args, "generation 2/");
    let resumed = run("coordinator", ["resume", &several.path("out"), "--json"]).expect_success();
    assert_eq!(digest(&resumed), digest(&ran));
    let verified = run("coordinator", ["verify", &out]).expect_success();
    assert!(verified.stdout.contains("sound: run digest"), "{verified}");
    run("coordinator", ["export", &out, &whole.path("artefact")]).expect_success();
    run("coordinator", ["report", &out, "--out", &whole.path("report")]).expect_success();
}

#[test]
fn other_methods_search_the_joined_structures_of_members() {
    for method in ["random", "hill-climb", "nsga2"] {
        let experiment = Experiment::new(&format!(
            "[descriptor]\nfamily = \"structure\"\nmembers = 2\n[ga]\npopulation = 6\n\
             crossover = \"any-slots\"\nmutation = \"slot\"\n[search]\nmethod = \"{method}\"\n\
             [stop]\nevaluations = 8\n[results]\nbaselines = false\n"
        ));
        experiment.run("out", &[]).expect_success();
        let out = experiment.path("out");
        let rows = read_evaluations(&out).unwrap();
        assert!(rows.iter().all(|row| row.chromosome.len() == 102 && row.genes.len() == 60), "{method}");
        assert!(rows.iter().any(|row| row.genes[15] == Some(1.0)), "{method}: two channels");
        let verified = run("coordinator", ["verify", &out]).expect_success();
        assert!(verified.stdout.contains("sound: run digest"), "{verified}");
    }
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
    refused(&format!("{structure}slots = 9\n"), "descriptor.slots: must be 1 to 8, got 9\n");
    refused(
        &format!("{structure}slots = 4\nmembers = 3\n"),
        "descriptor.members: must divide the number of slots, 4, got 3\n",
    );
    refused(
        &format!("{structure}slots = 8\nmembers = 2\n"),
        "descriptor.members: must be more than the slots of each, 4, got 2 with 8\n",
    );
    refused(
        &format!("{structure}members = 3\n[ga]\npreselection = 2\n"),
        "ga.preselection: must be 1 beside descriptor.members, got 2\n",
    );
    refused(
        "[descriptor]\nmembers = 2\n",
        "descriptor.members: only of family structure, got family disk-ring\n",
    );
    refused(&format!("{structure}members = 9\n"), "descriptor.members: must be 1 to 8, got 9\n");
    refused(
        &format!("{structure}[preprocess]\nleaf_cm = 2.0\n"),
        "preprocess.leaf_cm: not for family structure",
    );
    refused(
        &format!("{structure}[descriptor.genes]\nR1 = 1.0\n"),
        "descriptor.genes: family structure has none",
    );
    refused(
        "[descriptor]\nmax_bins = 500\n",
        "descriptor.max_bins: only of family structure, got family disk-ring\n",
    );
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
