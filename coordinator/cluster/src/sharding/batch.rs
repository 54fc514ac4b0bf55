//! Evaluations and scales that are asked for together, each whole or sharded, from tasks to results. An evaluation begins as
//! soon as the scales of its own channels are found, whatever the others wait for.

use std::sync::Arc;

use proto::JobId;
use proto::task::{Evaluation, EvaluationResult, Scale, Task, TaskResult};

use super::plan::{ShardPlan, pairs_cost};
use super::sharded::{ShardedEvaluation, Subtask};
use super::sharded_scale::{FoundScale, ScaleSubtask, ShardedScale, SplitSide};
use super::side::Side;
use crate::scheduler::messages::Finished;

/// An evaluation with how it is sharded, if it is.
pub type Planned = (Evaluation, Option<(ShardPlan, [Arc<Side>; 2])>);

/// A scale with the shards of its splits, if it is sharded.
pub type PlannedScale = (Scale, Option<Vec<SplitSide>>);

/// An evaluation, and which of its scales are asked for with it.
#[derive(Clone, Debug, PartialEq)]
pub struct AwaitingScales {
    /// With the scales that are known, and 1 for the others.
    pub evaluation: Evaluation,
    /// The others: the channel's place, and the index of its scale among those that are asked for.
    pub awaited: Vec<(u32, usize)>,
}

/// Evaluations that wait for scales.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Waiting {
    /// How many.
    pub evaluations: usize,
    /// Counted cost of matching the pairs of all of them.
    pub pairs_cost: u64,
}

/// Evaluations and scales under way. Its tasks are numbered in the order in which it gives them.
#[derive(Default)]
pub struct Batch {
    evaluations: Vec<State<ShardedEvaluation, EvaluationResult>>,
    scales: Vec<State<ShardedScale, FoundScale>>,
    /// Of each scale the evaluations that wait for it, with the channel's place.
    waiting_for: Vec<Vec<(usize, u32)>>,
    waiting: Waiting,
    /// Evaluations that wait for no scale and have not begun.
    ready: Vec<usize>,
    /// What each task so far belongs to.
    tasks: Vec<Part>,
    /// Evaluations that were done since somebody has looked.
    evaluated: Vec<usize>,
}

/// An evaluation or a scale.
enum State<Sharded, Result> {
    /// An evaluation that has not begun, and how many scales it waits for.
    Waiting(Box<Evaluation>, usize),
    Whole,
    Sharded(JobId, Box<Sharded>),
    Done(Box<Finished<Result>>),
}

/// What a task belongs to, by index; without a subtask it is the whole of it.
#[derive(Clone, Copy)]
enum Part {
    Evaluation(usize, Option<Subtask>),
    Scale(usize, Option<ScaleSubtask>),
}

impl Batch {
    /// Evaluations of which nothing is there yet.
    pub fn new(evaluations: Vec<AwaitingScales>) -> Self {
        let mut batch = Self::default();
        for (index, AwaitingScales { evaluation, awaited }) in evaluations.into_iter().enumerate() {
            for &(place, scale) in &awaited {
                if batch.waiting_for.len() <= scale {
                    batch.waiting_for.resize_with(scale + 1, Vec::new);
                }
                batch.waiting_for[scale].push((index, place));
            }
            batch.waiting.add(&evaluation);
            if awaited.is_empty() {
                batch.ready.push(index);
            }
            batch.evaluations.push(State::Waiting(Box::new(evaluation), awaited.len()));
        }
        batch
    }

    /// Takes the evaluations that wait for no scale any more, each with its index, to be begun.
    pub fn take_ready(&mut self) -> Vec<(usize, Evaluation)> {
        let mut taken = Vec::new();
        for index in std::mem::take(&mut self.ready) {
            if let State::Waiting(evaluation, 0) = &self.evaluations[index] {
                self.waiting.remove(evaluation);
                taken.push((index, (**evaluation).clone()));
            }
        }
        taken
    }

    /// The evaluations that are not begun, without those that were taken to be.
    pub fn waiting(&self) -> Waiting {
        self.waiting
    }

    /// Begins an evaluation that was ready, and returns its first tasks.
    pub fn begin(&mut self, index: usize, (evaluation, plan): Planned) -> Vec<Task> {
        let whole = Task::Evaluation(evaluation.clone());
        let Some((plan, sides)) = plan else {
            self.evaluations[index] = State::Whole;
            return vec![self.number(Part::Evaluation(index, None), whole)];
        };
        let sharded = ShardedEvaluation::new(evaluation, plan, sides);
        let number = |(subtask, task)| self.number(Part::Evaluation(index, Some(subtask)), task);
        let first = sharded.begin().into_iter().map(number).collect();
        self.evaluations[index] = State::Sharded(whole.job(0), Box::new(sharded));
        first
    }

    /// Begins the scales, once, and returns their first tasks.
    ///
    /// # Panics
    /// If an evaluation awaits one that is not there: a programming error.
    pub fn begin_scales(&mut self, scales: Vec<PlannedScale>) -> Vec<Task> {
        assert!(self.waiting_for.len() <= scales.len(), "scale {}", self.waiting_for.len() - 1);
        let mut first = Vec::new();
        for (index, (scale, splits)) in scales.into_iter().enumerate() {
            let whole = Task::Scale(scale.clone());
            let state = match splits {
                None => {
                    first.push(self.number(Part::Scale(index, None), whole));
                    State::Whole
                }
                Some(splits) => {
                    let sharded = ShardedScale::new(scale, splits);
                    for (subtask, task) in sharded.begin() {
                        first.push(self.number(Part::Scale(index, Some(subtask)), task));
                    }
                    State::Sharded(whole.job(0), Box::new(sharded))
                }
            };
            self.scales.push(state);
        }
        first
    }

    /// Takes in the result of a task, and returns what can be done by now.
    pub fn take(&mut self, task: usize, finished: Finished) -> Vec<Task> {
        match self.tasks[task] {
            Part::Evaluation(index, subtask) => self.take_evaluation(index, subtask, finished),
            Part::Scale(index, subtask) => self.take_scale(index, subtask, finished).into_iter().collect(),
        }
    }

    fn take_evaluation(&mut self, index: usize, subtask: Option<Subtask>, finished: Finished) -> Vec<Task> {
        let (further, result) = match (&mut self.evaluations[index], subtask) {
            (State::Sharded(job, sharded), Some(subtask)) => {
                let further = sharded.take(subtask, finished);
                (further, sharded.finish(*job))
            }
            (State::Whole, None) => (Vec::new(), finished.of_kind(evaluation_result)),
            _ => (Vec::new(), None), // answered before
        };
        if let Some(result) = result {
            self.evaluations[index] = State::Done(Box::new(result));
            self.evaluated.push(index);
        }
        let number = |(subtask, task)| self.number(Part::Evaluation(index, Some(subtask)), task);
        further.into_iter().map(number).collect()
    }

    fn take_scale(
        &mut self,
        index: usize,
        subtask: Option<ScaleSubtask>,
        finished: Finished,
    ) -> Option<Task> {
        let (further, result) = match (&mut self.scales[index], subtask) {
            (State::Sharded(job, sharded), Some(subtask)) => {
                let further = sharded.take(subtask, finished);
                (further, sharded.finish(*job))
            }
            (State::Whole, None) => (None, finished.of_kind(found_scale)),
            _ => (None, None), // answered before
        };
        if let Some(result) = result {
            self.scale_evaluations(index, &result.result);
            self.scales[index] = State::Done(Box::new(result));
        }
        further.map(|(subtask, task)| self.number(Part::Scale(index, Some(subtask)), task))
    }

    /// Gives a scale to the evaluations that wait for it.
    fn scale_evaluations(&mut self, index: usize, found: &FoundScale) {
        let waiting = self.waiting_for.get_mut(index).map(std::mem::take).unwrap_or_default();
        for (evaluation, place) in waiting {
            if let State::Waiting(waiting, missing) = &mut self.evaluations[evaluation] {
                found.scale(place, waiting);
                *missing -= 1;
                if *missing == 0 {
                    self.ready.push(evaluation);
                }
            }
        }
    }

    /// The evaluations that were done since the last call, by index.
    pub fn evaluated(&mut self) -> Vec<(usize, &EvaluationResult)> {
        let result = |index: usize| match &self.evaluations[index] {
            State::Done(finished) => Some((index, &finished.result)),
            State::Waiting(..) | State::Whole | State::Sharded(..) => None,
        };
        std::mem::take(&mut self.evaluated).into_iter().filter_map(result).collect()
    }

    /// The results of evaluations and of scales, in their order, of those that are done.
    pub fn finish(self) -> (Vec<Finished<EvaluationResult>>, Vec<Finished<FoundScale>>) {
        (done(self.evaluations), done(self.scales))
    }

    fn number(&mut self, part: Part, task: Task) -> Task {
        self.tasks.push(part);
        task
    }
}

impl From<Evaluation> for AwaitingScales {
    /// One that awaits none.
    fn from(evaluation: Evaluation) -> Self {
        Self { evaluation, awaited: Vec::new() }
    }
}

impl Waiting {
    fn add(&mut self, evaluation: &Evaluation) {
        self.evaluations += 1;
        self.pairs_cost = self.pairs_cost.saturating_add(pairs_cost(evaluation));
    }

    fn remove(&mut self, evaluation: &Evaluation) {
        self.evaluations -= 1;
        self.pairs_cost = self.pairs_cost.saturating_sub(pairs_cost(evaluation));
    }
}

fn done<Sharded, Result>(states: Vec<State<Sharded, Result>>) -> Vec<Finished<Result>> {
    let result = |state| match state {
        State::Done(finished) => Some(*finished),
        State::Waiting(..) | State::Whole | State::Sharded(..) => None,
    };
    states.into_iter().filter_map(result).collect()
}

fn evaluation_result(result: TaskResult) -> Option<EvaluationResult> {
    match result {
        TaskResult::Evaluation(result) => Some(result),
        _ => None, // `Task::check` lets none pass
    }
}

fn found_scale(result: TaskResult) -> Option<FoundScale> {
    match result {
        TaskResult::Scale(scale) => Some(FoundScale { scale, described: Vec::new() }),
        _ => None, // `Task::check` lets none pass
    }
}
