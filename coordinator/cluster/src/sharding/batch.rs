//! Evaluations that are asked for together, each whole or sharded, from tasks to results.

use std::sync::Arc;

use proto::JobId;
use proto::task::{Evaluation, EvaluationResult, Task, TaskResult};

use super::plan::ShardPlan;
use super::sharded::{ShardedEvaluation, Subtask};
use super::side::Side;
use crate::scheduler::messages::Finished;

/// An evaluation with how it is sharded, if it is.
pub type Planned = (Evaluation, Option<(ShardPlan, [Arc<Side>; 2])>);

/// Evaluations under way. Its tasks are numbered in the order in which it gives them.
pub struct Batch {
    evaluations: Vec<State>,
    /// Evaluation and subtask of each task so far; `None` of a whole evaluation.
    tasks: Vec<(usize, Option<Subtask>)>,
    done: usize,
}

enum State {
    Whole,
    Sharded(JobId, Box<ShardedEvaluation>),
    Done(Box<Finished<EvaluationResult>>),
}

impl Batch {
    /// Evaluations of which nothing is there yet, and the first tasks.
    pub fn new(planned: Vec<Planned>) -> (Self, Vec<Task>) {
        let mut batch = Self { evaluations: Vec::new(), tasks: Vec::new(), done: 0 };
        let mut first = Vec::new();
        for (index, (evaluation, plan)) in planned.into_iter().enumerate() {
            let whole = Task::Evaluation(evaluation.clone());
            let Some((plan, sides)) = plan else {
                batch.evaluations.push(State::Whole);
                batch.tasks.push((index, None));
                first.push(whole);
                continue;
            };
            let sharded = ShardedEvaluation::new(evaluation, plan, sides);
            first.extend(batch.number(index, sharded.begin()));
            batch.evaluations.push(State::Sharded(whole.job(0), Box::new(sharded)));
        }
        (batch, first)
    }

    /// Takes in the result of a task, and returns what can be done by now.
    pub fn take(&mut self, task: usize, finished: Finished) -> Vec<Task> {
        let (index, subtask) = self.tasks[task];
        let (further, result) = match (&mut self.evaluations[index], subtask) {
            (State::Sharded(job, sharded), Some(subtask)) => {
                let further = sharded.take(subtask, finished);
                (further, sharded.finish(*job))
            }
            (State::Whole, None) => (Vec::new(), whole(finished)),
            _ => (Vec::new(), None), // answered before
        };
        if let Some(result) = result {
            self.evaluations[index] = State::Done(Box::new(result));
            self.done += 1;
        }
        self.number(index, further)
    }

    /// How many evaluations are done.
    pub fn done(&self) -> usize {
        self.done
    }

    /// The results in the order of the evaluations, of those that are done.
    pub fn finish(self) -> Vec<Finished<EvaluationResult>> {
        let result = |state| match state {
            State::Done(finished) => Some(*finished),
            State::Whole | State::Sharded(..) => None,
        };
        self.evaluations.into_iter().filter_map(result).collect()
    }

    fn number(&mut self, evaluation: usize, tasks: Vec<(Subtask, Task)>) -> Vec<Task> {
        self.tasks.extend(tasks.iter().map(|(subtask, _)| (evaluation, Some(*subtask))));
        tasks.into_iter().map(|(_, task)| task).collect()
    }
}

fn whole(finished: Finished) -> Option<Finished<EvaluationResult>> {
    finished.of_kind(|result| match result {
        TaskResult::Evaluation(result) => Some(result),
        _ => None, // `Task::check` lets none pass
    })
}
