//! The scheduler as several tasks share it: the service feeds it, runs wait on it, a clock expires leases.
//!
//! Here is the workers' side; `client` is the side of those who ask.

mod client;
mod clients;
mod floor;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use proto::task::{Described, Evaluation, Task, TaskResult};
use proto::{Lease, SessionId, WorkerId};
use tokio::sync::{Notify, watch};

use crate::assembly::{Batch, Load, Pieces, Planner};
use crate::blobs::BlobStore;
use crate::chronicle::Chronicle;
use crate::journal::{Journal, JournalError, Mark, Recorded};
use crate::ledger::Ledger;
use crate::scheduler::{
    Answer, Event, Finished, Introduction, JobFailed, Limits, Poll, PollRefusal, RegisterRefusal, Scheduler,
    Staffing,
};
pub use client::{CellAnswer, Client};
use floor::Floor;

/// How often silence is looked for.
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
fn job_failed(failed: &JobFailed) -> String {
    let JobFailed { task, failures } = failed;
    let lines = failures.iter().map(ToString::to_string);
    let lines: Vec<String> = lines.filter_map(|line| line.lines().next().map(str::to_owned)).collect();
    let (lines, count) = (lines.join("\n  "), failures.len());
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

/// Scheduler, blobs and the signals between those who use them.
pub struct Cluster {
    /// Names the run to its workers.
    pub session: SessionId,
    /// What workers may fetch.
    pub blobs: BlobStore,
    limits: Limits,
    floor: Mutex<Floor>,
    planner: Mutex<Planner>,
    journal: Option<Arc<Journal>>,
    /// Earlier starts have left answers.
    has_past: bool,
    /// Whether every client has asked for something that had no answer.
    begun: watch::Sender<bool>,
}

impl Cluster {
    /// A cluster without workers that keeps nothing.
    pub fn new(limits: Limits) -> Arc<Self> {
        let session = SessionId(rand::random());
        let (scheduler, ledger) = (Scheduler::new(limits), Ledger::default());
        let chronicle = Chronicle::begin(Instant::now(), SystemTime::now(), &Recorded::default());
        let floor = Floor::new(scheduler, ledger, chronicle);
        Self::with(limits, session, (None, false), floor, Planner::default())
    }

    /// The cluster of a run that keeps what it accepts, and goes on where earlier starts ended.
    pub fn with_journal(
        limits: Limits,
        session: SessionId,
        journal: Journal,
        recorded: Recorded,
    ) -> Arc<Self> {
        let journal = Arc::new(journal);
        let (mut scheduler, now) = (Scheduler::new(limits), Instant::now());
        if recorded.starts > 1 {
            scheduler.restore(&recorded, now);
        }
        let chronicle = Chronicle::begin(now, SystemTime::now(), &recorded);
        let has_past = !recorded.accepted.is_empty();
        let ledger = Ledger::new(Arc::clone(&journal), recorded.accepted);
        let floor = Floor::new(scheduler, ledger, chronicle);
        Self::with(limits, session, (Some(journal), has_past), floor, Planner::new(recorded.cuts))
    }

    fn with(
        limits: Limits,
        session: SessionId,
        (journal, has_past): (Option<Arc<Journal>>, bool),
        floor: Floor,
        planner: Planner,
    ) -> Arc<Self> {
        Arc::new(Self {
            session,
            blobs: BlobStore::default(),
            limits,
            floor: Mutex::new(floor),
            planner: Mutex::new(planner),
            journal,
            has_past,
            begun: watch::Sender::new(false),
        })
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
        self.floor().register(id, introduction, in_process, Instant::now())
    }

    /// Waits until every client has submitted its first job, as long as a poll may be held back; `false` if one has not.
    /// A run that was started again is not before that where it was: it can judge neither leases nor reports, and has
    /// not released what its workers may ask for.
    pub async fn begun(&self) -> bool {
        let mut begun = self.begun.subscribe();
        tokio::time::timeout(self.hold(), begun.wait_for(|begun| *begun)).await.is_ok()
    }

    fn begin_if_all_arrived(&self, floor: &Floor) {
        if floor.clients.have_arrived() {
            self.begun.send_if_modified(|begun| !std::mem::replace(begun, true));
        }
    }

    /// See [`Scheduler::deny`].
    pub fn deny(&self, id: WorkerId) {
        self.floor().deny(id, Instant::now());
    }

    /// Answers a poll; holds the answer back while it would be empty and the worker wants jobs.
    pub async fn poll(&self, id: WorkerId, poll: Poll) -> Result<Answer, PollRefusal> {
        let deadline = tokio::time::Instant::now() + self.hold();
        if !self.begun().await {
            return Ok(Answer::default());
        }
        let (sequence, wanted, leaving) = (poll.sequence, poll.wanted, poll.leaving);
        let bell = Arc::new(Notify::new());
        let (mut answer, withheld) = self.floor().poll(id, poll, &bell, Instant::now())?;
        if leaving && !withheld.is_empty() {
            // It would not come back to be told.
            answer.acknowledged.extend(self.wait_for_journal(withheld, deadline).await);
        } else if answer.is_empty() && wanted > 0 && !leaving {
            return self.wait_for_jobs(id, (sequence, wanted), withheld, &bell, deadline).await;
        }
        Ok(answer)
    }

    /// Waits for jobs, or until one of the reports that came with the poll can be acknowledged.
    async fn wait_for_jobs(
        &self,
        id: WorkerId,
        (sequence, wanted): (u64, usize),
        mut withheld: Vec<Lease>,
        bell: &Notify,
        deadline: tokio::time::Instant,
    ) -> Result<Answer, PollRefusal> {
        loop {
            let (answer, mark) = {
                let (mut floor, now) = (self.floor(), Instant::now());
                let jobs = floor.lease_later(id, sequence, wanted, now)?;
                let acknowledged = floor.ledger.release(&mut withheld);
                (Answer { jobs, acknowledged, ..Answer::default() }, floor.ledger.mark(&withheld))
            };
            if !answer.is_empty() {
                return Ok(answer);
            }
            tokio::select! {
                () = bell.notified() => {}
                () = self.kept(mark) => {}
                () = tokio::time::sleep_until(deadline) => return Ok(answer),
            }
        }
    }

    /// The leases among these whose reports are on the disk, or are in time.
    async fn wait_for_journal(&self, mut leases: Vec<Lease>, deadline: tokio::time::Instant) -> Vec<Lease> {
        let mark = self.floor().ledger.mark(&leases);
        if tokio::time::timeout_at(deadline, self.kept(mark)).await.is_err() {
            return Vec::new();
        }
        self.floor().ledger.withhold(&mut leases);
        leases
    }

    /// Waits until the journal has come to the mark; for ever if there is none, or nothing will be kept any more.
    async fn kept(&self, mark: Option<Mark>) {
        if let (Some(journal), Some(mark)) = (&self.journal, mark)
            && journal.durable(mark).await.is_ok()
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

    /// Waits until everything up to the mark is on the disk.
    async fn durable(&self, mark: Mark) -> Result<(), ClusterError> {
        match &self.journal {
            Some(journal) => journal.durable(mark).await.map_err(ClusterError::Journal),
            None => Ok(()),
        }
    }

    /// Its clients are members of a sweep, of which some may be finished.
    pub fn share(&self) {
        self.floor().clients.share();
    }

    /// Whether earlier starts have left answers.
    pub fn has_past(&self) -> bool {
        self.has_past
    }

    /// Whether the answer to this evaluation is there, because an earlier start has accepted it, or this one has; or
    /// whether it was asked for in pieces.
    pub fn recalls(&self, evaluation: Evaluation) -> bool {
        let job = Task::Evaluation(evaluation).job(0);
        if self.planner().has_cut(job) {
            return true;
        }
        let floor = self.floor();
        floor.ledger.has(job) || floor.book.has(job)
    }

    /// From here on, evaluations are cut like this.
    pub fn set_pieces(&self, pieces: Pieces) {
        self.planner().set_pieces(pieces);
    }

    /// Decides which evaluations are cut, and keeps that before the first piece is asked for.
    fn plan(&self, evaluations: Vec<Evaluation>) -> (Batch, Vec<Task>) {
        let mut planner = self.planner();
        {
            let floor = self.floor();
            let load = Load { jobs: floor.scheduler.open_jobs(), workers: floor.scheduler.worker_count() };
            for (job, cut) in planner.decide(&evaluations, load, |job| floor.was_asked(job)) {
                floor.ledger.cut(job, cut);
            }
        }
        Batch::new(evaluations.into_iter().map(|one| planner.lay_out(one, &self.blobs)).collect())
    }

    /// Takes in what an answer tells beside its result: what such tasks take, and a description for others to use.
    fn learn(&self, task: &Task, answer: &Finished) {
        self.planner().observe(task, answer.run_seconds);
        if let TaskResult::Description(Described { digest, bytes: Some(bytes) }) = &answer.result {
            self.blobs.publish_description(*digest, bytes);
        }
    }

    /// Whether evaluations failed for good.
    fn check_failures(&self, news: &ClusterNews) -> Result<(), ClusterError> {
        if let Some(failure) = self.journal.as_ref().and_then(|journal| journal.failure()) {
            return Err(ClusterError::Journal(failure));
        }
        if let Some(failed) = &news.failed {
            self.floor().doubt_descriptions(&failed.task);
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
        self.floor().close(Instant::now());
    }

    /// Whether no worker of this run was wrong; else what it has computed may be wrong where nobody has looked.
    pub fn is_trusted(&self) -> bool {
        self.floor().chronicle.is_trusted()
    }

    /// Not to be called by who holds the floor.
    fn planner(&self) -> MutexGuard<'_, Planner> {
        self.planner.lock().unwrap_or_else(PoisonError::into_inner) // as below
    }

    fn floor(&self) -> MutexGuard<'_, Floor> {
        // Decisions are made in one go: a panic in one of them is a bug, but leaves no half-made state to fear.
        self.floor.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What happened since the last look.
#[derive(Debug)]
pub struct ClusterNews {
    /// How many evaluations or cells were finished.
    pub finished: usize,
    /// Workers that came and went, attempts that ended, answers that differ. Each is told to one client.
    pub events: Vec<Event>,
    /// Those of them after which answers that were taken may be wrong. Each is told to all clients.
    pub doubts: Vec<Event>,
    /// How many workers are there.
    pub workers: usize,
    staffing: Staffing,
    failed: Option<JobFailed>,
}

#[cfg(test)]
mod tests;
