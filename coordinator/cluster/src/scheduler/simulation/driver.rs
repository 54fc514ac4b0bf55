//! What a run does with the scheduler: submits tasks, keeps the results, and asks again where a worker was wrong.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Instant;

use proto::task::{Evaluation, Task, TaskResult};
use proto::{Digest, JobId, Principal};

use super::super::{ClientId, Doubt, Scheduler};
use super::actor::truth;
use crate::events::EventKind;
use crate::job_names::JobNames;

/// Runs that share the workers.
pub const CLIENTS: u32 = 3;
/// One task of so many is foreseen before it is asked for.
const FORESEEN: u32 = 4;
/// One of so many of these never is.
const IN_VAIN: u32 = 3;
/// Of so many results one is confirmed.
const CONFIRMED: u32 = 5;

/// The run.
#[derive(Default)]
pub struct Driver {
    open: BTreeMap<JobId, u32>,
    /// Jobs that were only foreseen so far.
    foreseen: BTreeMap<JobId, ClientId>,
    /// Jobs that were foreseen in vain and have begun.
    in_vain: BTreeSet<JobId>,
    /// By task: the result and who gave it.
    answers: BTreeMap<u32, (u32, Principal)>,
    asked: BTreeSet<u32>,
    names: JobNames,
    pub quarantined: BTreeSet<Principal>,
    pub disagreements: u64,
    pub excluded: u64,
}

fn task(number: u32) -> Task {
    let split = |number: u32| vec![Digest([number as u8; 32])];
    let sample = Evaluation::sample(number, 1000, 10);
    Task::Evaluation(Evaluation { query: split(number % 2), database: split(2), ..sample })
}

impl Driver {
    /// Asks for a task that is new, or foresees it.
    pub fn submit(&mut self, scheduler: &mut Scheduler, number: u32, now: Instant) {
        let client = ClientId::new(number % CLIENTS);
        if number.is_multiple_of(FORESEEN) {
            let foresight = client.foresight(1 + number);
            let job = self.submit_for(scheduler, number, foresight, now);
            self.foreseen.insert(job, foresight);
        } else {
            self.submit_for(scheduler, number, client, now);
        }
    }

    fn submit_for(
        &mut self,
        scheduler: &mut Scheduler,
        number: u32,
        client: ClientId,
        now: Instant,
    ) -> JobId {
        let task = task(number);
        let job = self.names.next(&task);
        scheduler.submit(job, Arc::new(task), client, now);
        assert_eq!(self.open.insert(job, number), None, "one id for two jobs");
        self.asked.insert(number);
        job
    }

    /// Whether there is something to be asked for that was only foreseen so far.
    pub fn has_foreseen(&self) -> bool {
        !self.foreseen.is_empty()
    }

    /// Asks for what was only foreseen so far, but for one job in so many.
    pub fn ask_foreseen(&mut self, scheduler: &mut Scheduler, now: Instant) {
        for (job, client) in std::mem::take(&mut self.foreseen) {
            match self.open.get(&job).copied() {
                Some(number) if number.is_multiple_of(IN_VAIN * FORESEEN) => {
                    self.open.remove(&job);
                    self.asked.remove(&number);
                    if scheduler.forget_client(client) != [job] {
                        self.in_vain.insert(job);
                    }
                }
                _ => {
                    scheduler.share(job, client.owner(), now);
                    assert_eq!(scheduler.forget_client(client), []);
                }
            }
        }
    }

    /// Takes in what happened; every task that a quarantined principal answered is asked again.
    pub fn look(&mut self, scheduler: &mut Scheduler, now: Instant) {
        for finished in scheduler.drain_finished() {
            if self.in_vain.remove(&finished.job) {
                continue;
            }
            let number = self.open.remove(&finished.job).expect("an answer to no open job");
            if number.is_multiple_of(CONFIRMED) {
                let client = ClientId::new(number % CLIENTS);
                scheduler.confirm(&Arc::new(task(number)), &finished, client, now);
            }
            let TaskResult::Evaluation(result) = finished.result else { panic!("another kind of answer") };
            self.answers.insert(number, (result.object_correct, finished.principal));
        }
        for event in scheduler.drain_events() {
            match event.kind {
                EventKind::Disagreement { .. } => self.disagreements += 1,
                EventKind::Excluded { .. } => self.excluded += 1,
                _ => {}
            }
        }
        for doubt in scheduler.drain_doubts() {
            if let Doubt::Quarantined(principal) = doubt {
                self.quarantined.insert(principal);
            }
        }
        let doubtful = self.answers.iter().filter(|(_, (_, principal))| self.quarantined.contains(principal));
        for number in doubtful.map(|(number, _)| *number).collect::<Vec<_>>() {
            self.answers.remove(&number);
            self.submit_for(scheduler, number, ClientId::new(number % CLIENTS), now);
        }
    }

    pub fn is_done(&self, scheduler: &Scheduler) -> bool {
        self.open.is_empty() && !scheduler.in_doubt(|_| true)
    }

    /// How many results are still missing.
    pub fn missing(&self) -> usize {
        self.open.len()
    }

    /// That every result is there, and right.
    pub fn check(&self) {
        assert_eq!(self.answers.keys().copied().collect::<BTreeSet<_>>(), self.asked);
        for (number, (answer, principal)) in &self.answers {
            assert_eq!(*answer, truth(*number), "task {number}, as {principal} answered it");
        }
    }
}
