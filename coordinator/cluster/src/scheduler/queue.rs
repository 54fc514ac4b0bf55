//! Who may get something next: jobs that wait, jobs that a second worker may take, workers that polled in vain.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use proto::{JobId, WorkerId};

use super::turns::{ClientId, Place, Turns};

/// Jobs that are overdue and workers that are called for them at once.
const MAX_HEDGES_AT_ONCE: usize = 16;

/// Jobs and workers in the order in which they are matched.
#[derive(Debug, Default)]
pub(super) struct Queue {
    /// Jobs that need more answers than they have leases, by place.
    waiting: BTreeMap<Place, JobId>,
    turns: Turns,
    /// Jobs that need the one answer of the one lease they have, by when a second worker may take them.
    covered: BTreeSet<(Instant, JobId)>,
    /// Workers that polled in vain, those without a lease first.
    hungry: BTreeSet<(bool, WorkerId)>,
    /// Workers that were called and have not asked yet.
    called: BTreeSet<WorkerId>,
}

impl Queue {
    /// How many jobs wait.
    pub(super) fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// The jobs that wait, in order.
    pub(super) fn in_order(&self) -> impl Iterator<Item = JobId> {
        self.waiting.values().copied()
    }

    /// The place of a client's next job.
    pub(super) fn place(&mut self, client: ClientId) -> Place {
        self.turns.place(client)
    }

    /// Notes that the job at this place is handed out.
    pub(super) fn serve(&mut self, place: Place) {
        self.turns.serve(place);
    }

    pub(super) fn forget_client(&mut self, client: ClientId) {
        self.turns.forget(client);
    }

    pub(super) fn set_waiting(&mut self, place: Place, job: JobId, waits: bool) {
        if waits {
            self.waiting.insert(place, job);
        } else {
            self.waiting.remove(&place);
        }
    }

    /// Files a job under another time from which it may be hedged.
    pub(super) fn move_covered(&mut self, job: JobId, from: Option<Instant>, to: Option<Instant>) {
        if let Some(from) = from {
            self.covered.remove(&(from, job));
        }
        if let Some(to) = to {
            self.covered.insert((to, job));
        }
    }

    /// Jobs that a second worker may take, those that have been due for longest first.
    pub(super) fn overdue(&self, now: Instant) -> impl Iterator<Item = JobId> {
        self.covered.iter().take_while(move |(due, _)| *due <= now).map(|(_, job)| *job)
    }

    /// Notes whether a worker, busy or idle, polled in vain.
    pub(super) fn set_hungry(&mut self, id: WorkerId, busy: Option<bool>) {
        self.forget_worker(id);
        if let Some(busy) = busy {
            self.hungry.insert((busy, id));
        }
    }

    /// A worker that may have polled in vain while it was busy has nothing more to do.
    pub(super) fn comes_free(&mut self, id: WorkerId) {
        if self.hungry.remove(&(true, id)) {
            self.hungry.insert((false, id));
        }
    }

    pub(super) fn hungry(&self) -> impl Iterator<Item = (bool, WorkerId)> {
        self.hungry.iter().copied()
    }

    /// How many more workers to call: one a job, less those that are on their way.
    pub(super) fn calls(&self, now: Instant) -> usize {
        let jobs = self.waiting.len() + self.overdue(now).take(MAX_HEDGES_AT_ONCE).count();
        jobs.saturating_sub(self.called.len())
    }

    pub(super) fn call(&mut self, id: WorkerId) {
        self.forget_worker(id);
        self.called.insert(id);
    }

    /// A call may not have been heard, because the poll was given up meanwhile: others may be called instead.
    pub(super) fn forget_calls(&mut self) {
        self.called.clear();
    }

    pub(super) fn forget_worker(&mut self, id: WorkerId) {
        self.hungry.remove(&(false, id));
        self.hungry.remove(&(true, id));
        self.called.remove(&id);
    }
}
