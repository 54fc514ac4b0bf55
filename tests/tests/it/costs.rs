//! What a structure may cost: those that cost more have fitness 0 without being evaluated; and what the fitness counts
//! when it counts categories.

use std::collections::BTreeSet;

use descriptor::SearchSpace;
use descriptor::structure::StructureSpace;
use results::{EvaluationRow, TableName, read_evaluations, read_table};

use crate::experiments::{Experiment, clouds, digest, summary};
use crate::process::run;

/// What some of the structures that these searches meet cost more than, and others do not.
const MAX_COST: u64 = 500_000;

fn search(descriptor: &str, fitness: &str, coordinator: &str) -> Experiment {
    Experiment::new(&format!(
        "[descriptor]\nfamily = \"structure\"\nmax_bins = 300\nslots = 2\n{descriptor}\n\
         [search.fitness]\n{fitness}\n[ga]\npopulation = 8\n[stop]\nevaluations = 16\nperfect = false\n\
         [coordinator]\naudit = 0\n{coordinator}\n"
    ))
}

#[test]
fn what_costs_too_much_has_fitness_0_and_is_not_evaluated() {
    let limit = format!("max_cost = {MAX_COST}");
    for fitness in ["cross-sequence = 2\nleave-one-out = 1", "split = 1\nobjective = \"category\""] {
        let experiment = search(&limit, fitness, "");
        let told = summary(&experiment.run("out", &["--local-workers", "1"]).expect_success());
        let out = experiment.path("out");
        let rows = read_evaluations(&out).unwrap();
        let queries: BTreeSet<u32> = rows.iter().map(|row| row.counts.queries).collect();
        assert_eq!(queries.len(), 1, "{fitness}");
        let (none, some): (Vec<_>, Vec<_>) = rows.iter().partition(|row| row.margin == Some(-1.0));
        assert!(!none.is_empty() && !some.is_empty(), "{} and {}", none.len(), some.len());
        for row in none {
            assert_eq!((row.counts.object_correct, row.counts.category_correct), (0, 0));
            assert!(row.computed.is_none(), "generation {}", row.generation);
        }
        let known: BTreeSet<String> = some.iter().map(|row| format!("{:?}", row.genes)).collect();
        assert_eq!((known.len(), &told["evaluations_computed"]), (16, &16.into()));
        assert_eq!(told["stop_reason"], "evaluations");

        let pieces = search(&limit, fitness, "pieces = 2");
        let shared = pieces.run("out", &["--local-workers", "3"]).expect_success();
        assert_eq!(digest(&shared), told["run_digest"]);
        let verified = run("coordinator", ["verify", &out, "--sample", "1000"]).expect_success();
        assert!(verified.stdout.contains("sound: run digest"), "{verified}");
        let free = search("", fitness, "");
        assert_ne!(digest(&free.run("out", &[]).expect_success()), told["run_digest"]);
    }
}

#[test]
fn a_random_search_of_the_same_budget_spends_none_of_it_on_what_costs_too_much() {
    let experiment = search(&format!("max_cost = {MAX_COST}"), "leave-one-out = 1", "");
    let finished = experiment.run("out", &["--local-workers", "1", "--control"]).expect_success();
    assert!(
        finished.stderr.contains("random search of 16 descriptors, as many as the run has met"),
        "{finished}"
    );
    let mut dear = 0;
    for run in ["out", "out-random"] {
        let rows = read_evaluations(experiment.path(run)).unwrap();
        let evaluated = rows.iter().filter(|row| row.margin != Some(-1.0));
        let different: BTreeSet<String> = evaluated.map(|row| format!("{:?}", row.genes)).collect();
        assert_eq!(different.len(), 16, "{run}");
        dear += rows.iter().filter(|row| row.margin == Some(-1.0)).count();
    }
    assert!(dear > 0, "nothing costs too much");
}

#[test]
fn a_limit_that_nothing_keeps_is_told_with_what_the_cheapest_costs() {
    // Some structure is as cheap, but 16 of 10^30 are unlikely to find it.
    let space = StructureSpace { slots: 2, max_bins: 300, ..StructureSpace::default() };
    let least = SearchSpace::Structures(space).least_cost();
    let experiment = search(&format!("max_cost = {least}"), "cross-sequence = 1", "");
    let finished = experiment.run("out", &["--local-workers", "1"]).expect_error();
    let complaint = format!("search: no descriptor costs at most descriptor.max_cost = {least}, got ");
    assert!(finished.stderr.contains(&complaint), "{finished}");

    let below =
        format!("descriptor.max_cost: not at least {least}, what the cheapest costs, got {}", least - 1);
    for (descriptor, complaint) in [
        (format!("family = \"structure\"\nslots = 2\nmax_cost = {}", least - 1), below.as_str()),
        (
            "family = \"structure\"\nmax_cost = 0".to_owned(),
            "descriptor.max_cost: not at least 1506, what the cheapest costs, got 0",
        ),
        (
            "family = \"structure\"\nmembers = 4\nmax_cost = 4517".to_owned(),
            "descriptor.max_cost: not at least 4518, what the cheapest costs, got 4517",
        ),
        ("max_cost = 5".to_owned(), "descriptor.max_cost: only of family structure, got family disk-ring"),
    ] {
        let experiment = Experiment::new(&format!("[descriptor]\n{descriptor}\n"));
        let finished = run("coordinator", ["check", &experiment.path("exp.toml")]).expect_error();
        assert!(finished.stderr.contains(complaint), "{finished}");
    }
}

#[test]
fn evaluate_tells_what_a_descriptor_costs() {
    let data = clouds().display().to_string();
    let args = ["evaluate", "--data", &data, "--query", "test.txt", "--database", "train1.txt"];
    let finished = run("coordinator", args).expect_success();
    assert!(finished.stdout.contains("\ncounted cost    "), "{finished}");
    let json = run("coordinator", args.into_iter().chain(["--json"])).expect_success();
    let json: serde_json::Value = serde_json::from_str(&json.stdout).unwrap();
    let cost = descriptor::Descriptor::default_of(descriptor::Family::DiskRing).cost(1, 1000);
    assert_eq!(json["counted_cost"], cost);
}

#[test]
fn an_objective_of_categories_orders_individuals_by_them() {
    let experiment = search("", "leave-one-out = 1\nobjective = \"category\"", "");
    let finished = experiment.run("out", &["--local-workers", "1"]).expect_success();
    let told = summary(&finished);
    let out = experiment.path("out");
    let rows = read_evaluations(&out).unwrap();
    assert!(rows.iter().all(|row| row.objective_correct == Some(row.counts.category_correct)));
    // By objects another individual would be the best of some generation.
    let generations = read_table(&out, TableName::Generations).unwrap();
    let best = generations.column("best_individual").unwrap().u32().unwrap().clone();
    let mut differs = false;
    for (number, best) in (1..).zip(best.iter().flatten()) {
        let of_generation: Vec<_> = rows.iter().filter(|row| row.generation == number).collect();
        let most = of_generation.iter().map(|row| row.counts.category_correct).max().unwrap();
        assert_eq!(of_generation[best as usize].counts.category_correct, most, "generation {number}");
        let wrong = |row: &&EvaluationRow| 100.0 * row.counts.category_error();
        let mean = of_generation.iter().map(wrong).sum::<f64>() / of_generation.len() as f64;
        let best_error = wrong(&of_generation[best as usize]);
        let shown = format!(": best {best_error:.2} % mean {mean:.2} % ");
        let line = |line: &&str| line.starts_with(&format!("generation {number}/"));
        assert!(finished.stderr.lines().find(line).unwrap().contains(&shown), "{shown}: {finished}");
        let objects = of_generation.iter().map(|row| row.counts.object_correct).max().unwrap();
        differs |= of_generation[best as usize].counts.object_correct < objects;
    }
    assert!(differs, "{told}");
}
