//! The cluster as async tasks share it: the service hands polls in, clients wait for results, a clock removes silent
//! workers.
//!
//! This file is the workers' side, `client` the clients'; `state` is what they share, under one lock.

mod client;
mod clients;
mod control;
mod state;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, Weak};
use std::time::{Duration, Instant, SystemTime};

use proto::task::{DescriptorBytes, Evaluation, Scale, Task, TaskResult};
use proto::{Introduction, JobId, Lease, Message, Principal, SessionId, WorkerId};
use tokio::sync::{Notify, Semaphore, watch};
use tokio::time::MissedTickBehavior;

use crate::blobs::BlobStore;
use crate::events::{EventCursor, EventKind, EventLog};
use crate::journal::{Journal, JournalError, LogSequence, Recorded};
use crate::lock::lock;
use crate::scheduler::{
    Answer, Audit, Caller, ClientId, Doubt, Finished, JobFailed, Limits, Poll, PollRefusal, Provenance,
    Provenances, RegisterRefusal, RunSecret, Scheduler, Staffing,
};
use crate::sharding::{Batch, Layouts, ShardCount};
use crate::spill::SpillError;
pub use client::{CellAnswer, Client, DescriptionAnswer};
pub use control::ControlRefusal;
use state::ClusterState;

/// Polls with reports that may wait for a run to begin.
const EARLY_REPORTS: usize = 16;
/// Failures of one job that a message lists.
const MAX_FAILURES_SHOWN: usize = 10;
/// Workers that have not polled for a heartbeat and this long do not hear that the run has ended.
const DISMISSAL_MARGIN: Duration = Duration::from_secs(1);
/// How often silent workers are looked for.
const TICK: Duration = Duration::from_millis(500);

/// Why evaluations stopped for good.
#[derive(Debug, thiserror::Error)]
pub enum ClusterError {
    /// A job failed as often as the limit allows, or is malformed.
    #[error("{}", job_failed(.0))]
    JobFailed(JobFailed),
    /// No worker is left, and none came back.
    #[error(
        "workers: the last one was lost {seconds} s ago and none has joined since\nstart workers, then run the same command again"
    )]
    NoWorkers {
        /// Since when.
        seconds: u64,
    },
    /// Two workers differ, and there is no other principal.
    #[error(
        "workers: two gave different answers to one evaluation, and nobody has joined within {seconds} s who could decide\nstart a worker with another certificate or at another address, or --local-workers 1, then run the same command again"
    )]
    Undecided {
        /// Since when.
        seconds: u64,
    },
    /// The journal cannot be written any more.
    #[error(transparent)]
    Journal(JournalError),
    /// What has outgrown memory cannot be read any more.
    #[error(transparent)]
    Spill(SpillError),
    /// Descriptions are no longer in memory.
    #[error(
        "descriptions: they were dropped for want of memory before they were used\nrun the same command again"
    )]
    Gone,
    /// Results that had been accepted were wrong.
    #[error("{} answers of a worker that was wrong were corrected\nrun the same command again", .0.len())]
    Corrected(Vec<Arc<Task>>),
}

/// What failed, a line each: advice given to one machine is not repeated for all.
fn job_failed(failed: &JobFailed) -> String {
    let JobFailed { task, failures } = failed;
    let mut lines: Vec<String> =
        failures.iter().take(MAX_FAILURES_SHOWN).map(|failure| Message::of(failure).what).collect();
    let count = failures.len();
    if count > MAX_FAILURES_SHOWN {
        lines.push(format!("and {} more", count - MAX_FAILURES_SHOWN));
    }
    let lines = lines.join("\n  ");
    if failed.is_malformed() {
        format!(
            "{task}: malformed, got\n  {lines}\nuse workers of the coordinator's release; if they are, report this as a bug"
        )
    } else {
        format!(
            "{task}: failed {count} times, got\n  {lines}\nlook at the workers' logs; coordinator.max_failures and coordinator.job_seconds set the limits"
        )
    }
}

/// The shared state of a run: workers, jobs, blobs, events.
pub struct Cluster {
    /// Names the run to its workers.
    pub session: SessionId,
    /// What workers may fetch.
    pub blobs: BlobStore,
    limits: Limits,
    /// Everything that is decided, under the one lock.
    state: Mutex<ClusterState>,
    /// Only a cache: nothing is decided under its lock.
    layouts: Mutex<Layouts>,
    events: Arc<EventLog>,
    journal: Option<Arc<Journal>>,
    /// Earlier starts have left results.
    has_past: bool,
    /// Whether every client waits for a result, or has nothing to submit.
    begun: watch::Sender<bool>,
    /// A worker has left that was told that the run has ended.
    left: Notify,
    /// Permits for polls with reports that wait for that.
    early_reports: Semaphore,
}

impl Cluster {
    /// A cluster without workers that keeps nothing. To be called within a tokio runtime.
    pub fn new(limits: Limits) -> Arc<Self> {
        let session = SessionId(rand::random());
        let events = Arc::new(EventLog::new(Vec::new()));
        let started = (Instant::now(), SystemTime::now());
        let scheduler = Scheduler::new(limits, RunSecret::new(rand::random()), None);
        let state = ClusterState::new(scheduler, None, Arc::clone(&events), started);
        Self::with(limits, session, (None, false), state, events)
    }

    /// The cluster of a run that keeps what it accepts, and goes on where earlier starts ended. To be called within a
    /// tokio runtime.
    pub fn with_journal(
        limits: Limits,
        (session, secret): (SessionId, RunSecret),
        journal: Journal,
        mut recorded: Recorded,
    ) -> Arc<Self> {
        let journal = Arc::new(journal);
        let (mut scheduler, now) = (Scheduler::new(limits, secret, journal.directory()), Instant::now());
        if recorded.starts > 1 {
            scheduler.restore(&recorded, now);
        }
        let events = Arc::new(EventLog::new(std::mem::take(&mut recorded.events)));
        let members = std::mem::take(&mut recorded.members);
        let has_past = !recorded.accepted.is_empty();
        scheduler.jobs.restore(recorded);
        let (started, kept) = ((now, SystemTime::now()), Some(Arc::clone(&journal)));
        let mut state = ClusterState::new(scheduler, kept, Arc::clone(&events), started);
        for (worker, label) in events.present() {
            if !members.contains_key(&worker) {
                state.append(now, EventKind::Ended { worker, label });
            }
        }
        Self::with(limits, session, (Some(journal), has_past), state, events)
    }

    fn with(
        limits: Limits,
        session: SessionId,
        (journal, has_past): (Option<Arc<Journal>>, bool),
        state: ClusterState,
        events: Arc<EventLog>,
    ) -> Arc<Self> {
        let cluster = Arc::new(Self {
            session,
            blobs: BlobStore::default(),
            limits,
            state: Mutex::new(state),
            layouts: Mutex::default(),
            events,
            journal,
            has_past,
            begun: watch::Sender::new(false),
            left: Notify::new(),
            early_reports: Semaphore::new(EARLY_REPORTS),
        });
        tokio::spawn(tick(Arc::downgrade(&cluster)));
        cluster
    }

    /// A cursor at the first event of this start of the coordinator. Each observer needs one of its own.
    pub fn events(&self) -> EventCursor {
        self.events.follow()
    }

    /// Who has asked for a job, the first of several; `None` if that is nobody of those who are here.
    pub fn asker(&self, job: JobId) -> Option<ClientId> {
        self.state().clients.asker(job)
    }

    /// A new client. All clients have to be made before the first of them submits anything ([`Cluster::begun`]).
    pub fn client(self: &Arc<Self>) -> Client {
        Client::new(self, None)
    }

    /// A client that asks beforehand for what another will ask for: its tasks are for workers that have nothing else to do,
    /// and their results are kept for the other. When it is dropped, those that nobody has begun or asked for are given up.
    pub fn foresight(self: &Arc<Self>, owner: ClientId) -> Client {
        Client::new(self, Some(owner))
    }

    /// How often a busy worker has to poll: several polls may be lost before its lease ends.
    pub fn heartbeat(&self) -> Duration {
        (self.limits.lease / 6).min(Duration::from_secs(5))
    }

    /// How long a poll may be held back.
    pub fn hold(&self) -> Duration {
        (self.limits.lease / 3).min(Duration::from_secs(10))
    }

    /// How much of what others have computed is computed again.
    pub fn audit(&self) -> Audit {
        self.limits.audit
    }

    /// See [`Scheduler::register`]. A worker of this process ends with it, and is not kept.
    pub fn register(&self, id: WorkerId, introduction: Introduction) -> Result<String, RegisterRefusal> {
        self.state().register(id, introduction, Instant::now())
    }

    /// Waits until every client has submitted its first job, as long as a poll may be held back; `false` if one has not.
    /// Before that, a run that was started again has not come back to where it was: it can judge neither leases nor
    /// reports, and has not published the blobs that its workers may fetch.
    pub async fn begun(&self) -> bool {
        let mut begun = self.begun.subscribe();
        tokio::time::timeout(self.hold(), begun.wait_for(|begun| *begun)).await.is_ok()
    }

    fn begin_if_all_arrived(&self, state: &ClusterState) {
        if state.clients.have_arrived() {
            self.begun.send_if_modified(|begun| !std::mem::replace(begun, true));
        }
    }

    /// Ends the quarantine of a principal; `false` if it is not quarantined.
    pub fn readmit(&self, principal: Principal) -> bool {
        self.state().readmit(principal, Instant::now())
    }

    /// See [`Scheduler::quarantine`].
    pub fn quarantine(&self, principal: Principal) {
        self.state().quarantine(principal, Instant::now());
    }

    /// See [`Scheduler::suspect`].
    pub fn suspect(&self, principal: Principal) {
        self.state().scheduler.suspect(principal);
    }

    /// See [`Scheduler::deny`].
    pub fn deny(&self, id: WorkerId) {
        self.state().deny(id, Instant::now());
    }

    /// Answers a poll; holds the reply back while it would be empty and the worker wants jobs.
    pub async fn poll(&self, caller: Caller, poll: Poll) -> Result<Answer, PollRefusal> {
        let deadline = tokio::time::Instant::now() + self.hold();
        self.state().scheduler.heard_from(caller, Instant::now());
        // Reports that cannot be judged yet must not fill the memory: most of them come again.
        let waits = (!poll.finished.is_empty()).then(|| self.early_reports.try_acquire());
        if matches!(waits, Some(Err(_))) && !*self.begun.borrow() || !self.begun().await {
            return Ok(Answer::default());
        }
        drop(waits);
        let (sequence, wanted, leaving) = (poll.sequence, poll.wanted, poll.leaving);
        let wakeup = Arc::new(Notify::new());
        let (mut answer, withheld) = self.state().poll(caller, poll, &wakeup, Instant::now())?;
        if leaving && answer.run_ended {
            self.left.notify_one();
        }
        if leaving && !withheld.is_empty() {
            // It will not poll again.
            answer.acknowledged.extend(self.wait_for_journal(withheld, deadline).await);
        } else if answer.is_empty() && wanted > 0 && !leaving {
            return self.wait_for_jobs(caller, (sequence, wanted), withheld, &wakeup, deadline).await;
        }
        Ok(answer)
    }

    /// Waits for jobs, or until one of the reports that came with the poll can be acknowledged.
    async fn wait_for_jobs(
        &self,
        caller: Caller,
        (sequence, wanted): (u64, usize),
        mut withheld: Vec<Lease>,
        wakeup: &Notify,
        deadline: tokio::time::Instant,
    ) -> Result<Answer, PollRefusal> {
        loop {
            let (answer, sequence) = {
                let (mut state, now) = (self.state(), Instant::now());
                let jobs = state.lease_later(caller, sequence, wanted, now)?;
                let still = state.withhold(&mut withheld);
                let acknowledged = std::mem::replace(&mut withheld, still);
                let sequence = state.scheduler.jobs.last_pending(&withheld);
                let run_ended = state.scheduler.has_ended();
                (Answer { jobs, acknowledged, run_ended, ..Answer::default() }, sequence)
            };
            if !answer.is_empty() {
                return Ok(answer);
            }
            tokio::select! {
                () = wakeup.notified() => {}
                () = self.kept(sequence) => {}
                () = tokio::time::sleep_until(deadline) => return Ok(answer),
            }
        }
    }

    /// Those of these leases whose reports are on the disk before the deadline.
    async fn wait_for_journal(&self, mut leases: Vec<Lease>, deadline: tokio::time::Instant) -> Vec<Lease> {
        let sequence = self.state().scheduler.jobs.last_pending(&leases);
        if tokio::time::timeout_at(deadline, self.kept(sequence)).await.is_err() {
            return Vec::new();
        }
        self.state().withhold(&mut leases);
        leases
    }

    /// Waits until the journal is durable up to a sequence number; for ever if there is none, or the journal has failed.
    async fn kept(&self, sequence: Option<LogSequence>) {
        if let (Some(journal), Some(sequence)) = (&self.journal, sequence)
            && journal.durable(sequence).await.is_ok()
        {
            return;
        }
        std::future::pending().await
    }

    /// Waits until every result that was accepted is on the disk.
    ///
    /// # Errors
    /// If that cannot be written, or what has outgrown memory cannot be looked up any more.
    pub async fn flush(&self) -> Result<(), ClusterError> {
        if let Some(journal) = &self.journal {
            self.durable(journal.end()).await?;
        }
        self.check_spilled()
    }

    /// Fails if what has outgrown memory cannot be looked up any more.
    ///
    /// # Errors
    /// [`ClusterError::Spill`]: then no more is to be written that rests on it.
    pub fn check_spilled(&self) -> Result<(), ClusterError> {
        self.state().check_spilled()
    }

    /// Waits until the journal is durable up to a sequence number.
    async fn durable(&self, sequence: LogSequence) -> Result<(), ClusterError> {
        match &self.journal {
            Some(journal) => journal.durable(sequence).await.map_err(ClusterError::Journal),
            None => Ok(()),
        }
    }

    /// Its clients are members of a sweep, of which some may be finished.
    pub fn set_shared(&self) {
        self.state().clients.set_shared();
    }

    /// Whether earlier starts have left results.
    pub fn has_past(&self) -> bool {
        self.has_past
    }

    /// Whether this evaluation was computed by this run: an earlier start or this one has accepted its result, or has
    /// sharded it.
    pub fn recalls(&self, evaluation: Evaluation) -> bool {
        let job = Task::Evaluation(evaluation).job(0);
        let state = self.state();
        let jobs = &state.scheduler.jobs;
        jobs.has_result(job) || jobs.plan(job).flatten().is_some()
    }

    /// Sets into how many shards evaluations are divided from here on.
    pub fn set_shard_count(&self, shard_count: ShardCount) {
        self.state().planner.set_shard_count(shard_count);
    }

    /// Begins the evaluations of a batch that wait for no scale any more, whole or sharded as it is decided, and returns
    /// their first tasks. So many scales are about to be asked for.
    fn begin_ready(&self, client: ClientId, batch: &mut Batch, scales: usize) -> Vec<Task> {
        let ready = batch.take_ready();
        if ready.is_empty() {
            return Vec::new();
        }
        let (places, evaluations): (Vec<usize>, Vec<Evaluation>) = ready.into_iter().unzip();
        let plans = self.state().plan(client, &evaluations, (batch.waiting(), scales));
        let mut layouts = lock(&self.layouts);
        let planned = places.into_iter().zip(evaluations).zip(plans);
        let begin =
            |((place, evaluation), plan)| batch.begin(place, layouts.lay_out(evaluation, plan, &self.blobs));
        planned.flat_map(begin).collect()
    }

    /// Begins the scales of a batch in the same way.
    fn begin_scales(&self, batch: &mut Batch, scales: Vec<Scale>) -> Vec<Task> {
        let plans = self.state().plan_scales(&scales);
        let mut layouts = lock(&self.layouts);
        let planned = scales.into_iter().zip(plans);
        batch.begin_scales(
            planned.map(|(scale, plan)| layouts.lay_out_scale(scale, plan, &self.blobs)).collect(),
        )
    }

    /// Learns from a result how long such tasks take, and publishes a description for tiles to use.
    fn learn(&self, task: &Task, answer: &Finished) {
        self.state().planner.observe(task, answer.run_seconds);
        if let TaskResult::Description(described) = &answer.result {
            self.blobs.publish_description(described);
        }
    }

    /// Fails if evaluations failed for good, or results cannot be kept.
    fn check_failures(&self, news: &ClusterNews) -> Result<(), ClusterError> {
        if let Some(failure) = self.journal.as_ref().and_then(|journal| journal.failure()) {
            return Err(ClusterError::Journal(failure));
        }
        if let Some(failed) = &news.failed {
            self.state().doubt_descriptions(&failed.task);
            return Err(ClusterError::JobFailed(failed.clone()));
        }
        Ok(())
    }

    /// Fails if there have been too few workers for too long.
    fn check_staffing(&self, news: &ClusterNews) -> Result<(), ClusterError> {
        let seconds = self.limits.worker_grace.as_secs();
        match news.staffing {
            Staffing::GraceOver => Err(ClusterError::NoWorkers { seconds }),
            Staffing::Undecided => Err(ClusterError::Undecided { seconds }),
            Staffing::Staffed | Staffing::NotYet | Staffing::Lost(_) => Ok(()),
        }
    }

    /// Waits until a worker has joined, and, if one of the own process is to come, until that has: it decides where others
    /// differ, who may be there from an earlier start. Calls `still_waiting` each minute with the time that has passed.
    pub async fn wait_for_worker(self: &Arc<Self>, is_own_coming: bool, still_waiting: impl FnMut(Duration)) {
        self.client().wait_for_worker(is_own_coming, still_waiting).await;
    }

    /// Ends all leases, because nobody waits for them any more.
    pub fn close(&self) {
        self.state().close(Instant::now());
    }

    /// Tells the workers of other processes that the run has ended, and waits until they have left, or have been silent for
    /// longer than a worker is that is still there.
    pub async fn dismiss_workers(&self) {
        self.state().end_run(Instant::now());
        self.begun.send_replace(true); // nobody will submit anything
        let silence = self.heartbeat() + DISMISSAL_MARGIN;
        let latest = tokio::time::Instant::now() + silence;
        loop {
            let Some(last) = self.state().scheduler.last_sign_of_life() else { return };
            let until = latest.min((last + silence).into());
            if tokio::time::timeout_at(until, self.left.notified()).await.is_err() {
                return;
            }
        }
    }

    /// The provenance of everything that is known about each descriptor; without those that are nothing to go on with for
    /// others than this run. Workers are answered meanwhile.
    ///
    /// # Errors
    /// If what has outgrown memory cannot be looked up any more.
    pub async fn provenances(&self) -> Result<BTreeMap<DescriptorBytes, Arc<Provenance>>, ClusterError> {
        let mut provenances = Provenances::default();
        for number in 0.. {
            let Some((part, of_grounds)) = self.state().scheduler.provenances_of_part(number) else { break };
            for record in part.records() {
                provenances.add(&record.task().subject().descriptor, of_grounds[&record.grounds].clone());
            }
            tokio::task::yield_now().await;
        }
        self.check_spilled().map(|()| provenances.into_known())
    }

    /// The provenance of everything that is known about a descriptor; `None` if nothing is, or nothing to go on with for
    /// others than this run.
    ///
    /// # Errors
    /// If what has outgrown memory cannot be looked up any more.
    pub fn provenance_about(&self, descriptor: &DescriptorBytes) -> Result<Option<Provenance>, ClusterError> {
        let state = self.state();
        let provenance = state.scheduler.provenance_about(descriptor);
        state.check_spilled().map(|()| provenance)
    }

    /// The provenance of the result of a task that is kept; `None` also if it is nothing to go on with for others than this
    /// run.
    pub fn provenance(&self, task: &Task) -> Option<Provenance> {
        let mut state = self.state();
        let finished = state.scheduler.jobs.recall(task.job(0), task)?;
        state.scheduler.provenance(&finished)
    }

    /// See [`Scheduler::answerers`].
    ///
    /// # Errors
    /// If what has outgrown memory cannot be looked up any more: a result that was replaced may have gone unnoticed.
    pub fn answerers(&self) -> Result<BTreeSet<Principal>, ClusterError> {
        let state = self.state();
        let answerers = state.scheduler.answerers();
        state.check_spilled().map(|()| answerers)
    }

    /// See [`Scheduler::spot_checks`].
    pub fn spot_checks(&self, task: &Task) -> bool {
        self.state().scheduler.spot_checks(task.job(0))
    }

    /// Who was quarantined in this run. If anybody was, results that were not audited may be wrong.
    pub fn quarantined(&self) -> BTreeSet<Principal> {
        self.state().scheduler.quarantined().clone()
    }

    /// Whether a principal is quarantined.
    pub fn is_quarantined(&self, principal: &Principal) -> bool {
        self.state().scheduler.quarantined().contains(principal)
    }

    fn state(&self) -> MutexGuard<'_, ClusterState> {
        lock(&self.state)
    }
}

/// The clock: removes silent workers, whether anybody waits for results or not, until the cluster is dropped.
async fn tick(cluster: Weak<Cluster>) {
    let mut ticks = tokio::time::interval(TICK);
    // After a pause there is no silence to catch up with.
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        let Some(cluster) = cluster.upgrade() else { return };
        cluster.state().expire(Instant::now());
    }
}

/// What happened since the last look.
#[derive(Debug)]
pub struct ClusterNews {
    /// How many evaluations, cells or scales were finished.
    pub finished: usize,
    /// Why results that were accepted may be wrong. Each goes to all clients.
    pub doubts: Vec<Doubt>,
    /// How many workers are there.
    pub workers: usize,
    staffing: Staffing,
    failed: Option<JobFailed>,
}

#[cfg(test)]
mod tests;
