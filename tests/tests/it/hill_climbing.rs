//! Hill climbing end to end: the same run whatever happens to the coordinator, in tables that can be verified.

use crate::experiments::{Experiment, digest, summary};
use crate::process::{kill_at, run};

/// A small space, so that there are several climbs and the same descriptors are met again.
const SEARCH: &str = "[search]\nmethod = \"hill-climb\"\n[stop]\ngenerations = 60\nstagnation = \"off\"\n\
    validation_patience = \"off\"\n[descriptor.genes]\nshape_bins = { min = 8, max = 13 }\nm = { min = 3, max = 4 }\n\
    R1 = 1.0\nR2 = 2.5\nw = { min = 0.0, max = 1.0, step = 0.05 }\n[coordinator]\naudit = 0\n";

#[test]
fn a_hill_climb_resumes_to_the_same_digest_and_its_tables_are_climbs() {
    let experiment = Experiment::new(SEARCH);
    let checked = run("coordinator", ["check", &experiment.path("exp.toml")]).expect_success();
    // The point, two ways along shape_bins and w, one along m.
    let line = "# search: hill-climb, at most 360 individuals in 60 generations of 6\n";
    assert!(checked.stdout.contains(line), "{checked}");

    let args = experiment.run_args("out", &["--local-workers", "1"]);
    kill_at("coordinator", args, "generation 2/60");
    let out = experiment.path("out");
    let finished = run("coordinator", ["resume", &out, "--json"]).expect_success();
    assert!(finished.stderr.contains("unfinished, goes on with"), "{finished}");
    let undisturbed = experiment.run("undisturbed", &["--local-workers", "4"]).expect_success();
    assert_eq!(digest(&finished), digest(&undisturbed));
    assert_eq!(summary(&finished)["stop_reason"], "generations");
    run("coordinator", ["verify", &out]).expect_success();

    let frame = results::read_table(&out, results::TableName::Evaluations).unwrap();
    let numbers =
        |name: &str| -> Vec<Option<u32>> { frame.column(name).unwrap().u32().unwrap().iter().collect() };
    let [generations, individuals, correct, parents, others] =
        ["generation", "individual", "object_correct", "parent_a", "parent_b"].map(numbers);
    let elite: Vec<Option<bool>> = frame.column("elite").unwrap().bool().unwrap().iter().collect();
    assert!(others.iter().all(Option::is_none));
    let mut starts = 0;
    let mut before: Option<(u32, u32)> = None; // of the generation before: its best individual and that one's count
    for generation in 1..=60 {
        let rows: Vec<usize> =
            (0..frame.height()).filter(|&row| generations[row] == Some(generation)).collect();
        let first = rows[0];
        assert_eq!(individuals[first], Some(0));
        let is_start = parents[first].is_none();
        assert_eq!(elite[first], Some(!is_start));
        if is_start {
            starts += 1;
            assert_eq!(rows.len(), 1);
        } else {
            let (best, count) = before.unwrap();
            assert!(rows.iter().all(|&row| parents[row] == Some(best)), "generation {generation}");
            assert_eq!(correct[first], Some(count));
        }
        let best = rows.iter().copied().max_by_key(|&row| (correct[row], std::cmp::Reverse(row))).unwrap();
        before = individuals[best].zip(correct[best]);
    }
    assert!(starts > 1, "one climb took all generations");
}
