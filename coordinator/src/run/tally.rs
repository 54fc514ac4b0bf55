//! What the runs of a sweep have done together, for the live line that they share.

use std::sync::{Mutex, MutexGuard};
use std::time::Instant;

use crate::lock::lock;

/// Counts over all runs of a sweep.
pub struct Tally {
    runs: usize,
    started: Instant,
    counts: Mutex<Counts>,
}

#[derive(Default)]
struct Counts {
    finished: usize,
    generations: u64,
    /// Individuals that were evaluated for the runs.
    computed: u64,
    workers: usize,
}

impl Tally {
    /// Of so many runs, of which some are finished already.
    pub fn new(runs: usize, finished: usize) -> Self {
        let counts = Mutex::new(Counts { finished, ..Counts::default() });
        Self { runs, started: Instant::now(), counts }
    }

    /// So many workers are there.
    pub fn staffed(&self, workers: usize) {
        self.counts().workers = workers;
    }

    /// A run has had so many individuals evaluated.
    pub fn computed(&self, before: u64, now: u64) {
        let mut counts = self.counts();
        counts.computed = counts.computed.saturating_sub(before) + now;
    }

    /// A run has completed a generation; how many all have.
    pub fn generation_done(&self) -> u64 {
        let mut counts = self.counts();
        counts.generations += 1;
        counts.generations
    }

    /// A run is finished.
    pub fn run_done(&self) {
        self.counts().finished += 1;
    }

    /// Two lines that fit 80 columns.
    pub fn lines(&self) -> [String; 2] {
        let Counts { finished, generations, computed, workers } = *self.counts();
        let rate = computed as f64 / self.started.elapsed().as_secs_f64().max(1e-3);
        let noun = if workers == 1 { "worker" } else { "workers" };
        [
            format!("{finished} of {} runs finished, {generations} generations", self.runs),
            format!("{computed} computed ({rate:.1}/s) | {workers} {noun}"),
        ]
    }

    fn counts(&self) -> MutexGuard<'_, Counts> {
        lock(&self.counts)
    }
}
