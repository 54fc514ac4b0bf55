//! What can happen: workers that come and go, attempts and how they end, results that disagree.

use std::fmt;
use std::time::{Duration, SystemTime};

use proto::task::TaskKind;
use proto::{Introduction, JobId, WorkerId};
use serde::{Deserialize, Serialize};

use super::control::Controlled;
use super::serde_forms;

/// Something that happened, and when. In JSON all fields stand side by side.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Grows with each event, through all starts of the coordinator.
    pub sequence: u64,
    /// When the coordinator noticed, to the millisecond.
    #[serde(rename = "at_ms", with = "serde_forms::milliseconds")]
    pub at: SystemTime,
    /// What happened.
    #[serde(flatten)]
    pub kind: EventKind,
    /// Beyond the bound of its kind: observers that follow see it, but neither log nor journal keeps it.
    #[serde(skip)]
    pub omitted: bool,
}

/// What happened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum EventKind {
    /// A worker registered, or was found registered when the coordinator was started again.
    Joined {
        /// Its id.
        #[serde(with = "serde_forms::worker_id")]
        worker: WorkerId,
        /// Its unique label.
        label: String,
        /// How it introduced itself.
        #[serde(flatten, with = "serde_forms::introduction")]
        introduction: Introduction,
    },
    /// A worker was removed.
    Departed {
        /// Its id.
        #[serde(with = "serde_forms::worker_id")]
        worker: WorkerId,
        /// Its label.
        label: String,
        /// Why.
        departure: Departure,
        /// Leases it held.
        leases: usize,
        /// Valid results it reported since its id was first seen.
        answers: u64,
    },
    /// A worker of the coordinator's own process ended with an earlier start of it.
    Ended {
        /// Its id.
        #[serde(with = "serde_forms::worker_id")]
        worker: WorkerId,
        /// Its label.
        label: String,
    },
    /// An attempt ended; a late result of it makes a second event.
    Attempt(Attempt),
    /// Two workers reported different results of one job; the coordinator's own or a further principal decides.
    Disagreement {
        /// The job.
        #[serde(with = "serde_forms::job_id")]
        job: JobId,
        /// Label of its task.
        task: String,
        /// Labels of those who reported.
        workers: Vec<String>,
    },
    /// A worker failed so often that it gets no jobs for a while, as long as there are others.
    Excluded {
        /// Its id.
        #[serde(with = "serde_forms::worker_id")]
        worker: WorkerId,
        /// Its label.
        label: String,
        /// For how long.
        seconds: u64,
    },
    /// A principal that was quarantined may work again, as an operator has said.
    Readmitted {
        /// Who.
        principal: String,
    },
    /// Results disagree and there is no further principal to decide.
    Undecided {
        /// Label of the job's task.
        task: String,
    },
    /// An evaluation that was to be audited was accepted from the only principal that can answer it. Emitted once; audits
    /// are made up for when another joins.
    Unaudited,
    /// Workers have been idle for a while.
    Starving {
        /// How many.
        idle: usize,
        /// Jobs that others work on.
        unfinished: usize,
    },
    /// An operator has ordered something, and it was done.
    Controlled(Controlled),
    /// A run went back to the beginning of a generation.
    Rewind {
        /// Which one.
        generation: u32,
        /// Why.
        why: String,
    },
}

impl fmt::Display for EventKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Joined { label, introduction, .. } => {
                write!(f, "worker {label}: joined, {} threads, {}", introduction.threads, introduction.build)?;
                let credential = introduction.principal.credential();
                credential.map_or(Ok(()), |credential| write!(f, ", with {credential}"))
            }
            Self::Departed { label, departure, leases, .. } => {
                let noun = if *leases == 1 { "lease" } else { "leases" };
                let (word, reason) = (departure.as_str(), departure.reason());
                write!(f, "worker {label}: {word}: {reason}, {leases} {noun} handed back")
            }
            Self::Ended { label, .. } => write!(f, "worker {label}: ended with the coordinator"),
            Self::Attempt(Attempt { number, task, label, end, .. }) => {
                write!(f, "worker {label}: {task}, attempt {number}: {}", end.as_str())?;
                end.reason().map_or(Ok(()), |reason| write!(f, ": {reason}"))
            }
            Self::Disagreement { task, workers, .. } => {
                write!(f, "{task}: different answers of {}; another worker decides", workers.join(" and "))
            }
            Self::Excluded { label, seconds, .. } => {
                write!(f, "worker {label}: fails too often and gets no jobs for {seconds} s, while there are others")
            }
            Self::Readmitted { principal } => write!(f, "{principal}: is no longer quarantined"),
            Self::Undecided { task } => {
                write!(f, "{task}: workers differ and no other is there to decide; waiting for one to join")
            }
            Self::Unaudited => f.write_str(
                "answers go unaudited: no other principal is there that can give a second one; workers that show the same credential from the same address are one, and audits are made up for when another joins",
            ),
            Self::Starving { idle, unfinished } => {
                let workers = if *idle == 1 { "worker is" } else { "workers are" };
                let jobs = if *unfinished == 1 { "evaluation is" } else { "evaluations are" };
                write!(f, "{idle} {workers} idle: only {unfinished} {jobs} left before the next can be chosen")
            }
            Self::Controlled(controlled) => controlled.fmt(f),
            Self::Rewind { generation, why } => write!(f, "back to generation {generation}: {why}"),
        }
    }
}

impl EventKind {
    /// Whether the scheduler has something unusual to say to people: what goes as it should is not printed, and a
    /// rewind is announced by the run itself.
    pub fn is_news(&self) -> bool {
        match self {
            Self::Attempt(attempt) => matches!(attempt.end, AttemptEnd::Failed(_) | AttemptEnd::Overdue),
            Self::Ended { .. } | Self::Rewind { .. } => false,
            _ => true,
        }
    }
}

/// Why a worker was removed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Departure {
    /// It said goodbye.
    Left,
    /// It fell silent for longer than a lease lasts.
    Lost,
    /// A result of its principal was wrong.
    Quarantined,
    /// It is on the deny list, or an operator has denied it.
    Denied,
    /// It had nothing to show when there were too many workers.
    Displaced,
}

impl Departure {
    /// One word for it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Lost => "lost",
            Self::Quarantined => "quarantined",
            Self::Denied => "denied",
            Self::Displaced => "displaced",
        }
    }

    /// A sentence for it, without its subject.
    pub fn reason(self) -> &'static str {
        match self {
            Self::Left => "said goodbye",
            Self::Lost => "no sign of life within the lease",
            Self::Quarantined => "an answer that came with its credential was wrong",
            Self::Denied => "is not let in any more",
            Self::Displaced => "too many workers, and it has answered nothing",
        }
    }
}

/// One attempt that has ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Attempt {
    /// Which job.
    #[serde(with = "serde_forms::job_id")]
    pub job: JobId,
    /// Which attempt at it, from 1.
    #[serde(rename = "attempt")]
    pub number: u32,
    /// Label of the task.
    pub task: String,
    /// Its kind, for observers that follow: the journal does not keep it.
    #[serde(skip)]
    pub kind: Option<TaskKind>,
    /// Id of the worker.
    #[serde(with = "serde_forms::worker_id")]
    pub worker: WorkerId,
    /// Its label.
    pub label: String,
    /// Seconds from the lease to the end of the attempt.
    pub held_seconds: f64,
    /// Seconds on the worker's clock, if it reported.
    pub run_seconds: Option<f64>,
    /// How it ended.
    #[serde(flatten)]
    pub end: AttemptEnd,
}

impl Attempt {
    /// When the lease was granted, given when the attempt ended.
    pub fn leased_at(&self, ended: SystemTime) -> SystemTime {
        let held = Duration::try_from_secs_f64(self.held_seconds).unwrap_or_default();
        ended.checked_sub(held).unwrap_or(ended)
    }
}

/// How an attempt ended.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "end", content = "reason", rename_all = "snake_case")]
pub enum AttemptEnd {
    /// The first result of its job.
    Answered,
    /// The same result as another worker's.
    Agreed,
    /// Another result than another worker's.
    Disagreed,
    /// A valid result on a lease that had been given up.
    Late,
    /// The worker reported why it has no result, or a result that cannot be one.
    Failed(String),
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
    pub fn reason(&self) -> Option<&str> {
        match self {
            Self::Failed(reason) => Some(reason),
            Self::Gone(departure) => Some(departure.reason()),
            _ => None,
        }
    }
}
