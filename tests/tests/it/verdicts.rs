//! The end of a run: its winner beside what anybody has without a search, beside random search and by the recogniser of
//! the experiment; and what the seeds of a sweep say together.

use std::fs;
use std::path::Path;

use results::{TableName, read_comparison, read_pairs, read_run, read_table};
use serde_json::Value;

use crate::experiments::{Experiment, free_address, summary};
use crate::process::{Running, run};

const SEARCH: &str = "[ga]\npopulation = 6\n[stop]\ngenerations = 3\nvalidation_patience = \"off\"\n";
const BASELINES: [&str; 4] = ["evolved", "paper", "global-chroma", "global-hue-saturation"];

fn labels(told: &Value) -> Vec<&str> {
    told["compared"].as_array().unwrap().iter().map(|row| row["descriptor"].as_str().unwrap()).collect()
}

fn verdict(told: &Value) -> Vec<&str> {
    told["verdict"].as_array().unwrap().iter().map(|sentence| sentence.as_str().unwrap()).collect()
}

fn looks(folder: &str) -> Vec<String> {
    let frame = read_table(folder, TableName::Looks).unwrap();
    let column = frame.column("descriptors").unwrap();
    (0..frame.height()).map(|row| column.get(row).unwrap().get_str().unwrap().to_owned()).collect()
}

#[test]
fn a_run_ends_beside_baselines_with_the_counts_of_a_comparison_and_shows_them_again() {
    for family in
        ["", "[descriptor]\nfamily = \"structure\"\nmax_bins = 300\n[search.fitness]\ncross-sequence = 1\n"]
    {
        let experiment = Experiment::new(&format!("{SEARCH}{family}"));
        let told = summary(&experiment.run("out", &[]).expect_success());
        let out = experiment.path("out");
        assert_eq!((labels(&told), looks(&out)), (BASELINES.to_vec(), vec![BASELINES.join(" ")]));
        let (rows, pairs) = (read_comparison(&out).unwrap(), read_pairs(&out).unwrap());
        assert_eq!(rows[0].counts, read_run(&out).unwrap().row.test.unwrap());
        assert!(rows.iter().all(|row| row.cloud_seconds.is_some_and(|seconds| seconds > 0.0)));
        // The sentences say what the tables say, of the paper's descriptor and of the best other one.
        let best = if rows[2].counts.object_error() <= rows[3].counts.object_error() { 2 } else { 3 };
        let sentences = verdict(&told);
        assert_eq!(sentences.len(), 2);
        for (sentence, other) in sentences.iter().zip([1, best]) {
            let errors = [0, other].map(|row: usize| 100.0 * rows[row].counts.object_error());
            assert!(sentence.contains(&rows[other].descriptor), "{sentence}");
            assert!(errors.iter().all(|error| sentence.contains(&format!("{error:.2} %"))), "{sentence}");
            let is_said = sentence.contains("no evidence") || sentence.contains("equally many");
            let pair = pairs.iter().find(|pair| {
                pair.level == "object"
                    && pair.descriptor_a == "evolved"
                    && pair.descriptor_b == rows[other].descriptor
            });
            assert!(is_said || pair.unwrap().p_value < 0.05, "{sentence}");
        }
        // Nothing of it enters the digest, and it is there whenever the run is shown again.
        run("coordinator", ["verify", &out]).expect_success();
        let again = summary(&experiment.run("out", &[]).expect_success());
        let told_of = |told: &Value| ["compared", "verdict", "at_a_bound"].map(|key| told[key].clone());
        assert_eq!(told_of(&again), told_of(&told));
        let off = Experiment::new(&format!("{SEARCH}{family}[results]\nbaselines = false\n"));
        let without = summary(&off.run("out", &[]).expect_success());
        assert_eq!((labels(&without), looks(&off.path("out"))), (vec![], vec!["evolved".to_owned()]));
        assert_eq!(without["run_digest"], told["run_digest"]);
        // A comparison describes the same clouds for itself, and comes to the same counts and answers.
        let names = BASELINES.into_iter().flat_map(|name| ["--descriptor", name]);
        let compare = ["compare", &off.path("out"), "--no-times", "--json", "--listen", "127.0.0.1:0"];
        run("coordinator", compare.map(str::to_owned).into_iter().chain(names.map(str::to_owned)))
            .expect_success();
        let compared = read_comparison(off.path("out")).unwrap();
        for (own, other) in rows.iter().zip(&compared) {
            assert_eq!((&own.descriptor, own.counts), (&other.descriptor, other.counts));
            assert_eq!((own.object_bootstrap, &own.bytes), (other.object_bootstrap, &other.bytes));
        }
        assert_eq!(read_pairs(off.path("out")).unwrap(), pairs);
        let answers = |folder: &str| read_table(folder, TableName::Answers).unwrap();
        assert!(answers(&out).equals_missing(&answers(&off.path("out"))));
    }
}

#[test]
fn workers_elsewhere_and_a_kill_change_no_row() {
    let experiment = Experiment::new(&format!("{SEARCH}[coordinator]\naudit = 0\n"));
    experiment.run("here", &[]).expect_success();
    let address = free_address();
    let args = experiment.run_args_at("out", &address);
    let mut workers = ["a", "b"].map(|name| experiment.worker(name, &address));
    let mut first = Running::start(experiment.folder(), "first", "coordinator", args.clone());
    first.wait_for("generation 2/3");
    first.signal("KILL");
    first.wait();
    Running::start(experiment.folder(), "second", "coordinator", args).wait().expect_success();
    for worker in &mut workers {
        worker.signal("TERM");
        worker.wait().expect_success();
    }
    let rows = |out: &str| {
        let mut rows = read_comparison(experiment.path(out)).unwrap();
        rows.iter_mut().for_each(|row| row.cloud_seconds = None);
        (rows, read_pairs(experiment.path(out)).unwrap())
    };
    assert!(rows("out") == rows("here"));
}

#[test]
fn clouds_without_colours_have_no_baselines() {
    let experiment = Experiment::new(&format!("{SEARCH}[descriptor]\ncolour = false\n"));
    let ran = experiment.run("out", &[]).expect_success();
    let told = summary(&ran);
    assert!(ran.stderr.contains("clouds without colours: no baseline describes them"), "{ran}");
    assert_eq!((labels(&told), verdict(&told)), (vec![], vec![]));
    assert!(!Path::new(&experiment.path("out/comparison/comparison.parquet")).exists());
}

#[test]
fn the_experiments_recogniser_and_random_search_are_added_once() {
    let experiment = Experiment::new(&format!("{SEARCH}[recognition]\nmethod = \"projection\"\n"));
    let told = summary(&experiment.run("out", &["--control"]).expect_success());
    let all = ["evolved", "paper", "global-chroma", "global-hue-saturation", "random"];
    let learned: Vec<String> =
        all.iter().flat_map(|name| [(*name).to_owned(), format!("{name}-projection")]).collect();
    assert_eq!(labels(&told), learned);
    let sentences = verdict(&told);
    assert!(sentences.iter().any(|sentence| sentence.contains("evolved-projection")), "{sentences:?}");
    // As many different descriptors as the run has met.
    let met = |out: &str| {
        let rows = results::read_evaluations(experiment.path(out)).unwrap();
        let mut met: Vec<Vec<Option<u64>>> =
            rows.iter().map(|row| row.genes.iter().map(|gene| gene.map(f64::to_bits)).collect()).collect();
        met.sort();
        met.dedup();
        met.len()
    };
    assert_eq!(met("out"), met("out-random"));
    assert_eq!(looks(&experiment.path("out")).len(), 2);
    let again = experiment.run("out", &["--control"]).expect_success();
    assert_eq!(
        (summary(&again)["compared"].clone(), looks(&experiment.path("out")).len()),
        (told["compared"].clone(), 2)
    );
    // Neither says anything of the search.
    let plain = Experiment::new(SEARCH);
    assert_eq!(summary(&plain.run("out", &[]).expect_success())["run_digest"], told["run_digest"]);
}

#[test]
fn a_sweep_says_what_its_seeds_say_together() {
    let variants =
        "[sweep]\nseeds = [1, 2, 3]\n[sweep.variants.six]\n[sweep.variants.four]\nga.population = 4\n";
    let experiment = Experiment::new(&format!("{SEARCH}{variants}"));
    let ran = experiment.run("out", &[]).expect_success();
    let members: Vec<Value> = ran.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(members.len(), 6);
    for variant in ["four", "six"] {
        let own: Vec<&Value> =
            members.iter().filter(|one| one["member"].as_str().unwrap().starts_with(variant)).collect();
        let mut errors: Vec<f64> = own.iter().map(|one| one["test_object_error"].as_f64().unwrap()).collect();
        errors.sort_by(f64::total_cmp);
        let paper = own[0]["compared"][1]["object_error"].as_f64().unwrap();
        let better = errors.iter().filter(|&&error| error < paper).count();
        let said = own[0]["sweep_verdict"].as_array().unwrap();
        let said: Vec<&str> = said.iter().map(|sentence| sentence.as_str().unwrap()).collect();
        let median = format!("{:.2} % of test clouds wrong, median of 3 seeds", 100.0 * errors[1]);
        assert!(said[0].starts_with(&median), "{said:?}");
        let paper = format!("better than paper ({:.2} %) in {better} of 3 seeds", 100.0 * paper);
        assert!(said[1].starts_with(&paper), "{said:?}");
        assert!(own.iter().all(|one| one["sweep_verdict"] == own[0]["sweep_verdict"]));
    }
    let refused = experiment.run("other", &["--control"]).expect_error();
    assert!(refused.stderr.contains("--control: is for a single run, got a sweep"), "{refused}");
    assert!(!fs::exists(experiment.path("other")).unwrap());
}
