//! What a cluster decides under its one lock: who gets which job, what the journal keeps of it, and who is woken.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Instant, SystemTime};

use proto::journal::{Assurance, Member};
use proto::task::{DescriptorBytes, Evaluation, Scale, Task};
use proto::{Introduction, JobId, Lease, Principal, WorkerId};
use tokio::sync::Notify;

use super::clients::Clients;
use super::{ClusterError, ClusterNews};
use crate::events::{Event, EventKind, EventLog};
use crate::journal::{Entry, Journal, LogSequence};
use crate::scheduler::{
    Answer, Caller, ClientId, Confirmed, Doubt, Emitted, Finished, Poll, PollRefusal, RegisterRefusal,
    Scheduler,
};
use crate::sharding::{Load, Planner, ShardPlan, Waiting};
use crate::store::Checked;

pub(super) struct ClusterState {
    /// Workers, and the store of jobs.
    pub(super) scheduler: Scheduler,
    pub(super) clients: Clients,
    pub(super) planner: Planner,
    /// Without one, as for a single evaluation, nothing is kept.
    journal: Option<Arc<Journal>>,
    events: Arc<EventLog>,
    /// The entry of the journal with which the last retraction is on the disk.
    retracted: Option<LogSequence>,
    /// What wakes the poll of each worker that is held back.
    wakeups: BTreeMap<WorkerId, Arc<Notify>>,
    /// Both clocks, read at one moment: decisions use one, events the other.
    started: (Instant, SystemTime),
}

impl ClusterState {
    pub(super) fn new(
        scheduler: Scheduler,
        journal: Option<Arc<Journal>>,
        events: Arc<EventLog>,
        started: (Instant, SystemTime),
    ) -> Self {
        Self {
            scheduler,
            clients: Clients::new(journal.as_deref().and_then(Journal::directory)),
            planner: Planner::default(),
            journal,
            events,
            retracted: None,
            wakeups: BTreeMap::new(),
            started,
        }
    }

    /// Hands an entry to the journal.
    fn record(&self, entry: impl FnOnce() -> Entry) -> Option<LogSequence> {
        self.journal.as_ref().map(|journal| journal.record(entry()))
    }

    fn is_durable(&self, sequence: LogSequence) -> bool {
        self.journal.as_ref().is_none_or(|journal| journal.is_durable(sequence))
    }

    /// Fails if what has outgrown memory cannot be looked up any more: accepted results, or what clients have asked for.
    pub(super) fn check_spilled(&self) -> Result<(), ClusterError> {
        let failure = self.scheduler.jobs.failure().or_else(|| self.clients.failure());
        failure.map_or(Ok(()), |failure| Err(ClusterError::Spill(failure.clone())))
    }

    pub(super) fn register(
        &mut self,
        id: WorkerId,
        introduction: Introduction,
        now: Instant,
    ) -> Result<String, RegisterRefusal> {
        let label = self.scheduler.register(id, introduction.clone(), now)?;
        self.settle(now); // the same id may have left under another credential, which must not be recorded after this
        // A worker of this process ends with it.
        if introduction.principal != Principal::Coordinator {
            self.record(|| Entry::Joined(id, Member { label: label.clone(), introduction }));
        }
        Ok(label)
    }

    /// The answer to a poll, which `wakeup` wakes if it is held back, and the leases whose reports are accepted and not on
    /// the disk yet.
    pub(super) fn poll(
        &mut self,
        caller: Caller,
        poll: Poll,
        wakeup: &Arc<Notify>,
        now: Instant,
    ) -> Result<(Answer, Vec<Lease>), PollRefusal> {
        let (id, _) = caller;
        let answer = self.scheduler.poll(caller, poll, now);
        // An older poll that is held back is out of date, and may end; unless this one is the older.
        if answer.is_ok()
            && let Some(before) = self.wakeups.insert(id, Arc::clone(wakeup))
        {
            before.notify_one();
        }
        self.settle(now);
        self.wake(now); // a failure, a goodbye or a lost reply may have put jobs back
        let mut answer = answer?;
        self.keep_leases(&answer.jobs, id);
        let withheld = self.withhold(&mut answer.acknowledged);
        Ok((answer, withheld))
    }

    /// Takes out of `acknowledged` the leases whose reports are accepted and not on the disk yet.
    pub(super) fn withhold(&mut self, acknowledged: &mut Vec<Lease>) -> Vec<Lease> {
        let journal = self.journal.as_deref();
        let is_durable = |sequence| journal.is_none_or(|journal| journal.is_durable(sequence));
        self.scheduler.jobs.withhold(acknowledged, is_durable)
    }

    /// See [`Scheduler::lease_later`].
    pub(super) fn lease_later(
        &mut self,
        caller: Caller,
        sequence: u64,
        wanted: usize,
        now: Instant,
    ) -> Result<Vec<(Lease, Arc<Task>)>, PollRefusal> {
        let jobs = self.scheduler.lease_later(caller, sequence, wanted, now)?;
        self.keep_leases(&jobs, caller.0);
        self.wake(now); // now that this one is busy, others may take a job ahead
        Ok(jobs)
    }

    /// See [`Scheduler::readmit`].
    pub(super) fn readmit(&mut self, principal: Principal, now: Instant) -> bool {
        let was_quarantined = self.scheduler.readmit(principal, now);
        if was_quarantined {
            self.record(|| Entry::Readmitted(principal));
            self.settle(now);
        }
        was_quarantined
    }

    /// See [`Scheduler::quarantine`].
    pub(super) fn quarantine(&mut self, principal: Principal, now: Instant) {
        self.scheduler.quarantine(principal, None, now);
        self.settle(now);
        self.wake(now); // its jobs are free, and what it has answered is asked again
    }

    /// See [`Scheduler::deny`].
    pub(super) fn deny(&mut self, id: WorkerId, now: Instant) {
        self.scheduler.deny(id, now);
        self.settle(now);
        self.wake(now);
    }

    /// Submits a task for a client, unless its result is there or another client waits for it. Returns its job.
    pub(super) fn ask(&mut self, client: ClientId, task: Arc<Task>, now: Instant) -> JobId {
        let job = self.clients.name(client, &task);
        let jobs = &mut self.scheduler.jobs;
        jobs.ask(job);
        if let Some(finished) = jobs.recall(job, &task) {
            if finished.assurance == Assurance::Owed {
                self.scheduler.audit(&task, &finished, client, now); // an earlier start could not
            }
            self.scheduler.share(job, client, now); // it may be audited still, for one that only foresaw it
            self.clients.deliver_one(client, finished);
            return job;
        }
        self.clients.wait(client);
        if jobs.wait_for(job, &task, client) {
            self.scheduler.submit(job, task, client, now);
        } else {
            self.scheduler.share(job, client, now);
        }
        job
    }

    /// Decides how evaluations are sharded, if they are, and keeps that before the first shard is asked for: results of
    /// shards and tiles are of no use to any other plan. Others are `waiting`, and so many scales are about to be asked for.
    pub(super) fn plan(
        &mut self,
        client: ClientId,
        evaluations: &[Evaluation],
        (waiting, scales): (Waiting, usize),
    ) -> Vec<Option<ShardPlan>> {
        let workers = self.scheduler.worker_count();
        let load = Load { jobs: self.scheduler.open_jobs(client.foresees()) + scales, workers };
        let new = self.planner.decide(evaluations, waiting, load, &mut self.scheduler.jobs);
        self.planned(new, evaluations.iter().map(|one| Task::Evaluation(one.clone())))
    }

    /// The same for scales.
    pub(super) fn plan_scales(&mut self, scales: &[Scale]) -> Vec<Option<ShardPlan>> {
        let workers = self.scheduler.worker_count();
        let new = self.planner.decide_scales(scales, workers, &mut self.scheduler.jobs);
        self.planned(new, scales.iter().map(|one| Task::Scale(one.clone())))
    }

    /// Records plans that are new, and returns those of these tasks.
    fn planned(
        &mut self,
        new: Vec<(JobId, ShardPlan)>,
        tasks: impl Iterator<Item = Task>,
    ) -> Vec<Option<ShardPlan>> {
        for (job, plan) in new {
            self.record(|| Entry::Sharded(job, plan));
        }
        tasks.map(|task| self.scheduler.jobs.plan(task.job(0)).flatten()).collect()
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
        self.hold_checks();
        if self.is_halted() {
            self.scheduler.extend_graces(now);
        }
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

    /// The sequence number up to which the journal has to be durable before anything is delivered, if it is not.
    pub(super) fn retracted(&self) -> Option<LogSequence> {
        self.retracted.filter(|sequence| !self.is_durable(*sequence))
    }

    /// What is in doubt and this client has asked for, too, is held back no more because another is paused that has it
    /// confirmed. Looks at all open jobs.
    pub(super) fn share_held_doubts(&mut self, client: ClientId, now: Instant) {
        if self.scheduler.is_paused(client) {
            return;
        }
        let mut held = self.scheduler.held_in_doubt();
        held.retain(|job| self.clients.has_asked(client, *job));
        for &job in &held {
            self.scheduler.share(job, client, now);
        }
        if !held.is_empty() {
            self.wake(now);
        }
    }

    /// Whether accepted results are being checked that this client cannot do without. Looks at all open jobs.
    pub(super) fn is_in_doubt(&self, client: ClientId) -> bool {
        self.scheduler.jobs.is_checking()
            || self.scheduler.in_doubt(|job| self.clients.has_asked(client, job))
    }

    /// A client will submit nothing more.
    pub(super) fn leave(&mut self, client: ClientId) {
        self.clients.leave(client);
        for job in self.scheduler.forget_client(client) {
            self.scheduler.jobs.give_up(job);
        }
    }

    /// Draws the consequences of what the scheduler has decided since the last call.
    pub(super) fn settle(&mut self, now: Instant) {
        // What decides a disagreement comes after it, also in the journal.
        let (disagreements, others): (Vec<_>, Vec<_>) = self
            .scheduler
            .drain_doubts()
            .into_iter()
            .partition(|doubt| matches!(doubt, Doubt::Disagreement { .. }));
        disagreements.iter().for_each(|doubt| self.doubt(doubt, now));
        for finished in self.scheduler.drain_finished() {
            self.accept(&finished);
        }
        for confirmed in self.scheduler.drain_confirmed() {
            let job = self.scheduler.jobs.result_of(confirmed.job);
            let confirmed = Confirmed { job, ..confirmed };
            match self.scheduler.jobs.assure(&confirmed) {
                Some(finished) if confirmed.was_disputed => self.keep(&finished, finished.job),
                Some(Finished { job, assurance, seconded, .. }) => {
                    self.record(|| Entry::Assured(job, assurance, seconded));
                }
                None => {}
            }
        }
        let mut is_news = false;
        for Emitted { at, kind } in self.scheduler.drain_events() {
            if let EventKind::Departed { worker, .. } = &kind {
                self.record(|| Entry::Left(*worker));
                if let Some(wakeup) = self.wakeups.get(worker) {
                    wakeup.notify_one(); // it hears at once that it is gone
                }
            }
            is_news |= self.append(at, kind).kind.is_news();
        }
        others.iter().for_each(|doubt| self.doubt(doubt, now));
        if is_news {
            self.clients.wake_all();
        }
    }

    /// The time of day at a moment.
    pub(super) fn time_of(&self, at: Instant) -> SystemTime {
        let (started, time) = self.started;
        time + at.saturating_duration_since(started)
    }

    /// Appends an event to the log, and keeps it.
    pub(super) fn append(&mut self, at: Instant, kind: EventKind) -> Arc<Event> {
        let event = self.events.append(self.time_of(at), kind);
        if !event.omitted {
            self.record(|| Entry::Event(Arc::clone(&event)));
        }
        event
    }

    /// Accepts a result, and delivers it to the clients that wait for it.
    fn accept(&mut self, reported: &Finished) {
        if let Some(Checked { finished, corrected }) = self.scheduler.jobs.check(reported) {
            self.keep(&finished, reported.job);
            if let Some(task) = corrected {
                self.clients.correct(finished.job, &task);
            }
            self.clients.wake_all(); // they may have waited for this doubt to end
            return;
        }
        self.keep(reported, reported.job);
        if let Some((task, clients)) = self.scheduler.jobs.take_waiting(reported.job) {
            self.clients.deliver(clients, reported);
            self.scheduler.jobs.accept(&task, reported);
        }
    }

    /// Has the journal keep a result, as far as such results are kept. It was reported as one of `reported`, which may be a
    /// job that checks another.
    fn keep(&mut self, finished: &Finished, reported: JobId) {
        let (job, attempt) = (finished.job, finished.attempt);
        let Some(kept) = finished.kept() else { return };
        if let Some(sequence) = self.record(|| Entry::Accepted(job, Box::new(kept))) {
            self.scheduler.jobs.set_pending(reported, attempt, sequence);
        }
    }

    /// Has every result about this descriptor confirmed: see [`Scheduler::confirm`].
    pub(super) fn confirm(&mut self, client: ClientId, descriptor: &DescriptorBytes, now: Instant) {
        for (task, accepted) in self.scheduler.jobs.about(descriptor) {
            self.scheduler.confirm(&Arc::new(task), &accepted, client, now);
        }
        self.settle(now);
        self.wake(now);
    }

    /// Retracts what is in doubt, and tells all clients; results of a quarantined principal are computed again.
    fn doubt(&mut self, doubt: &Doubt, now: Instant) {
        match doubt {
            Doubt::Disagreement { job, .. } => self.retract(self.scheduler.jobs.result_of(*job)),
            Doubt::Quarantined(principal) => {
                self.record(|| Entry::Quarantined(*principal));
                for job in self.scheduler.jobs.drop_recorded(*principal) {
                    self.retract(job);
                }
                for recheck in self.scheduler.jobs.recheck(*principal) {
                    // Until it is checked, it is nothing to go on with.
                    self.retract(recheck.of);
                    self.scheduler.submit(recheck.job, recheck.task, ClientId::AUDITOR, now);
                }
            }
        }
        self.retracted = self.journal.as_ref().map(|journal| journal.end());
        self.clients.doubt(doubt);
    }

    /// Retracts a result: it is in doubt.
    fn retract(&self, job: JobId) {
        self.record(|| Entry::Retracted(job));
    }

    /// Retracts the descriptions that a task uses, because it failed for good and they may be the cause: the next start
    /// computes them again.
    pub(super) fn doubt_descriptions(&self, task: &Task) {
        let named = task.descriptions().collect();
        self.scheduler.jobs.describing(&named).into_iter().for_each(|job| self.retract(job));
    }

    /// Ends all leases.
    pub(super) fn close(&mut self, now: Instant) {
        self.scheduler.close(now);
        self.settle(now);
    }

    /// Ends all leases, and has workers told that nothing more will be asked; at once those whose poll is held back.
    pub(super) fn end_run(&mut self, now: Instant) {
        self.close(now);
        self.scheduler.end_run();
        self.wakeups.values().for_each(|wakeup| wakeup.notify_one());
    }

    /// Whether an event concerns a client: all do but attempts at jobs that only others have asked for.
    pub(super) fn concerns(&self, client: ClientId, event: &Event) -> bool {
        match &event.kind {
            EventKind::Attempt(attempt) => self.clients.concerns(client, attempt.job, &self.scheduler.jobs),
            _ => true,
        }
    }

    fn keep_leases(&self, jobs: &[(Lease, Arc<Task>)], holder: WorkerId) {
        for (lease, _) in jobs {
            self.record(|| Entry::Leased(lease.job, lease.attempt, holder));
        }
    }
}
