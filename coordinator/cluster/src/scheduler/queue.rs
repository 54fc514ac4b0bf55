//! What is matched next: waiting jobs, jobs due for a hedge, workers whose poll found nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use proto::{JobId, WorkerId};

use super::fair_queue::{ClientId, FairQueue, QueuePosition};

/// Jobs that are looked at to be hedged, and workers that are woken for them at once.
const MAX_HEDGES_AT_ONCE: usize = 16;

/// Jobs and workers in the order in which they are matched.
#[derive(Debug, Default)]
pub(super) struct Queue {
    /// Jobs that need more results than they have leases, by position.
    waiting: BTreeMap<QueuePosition, JobId>,
    /// How many of them are only foreseen.
    foreseen: usize,
    fair_queue: FairQueue,
    /// Jobs that need the one result of the one lease they have, by when a second worker may take them.
    covered: BTreeSet<(Instant, JobId)>,
    /// Workers that polled in vain, those without a lease first.
    idle_polls: BTreeSet<(bool, WorkerId)>,
    /// Workers that were woken and have not asked yet.
    woken: BTreeSet<WorkerId>,
}

impl Queue {
    /// How many jobs wait.
    pub(super) fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// How many jobs wait that somebody waits for.
    pub(super) fn count_waited_for(&self) -> usize {
        self.waiting.len() - self.foreseen
    }

    /// The jobs that wait and that somebody waits for, in order.
    pub(super) fn waited_for(&self) -> impl Iterator<Item = JobId> {
        self.waiting.values().take(self.count_waited_for()).copied()
    }

    /// The jobs that wait and that are only foreseen, in order.
    pub(super) fn foreseen(&self) -> impl Iterator<Item = JobId> {
        self.waiting.values().rev().take(self.foreseen).rev().copied()
    }

    /// The position of a client's next job.
    pub(super) fn position(&mut self, client: ClientId) -> QueuePosition {
        self.fair_queue.position(client)
    }

    /// Notes that the job at this position is handed out.
    pub(super) fn serve(&mut self, position: QueuePosition) {
        self.fair_queue.serve(position);
    }

    pub(super) fn forget_client(&mut self, client: ClientId) {
        self.fair_queue.forget(client);
    }

    /// As if the client had asked for nothing yet.
    pub(super) fn restart_client(&mut self, client: ClientId) {
        self.fair_queue.restart(client);
    }

    pub(super) fn weight(&self, client: ClientId) -> u32 {
        self.fair_queue.weight(client)
    }

    pub(super) fn set_weight(&mut self, client: ClientId, weight: u32) {
        self.fair_queue.set_weight(client, weight);
    }

    pub(super) fn set_waiting(&mut self, position: QueuePosition, job: JobId, waits: bool) {
        let waited = if waits { self.waiting.insert(position, job) } else { self.waiting.remove(&position) };
        if position.is_foreseen() {
            self.foreseen = self.foreseen + usize::from(waits) - usize::from(waited.is_some());
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

    /// Some jobs that a second worker may take, those that have been due for longest.
    pub(super) fn overdue(&self, now: Instant) -> impl Iterator<Item = JobId> {
        let due = self.covered.iter().take_while(move |(due, _)| *due <= now);
        due.map(|(_, job)| *job).take(MAX_HEDGES_AT_ONCE)
    }

    /// Notes whether a worker, busy or idle, polled in vain.
    pub(super) fn set_idle_poll(&mut self, id: WorkerId, busy: Option<bool>) {
        self.forget_worker(id);
        if let Some(busy) = busy {
            self.idle_polls.insert((busy, id));
        }
    }

    /// A worker that may have polled in vain while it was busy has nothing more to do.
    pub(super) fn comes_free(&mut self, id: WorkerId) {
        if self.idle_polls.remove(&(true, id)) {
            self.idle_polls.insert((false, id));
        }
    }

    pub(super) fn idle_polls(&self) -> impl Iterator<Item = (bool, WorkerId)> {
        self.idle_polls.iter().copied()
    }

    /// How many more polls to wake: one a job, less those that were woken and have not asked yet.
    pub(super) fn wakeups(&self, now: Instant) -> usize {
        let jobs = self.waiting.len() + self.overdue(now).count();
        jobs.saturating_sub(self.woken.len())
    }

    pub(super) fn note_wakeup(&mut self, id: WorkerId) {
        self.forget_worker(id);
        self.woken.insert(id);
    }

    /// A wakeup may be lost, because the poll was given up meanwhile: others may be woken instead.
    pub(super) fn forget_wakeups(&mut self) {
        self.woken.clear();
    }

    pub(super) fn forget_worker(&mut self, id: WorkerId) {
        self.idle_polls.remove(&(false, id));
        self.idle_polls.remove(&(true, id));
        self.woken.remove(&id);
    }
}
