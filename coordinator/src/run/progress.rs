//! What a run shows while it works: a live line on a terminal, plain lines elsewhere, always on standard error.

use std::io::{self, IsTerminal as _};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use descriptor::Descriptor;
use indicatif::{ProgressBar, ProgressStyle};
use results::ErrorRate;

use crate::console::{Console, has_viewer, say};
use crate::lines::{clock, percent};
use crate::lock::lock;
use crate::metrics::{MetricsSource, RunMetrics};
use crate::run::tally::Tally;
use cluster::events::EventCursor;
use cluster::{Cluster, ClusterNews};

/// What there is to say at the end of a generation.
pub struct GenerationReport<'a> {
    /// Which one, from 1.
    pub generation: u32,
    /// Training errors of all individuals, by what the fitness counts.
    pub errors: &'a [f64],
    /// The generation's best.
    pub best: &'a Descriptor,
    /// Whether that is the winner so far.
    pub improved: bool,
    /// Error of the best on the validation set, by the same, if measured.
    pub validation: Option<f64>,
    /// Different descriptors that the search has met with it: what a budget of evaluations is spent on.
    pub met: u64,
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

/// How far a search was.
#[derive(Clone, Copy, Debug, Default)]
struct There {
    generations: u32,
    met: u64,
    computed: u64,
}

/// The display of one run.
pub struct Progress {
    console: Console,
    generations: u32,
    /// Different descriptors after which the search ends.
    budget: Option<u32>,
    /// Set while a grid is evaluated.
    cells: Option<CellReport>,
    started: Instant,
    generation: u32,
    /// Generations that are complete, and different descriptors that the search has met by then.
    complete: u32,
    met: u64,
    /// What was there when this start began its first generation: it says nothing of how long the rest will take.
    there: There,
    /// Errors of the last complete generation.
    errors: String,
    workers: usize,
    /// Individuals whose descriptor was evaluated, and those whose descriptor was known already, as in the summary.
    computed: u64,
    remembered: u64,
    /// Of a run of a sweep: its name, and what all of them have done.
    member: Option<(String, Arc<Tally>)>,
    /// Events that are not printed yet; all runs of a sweep share it, so that each line is printed once.
    events: Option<Arc<Mutex<EventCursor>>>,
    metrics: Option<RunMetrics>,
}

impl Progress {
    /// A display for a run of at most `generations` generations.
    pub fn new(generations: u32) -> Self {
        let is_terminal = has_viewer() && io::stdout().is_terminal();
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
        Self { errors: "describing the clouds".to_owned(), ..Self::on(console, generations) }
    }

    /// A display on a console, of nothing yet.
    fn on(console: Console, generations: u32) -> Self {
        Self {
            console,
            generations,
            budget: None,
            cells: None,
            started: Instant::now(),
            generation: 0,
            complete: 0,
            met: 0,
            there: There::default(),
            errors: String::new(),
            workers: 0,
            computed: 0,
            remembered: 0,
            member: None,
            events: None,
            metrics: None,
        }
    }

    /// The same for a search that ends after so many different descriptors, if that is before its last generation.
    pub fn with_budget(self, budget: Option<u32>) -> Self {
        Self { budget, ..self }
    }

    /// A display without a live line.
    pub fn quiet() -> Self {
        let mut progress = Self::new(0);
        progress.finish();
        progress
    }

    /// The display of one run of a sweep: its lines carry its name, the live line is that of all.
    pub fn of_member(&self, name: &str, generations: u32, tally: &Arc<Tally>) -> Self {
        Self {
            member: Some((name.to_owned(), Arc::clone(tally))),
            events: self.events.clone(),
            metrics: self.metrics.as_ref().map(|metrics| metrics.of_member(name)),
            ..Self::on(self.console.clone(), generations)
        }
    }

    /// Prints what happens in a cluster from now on, whenever there is news.
    pub fn follow(&mut self, cluster: &Cluster) {
        self.events = Some(Arc::new(Mutex::new(cluster.events())));
    }

    /// Tells whoever measures the run in this folder how far it is.
    pub fn measure(&mut self, source: Option<&Arc<MetricsSource>>, folder: &Path) {
        let name = folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy();
        self.metrics = source.map(|source| source.run(&name));
    }

    /// The search has been told the results of a generation, which may have been written by an earlier start; the best
    /// training fitness so far is from 0 to 1.
    pub fn told(&self, generation: u32, best_fitness: f64) {
        if let Some(metrics) = &self.metrics {
            metrics.generation_done(generation, best_fitness);
        }
    }

    fn print_events(&self) {
        if let Some(events) = &self.events {
            print_news(events, &self.console);
        }
    }

    /// Prints what has happened and is not printed yet, as this does, whatever this does meanwhile.
    pub fn teller(&self) -> impl Fn() + use<> {
        let (events, console) = (self.events.clone(), self.console.clone());
        move || events.iter().for_each(|events| print_news(events, &console))
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

    /// A search begins, of which `found` generations are there already. Rates are counted from the first one that is not.
    pub fn search_starts(&mut self, found: u32) {
        self.started = Instant::now();
        self.complete = found;
        self.there = There { generations: found, ..There::default() };
        self.cells = None;
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
                say(self.cells_line(report).join(" | "));
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
            let error = ErrorRate::new(*correct, report.queries);
            format!(": best {} with {descriptor}", percent(error.share()))
        });
        let (workers, left) = (self.workers(), clock(elapsed.mul_f64(rest)));
        let place = format!("cell {}/{}{best}", report.done, report.cells);
        [place, format!("{workers}, {rate:.0} descriptors/s | about {left} left")]
    }

    fn workers(&self) -> String {
        format!("{} {}", self.workers, if self.workers == 1 { "worker" } else { "workers" })
    }

    /// A generation begins; the search has met so many different descriptors before it.
    pub fn generation_starts(&mut self, generation: u32, met: u64) {
        self.generation = generation;
        if generation == self.there.generations.saturating_add(1) {
            self.started = Instant::now();
            (self.there.met, self.there.computed) = (met, self.computed);
        }
        self.redraw();
    }

    /// Workers came or went, answers came.
    pub fn news(&mut self, news: &ClusterNews) {
        self.print_events();
        self.staffed(news.workers, news.finished > 0);
    }

    /// As [`news`](Self::news), with so many descriptors of individuals that are evaluated now.
    pub fn evaluated(&mut self, news: &ClusterNews, descriptors: u64) {
        self.counted(self.computed + descriptors, self.remembered);
        self.news(news);
    }

    fn staffed(&mut self, workers: usize, has_answers: bool) {
        let changed = self.workers != workers || has_answers;
        self.workers = workers;
        if let Some((_, tally)) = &self.member {
            tally.staffed(workers);
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
        let best = report.errors.iter().copied().min_by(f64::total_cmp).unwrap_or(1.0);
        let mean = report.errors.iter().sum::<f64>() / report.errors.len() as f64;
        let validation = report.validation.map_or("off".to_owned(), percent);
        self.errors = format!("best {} mean {} validation {validation}", percent(best), percent(mean));
        (self.complete, self.met) = (report.generation, report.met);
        let done = match &self.member {
            Some((_, tally)) => tally.generation_done(),
            None => (self.share() * f64::from(self.generations)).round() as u64,
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
            None => say(format_args!("{}{}: {} | {}", self.label(), self.place(), self.errors, self.work())),
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

    /// How much of the search is complete, by generations or by its budget, whichever is further.
    fn share(&self) -> f64 {
        let of_generations = f64::from(self.complete) / f64::from(self.generations.max(1));
        let of_budget = self.budget.map_or(0.0, |budget| self.met as f64 / f64::from(budget.max(1)));
        of_generations.max(of_budget).min(1.0)
    }

    /// What has been done, how fast, by whom, and how long the rest takes if no stop rule ends it earlier.
    fn work(&self) -> String {
        let elapsed = self.started.elapsed();
        let done = self.computed.saturating_sub(self.there.computed);
        let rate = done as f64 / elapsed.as_secs_f64().max(1e-3);
        let left = self.left(elapsed).map_or_else(String::new, |left| {
            format!(" | at most {} left", clock(left.max(Duration::from_secs(1))))
        });
        let Self { computed, remembered, .. } = self;
        format!("{computed} computed ({rate:.1}/s), {remembered} remembered | {}{left}", self.workers())
    }

    /// How long the rest takes at most, to the last generation or to the end of the budget, whichever comes first.
    /// Before this start has completed a generation nobody knows, and after the end there is no rest.
    fn left(&self, elapsed: Duration) -> Option<Duration> {
        let completed =
            self.complete.checked_sub(self.there.generations).filter(|&completed| completed > 0)?;
        let to_last = self.generations.saturating_sub(self.complete);
        let by_generations = f64::from(to_last) / f64::from(completed);
        let by_budget = self.budget.map(|budget| {
            let to_meet = u64::from(budget).saturating_sub(self.met) as f64;
            // Infinite if nothing new was met: then the generations bound it.
            if to_meet == 0.0 { 0.0 } else { to_meet / self.met.saturating_sub(self.there.met) as f64 }
        });
        let rest = by_budget.map_or(by_generations, |by_budget| by_generations.min(by_budget));
        (rest > 0.0).then(|| elapsed.mul_f64(rest))
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

fn print_news(events: &Mutex<EventCursor>, console: &Console) {
    let events = lock(events).read_to_end();
    for event in events.iter().filter(|event| event.kind.is_news()) {
        console.say(&event.kind.to_string());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The display of a search of which so many generations are there already.
    fn begun(generations: u32, budget: Option<u32>, found: u32) -> Progress {
        let mut progress = Progress { generations, ..Progress::quiet() }.with_budget(budget);
        progress.search_starts(found);
        progress
    }

    fn complete(progress: &mut Progress, (generation, met): (u32, u64)) {
        let best = Descriptor::default_of(descriptor::Family::DiskRing);
        let (errors, best) = (&[0.5], &best);
        progress.generation_done(&GenerationReport {
            generation,
            errors,
            best,
            improved: true,
            validation: None,
            met,
        });
    }

    #[test]
    fn the_line_counts_as_the_summary_does_and_says_how_long_only_when_that_is_known() {
        // A start that finds the first of four generations.
        let mut progress = begun(4, None, 1);
        progress.generation_starts(1, 0);
        progress.counted(3, 1);
        progress.generation_starts(2, 3);
        assert!(
            progress.work().starts_with("3 computed (0.0/s), 1 remembered | 0 workers"),
            "{}",
            progress.work()
        );
        assert!(!progress.work().contains("left"), "{}", progress.work());
        progress.counted(5, 1);
        progress.staffed(1, true);
        assert!(progress.work().starts_with("5 computed ("), "{}", progress.work());
        assert!(progress.work().ends_with("/s), 1 remembered | 1 worker"), "{}", progress.work());
        // Two of the generation's individuals were equal, and its best was measured on the validation set.
        progress.counted(5, 2);
        complete(&mut progress, (2, 5));
        assert!(progress.work().starts_with("5 computed ("), "{}", progress.work());
        assert!(progress.work().ends_with(" s left"), "{}", progress.work());
        complete(&mut progress, (4, 5));
        assert!(!progress.work().contains("left"), "{}", progress.work());
    }

    #[test]
    fn the_rate_is_that_of_descriptors_since_the_first_generation_that_was_not_there() {
        let mut progress = begun(9, None, 2);
        progress.generation_starts(1, 0);
        progress.counted(100, 0);
        progress.generation_starts(3, 100);
        progress.counted(107, 0);
        progress.started = Instant::now().checked_sub(Duration::from_millis(1000)).unwrap();
        // However long the test has taken since.
        let line = progress.work();
        let rate = line.split_once('(').unwrap().1.split_once("/s)").unwrap().0;
        let rate: f64 = rate.parse().unwrap();
        assert!(rate > 0.0 && rate <= 7.0, "{line}");
    }

    #[test]
    fn the_rest_ends_with_the_generations_or_with_the_budget() {
        let minute = Duration::from_secs(60);
        let left = |budget, met: [u64; 2], complete_generations: u32| {
            let mut progress = begun(10, budget, 1);
            progress.generation_starts(2, met[0]);
            complete(&mut progress, (complete_generations, met[1]));
            (progress.left(minute), (100.0 * progress.share()).round() as u32)
        };
        // Two generations a minute: of ten, seven are left.
        assert_eq!(left(None, [5, 15], 3), (Some(minute.mul_f64(3.5)), 30));
        // Ten descriptors a minute: of 20, five are left; of 2000, too many.
        assert_eq!(left(Some(20), [5, 15], 3), (Some(minute.mul_f64(0.5)), 75));
        assert_eq!(left(Some(2000), [5, 15], 3), (Some(minute.mul_f64(3.5)), 30));
        // Nothing new is met any more.
        assert_eq!(left(Some(20), [5, 5], 3), (Some(minute.mul_f64(3.5)), 30));
        // The end, or nothing that is known.
        assert_eq!(left(Some(20), [5, 20], 3), (None, 100));
        assert_eq!(left(Some(20), [5, 26], 3), (None, 100));
        assert_eq!(left(None, [5, 15], 10), (None, 100));
        assert_eq!(left(None, [5, 5], 1), (None, 10));
    }
}
