//! The settings of a search beyond the paper's: crossover by slots, mutation by field, a budget of evaluations, the
//! winner by validation or by fitness.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use results::{TableName, read_evaluations, read_table};
use serde_json::Value;

use crate::experiments::{Experiment, clouds, digest, summary};
use crate::process::{kill_at, run};

const BUDGET: usize = 60;

/// Every new setting, on the paper's family, of which each gene is a slot.
const SEARCH: &str = "[search]\nwinner = \"validation\"\n\
    [ga]\npopulation = 6\ncrossover = \"slots\"\nmutation = \"field\"\nmutation_rate = 0.3\nmutation_decay = 1.0\n\
    [stop]\ngenerations = 300\nstagnation = \"off\"\nperfect = false\nvalidation_patience = \"off\"\n\
    evaluations = 60\n[coordinator]\naudit = 0\n";

/// How many validation clouds the best of each generation recognises.
fn validated(folder: &str) -> Vec<Option<u32>> {
    let generations = read_table(folder, TableName::Generations).unwrap();
    generations.column("validation_object_correct").unwrap().u32().unwrap().iter().collect()
}

#[test]
fn the_same_budget_ends_a_run_whole_killed_remembered_or_shared() {
    let experiment = Experiment::new(SEARCH);
    let checked = run("coordinator", ["check", &experiment.path("exp.toml")]).expect_success();
    let line = "# search: ga, at most 1800 individuals in 300 generations of 6, or until 60 different descriptors are \
        evaluated\n";
    assert!(checked.stdout.contains(line), "{checked}");

    let cache = experiment.path("cache");
    let alone = experiment.run("alone", &["--local-workers", "1", "--cache", &cache]).expect_success();
    let told = summary(&alone);
    assert_eq!(told["stop_reason"], "evaluations", "{alone}");
    let three = experiment.run("three", &["--local-workers", "3", "--no-cache"]).expect_success();
    assert_eq!(digest(&three), digest(&alone));

    let args = experiment.run_args("killed", &["--local-workers", "1", "--no-cache"]);
    kill_at("coordinator", args, "generation 2/300");
    let resumed = run("coordinator", ["resume", &experiment.path("killed"), "--json"]).expect_success();
    assert!(resumed.stderr.contains("unfinished, goes on with"), "{resumed}");
    assert_eq!(digest(&resumed), digest(&alone));

    // What earlier runs have left costs nothing and is spent from the budget all the same.
    let again = summary(&experiment.run("again", &["--cache", &cache]).expect_success());
    assert_eq!((&again["run_digest"], &again["evaluations_computed"]), (&told["run_digest"], &0.into()));

    for folder in ["alone", "killed"] {
        let verified = run("coordinator", ["verify", &experiment.path(folder)]).expect_success();
        assert!(verified.stdout.contains("sound: run digest"), "{verified}");
    }
}

#[test]
fn the_tables_show_the_budget_and_who_won() {
    let experiment = Experiment::new(SEARCH);
    let told = summary(&experiment.run("out", &[]).expect_success());
    let out = experiment.path("out");
    let last = told["generations"].as_u64().unwrap();
    // Different descriptors up to a generation: the last reaches the budget and does not exceed it.
    let rows = read_evaluations(&out).unwrap();
    let met_up_to = |generation: u64| {
        let rows = rows.iter().filter(|row| u64::from(row.generation) <= generation);
        rows.map(|row| format!("{:?}", row.genes)).collect::<BTreeSet<_>>().len()
    };
    assert!(met_up_to(last) == BUDGET && met_up_to(last - 1) < BUDGET, "{last} generations");

    // Every generation's best was validated; the first with the most recognised clouds won.
    let counts = validated(&out);
    assert_eq!(counts.len() as u64, last);
    assert!(counts.iter().all(Option::is_some), "{counts:?}");
    let first = counts.iter().position(|count| count == counts.iter().max().unwrap()).unwrap();
    assert_eq!(told["winner_generation"], first + 1, "{counts:?}");

    // By fitness instead, nothing is validated but the winner, which is the first of the highest fitness.
    let by_fitness = Experiment::new(&SEARCH.replace("\"validation\"", "\"fitness\""));
    let told = summary(&by_fitness.run("out", &[]).expect_success());
    let out = by_fitness.path("out");
    assert!(validated(&out).iter().all(Option::is_none));
    let rows = read_evaluations(&out).unwrap();
    let most = rows.iter().map(|row| row.counts.object_correct).max().unwrap();
    let best = rows.iter().find(|row| row.counts.object_correct == most).unwrap();
    assert_eq!(told["winner_generation"], best.generation);
}

#[test]
fn a_winner_by_validation_needs_validation_clouds() {
    let split = "[dataset.splits.seeded]\nvalidation = 0\n";
    let refused = Experiment::new(&format!("{split}{SEARCH}"));
    let finished = run("coordinator", ["check", &refused.path("exp.toml")]).expect_error();
    assert!(
        finished.stderr.contains("dataset.splits.seeded.validation: a split without clouds"),
        "{finished}"
    );
    let allowed = Experiment::new(&format!("{split}{}", SEARCH.replace("\"validation\"", "\"fitness\"")));
    run("coordinator", ["check", &allowed.path("exp.toml")]).expect_success();
    // A manifest says it by its rows only.
    let manifest = allowed.path("clouds.csv");
    let mut rows = "path,category,instance,split\n".to_owned();
    for (list, split) in
        [("train1", "train1"), ("train2", "train2"), ("validation", "train2"), ("test", "test")]
    {
        for path in fs::read_to_string(clouds().join(list).with_extension("txt")).unwrap().lines() {
            let mut labels = path.split('/');
            let (category, instance) = (labels.next().unwrap(), labels.next().unwrap());
            rows += &format!("{path},{category},{instance},{split}\n");
        }
    }
    fs::write(&manifest, rows).unwrap();
    let layout = format!("layout = \"manifest\"\nmanifest = \"{manifest}\"\n");
    let refused = Experiment::new(&format!("{layout}{SEARCH}"));
    let checked = run("coordinator", ["check", &refused.path("exp.toml")]).expect_error();
    for finished in [checked, refused.run("out", &[]).expect_error()] {
        assert!(finished.stderr.contains("need validation clouds, got none\nset stop"), "{finished}");
    }
    assert!(!Path::new(&refused.path("out")).exists());
}

#[test]
fn searches_that_learn_from_validation_clouds_have_none() {
    let splits = "[dataset.splits]\ntrain2 = [\"train2.txt\", \"validation.txt\"]\nvalidation = []\n";
    for method in ["ga", "nsga2"] {
        let search = format!(
            "{splits}[descriptor]\nfamily = \"structure\"\n[ga]\npopulation = 6\n\
             [search]\nmethod = \"{method}\"\nwinner = \"fitness\"\n[stop]\nevaluations = 12\n"
        );
        let experiment = Experiment::new(&search);
        let told = summary(&experiment.run("out", &["--local-workers", "2"]).expect_success());
        assert_eq!((&told["validation_error"], &told["validation_queries"]), (&Value::Null, &Value::Null));
        assert_eq!((&told["test_queries"], told["train_queries"].as_u64()), (&24.into(), Some(48)));
        let out = experiment.path("out");
        assert!(validated(&out).iter().all(Option::is_none));
        run("coordinator", ["verify", &out]).expect_success();
        run("coordinator", ["report", &out, "--out", &experiment.path("report")]).expect_success();
        let exported = run("coordinator", ["export", &out, &experiment.path("artefact")]).expect_success();
        assert!(exported.stdout.contains("database      48 clouds"), "{exported}");
    }
    // Whoever leaves validation out of it is told what to write.
    let forgotten = splits.replace("validation = []\n", "");
    let refused = Experiment::new(&format!("{forgotten}{}", SEARCH.replace("\"validation\"", "\"fitness\"")));
    let refused = run("coordinator", ["check", &refused.path("exp.toml")]).expect_error();
    assert!(
        refused.stderr.contains("in validation and in train2") && refused.stderr.contains("validation = []"),
        "{refused}"
    );
}
