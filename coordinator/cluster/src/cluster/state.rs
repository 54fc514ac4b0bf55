//! What a cluster decides under one lock: who gets what, what is kept of it, and what is told.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Instant, SystemTime};

use descriptor::Descriptor;
use proto::{JobId, Lease, WorkerId};
use tokio::sync::Notify;

use super::ClusterNews;
use super::clients::Clients;
use crate::accepted::{AcceptedResults, Checked};
use crate::durability::Durability;
use crate::events::{Event, EventKind, EventLog};
use crate::journal::{LogSequence, Member};
use crate::scheduler::{
    Answer, ClientId, Doubt, Emitted, Finished, Introduction, Poll, PollRefusal, RegisterRefusal, Scheduler,
};
use crate::shard::Description;
use crate::task::Task;

pub(super) struct ClusterState {
    pub(super) scheduler: Scheduler,
    pub(super) durability: Durability,
    pub(super) accepted: AcceptedResults,
    pub(super) events: Arc<EventLog>,
    pub(super) clients: Clients,
    /// Until when the last answer that was taken back is on the disk.
    retracted: Option<LogSequence>,
    /// What wakes the poll of each worker that is held back.
    wakeups: BTreeMap<WorkerId, Arc<Notify>>,
    /// Two readings of the clocks at one moment: decisions are timed by one, events by the other.
    started: (Instant, SystemTime),
}

impl ClusterState {
    pub(super) fn new(
        scheduler: Scheduler,
        durability: Durability,
        events: Arc<EventLog>,
        started: (Instant, SystemTime),
    ) -> Self {
        Self {
            scheduler,
            durability,
            accepted: AcceptedResults::default(),
            events,
            clients: Clients::default(),
            retracted: None,
            wakeups: BTreeMap::new(),
            started,
        }
    }

    pub(super) fn register(
        &mut self,
        id: WorkerId,
        introduction: Introduction,
        in_process: bool,
        now: Instant,
    ) -> Result<String, RegisterRefusal> {
        let label = self.scheduler.register(id, introduction.clone(), now)?;
        if !in_process {
            self.durability.join(id, || Member { label: label.clone(), introduction });
        }
        self.settle(now);
        Ok(label)
    }

    /// The answer to a poll, which `wakeup` wakes if it is held back, and the leases whose reports are accepted and not on
    /// the disk yet.
    pub(super) fn poll(
        &mut self,
        id: WorkerId,
        poll: Poll,
        wakeup: &Arc<Notify>,
        now: Instant,
    ) -> Result<(Answer, Vec<Lease>), PollRefusal> {
        let answer = self.scheduler.poll(id, poll, now);
        // One that was held back before is out of date, and may end; unless it is this one that is.
        if answer.is_ok()
            && let Some(before) = self.wakeups.insert(id, Arc::clone(wakeup))
        {
            before.notify_one();
        }
        self.settle(now);
        self.wake(now); // a failure, a goodbye or a lost reply may have put jobs back
        let mut answer = answer?;
        self.keep_leases(&answer.jobs, id);
        let withheld = self.durability.withhold(&mut answer.acknowledged);
        Ok((answer, withheld))
    }

    /// See [`Scheduler::lease_later`].
    pub(super) fn lease_later(
        &mut self,
        id: WorkerId,
        sequence: u64,
        wanted: usize,
        now: Instant,
    ) -> Result<Vec<(Lease, Arc<Task>)>, PollRefusal> {
        let jobs = self.scheduler.lease_later(id, sequence, wanted, now)?;
        self.keep_leases(&jobs, id);
        self.wake(now); // now that this one is busy, others may take a job ahead
        Ok(jobs)
    }

    /// See [`Scheduler::deny`].
    pub(super) fn deny(&mut self, id: WorkerId, now: Instant) {
        self.scheduler.deny(id, now);
        self.settle(now);
        self.wake(now);
    }

    /// Asks for a task: it is submitted, unless its answer is there or another client waits for it. Returns the name of
    /// its job.
    pub(super) fn ask(&mut self, client: ClientId, task: Arc<Task>, now: Instant) -> JobId {
        let job = self.clients.name(client, &task);
        match self.recall(job, &task) {
            Some(finished) => self.clients.deliver_one(client, finished),
            None if self.clients.wait_for(client, job, &task) => {
                self.scheduler.submit(job, task, client, now);
            }
            None => self.scheduler.share(job, client),
        }
        job
    }

    /// The answer to a job that was asked before, by this start or an earlier one.
    fn recall(&mut self, job: JobId, task: &Arc<Task>) -> Option<Finished> {
        self.accepted.recall(job).or_else(|| {
            let finished = self.durability.recall(job, task)?;
            self.accepted.accept(task, &finished);
            Some(finished)
        })
    }

    /// Whether this job was asked for before, by this start or an earlier one.
    pub(super) fn was_asked(&self, job: JobId) -> bool {
        self.durability.has(job) || self.accepted.has(job) || self.scheduler.was_handed_out(job)
    }

    /// Wakes as many of the polls that are held back as there are jobs for them: waking all for each job would cost
    /// as much as the jobs.
    pub(super) fn wake(&mut self, now: Instant) {
        for id in self.scheduler.wake(now) {
            if let Some(wakeup) = self.wakeups.get(&id) {
                wakeup.notify_one();
            }
        }
    }

    /// One tick of the clock: removes silent workers, and wakes all clients, for whom a grace may be over.
    pub(super) fn expire(&mut self, now: Instant) {
        self.scheduler.expire(now);
        self.settle(now);
        self.wake(now);
        let scheduler = &self.scheduler;
        self.wakeups.retain(|id, _| scheduler.knows(*id));
        self.clients.wake_all();
    }

    /// What happened since a client last looked, with `finished` results for it.
    pub(super) fn news(&mut self, client: ClientId, finished: usize, now: Instant) -> ClusterNews {
        ClusterNews {
            finished,
            doubts: std::mem::take(&mut self.clients.account(client).doubts),
            workers: self.scheduler.worker_count(),
            staffing: self.scheduler.staffing(now),
            failed: self.scheduler.failed().cloned(),
        }
    }

    /// Until when everything that was taken back is on the disk, unless it is.
    pub(super) fn retracted(&self) -> Option<LogSequence> {
        self.retracted.filter(|sequence| !self.durability.is_durable(*sequence))
    }

    /// Whether accepted answers are being checked. It looks at all jobs.
    pub(super) fn is_in_doubt(&self) -> bool {
        self.accepted.is_checking() || self.scheduler.in_doubt()
    }

    /// A client will ask for nothing more.
    pub(super) fn leave(&mut self, client: ClientId) {
        self.clients.leave(client);
        self.scheduler.forget_client(client);
    }

    /// Draws the consequences of what the scheduler has decided since the last call.
    fn settle(&mut self, now: Instant) {
        for finished in self.scheduler.drain_finished() {
            self.accept(&finished);
        }
        let mut is_news = false;
        for Emitted { at, kind } in self.scheduler.drain_events() {
            if let EventKind::Departed { worker, .. } = &kind {
                self.durability.leave(*worker);
            }
            is_news |= self.append(at, kind).kind.is_news();
        }
        for doubt in self.scheduler.drain_doubts() {
            self.doubt(&doubt, now);
        }
        if is_news {
            self.clients.wake_all();
        }
    }

    /// Appends an event to the log, and keeps it.
    pub(super) fn append(&mut self, at: Instant, kind: EventKind) -> Arc<Event> {
        let (started, time) = self.started;
        let event = self.events.append(time + at.saturating_duration_since(started), kind);
        if !event.omitted {
            self.durability.event(Arc::clone(&event));
        }
        event
    }

    /// Keeps an answer and tells it to those who wait for it.
    fn accept(&mut self, finished: &Finished) {
        if let Some(Checked { finished, corrected }) = self.accepted.check(finished) {
            self.durability.accept(&finished);
            if let Some(task) = corrected {
                self.clients.correct(finished.job, &task);
            }
            self.clients.wake_all(); // they may have waited for this doubt to end
            return;
        }
        // What is in doubt is no answer to go on with: the next start asks again.
        if finished.settled {
            self.durability.accept(finished);
        }
        if let Some(task) = self.clients.deliver(finished) {
            self.accepted.accept(&task, finished);
        }
    }

    /// Takes back what is in doubt, and tells all clients; what a quarantined worker has answered is asked again.
    fn doubt(&mut self, doubt: &Doubt, now: Instant) {
        match doubt {
            Doubt::Disagreement { job, .. } => self.durability.retract(*job),
            Doubt::Quarantined(id) => {
                let worker = self.scheduler.label(*id);
                self.durability.distrust(&worker, *id);
                for recheck in self.accepted.doubt(&worker) {
                    // Until it is checked, it is no answer to go on with.
                    self.durability.retract(recheck.of);
                    self.clients.note_check(recheck.job);
                    self.scheduler.submit(recheck.job, recheck.task, ClientId::AUDITOR, now);
                }
            }
        }
        self.retracted = self.durability.end();
        self.clients.doubt(doubt);
    }

    /// Takes back the descriptions that a task rests on, because it failed for good, and they may be why: the next start
    /// asks for them again.
    pub(super) fn doubt_descriptions(&self, task: &Task) {
        let Task::Tile(tile) = task else { return };
        let descriptor = Descriptor::DiskRing(tile.evaluation.parameters);
        for &manifest in tile.evaluation.query.iter().chain(&tile.evaluation.database) {
            let clouds = tile.evaluation.queries; // no part of the name
            let description = Task::Description(Description { descriptor, manifest, clouds });
            // Under each name by which it was asked for.
            let names = (0..).map(|occurrence| description.job(occurrence));
            names.take_while(|job| self.clients.was_asked(*job)).for_each(|job| self.durability.retract(job));
        }
    }

    /// Ends all leases.
    pub(super) fn close(&mut self, now: Instant) {
        self.scheduler.close(now);
        self.settle(now);
    }

    /// The events that concern a client: all but attempts at jobs that only others have asked for.
    pub(super) fn concerning(&self, client: ClientId, mut events: Vec<Arc<Event>>) -> Vec<Arc<Event>> {
        events.retain(|event| match &event.kind {
            EventKind::Attempt(attempt) => self.clients.concerns(client, attempt.job),
            _ => true,
        });
        events
    }

    fn keep_leases(&self, jobs: &[(Lease, Arc<Task>)], holder: WorkerId) {
        for (lease, _) in jobs {
            self.durability.lease(*lease, holder);
        }
    }
}
