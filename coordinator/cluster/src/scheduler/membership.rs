//! Workers that come and go: registration, room for another, removal.

use std::collections::BTreeMap;
use std::time::Instant;

use proto::task::{Failure, FailureReason};
use proto::{Introduction, Principal, WorkerId};

use super::Scheduler;
use super::messages::{RegisterRefusal, WorkerFailure};
use super::worker::{Worker, WorkerIdentity};
use crate::events::{AttemptEnd, Departure, EventKind};
use crate::store::FailedAttempt;

impl Scheduler {
    /// Registers a worker, or one that comes back, and returns its unique label. The caller knows that the id is its own; by
    /// another credential it is another worker.
    pub fn register(
        &mut self,
        id: WorkerId,
        introduction: Introduction,
        now: Instant,
    ) -> Result<String, RegisterRefusal> {
        let registered = self.try_register(id, introduction, now);
        if let Err(refusal) = registered {
            *self.counters.refused.entry(refusal.as_str()).or_default() += 1;
        }
        registered
    }

    fn try_register(
        &mut self,
        id: WorkerId,
        introduction: Introduction,
        now: Instant,
    ) -> Result<String, RegisterRefusal> {
        let principal = introduction.principal;
        if self.run_ended {
            return Err(RegisterRefusal::RunEnded);
        }
        if self.denied.contains(&id) {
            return Err(RegisterRefusal::Denied);
        }
        match self.workers.get_mut(&id) {
            Some(worker) if worker.principal == principal => {
                worker.last_seen = now;
                return Ok(self.label(id));
            }
            Some(_) => self.remove_worker(id, Departure::Left, now),
            None => {}
        }
        if self.quarantined.contains(&principal) {
            return Err(RegisterRefusal::Quarantined);
        }
        if self.workers.len() >= self.limits.max_workers {
            self.make_room(principal, now).ok_or(RegisterRefusal::Full)?;
        }
        let (name, used) = (&introduction.name, &mut self.used_labels);
        let acquaintance = self.identities.entry(id).or_insert_with(|| WorkerIdentity::new(name, used));
        let label = acquaintance.label.clone();
        self.add_worker(id, &introduction, now);
        self.emit(now, EventKind::Joined { worker: id, label: label.clone(), introduction });
        Ok(label)
    }

    pub(super) fn add_worker(&mut self, id: WorkerId, introduction: &Introduction, now: Instant) {
        self.workers.insert(id, Worker::new(introduction, now));
        self.idle += 1;
        self.alone_since = None;
        self.join_present(introduction.principal);
    }

    /// One more worker of a principal is here and may be given jobs.
    pub(super) fn join_present(&mut self, principal: Principal) {
        let present = self.present.entry(principal).or_default();
        *present += 1;
        if *present == 1 {
            self.refile_all(); // it may be the one that jobs have waited for
        } else {
            self.refile_failing();
        }
    }

    /// One worker of a principal less.
    pub(super) fn leave_present(&mut self, principal: Principal) {
        let Some(present) = self.present.get_mut(&principal) else { return };
        *present -= 1;
        if *present == 0 {
            self.present.remove(&principal);
            self.refile_all(); // what waits for another principal may wait in vain now
        } else {
            self.refile_failing();
        }
    }

    /// How many workers of a principal are here says for how long it is asked for a second answer.
    fn refile_failing(&mut self) {
        for id in self.failing.iter().copied().collect::<Vec<_>>() {
            self.refile(id);
        }
    }

    /// Gives up hope of workers that ask for nothing, as one does that is still busy with what was taken from it. Whoever is
    /// there asks at least once a lease.
    pub(super) fn pass_over_passive(&mut self, now: Instant) {
        let patience = self.limits.job.max(2 * self.limits.lease);
        let passive = self
            .workers
            .values_mut()
            .filter_map(|worker| worker.becomes_passive(patience, now).then_some(worker.principal));
        let passive: Vec<Principal> = passive.collect();
        for &principal in &passive {
            self.leave_present(principal);
        }
        if !passive.is_empty() {
            if self.present.is_empty() {
                self.include_all(); // an excluded one is better than none
            }
            self.settle_for_want_of_others(now);
        }
    }

    /// Makes room for a worker of this principal: one that has neither a job nor an answer to show and has been silent for
    /// longest goes, of the principal that holds most places. Whoever registers without end displaces its own.
    fn make_room(&mut self, principal: Principal, now: Instant) -> Option<()> {
        // Those that get no jobs for a while have places, too.
        let mut places: BTreeMap<Principal, usize> = BTreeMap::new();
        self.workers.values().for_each(|worker| *places.entry(worker.principal).or_default() += 1);
        let own = places.get(&principal).copied().unwrap_or(0);
        let (&first, &most) = places.iter().max_by_key(|(_, count)| **count)?;
        let from = match most {
            _ if own == most => principal,
            _ if most > own + 1 => first,
            _ => return None,
        };
        let has_answered = |id: &WorkerId| self.identities.get(id).is_some_and(|known| known.answers > 0);
        let theirs = self.workers.iter().filter(|(_, worker)| worker.principal == from);
        let useless = theirs.filter(|(id, worker)| worker.is_idle() && !has_answered(id));
        let (_, id) = useless.map(|(id, worker)| (worker.last_seen, *id)).min()?;
        self.remove_worker(id, Departure::Displaced, now);
        Some(())
    }

    /// Nothing more will be asked: every worker is told so when it polls or registers, and that it leaves is no event.
    pub fn end_run(&mut self) {
        self.run_ended = true;
    }

    /// Whether workers are told that the run has ended.
    pub fn has_ended(&self) -> bool {
        self.run_ended
    }

    /// When a worker of another process was last heard from that has not left.
    pub fn last_sign_of_life(&self) -> Option<Instant> {
        let remote = self.workers.values().filter(|worker| worker.principal != Principal::Coordinator);
        remote.map(|worker| worker.last_seen).max()
    }

    /// Ends the quarantine of a principal, on somebody's word: it is a newcomer. `false` if it is not quarantined.
    pub fn readmit(&mut self, principal: Principal, now: Instant) -> bool {
        let was_quarantined = self.quarantined.remove(&principal);
        if was_quarantined {
            self.trust.forget(principal);
            self.emit(now, EventKind::Readmitted { principal: principal.to_string() });
        }
        was_quarantined
    }

    /// Makes a principal a newcomer, whose next answers are all audited: what it goes on with may be wrong, by another's fault.
    pub fn suspect(&mut self, principal: Principal) {
        self.trust.forget(principal);
    }

    /// Removes a worker that is not let in any more: its leases are free at once.
    pub fn deny(&mut self, id: WorkerId, now: Instant) {
        self.remove_worker(id, Departure::Denied, now);
    }

    /// The one place where a worker goes, whoever noticed: its leases go back to the queue, and losing the last
    /// worker starts the grace.
    pub(super) fn remove_worker(&mut self, id: WorkerId, why: Departure, now: Instant) {
        let Some(worker) = self.workers.get(&id) else { return };
        let (label, leases, principal) = (self.label(id), worker.leases().to_vec(), worker.principal);
        for &(job, _) in &leases {
            self.release(job, id, AttemptEnd::Gone(why), now);
            if why == Departure::Lost {
                let failure = Failure::new(FailureReason::Lost, why.reason());
                let failure = WorkerFailure { worker: label.clone(), failure };
                self.count_loss(job, FailedAttempt { worker: id, principal, failure });
            }
        }
        self.described.remove_worker(id);
        if let Some(worker) = self.workers.remove(&id) {
            self.idle -= usize::from(worker.is_free());
            if worker.is_available() {
                self.leave_present(principal);
            }
        }
        self.queue.forget_worker(id);
        if self.present.is_empty() {
            self.include_all();
        }
        if self.workers.is_empty() {
            self.alone_since = Some(now);
        }
        self.note_departure(id, why, leases.len(), now);
        if self.identities.get(&id).is_some_and(|known| known.answers == 0) {
            // It is in no result: strangers that come and go must not fill the memory with their names.
            self.identities.remove(&id);
            self.used_labels.remove(&label);
        }
        self.settle_for_want_of_others(now);
    }

    pub(super) fn note_departure(&mut self, id: WorkerId, why: Departure, leases: usize, now: Instant) {
        if self.run_ended {
            return;
        }
        let answers = self.identities.get(&id).map_or(0, |known| known.answers);
        let label = self.label(id);
        self.emit(now, EventKind::Departed { worker: id, label, departure: why, leases, answers });
    }
}
