//! What the results of subtasks make of the result of the whole, beside its value: who worked on it, how long, and what
//! it rests on.

use std::collections::BTreeMap;
use std::time::Duration;

use proto::journal::Assurance;
use proto::{JobId, Principal, WorkerId};

use crate::scheduler::messages::Finished;

/// What is known of the subtasks that are finished.
#[derive(Default)]
pub struct Combined {
    /// Who reported, with labels.
    workers: BTreeMap<WorkerId, String>,
    attempt: u32,
    queued: Option<Duration>,
    run_seconds: f64,
    /// The least of what it rests on, with the principal that gave that.
    assurance: Option<(Assurance, Principal)>,
}

impl Combined {
    /// Takes in a subtask that is finished, and returns its result.
    pub fn take<R>(&mut self, finished: Finished<R>) -> R {
        self.attempt = self.attempt.max(finished.attempt);
        self.queued.get_or_insert(finished.queued);
        self.run_seconds += finished.run_seconds;
        let assurance = (finished.assurance, finished.principal);
        self.assurance = Some(self.assurance.map_or(assurance, |least| least.min(assurance)));
        self.workers.insert(finished.worker_id, finished.worker);
        finished.result
    }

    /// The result of the whole, under the name of its job; `None` if no subtask is finished.
    pub fn finish<R>(self, job: JobId, result: R) -> Option<Finished<R>> {
        let count = self.workers.len();
        let (worker_id, label) = self.workers.into_iter().next()?;
        let (assurance, principal) = self.assurance?;
        Some(Finished {
            job,
            result,
            worker_id,
            worker: if count == 1 { label } else { format!("{count} workers") },
            attempt: self.attempt,
            queued: self.queued.unwrap_or_default(),
            run_seconds: self.run_seconds,
            principal,
            seconded: None,
            assurance,
        })
    }
}
