//! Evaluations and scales that are asked for together, each whole or sharded, from tasks to results.

use std::sync::Arc;

use proto::JobId;
use proto::task::{Evaluation, EvaluationResult, Scale, Task, TaskResult};

use super::plan::ShardPlan;
use super::sharded::{ShardedEvaluation, Subtask};
use super::sharded_scale::{FoundScale, ScaleSubtask, ShardedScale, SplitSide};
use super::side::Side;
use crate::scheduler::messages::Finished;

/// An evaluation with how it is sharded, if it is.
pub type Planned = (Evaluation, Option<(ShardPlan, [Arc<Side>; 2])>);

/// A scale with the shards of its splits, if it is sharded.
pub type PlannedScale = (Scale, Option<Vec<SplitSide>>);

/// Evaluations and scales under way. Its tasks are numbered in the order in which it gives them.
pub struct Batch {
    evaluations: Vec<State<ShardedEvaluation, EvaluationResult>>,
    scales: Vec<State<ShardedScale, FoundScale>>,
    /// What each task so far belongs to.
    tasks: Vec<Part>,
    evaluated: usize,
}

/// An evaluation or a scale.
enum State<Sharded, Result> {
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
    /// Evaluations and scales of which nothing is there yet, and the first tasks.
    pub fn new(evaluations: Vec<Planned>, scales: Vec<PlannedScale>) -> (Self, Vec<Task>) {
        let mut batch = Self { evaluations: Vec::new(), scales: Vec::new(), tasks: Vec::new(), evaluated: 0 };
        let mut first = Vec::new();
        for (index, (evaluation, plan)) in evaluations.into_iter().enumerate() {
            let whole = Task::Evaluation(evaluation.clone());
            let state = match plan {
                None => {
                    first.push(batch.number(Part::Evaluation(index, None), whole));
                    State::Whole
                }
                Some((plan, sides)) => {
                    let sharded = ShardedEvaluation::new(evaluation, plan, sides);
                    for (subtask, task) in sharded.begin() {
                        first.push(batch.number(Part::Evaluation(index, Some(subtask)), task));
                    }
                    State::Sharded(whole.job(0), Box::new(sharded))
                }
            };
            batch.evaluations.push(state);
        }
        for (index, (scale, splits)) in scales.into_iter().enumerate() {
            let whole = Task::Scale(scale.clone());
            let state = match splits {
                None => {
                    first.push(batch.number(Part::Scale(index, None), whole));
                    State::Whole
                }
                Some(splits) => {
                    let sharded = ShardedScale::new(scale, splits);
                    for (subtask, task) in sharded.begin() {
                        first.push(batch.number(Part::Scale(index, Some(subtask)), task));
                    }
                    State::Sharded(whole.job(0), Box::new(sharded))
                }
            };
            batch.scales.push(state);
        }
        (batch, first)
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
            self.evaluated += 1;
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
            self.scales[index] = State::Done(Box::new(result));
        }
        further.map(|(subtask, task)| self.number(Part::Scale(index, Some(subtask)), task))
    }

    /// How many evaluations are done.
    pub fn evaluated(&self) -> usize {
        self.evaluated
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

fn done<Sharded, Result>(states: Vec<State<Sharded, Result>>) -> Vec<Finished<Result>> {
    let result = |state| match state {
        State::Done(finished) => Some(*finished),
        State::Whole | State::Sharded(..) => None,
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
