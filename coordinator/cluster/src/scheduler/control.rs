//! What an operator orders while a run goes on: clients that are paused or go first, workers that are drained or denied.

use std::time::Instant;

use proto::{JobId, Principal, WorkerId};

use super::Scheduler;
use super::fair_queue::{ClientId, QueuePosition};
use crate::events::Departure;
use crate::store::Job;

/// The most that one client can get of the workers for each that another gets.
pub const MAX_PRIORITY: u32 = 100;

/// What draining a worker leaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Drained {
    /// Jobs that the worker has in hand, and ends.
    pub leases: usize,
    /// Workers that may still be given jobs.
    pub others: usize,
}

impl Scheduler {
    /// Hands out no more jobs of a client, unless another that is not paused asks for them, too; `false` if it is so
    /// already. Jobs in hand end, and are accepted.
    pub fn pause(&mut self, client: ClientId) -> bool {
        let is_new = self.paused.insert(client);
        if is_new {
            self.refile_all();
        }
        is_new
    }

    /// Hands out jobs of a client again; `false` if it was not paused. It has saved up no turns meanwhile.
    pub fn resume(&mut self, client: ClientId) -> bool {
        let was_paused = self.paused.remove(&client);
        if was_paused {
            self.reposition(client);
            self.refile_all();
        }
        was_paused
    }

    /// Whether jobs of this client are not handed out, nor what is foreseen for it.
    pub fn is_paused(&self, client: ClientId) -> bool {
        self.paused.contains(&client.owner())
    }

    /// Whether any client is paused; who checks for all of them does not count.
    pub fn has_paused(&self) -> bool {
        self.paused.iter().any(|client| *client != ClientId::AUDITOR)
    }

    /// Whether everybody who asks for a job is paused.
    pub(super) fn is_held(&self, job: &Job) -> bool {
        !self.paused.is_empty() && job.clients.iter().all(|client| self.is_paused(*client))
    }

    /// The weight of a client among those that compete for workers.
    pub fn priority(&self, client: ClientId) -> u32 {
        self.queue.weight(client)
    }

    /// Sets that weight, for jobs that wait as well as for those to come.
    pub fn set_priority(&mut self, client: ClientId, priority: u32) {
        self.queue.set_weight(client, priority);
        self.reposition(client);
    }

    /// Has the jobs stand in line that wait for nobody but this client, as if it asked for them now, in their order.
    fn reposition(&mut self, client: ClientId) {
        self.queue.restart_client(client);
        let its_own = |job: &Job| job.clients.iter().all(|other| other.owner() == client);
        let waits = |job: &Job| its_own(job) && self.wanted(job) > job.leases.len();
        let waiting = self.jobs.iter().filter(|(_, job)| waits(job));
        let mut waiting: Vec<(QueuePosition, JobId)> = waiting.map(|(id, job)| (job.position, id)).collect();
        waiting.sort_unstable();
        for (before, id) in waiting {
            self.queue.set_waiting(before, id, false);
            if let Some(job) = self.jobs.get_mut(id)
                && let Some(first) = job.clients.first()
            {
                job.position = self.queue.position(*first);
            }
            self.refile(id);
        }
    }

    /// Leaves the time since the last look out of all graces: nothing was to be handed out.
    pub fn extend_graces(&mut self, now: Instant) {
        let Some(last) = self.last_look else { return };
        let pause = now.saturating_duration_since(last);
        for since in [&mut self.alone_since, &mut self.undecided_since].into_iter().flatten() {
            *since = (*since + pause).min(now);
        }
    }

    /// The worker of this label that is here, and who answers for it.
    pub fn worker_labelled(&self, label: &str) -> Option<(WorkerId, Principal)> {
        let is_it = |id: &WorkerId| self.identities.get(id).is_some_and(|known| known.label == label);
        self.workers.iter().find(|(id, _)| is_it(id)).map(|(id, worker)| (*id, worker.principal))
    }

    /// Labels of the workers that are here, sorted.
    pub fn labels(&self) -> Vec<String> {
        let mut labels: Vec<String> = self.workers.keys().map(|id| self.label(*id)).collect();
        labels.sort_unstable();
        labels
    }

    /// Gives a worker no more jobs; it ends those it has, and stays. `None` if it is not here or is drained already.
    pub fn drain(&mut self, id: WorkerId, now: Instant) -> Option<Drained> {
        let worker = self.workers.get_mut(&id).filter(|worker| !worker.draining)?;
        let (was_available, leases, principal) =
            (worker.is_available(), worker.leases().len(), worker.principal);
        self.idle -= usize::from(worker.is_free());
        worker.draining = true;
        if was_available {
            self.leave_present(principal);
        }
        if self.present.is_empty() {
            self.include_all();
        }
        self.settle_for_want_of_others(now);
        Some(Drained { leases, others: self.present.values().sum() })
    }

    /// Gives a worker jobs again; `false` if it is not here or was not drained.
    pub fn end_drain(&mut self, id: WorkerId) -> bool {
        let Some(worker) = self.workers.get_mut(&id).filter(|worker| worker.draining) else { return false };
        worker.draining = false;
        self.idle += usize::from(worker.is_free());
        let (is_available, principal) = (worker.is_available(), worker.principal);
        if is_available {
            self.join_present(principal);
        }
        true
    }

    /// Removes a worker, and lets it in no more as long as this coordinator runs.
    pub fn ban(&mut self, id: WorkerId, now: Instant) {
        self.denied.insert(id);
        self.remove_worker(id, Departure::Denied, now);
    }
}
