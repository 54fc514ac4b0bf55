//! Whether a coordinator with a thousand workers goes on for long as it began: its memory, its journal and how fast it
//! answers, from one part of the time to the next.

use std::ops::Range;
use std::path::Path;
use std::time::{Duration, Instant};

use results::TableName;
use tempfile::TempDir;

use super::record::{Record, percentile};
use super::worker::Effort;
use super::{make_search, start_coordinator, work};
use crate::watch::{Glance, watch};
use tests::benches::table::{megabytes, time};

const WORKERS: u32 = 1000;
/// Individuals of a generation, each a random descriptor.
const POPULATION: u32 = 10_000;
/// What an evaluation takes on average.
const JOB: Duration = Duration::from_secs(1);
/// Parts of the time that are shown.
const PARTS: u32 = 6;

/// Lets the workers of a random search work for so many seconds, and prints a row for each part of them.
pub fn measure(seconds: u64) {
    let folder = TempDir::new().unwrap();
    let place = folder.path();
    let evaluations = seconds * u64::from(WORKERS) / JOB.as_secs();
    make_search(place, POPULATION, &format!("generations = 1000000\nevaluations = {evaluations}"));

    let (coordinator, address) = start_coordinator(place, "warn");
    let glances = watch(coordinator.process(), &place.join("run"));
    let began = Instant::now();
    let records = work(WORKERS, 1, Effort::About(JOB), address);
    let glances = glances.stop();
    let finished = coordinator.finish();
    check(&finished.json(), &records, place);

    println!(
        "| from, to | evaluations/s | memory | journal | poll p50, p99, longest |\n|---|---|---|---|---|"
    );
    let end = spans_end(&records);
    let part = (end - began) / PARTS;
    for number in 0..PARTS {
        let within = began + part * number..began + part * (number + 1);
        println!("| {} |", row(began, within, &glances, &records));
    }
    let peak = glances.iter().map(|glance| glance.memory).max().unwrap_or_default();
    println!("largest resident memory to the end, tables included: {}", megabytes(peak));
}

/// Every answer that was given must be in the results.
fn check(summary: &serde_json::Value, records: &[Record], place: &Path) {
    let table = results::read_table(place.join("run"), TableName::Evaluations).unwrap();
    let answered = table.column("worker").unwrap().str().unwrap().iter().flatten().count() as u64;
    assert_eq!(summary["evaluations_computed"].as_u64().unwrap(), answered, "an answer to each evaluation");
    let done: usize = records.iter().map(|record| record.spans.len()).sum();
    assert!(done as u64 >= answered, "{done} jobs were done, {answered} are in the results");
}

fn spans_end(records: &[Record]) -> Instant {
    let ends = records.iter().flat_map(|record| record.spans.last()).map(|span| span.end);
    ends.max().expect("jobs")
}

fn row(began: Instant, within: Range<Instant>, glances: &[Glance], records: &[Record]) -> String {
    let jobs =
        records.iter().flat_map(|record| &record.spans).filter(|span| within.contains(&span.end)).count();
    // One that hands in a result is not held back until there is a job: at the end of a generation there is none.
    let polls = records.iter().flat_map(|record| &record.reports).filter(|poll| within.contains(&poll.sent));
    let mut took: Vec<f64> = polls.map(|poll| poll.took.as_secs_f64()).collect();
    took.sort_by(f64::total_cmp);
    let last = glances.iter().rfind(|glance| within.contains(&glance.at)).expect("it was looked at");
    let minutes = [within.start, within.end].map(|at| (at - began).as_secs_f64() / 60.0);
    format!(
        "{:.1}, {:.1} min | {:.0} | {} | {} | {}, {}, {}",
        minutes[0],
        minutes[1],
        jobs as f64 / (within.end - within.start).as_secs_f64(),
        megabytes(last.memory),
        megabytes(last.journal),
        time(percentile(&took, 0.5)),
        time(percentile(&took, 0.99)),
        time(took.last().copied().unwrap_or(f64::NAN)),
    )
}
