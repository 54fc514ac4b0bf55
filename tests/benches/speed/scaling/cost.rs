//! What a set of clouds costs, in calls of the library and in a run.

use std::fs;
use std::path::Path;
use std::time::Instant;

use descriptor::Parameters;

use crate::programs::{Running, program};
use crate::watch::watch;
use tests::benches::prepared::{Evaluated, Pair, pool};
use tests::benches::table::Samples;

/// Evaluations of a descriptor, times the repetitions.
const EVALUATIONS: usize = 3;

/// Of the training clouds, on one thread: reading and preparing them, histograms and matching of a descriptor, seconds;
/// memory, bytes.
pub fn prepared(data: &Path, repetitions: usize) -> [f64; 4] {
    let one_thread = pool(1);
    let clock = Instant::now();
    let pair = one_thread.install(|| Pair::prepare(data, "train1.txt", "train2.txt"));
    let prepare = clock.elapsed().as_secs_f64();
    let evaluate =
        || (0..EVALUATIONS * repetitions).map(|_| pair.evaluate(&Parameters::PAPER_BEST)).collect();
    let evaluated: Vec<Evaluated> = one_thread.install(evaluate);
    let median = |value: fn(&Evaluated) -> f64| evaluated.iter().map(value).collect::<Samples>().median();
    [prepare, median(|one| one.describe), median(|one| one.matching), pair.bytes() as f64]
}

/// What a run took.
pub struct Searched {
    pub seconds: f64,
    /// Bytes of memory, of cache and results on disk, and of the journal while it was there.
    pub peak: f64,
    pub cache: f64,
    pub results: f64,
    pub journal: f64,
}

/// Lets a coordinator with a worker in its process search for so many generations, from an empty cache.
pub fn searched(folder: &Path, data: &Path, generations: u32) -> Searched {
    let [experiment, out, cache] = ["exp.toml", "run", "cache"].map(|name| folder.join(name));
    let text = format!(
        "version = 1\n[dataset]\nroot = {:?}\n[stop]\ngenerations = {generations}\nstagnation = \"off\"\n\
         perfect = false\nvalidation_patience = \"off\"\n[results]\nbaselines = false\n",
        data.to_str().unwrap()
    );
    fs::write(&experiment, text).unwrap();
    let mut command = program("coordinator");
    command.arg("run").arg(&experiment).arg("--out").arg(&out).arg("--cache").arg(&cache);
    command.args(["--listen", "127.0.0.1:0", "--json"]);
    let run = Running::start(command);
    let glances = watch(run.process(), &out);
    let finished = run.finish();
    let glances = glances.stop();
    let searched = Searched {
        seconds: finished.seconds,
        peak: finished.peak as f64,
        cache: bytes_in(&cache),
        results: bytes_in(&out),
        journal: glances.iter().map(|glance| glance.journal).max().unwrap_or_default() as f64,
    };
    fs::remove_dir_all(&out).unwrap();
    fs::remove_dir_all(&cache).unwrap();
    searched
}

fn bytes_in(folder: &Path) -> f64 {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    entries
        .map(|entry| match entry.metadata().unwrap() {
            found if found.is_dir() => bytes_in(&entry.path()),
            found => found.len() as f64,
        })
        .sum()
}
