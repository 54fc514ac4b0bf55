//! What a run does with the scheduler: submits tasks, keeps the answers, and asks again where a worker was wrong.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Instant;

use proto::JobId;
use proto::task::{Evaluation, Task, TaskResult};

use super::super::{ClientId, Departure, Scheduler, What};
use super::actor::truth;
use crate::job_names::JobNames;

/// Runs that share the workers.
const CLIENTS: u32 = 3;

/// The run.
#[derive(Default)]
pub struct Driver {
    open: BTreeMap<JobId, u32>,
    /// By task: the answer and who gave it.
    answers: BTreeMap<u32, (u32, String)>,
    asked: BTreeSet<u32>,
    names: JobNames,
    pub quarantined: Vec<String>,
    pub disagreements: u64,
}

impl Driver {
    pub fn submit(&mut self, scheduler: &mut Scheduler, number: u32, now: Instant) {
        let task = Task::Evaluation(Evaluation::sample(number, 1000, 10));
        let job = self.names.next(&task);
        let client = ClientId(number % CLIENTS);
        scheduler.submit(job, Arc::new(task), client, now);
        assert_eq!(self.open.insert(job, number), None, "one id for two jobs");
        self.asked.insert(number);
    }

    /// Takes in what happened; every task that a quarantined worker answered is asked again.
    pub fn look(&mut self, scheduler: &mut Scheduler, now: Instant) {
        for finished in scheduler.drain_finished() {
            let number = self.open.remove(&finished.job).expect("an answer to no open job");
            let TaskResult::Evaluation(result) = finished.result else { panic!("another kind of answer") };
            self.answers.insert(number, (result.object_correct, finished.worker));
        }
        for event in scheduler.drain_events() {
            match event.what {
                What::Gone { worker, why: Departure::Quarantined, .. } => self.quarantined.push(worker),
                What::Disagreement { .. } => self.disagreements += 1,
                _ => {}
            }
        }
        let doubtful = self.answers.iter().filter(|(_, (_, worker))| self.quarantined.contains(worker));
        for number in doubtful.map(|(number, _)| *number).collect::<Vec<_>>() {
            self.answers.remove(&number);
            self.submit(scheduler, number, now);
        }
    }

    pub fn is_done(&self, scheduler: &Scheduler) -> bool {
        self.open.is_empty() && !scheduler.in_doubt()
    }

    /// How many answers are still missing.
    pub fn missing(&self) -> usize {
        self.open.len()
    }

    /// That every answer is there, and right.
    pub fn check(&self) {
        assert_eq!(self.answers.keys().copied().collect::<BTreeSet<_>>(), self.asked);
        for (number, (answer, worker)) in &self.answers {
            assert_eq!(*answer, truth(*number), "task {number}, as {worker} answered it");
        }
    }
}
