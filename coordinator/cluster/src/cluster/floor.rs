//! What a cluster decides under one lock: who gets what, what is kept of it, and what is told.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use proto::task::Task;
use proto::{JobId, Lease, WorkerId};
use results::Proceedings;
use tokio::sync::Notify;

use super::clients::Clients;
use super::{ClusterNews, TICK};
use crate::book::{Book, Checked};
use crate::chronicle::Chronicle;
use crate::journal::{Mark, Member};
use crate::ledger::Ledger;
use crate::scheduler::{
    Answer, ClientId, Departure, Event, Finished, Introduction, Poll, PollRefusal, RegisterRefusal,
    Scheduler, What,
};

/// Pieces of news beyond which no more are kept until somebody reads them: the chronicle has them all.
const MAX_UNREAD: usize = 10_000;

pub(super) struct Floor {
    pub(super) scheduler: Scheduler,
    pub(super) ledger: Ledger,
    pub(super) book: Book,
    pub(super) chronicle: Chronicle,
    pub(super) clients: Clients,
    /// News that no client has read.
    unread: Vec<Event>,
    /// Until when the last answer that was taken back is on the disk.
    struck: Option<Mark>,
    /// What wakes the poll of each worker that is held back.
    bells: BTreeMap<WorkerId, Arc<Notify>>,
    /// When silence is looked for next.
    next_look: Instant,
}

impl Floor {
    pub(super) fn new(scheduler: Scheduler, ledger: Ledger, chronicle: Chronicle) -> Self {
        Self {
            scheduler,
            ledger,
            book: Book::default(),
            chronicle,
            clients: Clients::default(),
            unread: Vec::new(),
            struck: None,
            bells: BTreeMap::new(),
            next_look: Instant::now(),
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
            self.ledger.join(id, || Member { label: label.clone(), introduction });
        }
        self.settle(now);
        Ok(label)
    }

    /// The answer to a poll, which `bell` wakes if it is held back, and the leases whose reports are accepted and not on
    /// the disk yet.
    pub(super) fn poll(
        &mut self,
        id: WorkerId,
        poll: Poll,
        bell: &Arc<Notify>,
        now: Instant,
    ) -> Result<(Answer, Vec<Lease>), PollRefusal> {
        let answer = self.scheduler.poll(id, poll, now);
        // One that was held back before is out of date, and may end; unless it is this one that is.
        if answer.is_ok()
            && let Some(before) = self.bells.insert(id, Arc::clone(bell))
        {
            before.notify_one();
        }
        self.settle(now);
        self.call(now); // a failure, a goodbye or a lost reply may have put jobs back
        let mut answer = answer?;
        self.keep_leases(&answer.jobs, id);
        let withheld = self.ledger.withhold(&mut answer.acknowledged);
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
        self.call(now); // now that this one is busy, others may take a job ahead
        Ok(jobs)
    }

    /// See [`Scheduler::deny`].
    pub(super) fn deny(&mut self, id: WorkerId, now: Instant) {
        self.scheduler.deny(id, now);
        self.settle(now);
        self.call(now);
    }

    /// Asks for a task: it is submitted, unless its answer is there or another client waits for it. Returns the name of
    /// its job.
    pub(super) fn ask(&mut self, client: ClientId, task: Arc<Task>, now: Instant) -> JobId {
        let job = self.clients.name(client, &task);
        match self.recall(job, &task) {
            Some(finished) => self.clients.tell(client, finished),
            None if self.clients.wait_for(client, job, &task) => {
                self.scheduler.submit(job, task, client, now);
            }
            None => self.scheduler.share(job, client),
        }
        job
    }

    /// The answer to a job that was asked before, by this start or an earlier one.
    fn recall(&mut self, job: JobId, task: &Arc<Task>) -> Option<Finished> {
        self.book.recall(job).or_else(|| {
            let finished = self.ledger.recall(job, task)?;
            self.book.accept(task, &finished);
            Some(finished)
        })
    }

    /// Whether this job was asked for before, by this start or an earlier one.
    pub(super) fn was_asked(&self, job: JobId) -> bool {
        self.ledger.has(job) || self.book.has(job) || self.scheduler.was_handed_out(job)
    }

    /// Wakes as many of the polls that are held back as there are jobs for them: waking all for each job would cost
    /// as much as the jobs.
    pub(super) fn call(&mut self, now: Instant) {
        for id in self.scheduler.call(now) {
            if let Some(bell) = self.bells.get(&id) {
                bell.notify_one();
            }
        }
    }

    /// Looks for silence, now and then, whoever calls.
    pub(super) fn expire(&mut self, now: Instant) {
        if now >= self.next_look {
            self.next_look = now + TICK;
            self.scheduler.expire(now);
            self.settle(now);
            self.call(now);
            let scheduler = &self.scheduler;
            self.bells.retain(|id, _| scheduler.knows(*id));
        }
    }

    /// What happened since somebody last looked, for a client that is told `finished` answers.
    pub(super) fn news(&mut self, client: ClientId, finished: usize, now: Instant) -> ClusterNews {
        ClusterNews {
            finished,
            events: std::mem::take(&mut self.unread),
            doubts: std::mem::take(&mut self.clients.account(client).doubts),
            workers: self.scheduler.worker_count(),
            staffing: self.scheduler.staffing(now),
            failed: self.scheduler.failed().cloned(),
        }
    }

    /// Until when everything that was taken back is on the disk, unless it is.
    pub(super) fn struck(&self) -> Option<Mark> {
        self.struck.filter(|mark| !self.ledger.is_durable(*mark))
    }

    /// Whether accepted answers are being checked. It looks at all jobs.
    pub(super) fn is_in_doubt(&self) -> bool {
        self.book.is_checking() || self.scheduler.in_doubt()
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
        let mut news: Vec<Event> = self.scheduler.drain_events();
        for event in &news {
            self.note(event, now);
        }
        news.retain(|event| event.what.is_news());
        if !news.is_empty() {
            news.truncate(MAX_UNREAD.saturating_sub(self.unread.len()));
            self.unread.append(&mut news);
            self.clients.ring();
        }
    }

    /// Keeps an answer and tells it to those who wait for it.
    fn accept(&mut self, finished: &Finished) {
        if let Some(Checked { finished, corrected }) = self.book.check(finished) {
            self.ledger.accept(&finished);
            if let Some(task) = corrected {
                self.clients.correct(finished.job, &task);
            }
            self.clients.ring(); // they may have waited for this doubt to end
            return;
        }
        // What is in doubt is no answer to go on with: the next start asks again.
        if finished.settled {
            self.ledger.accept(finished);
        }
        if let Some(task) = self.clients.deliver(finished) {
            self.book.accept(&task, finished);
        }
    }

    /// Notes what happened; what a quarantined worker has answered is asked again.
    fn note(&mut self, event: &Event, now: Instant) {
        if let What::Disagreement { job, .. } = &event.what {
            self.ledger.strike(*job);
        }
        if let What::Gone { worker, id, why, .. } = &event.what {
            self.ledger.leave(*id);
            if *why == Departure::Quarantined {
                self.doubt(worker, *id, now);
            }
        }
        if event.what.casts_doubt() {
            self.struck = self.ledger.end();
            self.clients.doubt(event);
        }
        self.chronicle.note(event);
        self.ledger.tell(self.chronicle.drain_unkept());
    }

    /// See [`Chronicle::note_rewind`].
    pub(super) fn note_rewind(&mut self, now: Instant, generation: u32, why: String) {
        self.chronicle.note_rewind(now, generation, why);
        self.ledger.tell(self.chronicle.drain_unkept());
    }

    fn doubt(&mut self, worker: &str, id: WorkerId, now: Instant) {
        self.ledger.distrust(worker, id);
        for recheck in self.book.doubt(worker) {
            // Until it is checked, it is no answer to go on with.
            self.ledger.strike(recheck.of);
            self.clients.note_check(recheck.job);
            self.scheduler.submit(recheck.job, recheck.task, ClientId::AUDITOR, now);
        }
    }

    /// Takes back the descriptions that a task rests on, because it failed for good, and they may be why: the next start
    /// asks for them again.
    pub(super) fn doubt_descriptions(&self, task: &Task) {
        let Task::Tile(tile) = task else { return };
        for description in tile.shards().map(Task::Description) {
            // Under each name by which it was asked for.
            let names = (0..).map(|occurrence| description.job(occurrence));
            names.take_while(|job| self.clients.was_asked(*job)).for_each(|job| self.ledger.strike(job));
        }
    }

    /// Ends all leases.
    pub(super) fn close(&mut self, now: Instant) {
        self.scheduler.close(now);
        self.settle(now);
    }

    /// What is to be told to a client of all that happened.
    pub(super) fn proceedings(&mut self, client: ClientId, now: Instant) -> Proceedings {
        self.chronicle.rows(now, |job| self.clients.concerns(client, job))
    }

    fn keep_leases(&self, jobs: &[(Lease, Arc<Task>)], holder: WorkerId) {
        for (lease, _) in jobs {
            self.ledger.lease(*lease, holder);
        }
    }
}
