//! What a run shows while it works: a live line on a terminal, plain lines elsewhere, always on standard error.

use std::io::IsTerminal as _;
use std::time::{Duration, Instant};

use descriptor::Parameters;
use indicatif::{ProgressBar, ProgressStyle};
use results::Counts;

use crate::cluster::ClusterNews;

/// What there is to say at the end of a generation.
pub struct GenerationReport<'a> {
    /// Which one, from 1.
    pub generation: u32,
    /// Of every individual.
    pub counts: &'a [Counts],
    /// The generation's best.
    pub best: &'a Parameters,
    /// Whether that is the winner so far.
    pub improved: bool,
    /// Counts of the best on the validation set, if measured.
    pub validation: Option<Counts>,
    /// Evaluations that were known already.
    pub remembered: u64,
}

/// The display of one run.
pub struct Progress {
    /// `None` where standard error is no terminal.
    bar: Option<ProgressBar>,
    generations: u32,
    started: Instant,
    generation: u32,
    /// Errors of the last complete generation.
    errors: String,
    workers: usize,
    /// Evaluations finished by workers since the run began, validation included.
    finished: u64,
    /// Individuals whose descriptor was known already.
    remembered: u64,
}

impl Progress {
    /// A display for a run of at most `generations` generations.
    pub fn new(generations: u32) -> Self {
        let bar = (std::io::stderr().is_terminal() && std::io::stdout().is_terminal()).then(|| {
            let bar = ProgressBar::new(generations.into());
            // Two lines that fit 80 columns.
            let style = ProgressStyle::with_template("{spinner} {bar:10} {prefix}\n  {wide_msg}");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.set_prefix("reading the clouds");
            bar.enable_steady_tick(Duration::from_millis(200));
            bar
        });
        let (started, errors) = (Instant::now(), "describing the clouds".to_owned());
        Self { bar, generations, started, generation: 0, errors, workers: 0, finished: 0, remembered: 0 }
    }

    /// A line that stays.
    pub fn say(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| eprintln!("{line}")),
            None => eprintln!("{line}"),
        }
    }

    /// Rates are counted from now: what came before was no evaluation.
    pub fn search_starts(&mut self) {
        self.started = Instant::now();
    }

    /// A generation begins.
    pub fn generation_starts(&mut self, generation: u32) {
        self.generation = generation;
        self.redraw();
    }

    /// Workers came or went, evaluations were finished.
    pub fn news(&mut self, news: &ClusterNews) {
        for arrival in &news.arrivals {
            let (threads, build) = (arrival.introduction.threads, &arrival.introduction.build);
            self.say(&format!("worker {}: joined, {threads} threads, {build}", arrival.label));
        }
        for farewell in &news.farewells {
            let leases = farewell.leases;
            let leases = if leases == 1 { "1 lease".to_owned() } else { format!("{leases} leases") };
            self.say(&format!("worker {}: {}, {leases} handed back", farewell.label, farewell.reason));
        }
        let changed = self.workers != news.workers || !news.finished.is_empty();
        self.workers = news.workers;
        self.finished += news.finished.len() as u64;
        if changed {
            self.redraw();
        }
    }

    /// A generation is complete.
    pub fn generation_done(&mut self, report: &GenerationReport<'_>) {
        let best = best_error(report.counts);
        let mean = report.counts.iter().map(Counts::object_error).sum::<f64>() / report.counts.len() as f64;
        let validation = report.validation.map_or("off".to_owned(), |counts| percent(counts.object_error()));
        self.errors = format!("best {} mean {} validation {validation}", percent(best), percent(mean));
        self.remembered = report.remembered;
        match &self.bar {
            Some(bar) => {
                bar.set_position(report.generation.into());
                self.redraw();
                if report.improved {
                    self.say(&format!(
                        "generation {}: error {} with {}",
                        report.generation,
                        percent(best),
                        report.best
                    ));
                }
            }
            None => eprintln!("{}: {} | {}", self.place(), self.errors, self.work()),
        }
    }

    /// Takes the live line away.
    pub fn finish(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }

    fn place(&self) -> String {
        format!("generation {}/{}", self.generation, self.generations)
    }

    /// What has been done, by whom, how fast, and how long the rest takes if no stop rule ends it earlier.
    fn work(&self) -> String {
        let elapsed = self.started.elapsed();
        let rate = self.finished as f64 / elapsed.as_secs_f64().max(1e-3);
        let rest =
            f64::from(self.generations.saturating_sub(self.generation)) / f64::from(self.generation.max(1));
        format!(
            "{} evaluated, {} remembered | {} {}, {rate:.1}/s | at most {} left",
            self.finished,
            self.remembered,
            self.workers,
            if self.workers == 1 { "worker" } else { "workers" },
            clock(elapsed.mul_f64(rest)),
        )
    }

    fn redraw(&self) {
        if let Some(bar) = &self.bar {
            bar.set_prefix(format!("{}: {}", self.place(), self.errors));
            bar.set_message(self.work());
        }
    }
}

fn best_error(counts: &[Counts]) -> f64 {
    counts.iter().map(Counts::object_error).min_by(f64::total_cmp).unwrap_or(1.0)
}

/// A share as per cent with two digits, as tables of errors have it.
pub fn percent(share: f64) -> String {
    format!("{:.2} %", 100.0 * share)
}

/// A duration as people read it.
pub fn clock(duration: Duration) -> String {
    let seconds = duration.as_secs();
    match (seconds / 3600, seconds / 60 % 60, seconds % 60) {
        (0, 0, seconds) => format!("{seconds} s"),
        (0, minutes, seconds) => format!("{minutes} min {seconds:02} s"),
        (hours, minutes, _) => format!("{hours} h {minutes:02} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_shares_read_naturally() {
        assert_eq!(clock(Duration::from_secs(59)), "59 s");
        assert_eq!(clock(Duration::from_secs(61)), "1 min 01 s");
        assert_eq!(clock(Duration::from_secs(7_260)), "2 h 01 min");
        assert_eq!(percent(104.0 / 352.0), "29.55 %");
    }
}
