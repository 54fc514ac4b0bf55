//! What happened: workers that came and went, attempts and how they ended, answers that disagree.

use std::fmt;
use std::sync::Arc;
use std::time::Instant;

use proto::task::{Failure, Task};
use proto::{JobId, WorkerId};

use super::worker::Introduction;

/// Events beyond which no more are kept until somebody reads them.
const MAX_UNREAD: usize = 100_000;

/// Something that happened, and when.
#[derive(Clone, Debug)]
pub struct Event {
    /// When the scheduler learnt of it.
    pub at: Instant,
    /// What it was.
    pub what: What,
}

/// What happened.
#[derive(Clone, Debug)]
pub enum What {
    /// A worker registered.
    Joined {
        /// Its unique label.
        worker: String,
        /// Its id.
        id: WorkerId,
        /// How it introduced itself.
        introduction: Introduction,
    },
    /// A worker is no longer counted upon.
    Gone {
        /// Its label.
        worker: String,
        /// Its id.
        id: WorkerId,
        /// Why.
        why: Departure,
        /// Leases it held.
        leases: usize,
        /// Valid answers it gave since it joined.
        answers: u64,
    },
    /// An attempt ended; a late answer to it makes a second event.
    Attempt(Attempt),
    /// Two workers gave different answers to one job; a further worker decides.
    Disagreement {
        /// The job.
        job: JobId,
        /// What it asks.
        task: Arc<Task>,
        /// Labels of those who answered.
        workers: Vec<String>,
    },
    /// Answers disagree and there is no further worker to decide.
    Undecided {
        /// The job.
        task: Arc<Task>,
    },
    /// An evaluation that was to be audited was taken from the only worker there is. Reported once; audits are made
    /// up for when another worker joins.
    Unaudited,
    /// Workers have had nothing to do for a while.
    Starving {
        /// How many.
        idle: usize,
        /// Jobs that others work on.
        unfinished: usize,
    },
}

impl fmt::Display for What {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Joined { worker, introduction, .. } => {
                write!(f, "worker {worker}: joined, {} threads, {}", introduction.threads, introduction.build)?;
                introduction.credential.as_ref().map_or(Ok(()), |credential| write!(f, ", with {credential}"))
            }
            Self::Gone { worker, why, leases, .. } => {
                let noun = if *leases == 1 { "lease" } else { "leases" };
                write!(f, "worker {worker}: {}: {}, {leases} {noun} handed back", why.as_str(), why.reason())
            }
            Self::Attempt(Attempt { number, task, worker, end, .. }) => {
                write!(f, "worker {worker}: {task}, attempt {number}: {}", end.as_str())?;
                end.reason().map_or(Ok(()), |reason| write!(f, ": {reason}"))
            }
            Self::Disagreement { task, workers, .. } => {
                write!(f, "{task}: different answers of {}; another worker decides", workers.join(" and "))
            }
            Self::Undecided { task } => {
                write!(f, "{task}: workers differ and no other is there to decide; waiting for one to join")
            }
            Self::Unaudited => f.write_str(
                "evaluations that are to be audited are taken from the only worker there is, until another joins",
            ),
            Self::Starving { idle, unfinished } => {
                let workers = if *idle == 1 { "worker is" } else { "workers are" };
                let jobs = if *unfinished == 1 { "evaluation is" } else { "evaluations are" };
                write!(f, "{idle} {workers} idle: only {unfinished} {jobs} left before the next can be chosen")
            }
        }
    }
}

impl What {
    /// Whether answers that were taken may be wrong.
    pub fn casts_doubt(&self) -> bool {
        matches!(self, Self::Disagreement { .. } | Self::Gone { why: Departure::Quarantined, .. })
    }

    /// Whether its line belongs in the log: what goes as it should does not.
    pub fn is_news(&self) -> bool {
        match self {
            Self::Attempt(attempt) => matches!(attempt.end, AttemptEnd::Failed(_) | AttemptEnd::Overdue),
            _ => true,
        }
    }
}

/// Why a worker is no longer counted upon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Departure {
    /// It said goodbye.
    Left,
    /// It fell silent for longer than a lease lasts.
    Lost,
    /// Two other workers agreed on an answer that differs from its own.
    Quarantined,
    /// It is on the deny list.
    Denied,
}

impl Departure {
    /// One word for it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Lost => "lost",
            Self::Quarantined => "quarantined",
            Self::Denied => "denied",
        }
    }

    /// A sentence for it, without its subject.
    pub fn reason(self) -> &'static str {
        match self {
            Self::Left => "said goodbye",
            Self::Lost => "no sign of life within the lease",
            Self::Quarantined => "gave an answer that two other workers contradict",
            Self::Denied => "is on the deny list",
        }
    }
}

/// One attempt that has ended.
#[derive(Clone, Debug)]
pub struct Attempt {
    /// Which job.
    pub job: JobId,
    /// Which attempt at it, from 1.
    pub number: u32,
    /// What was asked.
    pub task: Arc<Task>,
    /// Label of the worker.
    pub worker: String,
    /// When the lease was handed out.
    pub handed_out: Instant,
    /// How it ended.
    pub end: AttemptEnd,
    /// Seconds on the worker's clock, if it reported.
    pub run_seconds: Option<f64>,
}

/// How an attempt ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AttemptEnd {
    /// The first answer to its job.
    Answered,
    /// The same answer as another worker's.
    Agreed,
    /// Another answer than another worker's.
    Disagreed,
    /// A valid answer on a lease that had been given up.
    Late,
    /// The worker said why it has no answer, or its answer cannot be one.
    Failed(Failure),
    /// No result within the time a job may take.
    Overdue,
    /// The reply that carried the lease did not arrive.
    Undelivered,
    /// Answered by others before the worker began.
    Revoked,
    /// The worker went: it left, was lost or was quarantined.
    Gone(Departure),
    /// The run ended first.
    Dropped,
}

impl AttemptEnd {
    /// One word for it.
    pub fn as_str(&self) -> &'static str {
        match self {
            Self::Answered => "answered",
            Self::Agreed => "agreed",
            Self::Disagreed => "disagreed",
            Self::Late => "late",
            Self::Failed(_) => "failed",
            Self::Overdue => "overdue",
            Self::Undelivered => "undelivered",
            Self::Revoked => "revoked",
            Self::Gone(departure) => departure.as_str(),
            Self::Dropped => "dropped",
        }
    }

    /// What more there is to say of it.
    pub fn reason(&self) -> Option<String> {
        match self {
            Self::Failed(failure) => Some(failure.to_string()),
            Self::Gone(departure) => Some(departure.reason().to_owned()),
            _ => None,
        }
    }
}

/// Events nobody has read yet. Strangers that come and go while nobody reads must not fill the memory.
#[derive(Debug, Default)]
pub(super) struct Events {
    unread: Vec<Event>,
}

impl Events {
    pub(super) fn add(&mut self, at: Instant, what: What) {
        if self.unread.len() < MAX_UNREAD {
            self.unread.push(Event { at, what });
        }
    }

    pub(super) fn drain(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.unread)
    }
}
