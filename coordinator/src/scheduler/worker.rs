//! What the scheduler knows of one worker.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use proto::JobId;

/// How a worker introduces itself.
#[derive(Clone, Debug)]
pub struct Introduction {
    /// The name its operator gave it.
    pub name: String,
    /// Threads that evaluate.
    pub threads: u32,
    /// Which build it is.
    pub build: String,
}

/// A worker that went.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Farewell {
    /// Its label.
    pub label: String,
    /// [`Farewell::LEFT`] or [`Farewell::LOST`].
    pub reason: &'static str,
    /// Leases that went back to the queue.
    pub leases: usize,
}

impl Farewell {
    /// It said goodbye.
    pub const LEFT: &'static str = "left";
    /// It fell silent for longer than a lease lasts.
    pub const LOST: &'static str = "lost: no sign of life within the lease";
}

/// A worker that came.
#[derive(Clone, Debug)]
pub struct Arrival {
    /// Its unique label.
    pub label: String,
    /// How it introduced itself.
    pub introduction: Introduction,
}

pub(super) struct Worker {
    pub(super) label: String,
    pub(super) last_seen: Instant,
    pub(super) sequence: u64,
    pub(super) finished: u64,
    /// Jobs and attempts in the order in which it took them, which is the order in which it works on them.
    leases: Vec<(JobId, u32)>,
    /// Since when the first lease has been the first: a job taken ahead is not worked on yet.
    first_since: Instant,
}

impl Worker {
    pub(super) fn new(label: String, now: Instant) -> Self {
        Self { label, last_seen: now, sequence: 0, finished: 0, leases: Vec::new(), first_since: now }
    }

    pub(super) fn leases(&self) -> &[(JobId, u32)] {
        &self.leases
    }

    /// The job it works on, and since when.
    pub(super) fn in_hand(&self) -> Option<(JobId, Instant)> {
        self.leases.first().map(|(job, _)| (*job, self.first_since))
    }

    pub(super) fn take(&mut self, job: JobId, attempt: u32, now: Instant) {
        if self.leases.is_empty() {
            self.first_since = now;
        }
        self.leases.push((job, attempt));
    }

    pub(super) fn put_down(&mut self, job: JobId, now: Instant) {
        if self.leases.first().is_some_and(|(first, _)| *first == job) {
            self.first_since = now;
        }
        self.leases.retain(|(other, _)| *other != job);
    }

    /// Takes a pause of the coordinator's out of every reckoning.
    pub(super) fn forgive(&mut self, pause: Duration, now: Instant) {
        self.last_seen = (self.last_seen + pause).min(now);
        self.first_since = (self.first_since + pause).min(now);
    }
}

/// `name`, or `name-2`, `name-3`, … if that is taken.
pub(super) fn unique_label(name: &str, taken: &BTreeSet<String>) -> String {
    let name = if name.is_empty() { "worker" } else { name };
    if !taken.contains(name) {
        return name.to_owned();
    }
    (2u64..).map(|number| format!("{name}-{number}")).find(|label| !taken.contains(label)).unwrap_or_default()
}
