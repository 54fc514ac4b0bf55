//! The answers of a run: what one that begins again, or another that shares its workers, need not ask twice; and what is
//! asked again when the worker that answered was found to be wrong.

use std::collections::BTreeMap;
use std::sync::Arc;

use proto::task::Task;
use proto::{Digest, JobId};

use crate::scheduler::Finished;

/// Accepted answers by job.
#[derive(Default)]
pub struct Book {
    answers: BTreeMap<JobId, Accepted>,
    /// Jobs that ask again, by name: which answer each of them checks.
    rechecks: BTreeMap<JobId, JobId>,
    /// How many of them there were.
    rechecked: u32,
}

/// A question that is asked again.
pub struct Recheck {
    /// The job that asks again.
    pub job: JobId,
    /// The job whose answer it checks.
    pub of: JobId,
    /// What is asked.
    pub task: Arc<Task>,
}

/// An answer to a question that was asked again.
pub struct Checked {
    /// As an answer to the job that it checks.
    pub finished: Finished,
    /// What was asked, if the answer that was accepted before was wrong.
    pub corrected: Option<Arc<Task>>,
}

struct Accepted {
    task: Arc<Task>,
    worker: String,
    fingerprint: Digest,
    /// With what is kept of the answer.
    finished: Finished,
}

impl Accepted {
    /// `None` if nothing is kept of such an answer.
    fn new(task: Arc<Task>, finished: &Finished) -> Option<Self> {
        let (fingerprint, kept) = (finished.result.fingerprint(), finished.result.kept()?);
        let finished = Finished { result: kept, ..finished.clone() };
        Some(Self { task, worker: finished.worker.clone(), fingerprint, finished })
    }
}

impl Book {
    /// Takes in an answer to a job of this task. Cells of a grid are large, and have files of their own: who writes those
    /// keeps book of them.
    pub fn accept(&mut self, task: &Arc<Task>, finished: &Finished) {
        if let Some(accepted) = Accepted::new(Arc::clone(task), finished) {
            self.answers.insert(finished.job, accepted);
        }
    }

    /// The answer to a job that was asked before.
    pub fn recall(&self, job: JobId) -> Option<Finished> {
        self.answers.get(&job).map(|accepted| accepted.finished.clone())
    }

    /// Whether the answer to this job is there.
    pub fn has(&self, job: JobId) -> bool {
        self.answers.contains_key(&job)
    }

    /// Names the jobs that ask again for everything that this worker has answered. Names of first askings count from 0,
    /// these from the other end.
    pub fn doubt(&mut self, worker: &str) -> Vec<Recheck> {
        let doubtful = self.answers.iter().filter(|(_, accepted)| accepted.worker == worker);
        let mut asked = Vec::new();
        for (&of, Accepted { task, .. }) in doubtful {
            let job = task.job(u32::MAX - self.rechecked);
            self.rechecked += 1;
            self.rechecks.insert(job, of);
            asked.push(Recheck { job, of, task: Arc::clone(task) });
        }
        asked
    }

    /// Takes in an answer if it checks another. What follows from one that was wrong has to be done again.
    pub fn check(&mut self, finished: &Finished) -> Option<Checked> {
        let of = self.rechecks.remove(&finished.job)?;
        let finished = Finished { job: of, ..finished.clone() };
        let mut corrected = None;
        if let Some(before) = self.answers.get_mut(&of)
            && let Some(after) = Accepted::new(Arc::clone(&before.task), &finished)
        {
            corrected = (after.fingerprint != before.fingerprint).then(|| Arc::clone(&after.task));
            *before = after;
        }
        Some(Checked { finished, corrected })
    }

    /// Whether answers are still being checked.
    pub fn is_checking(&self) -> bool {
        !self.rechecks.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use proto::task::{Evaluation, EvaluationResult, TaskResult};

    fn task(number: u32) -> Arc<Task> {
        Arc::new(Task::Evaluation(Evaluation::sample(number, 10, 10)))
    }

    fn finished(job: JobId, worker: &str, correct: u32) -> Finished {
        let result = EvaluationResult {
            queries: 10,
            object_correct: correct,
            category_correct: correct,
            matches: vec![],
        };
        Finished {
            job,
            result: TaskResult::Evaluation(result),
            worker: worker.to_owned(),
            attempt: 1,
            queued: Duration::ZERO,
            run_seconds: 1.0,
            settled: true,
        }
    }

    #[test]
    fn what_a_doubtful_worker_answered_is_asked_again_and_a_changed_answer_replaces_it() {
        let mut book = Book::default();
        for (bins, worker) in [(8, "good"), (9, "bad"), (10, "bad")] {
            book.accept(&task(bins), &finished(task(bins).job(0), worker, 5));
        }
        assert!(book.recall(task(11).job(0)).is_none(), "nobody has asked that");
        let asked = book.doubt("bad");
        assert!(book.is_checking());
        for Recheck { job, of, task: asked } in &asked {
            let correct = if *asked == task(9) { 5 } else { 6 };
            let checked = book.check(&finished(*job, "good", correct)).unwrap();
            assert_eq!(checked.finished.job, *of);
            assert_eq!(checked.corrected, (correct == 6).then(|| task(10)));
        }
        assert!(!book.is_checking());
        assert!(book.check(&finished(asked[0].job, "good", 5)).is_none(), "an answer checks once");
        assert!(book.doubt("bad").is_empty(), "each answer is another's by now");
        assert_eq!(book.recall(task(10).job(0)), Some(finished(task(10).job(0), "good", 6)));
    }
}
