//! Rows `shotcolor` and `pfhrgb`: the descriptors without genes from files to errors, one thread.

use std::fs;
use std::path::Path;
use std::time::Instant;

use descriptor::prepare::{Normals, keypoints};
use descriptor::{
    Correct, FixedDescriptor, FixedKind, Label, Preprocess, Signature, Signatures, pcd, recognise,
};

use crate::Bench;
use crate::peer::Work;
use tests::benches::prepared::pool;
use tests::benches::table::{Row, Samples, time};

/// Names of the stages below, in their order.
const STAGES: [&str; 5] = ["read", "keypoints", "normals", "describe", "match"];

/// Measures the rows that are wanted.
pub fn measure(bench: &mut Bench) {
    let what = |clouds: &str| format!("5 cm, from files to errors, {clouds}, one thread");
    measure_kind(bench, FixedKind::ShotColor, Work::ShotColor, what("475 against 943"));
    measure_kind(bench, FixedKind::PfhRgb, Work::PfhRgb, what("the 20 clouds of peers/pcl, beside pfhfast"));
}

fn measure_kind(bench: &mut Bench, kind: FixedKind, work: Work, what: String) {
    if !bench.wants(&[kind.name()]) {
        return;
    }
    let [queries, database] = work.lists().map(|lists| bench.household.listed(lists));
    let one_thread = pool(1);
    let evaluate = |root: &Path| one_thread.install(|| Evaluated::new(kind, root, [&queries, &database]));
    evaluate(&bench.household.root); // files into the system's cache
    let mut runs = Vec::new();
    for _ in 0..bench.repetitions {
        bench.peer.run(work);
        runs.push(evaluate(&bench.household.root));
    }
    let Correct { queries, object, category } = runs[0].correct;
    assert!(runs.iter().all(|run| run.correct == runs[0].correct), "{kind}: results differ");

    let stage = |stage: usize| runs.iter().map(|run| run.seconds[stage]).collect::<Samples>();
    let stages =
        STAGES.iter().enumerate().map(|(index, name)| format!("{name} {}", time(stage(index).median())));
    let error = |correct: usize| 100.0 * (queries - correct) as f64 / queries as f64;
    let mut notes = vec![
        stages.collect::<Vec<_>>().join(", "),
        format!("object error {:.2} %, category error {:.2} %", error(object), error(category)),
    ];
    notes.extend(bench.peer.object_error(work));
    let own = runs.iter().map(|run| run.seconds.iter().sum()).collect();
    let peer = bench.peer.anchors(work);
    bench.table.add(Row { name: kind.name(), what, own, peer, notes });
}

/// What one evaluation finds, and how long its stages take.
struct Evaluated {
    correct: Correct,
    seconds: [f64; 5],
}

impl Evaluated {
    fn new(kind: FixedKind, root: &Path, names: [&[String]; 2]) -> Self {
        let mut seconds = [0.0; 5];
        let [queries, database] = names.map(|names| {
            let signatures: Vec<Signature> =
                names.iter().map(|name| signature(kind, &root.join(name), &mut seconds)).collect();
            signatures.iter().collect::<Signatures>()
        });
        let all: Vec<&String> = names.into_iter().flatten().collect();
        let [query_labels, labels] = names.map(|names| labels(names, &all));
        let start = Instant::now();
        let matches = recognise(&[queries], &[database], &[1.0], &labels).unwrap();
        seconds[4] = start.elapsed().as_secs_f64();
        Self { correct: Correct::count(&matches, &query_labels, &labels), seconds }
    }
}

/// One cloud's signature; adds what its stages take.
fn signature(kind: FixedKind, path: &Path, seconds: &mut [f64; 5]) -> Signature {
    let preprocess = Preprocess::default();
    let mut start = Instant::now();
    let mut lap = |stage: usize| {
        seconds[stage] += start.elapsed().as_secs_f64();
        start = Instant::now();
    };
    let cloud = pcd::read(&fs::read(path).unwrap()).unwrap();
    lap(0);
    let keypoints = keypoints(&cloud, &preprocess).unwrap();
    lap(1);
    let normals = Normals::new(&cloud, &keypoints, &preprocess).unwrap();
    lap(2);
    let descriptor = FixedDescriptor { kind, radius_um: 50_000 };
    let signature = descriptor.describe(&cloud, &keypoints, &normals).unwrap().signature();
    lap(3);
    signature
}

/// Numbers for the category and instance folders of some names, by the names of both sides.
fn labels(names: &[String], all: &[&String]) -> Vec<Label> {
    let number = |name: &str, folders: usize| {
        let prefix = |name: &str| name.split('/').take(folders).map(str::to_owned).collect::<Vec<_>>();
        all.iter().position(|other| prefix(other) == prefix(name)).unwrap() as u32
    };
    names.iter().map(|name| Label { category: number(name, 1), instance: number(name, 2) }).collect()
}
