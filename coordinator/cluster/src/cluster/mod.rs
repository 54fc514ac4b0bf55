//! The scheduler as several tasks share it: the service feeds it, runs wait on it, a clock removes silent workers.
//!
//! Here is the workers' side; `client` is the side of those who ask.

mod client;
mod clients;
mod state;

use std::sync::{Arc, Mutex, MutexGuard, Weak};
use std::time::{Duration, Instant, SystemTime};

use proto::{Lease, SessionId, WorkerId};
use tokio::sync::{Notify, watch};
use tokio::time::MissedTickBehavior;

use crate::blobs::BlobStore;
use crate::durability::Durability;
use crate::evaluation::Evaluation;
use crate::events::{EventCursor, EventKind, EventLog};
use crate::journal::{Journal, JournalError, LogSequence, Recorded};
use crate::lock::lock;
use crate::scheduler::{
    Answer, Doubt, Finished, Introduction, JobFailed, Limits, Poll, PollRefusal, RegisterRefusal, Scheduler,
    Staffing,
};
use crate::shard::Described;
use crate::sharding::{Batch, Load, Planner, ShardCount};
use crate::task::{Task, TaskResult};
pub use client::{CellAnswer, Client};
use state::ClusterState;

/// How often silent workers are looked for.
const TICK: Duration = Duration::from_millis(500);

/// Why evaluations stopped for good.
#[derive(Debug, thiserror::Error)]
pub enum ClusterError {
    /// A job failed as often as the limit allows.
    #[error("{task}: failed {count} times, got\n  {failures}\nlook at the workers' logs; coordinator.max_failures and coordinator.job_seconds set the limits", task = .0.task, count = .0.failures.len(), failures = first_lines(&.0.failures))]
    JobFailed(JobFailed),
    /// No worker is left, and none came back.
    #[error(
        "workers: the last one was lost {seconds} s ago and none has joined since\nstart workers, then run the same command again"
    )]
    NoWorkers {
        /// Since when.
        seconds: u64,
    },
    /// Two workers differ, and there is no third.
    #[error(
        "workers: two gave different answers to one evaluation, and no other has joined within {seconds} s to decide\nstart one more worker, then run the same command again"
    )]
    Undecided {
        /// Since when.
        seconds: u64,
    },
    /// Answers cannot be kept any more.
    #[error(transparent)]
    Journal(JournalError),
    /// Descriptions that were not kept.
    #[error(
        "descriptions: they were dropped for want of memory before they were used\nrun the same command again"
    )]
    Gone,
    /// Answers that had been accepted were wrong.
    #[error("{} answers of a worker that was wrong were corrected\nrun the same command again", .0.len())]
    Corrected(Vec<Arc<Task>>),
}

/// What failed, a line each: advice given to one machine is not repeated for all.
fn first_lines(failures: &[String]) -> String {
    let lines: Vec<&str> = failures.iter().filter_map(|failure| failure.lines().next()).collect();
    lines.join("\n  ")
}

/// Scheduler, blobs and the signals between those who use them.
pub struct Cluster {
    /// Names the run to its workers.
    pub session: SessionId,
    /// What workers may fetch.
    pub blobs: BlobStore,
    limits: Limits,
    state: Mutex<ClusterState>,
    planner: Mutex<Planner>,
    events: Arc<EventLog>,
    journal: Option<Arc<Journal>>,
    /// Earlier starts have left answers.
    has_past: bool,
    /// Whether every client has asked for something that had no answer.
    begun: watch::Sender<bool>,
}

impl Cluster {
    /// A cluster without workers that keeps nothing. To be called within a tokio runtime.
    pub fn new(limits: Limits) -> Arc<Self> {
        let session = SessionId(rand::random());
        let events = Arc::new(EventLog::new(Vec::new()));
        let started = (now(), SystemTime::now());
        let state =
            ClusterState::new(Scheduler::new(limits), Durability::default(), Arc::clone(&events), started);
        Self::with(limits, session, (None, false), state, Planner::default(), events)
    }

    /// The cluster of a run that keeps what it accepts, and goes on where earlier starts ended. To be called within a
    /// tokio runtime.
    pub fn with_journal(
        limits: Limits,
        session: SessionId,
        journal: Journal,
        recorded: Recorded,
    ) -> Arc<Self> {
        let journal = Arc::new(journal);
        let (mut scheduler, now) = (Scheduler::new(limits), now());
        if recorded.starts > 1 {
            scheduler.restore(&recorded, now);
        }
        let events = Arc::new(EventLog::new(recorded.events));
        let has_past = !recorded.accepted.is_empty();
        let durability = Durability::new(Arc::clone(&journal), recorded.accepted);
        let mut state =
            ClusterState::new(scheduler, durability, Arc::clone(&events), (now, SystemTime::now()));
        for (worker, label) in events.present() {
            if !recorded.members.contains_key(&worker) {
                state.append(now, EventKind::Ended { worker, label });
            }
        }
        let planner = Planner::new(recorded.plans);
        Self::with(limits, session, (Some(journal), has_past), state, planner, events)
    }

    fn with(
        limits: Limits,
        session: SessionId,
        (journal, has_past): (Option<Arc<Journal>>, bool),
        state: ClusterState,
        planner: Planner,
        events: Arc<EventLog>,
    ) -> Arc<Self> {
        let cluster = Arc::new(Self {
            session,
            blobs: BlobStore::default(),
            limits,
            state: Mutex::new(state),
            planner: Mutex::new(planner),
            events,
            journal,
            has_past,
            begun: watch::Sender::new(false),
        });
        tokio::spawn(tick(Arc::downgrade(&cluster)));
        cluster
    }

    /// Follows what happens from this start of the coordinator on. Each observer needs a cursor of its own.
    pub fn events(&self) -> EventCursor {
        self.events.follow()
    }

    /// Somebody new who asks for evaluations. To be called for all who will ask before the first of them does
    /// ([`Cluster::begun`]).
    pub fn client(self: &Arc<Self>) -> Client {
        Client::new(self)
    }

    /// How often a busy worker has to poll: several polls may be lost before its lease ends.
    pub fn heartbeat(&self) -> Duration {
        (self.limits.lease / 6).min(Duration::from_secs(5))
    }

    /// How long a poll may be held back.
    pub fn hold(&self) -> Duration {
        (self.limits.lease / 3).min(Duration::from_secs(10))
    }

    /// See [`Scheduler::register`]. A worker of this process ends with it, and is not kept.
    pub fn register(
        &self,
        id: WorkerId,
        introduction: Introduction,
        in_process: bool,
    ) -> Result<String, RegisterRefusal> {
        self.state().register(id, introduction, in_process, now())
    }

    /// Waits until every client has submitted its first job, as long as a poll may be held back; `false` if one has not.
    /// A run that was started again is not before that where it was: it can judge neither leases nor reports, and has
    /// not released what its workers may ask for.
    pub async fn begun(&self) -> bool {
        let mut begun = self.begun.subscribe();
        tokio::time::timeout(self.hold(), begun.wait_for(|begun| *begun)).await.is_ok()
    }

    fn begin_if_all_arrived(&self, state: &ClusterState) {
        if state.clients.have_arrived() {
            self.begun.send_if_modified(|begun| !std::mem::replace(begun, true));
        }
    }

    /// See [`Scheduler::deny`].
    pub fn deny(&self, id: WorkerId) {
        self.state().deny(id, now());
    }

    /// Answers a poll; holds the answer back while it would be empty and the worker wants jobs.
    pub async fn poll(&self, id: WorkerId, poll: Poll) -> Result<Answer, PollRefusal> {
        let deadline = tokio::time::Instant::now() + self.hold();
        self.state().scheduler.heard_from(id, now());
        if !self.begun().await {
            return Ok(Answer::default());
        }
        let (sequence, wanted, leaving) = (poll.sequence, poll.wanted, poll.leaving);
        let wakeup = Arc::new(Notify::new());
        let (mut answer, withheld) = self.state().poll(id, poll, &wakeup, now())?;
        if leaving && !withheld.is_empty() {
            // It will not poll again.
            answer.acknowledged.extend(self.wait_for_journal(withheld, deadline).await);
        } else if answer.is_empty() && wanted > 0 && !leaving {
            return self.wait_for_jobs(id, (sequence, wanted), withheld, &wakeup, deadline).await;
        }
        Ok(answer)
    }

    /// Waits for jobs, or until one of the reports that came with the poll can be acknowledged.
    async fn wait_for_jobs(
        &self,
        id: WorkerId,
        (sequence, wanted): (u64, usize),
        mut withheld: Vec<Lease>,
        wakeup: &Notify,
        deadline: tokio::time::Instant,
    ) -> Result<Answer, PollRefusal> {
        loop {
            let (answer, sequence) = {
                let (mut state, now) = (self.state(), now());
                let jobs = state.lease_later(id, sequence, wanted, now)?;
                let acknowledged = state.durability.release(&mut withheld);
                (Answer { jobs, acknowledged, ..Answer::default() }, state.durability.sequence(&withheld))
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

    /// The leases among these whose reports are on the disk, or are in time.
    async fn wait_for_journal(&self, mut leases: Vec<Lease>, deadline: tokio::time::Instant) -> Vec<Lease> {
        let sequence = self.state().durability.sequence(&leases);
        if tokio::time::timeout_at(deadline, self.kept(sequence)).await.is_err() {
            return Vec::new();
        }
        self.state().durability.withhold(&mut leases);
        leases
    }

    /// Waits until the journal has come to the sequence; for ever if there is none, or nothing will be kept any more.
    async fn kept(&self, sequence: Option<LogSequence>) {
        if let (Some(journal), Some(sequence)) = (&self.journal, sequence)
            && journal.durable(sequence).await.is_ok()
        {
            return;
        }
        std::future::pending().await
    }

    /// Waits until every answer that was accepted is on the disk.
    pub async fn flush(&self) -> Result<(), ClusterError> {
        match &self.journal {
            Some(journal) => self.durable(journal.end()).await,
            None => Ok(()),
        }
    }

    /// Waits until everything up to the sequence is on the disk.
    async fn durable(&self, sequence: LogSequence) -> Result<(), ClusterError> {
        match &self.journal {
            Some(journal) => journal.durable(sequence).await.map_err(ClusterError::Journal),
            None => Ok(()),
        }
    }

    /// Its clients are members of a sweep, of which some may be finished.
    pub fn share(&self) {
        self.state().clients.share();
    }

    /// Whether earlier starts have left answers.
    pub fn has_past(&self) -> bool {
        self.has_past
    }

    /// Whether the answer to this evaluation is there, because an earlier start has accepted it, or this one has; or
    /// whether it was sharded.
    pub fn recalls(&self, evaluation: Evaluation) -> bool {
        let job = Task::Evaluation(evaluation).job(0);
        if self.planner().has_plan(job) {
            return true;
        }
        let state = self.state();
        state.durability.has(job) || state.accepted.has(job)
    }

    /// From here on, evaluations are sharded like this.
    pub fn set_shard_count(&self, shard_count: ShardCount) {
        self.planner().set_shard_count(shard_count);
    }

    /// Decides which evaluations are sharded, and keeps that before the first subtask is asked for.
    fn plan(&self, evaluations: Vec<Evaluation>) -> (Batch, Vec<Task>) {
        let mut planner = self.planner();
        {
            let state = self.state();
            let load = Load { jobs: state.scheduler.open_jobs(), workers: state.scheduler.worker_count() };
            for (job, plan) in planner.decide(&evaluations, load, |job| state.was_asked(job)) {
                state.durability.plan(job, plan);
            }
        }
        Batch::new(evaluations.into_iter().map(|one| planner.lay_out(one, &self.blobs)).collect())
    }

    /// Takes in what an answer tells beside its result: what such tasks take, and a description for others to use.
    fn learn(&self, task: &Task, answer: &Finished) {
        self.planner().observe(task, answer.run_seconds);
        if let TaskResult::Description(Described { digest, parts: Some(parts) }) = &answer.result {
            self.blobs.publish_description(*digest, parts);
        }
    }

    /// Whether evaluations failed for good.
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

    /// Whether there has been nobody for too long who can evaluate, or decide.
    fn check_staffing(&self, news: &ClusterNews) -> Result<(), ClusterError> {
        let seconds = self.limits.worker_grace.as_secs();
        match news.staffing {
            Staffing::GraceOver => Err(ClusterError::NoWorkers { seconds }),
            Staffing::Undecided => Err(ClusterError::Undecided { seconds }),
            Staffing::Staffed | Staffing::NotYet | Staffing::Lost(_) => Ok(()),
        }
    }

    /// Ends all leases, because nobody waits for them any more.
    pub fn close(&self) {
        self.state().close(now());
    }

    /// Whether no worker of this run was wrong; else what it has computed may be wrong where nobody has looked.
    pub fn is_trusted(&self) -> bool {
        self.state().scheduler.is_trusted()
    }

    /// Not to be called by who holds the state.
    fn planner(&self) -> MutexGuard<'_, Planner> {
        lock(&self.planner)
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
        cluster.state().expire(now());
    }
}

/// The time that decisions are made by.
fn now() -> Instant {
    tokio::time::Instant::now().into_std()
}

/// What happened since the last look.
#[derive(Debug)]
pub struct ClusterNews {
    /// How many evaluations or cells were finished.
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
