//! Evaluations that are asked for together, each whole or in pieces, from tasks to results.

use std::sync::Arc;

use proto::JobId;
use proto::task::{Evaluation, EvaluationResult, Task, TaskResult};

use super::cut::Cut;
use super::side::Side;
use super::under_way::{Piece, UnderWay};
use crate::scheduler::Finished;

/// An evaluation with how it is cut, if it is.
pub type Planned = (Evaluation, Option<(Cut, [Arc<Side>; 2])>);

/// Evaluations under way. Its tasks are numbered in the order in which it gives them.
pub struct Batch {
    evaluations: Vec<State>,
    /// Evaluation and piece of each task so far; `None` of a whole evaluation.
    tasks: Vec<(usize, Option<Piece>)>,
    done: usize,
}

enum State {
    Whole,
    InPieces(JobId, Box<UnderWay>),
    Done(Finished<EvaluationResult>),
}

impl Batch {
    /// Evaluations of which nothing is there yet, and the first tasks.
    pub fn new(planned: Vec<Planned>) -> (Self, Vec<Task>) {
        let mut batch = Self { evaluations: Vec::new(), tasks: Vec::new(), done: 0 };
        let mut first = Vec::new();
        for (index, (evaluation, cut)) in planned.into_iter().enumerate() {
            let whole = Task::Evaluation(evaluation.clone());
            let Some((cut, sides)) = cut else {
                batch.evaluations.push(State::Whole);
                batch.tasks.push((index, None));
                first.push(whole);
                continue;
            };
            let under_way = UnderWay::new(evaluation, cut, sides);
            first.extend(batch.number(index, under_way.begin()));
            batch.evaluations.push(State::InPieces(whole.job(0), Box::new(under_way)));
        }
        (batch, first)
    }

    /// Takes in the answer to a task, and returns what can be done by now.
    pub fn take(&mut self, task: usize, finished: Finished) -> Vec<Task> {
        let (index, piece) = self.tasks[task];
        let (further, result) = match (&mut self.evaluations[index], piece) {
            (State::InPieces(job, under_way), Some(piece)) => {
                let further = under_way.take(piece, finished);
                (further, under_way.finish(*job))
            }
            (State::Whole, None) => (Vec::new(), whole(finished)),
            _ => (Vec::new(), None), // answered before
        };
        if let Some(result) = result {
            self.evaluations[index] = State::Done(result);
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
            State::Done(finished) => Some(finished),
            State::Whole | State::InPieces(..) => None,
        };
        self.evaluations.into_iter().filter_map(result).collect()
    }

    fn number(&mut self, evaluation: usize, tasks: Vec<(Piece, Task)>) -> Vec<Task> {
        self.tasks.extend(tasks.iter().map(|(piece, _)| (evaluation, Some(*piece))));
        tasks.into_iter().map(|(_, task)| task).collect()
    }
}

fn whole(finished: Finished) -> Option<Finished<EvaluationResult>> {
    let Finished { job, result, worker, attempt, queued, run_seconds, settled } = finished;
    match result {
        TaskResult::Evaluation(result) => {
            Some(Finished { job, result, worker, attempt, queued, run_seconds, settled })
        }
        TaskResult::GridCell(_) | TaskResult::Description(_) => None, // `Task::check` lets none pass
    }
}
