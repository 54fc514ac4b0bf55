//! How cost grows with the number of clouds: synthetic sets of one, four and sixteen times as many views.

use std::fs;
use std::path::Path;
use std::time::Instant;

use descriptor::Parameters;
use tempfile::TempDir;

use crate::programs;
use tests::benches::prepared::{Evaluated, Pair, pool};
use tests::benches::table::{Samples, megabytes, time};

/// Objects in each set.
const OBJECTS: &str = "24";
/// Views of each object.
const VIEWS: [u32; 3] = [20, 80, 320];
/// Descriptors that are measured on each set, times the repetitions.
const DESCRIPTORS: usize = 7;

/// What a set costs.
struct Cost {
    clouds: usize,
    /// In the order of [`QUANTITIES`].
    values: [f64; 6],
}

/// How a quantity is written.
type Written = fn(f64) -> String;

/// What is measured.
const QUANTITIES: [(&str, Written); 6] = [
    ("read and prepare the training clouds, one thread", time),
    ("one new chromosome: histograms", time),
    ("one new chromosome: matching", time),
    ("prepared training clouds in memory", memory),
    ("a run of 2 generations from an empty cache, all threads", time),
    ("its peak resident memory", memory),
];

fn memory(bytes: f64) -> String {
    megabytes(bytes as u64)
}

/// Measures all sets and prints a table with exponents.
pub fn measure(repetitions: usize) {
    let folder = TempDir::new().unwrap();
    let costs = VIEWS.map(|views| {
        println!("{OBJECTS} objects, {views} views");
        cost(&folder.path().join(views.to_string()), views, repetitions)
    });
    let heads = costs.each_ref().map(|cost| format!("{} training clouds", cost.clouds));
    println!("\n| what | {} | exponent | of the last step |\n|---|---|---|---|---|---|", heads.join(" | "));
    for (index, (what, write)) in QUANTITIES.iter().enumerate() {
        let cells = costs.each_ref().map(|cost| write(cost.values[index]));
        let points = costs.each_ref().map(|cost| (cost.clouds as f64, cost.values[index]));
        println!(
            "| {what} | {} | {:.2} | {:.2} |",
            cells.join(" | "),
            exponent(&points),
            exponent(&points[1..])
        );
    }
}

fn cost(folder: &Path, views: u32, repetitions: usize) -> Cost {
    let data = folder.join("data");
    let root = data.to_str().unwrap();
    programs::run("coordinator", ["synth", root, "--objects", OBJECTS, "--views", &views.to_string()]);
    let one_thread = pool(1);
    let clock = Instant::now();
    let pair = one_thread.install(|| Pair::prepare(&data, "train1.txt", "train2.txt"));
    let prepare = clock.elapsed().as_secs_f64();
    let evaluated: Vec<Evaluated> = one_thread
        .install(|| (0..DESCRIPTORS * repetitions).map(|_| pair.evaluate(&Parameters::PAPER_BEST)).collect());
    let median = |value: fn(&Evaluated) -> f64| evaluated.iter().map(value).collect::<Samples>().median();
    let bytes = pair.bytes() as f64;
    let clouds = pair.clouds();
    drop(pair);

    let experiment = folder.join("exp.toml");
    let text = format!("version = 1\n[dataset]\nroot = {root:?}\n[stop]\ngenerations = 2\n");
    fs::write(&experiment, text).unwrap();
    let [experiment, out, cache] =
        [experiment, folder.join("run"), folder.join("cache")].map(|path| path.display().to_string());
    let args = ["run", &experiment, "--out", &out, "--cache", &cache, "--listen", "127.0.0.1:0", "--json"];
    let run = programs::run("coordinator", args);
    let values = [
        prepare,
        median(|one| one.describe),
        median(|one| one.matching),
        bytes,
        run.seconds,
        run.peak as f64,
    ];
    fs::remove_dir_all(folder).unwrap(); // the largest sets fill gigabytes
    Cost { clouds, values }
}

/// Slope of the least-squares line through the logarithms.
#[expect(clippy::disallowed_methods, reason = "describes a measurement, which no two machines share")]
fn exponent(points: &[(f64, f64)]) -> f64 {
    let logarithms: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let mean =
        |value: fn(&(f64, f64)) -> f64| logarithms.iter().map(value).sum::<f64>() / points.len() as f64;
    let (x_mean, y_mean) = (mean(|point| point.0), mean(|point| point.1));
    let covariance: f64 = logarithms.iter().map(|(x, y)| (x - x_mean) * (y - y_mean)).sum();
    let variance: f64 = logarithms.iter().map(|(x, _)| (x - x_mean) * (x - x_mean)).sum();
    covariance / variance
}
