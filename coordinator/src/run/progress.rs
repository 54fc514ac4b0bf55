//! What a run shows while it works: a live line on a terminal, plain lines elsewhere, always on standard error.

use std::io::IsTerminal as _;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use descriptor::Descriptor;
use indicatif::{ProgressBar, ProgressStyle};
use results::Counts;

use crate::console::Console;
use crate::run::tally::Tally;
use cluster::events::EventCursor;
use cluster::{Cluster, ClusterNews};

/// What there is to say at the end of a generation.
pub struct GenerationReport<'a> {
    /// Which one, from 1.
    pub generation: u32,
    /// Of every individual.
    pub counts: &'a [Counts],
    /// The generation's best.
    pub best: &'a Descriptor,
    /// Whether that is the winner so far.
    pub improved: bool,
    /// Counts of the best on the validation set, if measured.
    pub validation: Option<Counts>,
}

/// What there is to say of an exhaustive search.
#[derive(Clone, Debug)]
pub struct CellReport {
    /// Cells that are done, those that were there already among them.
    pub done: usize,
    /// Cells of the grid.
    pub cells: usize,
    /// Cells that were computed since [`Progress::cells_start`].
    pub computed: usize,
    /// Descriptors of a cell.
    pub cell_len: usize,
    /// Training queries.
    pub queries: u32,
    /// The best descriptor so far with its count of correct answers.
    pub best: Option<(u32, Descriptor)>,
}

impl CellReport {
    fn percent_done(&self) -> usize {
        100 * self.done / self.cells
    }
}

/// The display of one run.
pub struct Progress {
    console: Console,
    generations: u32,
    /// Set while a grid is evaluated.
    cells: Option<CellReport>,
    started: Instant,
    generation: u32,
    /// Generations that are complete, and how many of them this start has completed: those that were there already say
    /// nothing of how long the rest will take.
    complete: u32,
    completed: u32,
    /// Errors of the last complete generation.
    errors: String,
    workers: usize,
    /// Answers of workers since the run began, whatever was asked: what rates are made of.
    finished: u64,
    /// Individuals whose descriptor was evaluated, and those whose descriptor was known already, as in the summary.
    computed: u64,
    remembered: u64,
    /// Of a run of a sweep: its name, and what all of them have done.
    member: Option<(String, Arc<Tally>)>,
    /// Events that are not printed yet; all runs of a sweep share it, so that each line is printed once.
    events: Option<Arc<Mutex<EventCursor>>>,
}

impl Progress {
    /// A display for a run of at most `generations` generations.
    pub fn new(generations: u32) -> Self {
        let is_terminal = std::io::stderr().is_terminal() && std::io::stdout().is_terminal();
        let console = if is_terminal {
            let bar = ProgressBar::new(generations.into());
            // Two lines that fit 80 columns.
            let style = ProgressStyle::with_template("{spinner} {bar:10} {prefix}\n  {wide_msg}");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.set_prefix("reading the clouds");
            bar.enable_steady_tick(Duration::from_millis(200));
            Console::with(bar)
        } else {
            Console::default()
        };
        let (started, errors) = (Instant::now(), "describing the clouds".to_owned());
        Self {
            console,
            generations,
            cells: None,
            started,
            generation: 0,
            complete: 0,
            completed: 0,
            errors,
            workers: 0,
            finished: 0,
            computed: 0,
            remembered: 0,
            member: None,
            events: None,
        }
    }

    /// A display without a live line.
    pub fn quiet() -> Self {
        let mut progress = Self::new(0);
        progress.finish();
        progress
    }

    /// The display of one run of a sweep: its lines carry its name, the live line is that of all.
    pub fn of_member(&self, name: &str, generations: u32, tally: &Arc<Tally>) -> Self {
        let (console, member) = (self.console.clone(), Some((name.to_owned(), Arc::clone(tally))));
        Self {
            console,
            generations,
            cells: None,
            started: Instant::now(),
            generation: 0,
            complete: 0,
            completed: 0,
            errors: String::new(),
            workers: 0,
            finished: 0,
            computed: 0,
            remembered: 0,
            member,
            events: self.events.clone(),
        }
    }

    /// Prints what happens in a cluster from now on, whenever there is news.
    pub fn follow(&mut self, cluster: &Cluster) {
        self.events = Some(Arc::new(Mutex::new(cluster.events())));
    }

    fn print_events(&self) {
        let Some(events) = &self.events else { return };
        let events = events.lock().unwrap_or_else(PoisonError::into_inner).read_to_end();
        for event in events.iter().filter(|event| event.kind.is_news()) {
            self.console.say(&event.kind.to_string());
        }
    }

    /// A line that stays.
    pub fn say(&self, line: &str) {
        self.console.say(&format!("{}{line}", self.label()));
    }

    /// Where lines go that are about all runs.
    pub fn console(&self) -> &Console {
        &self.console
    }

    fn label(&self) -> String {
        self.member.as_ref().map_or_else(String::new, |(name, _)| format!("{name}: "))
    }

    /// Rates are counted from now: what came before was no evaluation. `found` generations are there already.
    pub fn search_starts(&mut self, found: u32) {
        self.started = Instant::now();
        self.complete = found;
        self.completed = 0;
        self.cells = None;
        self.finished = 0;
        self.counted(0, 0);
        if let (Some(bar), None) = (self.console.bar(), &self.member) {
            bar.set_length(self.generations.into());
        }
    }

    /// The evaluation of a grid begins; rates are counted from now.
    pub fn cells_start(&mut self, report: &CellReport) {
        self.started = Instant::now();
        self.cells = Some(report.clone());
        if let Some(bar) = self.console.bar() {
            bar.set_length(report.cells as u64);
            bar.set_position(report.done as u64);
        }
        self.redraw();
    }

    /// A cell of the grid is done. Where there is no live line, one is written for each per cent of the grid.
    pub fn cell_done(&mut self, report: &CellReport) {
        let before = self.cells.replace(report.clone()).map_or(0, |before| before.percent_done());
        match self.console.bar() {
            Some(bar) => {
                bar.set_position(report.done as u64);
                self.redraw();
            }
            None if report.percent_done() > before => {
                eprintln!("{}", self.cells_line(report).join(" | "));
            }
            None => {}
        }
    }

    /// How far a grid is, and how fast.
    fn cells_line(&self, report: &CellReport) -> [String; 2] {
        let elapsed = self.started.elapsed();
        let rate = (report.computed * report.cell_len) as f64 / elapsed.as_secs_f64().max(1e-3);
        let rest = (report.cells - report.done) as f64 / report.computed.max(1) as f64;
        let best = report.best.as_ref().map_or_else(String::new, |(correct, descriptor)| {
            let error = f64::from(report.queries - correct) / f64::from(report.queries);
            format!(": best {} with {descriptor}", percent(error))
        });
        let (workers, left) = (self.workers(), clock(elapsed.mul_f64(rest)));
        let place = format!("cell {}/{}{best}", report.done, report.cells);
        [place, format!("{workers}, {rate:.0} descriptors/s | about {left} left")]
    }

    fn workers(&self) -> String {
        format!("{} {}", self.workers, if self.workers == 1 { "worker" } else { "workers" })
    }

    /// A generation begins.
    pub fn generation_starts(&mut self, generation: u32) {
        self.generation = generation;
        self.redraw();
    }

    /// Workers came or went, answers came.
    pub fn news(&mut self, news: &ClusterNews) {
        self.print_events();
        self.answered(news.finished as u64, news.workers);
    }

    /// As [`news`](Self::news), of answers that are individuals' evaluations.
    pub fn evaluations(&mut self, news: &ClusterNews) {
        self.counted(self.computed + news.finished as u64, self.remembered);
        self.news(news);
    }

    fn answered(&mut self, answers: u64, workers: usize) {
        let changed = self.workers != workers || answers > 0;
        self.workers = workers;
        self.finished += answers;
        if let Some((_, tally)) = &self.member {
            tally.answered(answers, workers);
        }
        if changed {
            self.redraw();
        }
    }

    /// How many individuals were evaluated and how many known, as the summary will count them.
    pub fn counted(&mut self, computed: u64, remembered: u64) {
        if let Some((_, tally)) = &self.member {
            tally.computed(self.computed, computed);
        }
        (self.computed, self.remembered) = (computed, remembered);
    }

    /// A generation is complete.
    pub fn generation_done(&mut self, report: &GenerationReport<'_>) {
        let best = best_error(report.counts);
        let mean = report.counts.iter().map(Counts::object_error).sum::<f64>() / report.counts.len() as f64;
        let validation = report.validation.map_or("off".to_owned(), |counts| percent(counts.object_error()));
        self.errors = format!("best {} mean {} validation {validation}", percent(best), percent(mean));
        (self.complete, self.completed) = (report.generation, self.completed + 1);
        let done = match &self.member {
            Some((_, tally)) => tally.generation_done(),
            None => report.generation.into(),
        };
        match self.console.bar() {
            Some(bar) => {
                bar.set_position(done);
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
            None => eprintln!("{}{}: {} | {}", self.label(), self.place(), self.errors, self.work()),
        }
    }

    /// Takes the live line away.
    pub fn finish(&mut self) {
        if let Some(bar) = std::mem::take(&mut self.console).bar() {
            bar.finish_and_clear();
        }
    }

    fn place(&self) -> String {
        format!("generation {}/{}", self.generation, self.generations)
    }

    /// What has been done, by whom, how fast, and how long the rest takes if no stop rule ends it earlier. Before the
    /// first generation is complete nobody knows, and after the last there is no rest.
    fn work(&self) -> String {
        let elapsed = self.started.elapsed();
        let rate = self.finished as f64 / elapsed.as_secs_f64().max(1e-3);
        let rest = self.generations.saturating_sub(self.complete);
        let left = if self.completed == 0 || rest == 0 {
            String::new()
        } else {
            let left = elapsed.mul_f64(f64::from(rest) / f64::from(self.completed));
            format!(" | at most {} left", clock(left.max(Duration::from_secs(1))))
        };
        let Self { computed, remembered, .. } = self;
        format!("{computed} computed, {remembered} remembered | {}, {rate:.1}/s{left}", self.workers())
    }

    fn redraw(&self) {
        if let Some(bar) = self.console.bar() {
            let [prefix, message] = match (&self.cells, &self.member) {
                (Some(report), _) => self.cells_line(report),
                (None, Some((_, tally))) => tally.lines(),
                (None, None) => [format!("{}: {}", self.place(), self.errors), self.work()],
            };
            bar.set_prefix(prefix);
            bar.set_message(message);
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

    #[test]
    fn the_line_counts_as_the_summary_does_and_says_how_long_only_when_that_is_known() {
        let counts = [Counts { object_correct: 1, category_correct: 1, queries: 2 }];
        let best = Descriptor::default_of(descriptor::Family::DiskRing);
        let done = |generation| GenerationReport {
            generation,
            counts: &counts,
            best: &best,
            improved: true,
            validation: None,
        };
        // A start that finds the first of four generations.
        let mut progress = Progress { generations: 4, ..Progress::quiet() };
        progress.search_starts(1);
        progress.counted(3, 1);
        progress.generation_starts(2);
        assert!(progress.work().starts_with("3 computed, 1 remembered | 0 workers"), "{}", progress.work());
        assert!(!progress.work().contains("left"), "{}", progress.work());
        progress.counted(5, 1);
        progress.answered(2, 1);
        assert!(progress.work().starts_with("5 computed, 1 remembered | 1 worker"), "{}", progress.work());
        // Two of the generation's individuals were equal, and its best was measured on the validation set.
        progress.counted(5, 2);
        progress.answered(1, 1);
        progress.generation_done(&done(2));
        assert!(progress.work().starts_with("5 computed, 2 remembered"), "{}", progress.work());
        assert!(progress.work().ends_with(" s left"), "{}", progress.work());
        progress.generation_done(&done(4));
        assert!(!progress.work().contains("left"), "{}", progress.work());
    }
}
