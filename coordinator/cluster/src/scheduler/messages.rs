//! What goes into the scheduler and what comes out of it.

use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

use proto::journal::{AcceptedResult, Assurance};
use proto::task::{Failure, FailureReason, Report, Task, TaskResult};
use proto::{Digest, JobId, Lease, Principal, WorkerId};

use crate::events::EventKind;

/// What one worker says in one poll.
#[derive(Debug, Default)]
pub struct Poll {
    /// Grows with each poll of a worker.
    pub sequence: u64,
    /// Every lease the worker holds.
    pub held: Vec<Lease>,
    /// Finished and not acknowledged.
    pub finished: Vec<Report>,
    /// How many more jobs the worker would take.
    pub wanted: usize,
    /// The worker is about to stop.
    pub leaving: bool,
}

/// What a poll is answered with.
#[derive(Debug, Default)]
pub struct Answer {
    /// Reports that need not be sent again.
    pub acknowledged: Vec<Lease>,
    /// Leases that are no longer wanted.
    pub revoked: Vec<Lease>,
    /// New leases.
    pub jobs: Vec<(Lease, Arc<Task>)>,
    /// Whether the run has ended, so that there will be no more.
    pub run_ended: bool,
}

impl Answer {
    /// Whether it says nothing, so that it may as well be held back.
    pub fn is_empty(&self) -> bool {
        self.acknowledged.is_empty() && self.revoked.is_empty() && self.jobs.is_empty() && !self.run_ended
    }
}

/// Why a poll is not answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PollRefusal {
    /// The worker has to register first.
    UnknownWorker,
    /// A newer poll of the same worker was seen.
    Stale,
    /// Its principal gave a wrong result.
    Quarantined,
}

/// Why a worker is not registered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RegisterRefusal {
    /// There are as many as there may be.
    Full,
    /// Its principal gave a wrong result.
    Quarantined,
    /// An operator has denied it.
    Denied,
    /// There is nothing left to do.
    RunEnded,
}

impl RegisterRefusal {
    /// A few words for it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Full => "too many workers",
            Self::Quarantined => "quarantined",
            Self::Denied => "denied",
            Self::RunEnded => "run ended",
        }
    }
}

/// A job that is done.
#[derive(Clone, Debug, PartialEq)]
pub struct Finished<R = TaskResult> {
    /// Which job.
    pub job: JobId,
    /// The result that counts.
    pub result: R,
    /// The worker that reported it first; of a sharded evaluation, one of those that did.
    pub worker_id: WorkerId,
    /// Its label, for people; of a sharded evaluation, how many there were.
    pub worker: String,
    /// Which attempt it was.
    pub attempt: u32,
    /// From submission to the lease of the attempt that reported the result.
    pub queued: Duration,
    /// Seconds on the worker's clock.
    pub run_seconds: f64,
    /// Who answers for the worker; of a sharded evaluation, for one of those that gave the least assurance.
    pub principal: Principal,
    /// Another principal that gave the same; of a sharded evaluation none.
    pub seconded: Option<Principal>,
    /// Why it is believed; of a sharded evaluation, the least of its parts.
    pub assurance: Assurance,
}

impl Finished {
    /// The same with what `of_kind` makes of the result; `None` if that is nothing.
    pub fn of_kind<R>(self, of_kind: impl FnOnce(TaskResult) -> Option<R>) -> Option<Finished<R>> {
        let Self {
            job,
            result,
            worker_id,
            worker,
            attempt,
            queued,
            run_seconds,
            principal,
            seconded,
            assurance,
        } = self;
        let result = of_kind(result)?;
        Some(Finished {
            job,
            result,
            worker_id,
            worker,
            attempt,
            queued,
            run_seconds,
            principal,
            seconded,
            assurance,
        })
    }

    /// What the journal keeps of it; `None` if nothing.
    pub fn kept(&self) -> Option<AcceptedResult> {
        Some(AcceptedResult {
            result: self.result.kept()?,
            worker_id: self.worker_id,
            worker: self.worker.clone(),
            principal: self.principal,
            seconded: self.seconded,
            assurance: self.assurance,
            attempt: self.attempt,
            queued: self.queued,
            run_seconds: self.run_seconds,
        })
    }

    /// A result that the journal has kept.
    pub fn recorded(job: JobId, accepted: AcceptedResult) -> Self {
        let AcceptedResult {
            result,
            worker_id,
            worker,
            principal,
            seconded,
            assurance,
            attempt,
            queued,
            run_seconds,
        } = accepted;
        Self { job, result, worker_id, worker, attempt, queued, run_seconds, principal, seconded, assurance }
    }
}

/// A job that was settled after a result of it was delivered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Confirmed {
    /// The job.
    pub job: JobId,
    /// Of the result that counts.
    pub fingerprint: Digest,
    /// Another principal that gave it.
    pub seconded: Option<Principal>,
    /// Why it is believed.
    pub assurance: Assurance,
    /// It was retracted, because results differed.
    pub was_disputed: bool,
}

/// Something that happened, for the event log.
#[derive(Clone, Debug)]
pub struct Emitted {
    /// When.
    pub at: Instant,
    /// What.
    pub kind: EventKind,
}

/// Why accepted results may be wrong.
#[derive(Clone, Debug)]
pub enum Doubt {
    /// Two workers reported different results of one job.
    Disagreement {
        /// The job.
        job: JobId,
        /// Its task.
        task: Arc<Task>,
    },
    /// A principal was quarantined.
    Quarantined(Principal),
}

/// A job that failed as often as the limit allows, or is malformed.
#[derive(Clone, Debug, PartialEq)]
pub struct JobFailed {
    /// The task.
    pub task: Arc<Task>,
    /// Every failure, oldest first.
    pub failures: Vec<WorkerFailure>,
}

/// One worker's failure at a job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WorkerFailure {
    /// Label of the worker.
    pub worker: String,
    /// Why there is no result.
    pub failure: Failure,
}

impl JobFailed {
    /// Whether the job cannot be carried out by any worker of this release.
    pub fn is_malformed(&self) -> bool {
        self.failures.iter().any(|one| one.failure.reason == FailureReason::InvalidJob)
    }
}

impl fmt::Display for WorkerFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.worker, self.failure)
    }
}

/// Whether there are workers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Staffing {
    /// At least one worker.
    Staffed,
    /// No worker has joined yet.
    NotYet,
    /// The last worker was lost this long ago, and there is still time for another to join.
    Lost(Duration),
    /// The grace after the loss of the last worker is over.
    GraceOver,
    /// Workers disagree, and none that could decide has joined within the grace.
    Undecided,
}
