//! A run in short: how far it is, how good its best is, and how long it will take.

use std::path::Path;

use cluster::journal::{JOURNAL_FILE, JournalFile};
use results::{Columnar, FinishedRun, is_in_use};
use serde_json::{Value, json};

use super::folders::{Found, Kind};
use super::run_log::{RunLogReader, milliseconds};
use crate::compare::verdict_of_run;
use crate::experiment::{Experiment, Overrides, Plan};

/// Generations whose time says how long the rest will take.
const RECENT: usize = 10;

/// Where a run stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum State {
    /// A coordinator works on it.
    Running,
    /// A coordinator holds it, and hands out nothing.
    Paused,
    /// It has ended as it should.
    Finished,
    /// Nobody works on it.
    #[default]
    Unfinished,
    /// Its folder cannot be read.
    Unreadable,
}

impl State {
    fn name(self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Paused => "paused",
            Self::Finished => "finished",
            Self::Unfinished => "unfinished",
            Self::Unreadable => "unreadable",
        }
    }
}

/// What is known of one run, sweep or grid.
pub struct Overview {
    found: Found,
    state: State,
    finished: Option<Finished>,
    /// What it was started with; `None` until it can be read.
    experiment: Option<Box<Experiment>>,
    figures: Value,
}

struct Finished {
    run: FinishedRun,
    verdict: Vec<String>,
}

impl Overview {
    /// Of a folder that has not been read yet.
    pub fn new(found: &Found) -> Self {
        Self {
            found: found.clone(),
            state: State::default(),
            finished: None,
            experiment: None,
            figures: Value::Null,
        }
    }

    /// What it was started with, if that can be read.
    pub fn experiment(&self) -> Option<&Experiment> {
        self.experiment.as_deref()
    }

    /// What was written at its end, if it has ended.
    pub fn finished(&self) -> Option<&FinishedRun> {
        self.finished.as_ref().map(|finished| &finished.run)
    }

    /// Takes what was read.
    pub fn read(&mut self, generations: &[Columnar], log: &RunLogReader, problem: Option<String>) {
        let folder = &self.found.folder;
        let (mut problem, mut is_damaged) = (problem, false);
        self.finished = match results::read_run(folder) {
            Ok(run) => {
                let verdict = verdict_of_run(folder, &run.row).unwrap_or_default();
                Some(Finished { verdict, run })
            }
            Err(results::Error::Unfinished(_)) => None,
            Err(error) => {
                problem = Some(error.to_string());
                is_damaged = true;
                None
            }
        };
        if self.experiment.is_none() {
            let member = self.found.sweep.as_ref().and(folder.file_name()).and_then(|name| name.to_str());
            let record = match &self.finished {
                Some(Finished { run, .. }) => Some((run.row.resolved_toml.as_str(), None)),
                None => log.experiment().map(|record| (record, member)),
            };
            self.experiment = record.and_then(|(record, member)| experiment(record, folder, member));
        }
        let is_held = match self.found.kind {
            // Its runs hold their folders; it has the journal of all.
            Kind::Sweep => matches!(JournalFile::is_open(&folder.join(JOURNAL_FILE)), Ok(Some(true))),
            Kind::Run | Kind::Grid => is_in_use(folder),
        };
        self.state = match (&self.finished, is_held) {
            (Some(_), _) => State::Finished,
            (None, true) if log.is_paused() => State::Paused,
            (None, true) => State::Running,
            (None, false) if is_damaged || problem.is_some() && generations.is_empty() => State::Unreadable,
            (None, false) => State::Unfinished,
        };
        self.figures = match (self.found.kind, &self.finished) {
            (Kind::Grid, _) => self.of_grid(),
            (Kind::Sweep, _) => json!({}),
            (Kind::Run, Some(finished)) => of_finished(finished),
            (Kind::Run, None) => self.of_unfinished(generations, log),
        };
        let is_done = match self.found.kind {
            Kind::Grid => self.figures["finished_ms"].is_number(),
            Kind::Sweep => !is_held && !folder.join(JOURNAL_FILE).exists(),
            Kind::Run => false,
        };
        if is_done {
            self.state = State::Finished;
        }
        self.figures["problem"] = json!(problem);
    }

    fn of_unfinished(&self, generations: &[Columnar], log: &RunLogReader) -> Value {
        let last =
            |name: &str| generations.last().and_then(|row| row.numbers(name).first().copied().flatten());
        let sum = |name: &str| -> f64 {
            generations.iter().filter_map(|row| row.numbers(name).first().copied().flatten()).sum()
        };
        let limit = self.experiment().map(|experiment| experiment.stop().generations);
        let recent = &generations[generations.len().saturating_sub(RECENT)..];
        let times: Vec<f64> =
            recent.iter().filter_map(|row| row.numbers("seconds").first().copied().flatten()).collect();
        let mean = times.iter().sum::<f64>() / times.len().max(1) as f64;
        let left = limit.map(|limit| f64::from(limit.saturating_sub(generations.len() as u32)) * mean);
        let is_at_work = matches!(self.state, State::Running | State::Paused);
        json!({
            "started_ms": log.started_at().map(milliseconds),
            "seconds": sum("seconds"),
            "generation": generations.len(), "generations": limit,
            "evaluations_computed": sum("evaluations_computed"),
            "evaluations_remembered": sum("evaluations_remembered"),
            "workers": if is_at_work { log.present() } else { None },
            "best_error": last("best_so_far_fitness").map(|fitness| 1.0 - fitness),
            "validation_error": last("validation_object_error"),
            "seconds_left": left.filter(|_| is_at_work && !times.is_empty()),
            "verdict": [],
        })
    }

    fn of_grid(&self) -> Value {
        let Ok(grid) = results::read_grid(&self.found.folder) else { return json!({"verdict": []}) };
        json!({
            "name": grid.row.name, "seconds": grid.row.seconds, "finished_ms": milliseconds(grid.row.finished_at),
            "best_error": share_wrong(grid.row.best_object_correct, grid.row.queries),
            "optimum_error": share_wrong(grid.row.best_object_correct, grid.row.queries),
            "verdict": [],
        })
    }

    /// As JSON.
    pub fn json(&self) -> Value {
        let Found { id, kind, sweep, folder, .. } = &self.found;
        let base = folder.file_name().map(|name| name.to_string_lossy().into_owned());
        let name = self.experiment().map(|experiment| experiment.name().to_owned());
        let mut run = json!({
            "id": id, "name": name.or(base.clone()), "seed": self.experiment().map(Experiment::seed),
            "kind": match kind { Kind::Run => "run", Kind::Sweep => "sweep", Kind::Grid => "grid" },
            "sweep": sweep, "member": if sweep.is_some() { base } else { None }, "state": self.state.name(),
            "started_ms": null, "finished_ms": null, "seconds": null, "generation": 0, "generations": null,
            "evaluations_computed": 0, "evaluations_remembered": 0, "workers": null, "best_error": null,
            "weighed_error": null, "validation_error": null, "test_error": null, "regret": null, "optimum_error": null,
            "seconds_left": null, "stop_reason": null, "verdict": [], "problem": null,
        });
        if let (Some(run), Value::Object(figures)) = (run.as_object_mut(), &self.figures) {
            run.extend(figures.clone());
        }
        run
    }
}

fn of_finished(Finished { run: FinishedRun { row, .. }, verdict }: &Finished) -> Value {
    let optimum = row.grid_best_object_correct;
    json!({
        "name": row.name, "seed": row.seed,
        "started_ms": milliseconds(row.started_at), "finished_ms": milliseconds(row.finished_at),
        "seconds": row.seconds, "generation": row.generations, "generations": row.generations,
        "evaluations_computed": row.evaluations_computed, "evaluations_remembered": row.evaluations_remembered,
        "best_error": row.train.object_error(),
        "weighed_error": row.weighted_train.map(|counts| counts.object_error()),
        "validation_error": row.validation.map(|counts| counts.object_error()),
        "test_error": row.test.map(|counts| counts.object_error()),
        "regret": row.regret(),
        "optimum_error": optimum.map(|best| share_wrong(best, row.train.queries)),
        "stop_reason": row.stop_reason, "verdict": verdict,
    })
}

fn share_wrong(correct: u32, queries: u32) -> f64 {
    f64::from(queries.saturating_sub(correct)) / f64::from(queries.max(1))
}

/// What a run was started with: `record` tells it in full, or the sweep of which it is this member.
fn experiment(record: &str, folder: &Path, member: Option<&str>) -> Option<Box<Experiment>> {
    let Some(member) = member else {
        return Experiment::from_record(record, folder, None, Overrides::default()).ok().map(Box::new);
    };
    match Plan::from_record(record, folder, Overrides::default()).ok()? {
        Plan::Run(experiment) => Some(experiment),
        Plan::Sweep(sweep) => {
            let mut members = sweep.members().into_iter();
            Some(Box::new(members.find(|other| other.name == member)?.experiment))
        }
    }
}
