//! What the scheduler knows of one worker.

use std::collections::BTreeMap;
use std::time::Instant;

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

/// A worker as progress shows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WorkerSummary {
    /// Its unique label.
    pub label: String,
    /// Threads that evaluate.
    pub threads: u32,
    /// Which build it is.
    pub build: String,
    /// Leases it holds.
    pub leases: usize,
    /// Jobs it finished first.
    pub finished: u64,
}

pub(super) struct Worker {
    pub(super) label: String,
    pub(super) introduction: Introduction,
    pub(super) last_seen: Instant,
    pub(super) sequence: u64,
    pub(super) leases: BTreeMap<JobId, u32>,
    pub(super) finished: u64,
}

impl Worker {
    pub(super) fn new(label: String, introduction: Introduction, now: Instant) -> Self {
        Self { label, introduction, last_seen: now, sequence: 0, leases: BTreeMap::new(), finished: 0 }
    }

    pub(super) fn summary(&self) -> WorkerSummary {
        WorkerSummary {
            label: self.label.clone(),
            threads: self.introduction.threads,
            build: self.introduction.build.clone(),
            leases: self.leases.len(),
            finished: self.finished,
        }
    }
}

/// `name`, or `name-2`, `name-3`, … if that is taken.
pub(super) fn unique_label<'a>(name: &str, taken: impl Iterator<Item = &'a str> + Clone) -> String {
    let name = if name.is_empty() { "worker" } else { name };
    let free = |label: &str| taken.clone().all(|other| other != label);
    if free(name) {
        return name.to_owned();
    }
    (2u64..).map(|number| format!("{name}-{number}")).find(|label| free(label)).unwrap_or_default()
}
