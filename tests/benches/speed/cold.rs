//! Row `cold`: one descriptor from files to errors, test against all other clouds, one thread.

use serde_json::Value;

use crate::Bench;
use crate::peer::Work;
use crate::programs;
use tests::benches::table::{Row, Samples, time};

/// Stages in the report of `coordinator evaluate`.
const STAGES: [&str; 5] = ["read", "keypoints", "normals", "describe", "match"];

/// Measures the row if it is wanted.
pub fn measure(bench: &mut Bench) {
    if !bench.wants(&["cold"]) {
        return;
    }
    evaluate(bench, Work::Test.lists()); // files into the system's cache
    let mut reports = Vec::new();
    for _ in 0..bench.repetitions {
        bench.peer.run(Work::Test);
        reports.push(evaluate(bench, Work::Test.lists()));
    }
    let wrong = &reports[0]["object_wrong"];
    assert!(
        reports.iter().all(|report| report["object_wrong"] == *wrong),
        "cold: results differ: {reports:?}"
    );

    let stage = |name: &str| -> Samples {
        reports.iter().map(|report| report["seconds"][name].as_f64().unwrap()).collect()
    };
    let stages = STAGES.map(|name| format!("{name} {}", time(stage(name).median())));
    let mut notes = vec![
        stages.join(", "),
        format!("object error {:.2} % ({wrong} wrong)", 100.0 * reports[0]["object_error"].as_f64().unwrap()),
    ];
    notes.extend(bench.peer.object_error(Work::Test));
    let row = Row {
        name: "cold",
        what: "read, keypoints, normals, describe, match: 475 against 943, one thread".to_owned(),
        own: stage("total"),
        peer: bench.peer.anchors(Work::Test),
        notes,
    };
    bench.table.add(row);
}

/// The report of `coordinator evaluate` on the paper's chromosome, one thread.
pub fn evaluate(bench: &Bench, [query, database]: [&[&str]; 2]) -> Value {
    let root = bench.household.root.to_str().unwrap();
    let mut args = vec!["evaluate", "--data", root, "--threads", "1", "--json"];
    args.extend(query.iter().flat_map(|list| ["--query", list]));
    args.extend(database.iter().flat_map(|list| ["--database", list]));
    programs::run("coordinator", args).json()
}
