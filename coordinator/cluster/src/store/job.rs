//! One job: who works on it, what was reported, and how many results it still needs.

use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use proto::task::{Task, TaskResult};
use proto::{Digest, WorkerId};

use crate::scheduler::fair_queue::QueuePosition;
use crate::scheduler::messages::WorkerFailure;

/// Attempts that are remembered: a worker that never gets its replies must not fill the memory.
const MAX_ATTEMPTS: usize = 256;

/// Attempts that may have been handed out and not recorded when a coordinator was killed: each takes longer than the
/// commit that records it.
pub const UNRECORDED: u32 = 8;

/// One worker's result.
pub struct Vote {
    pub worker: WorkerId,
    pub label: String,
    pub attempt: u32,
    /// Equal for results that are equal bit for bit.
    pub fingerprint: Digest,
    /// The result, until one is delivered.
    pub result: Option<TaskResult>,
    pub queued: Duration,
    pub run_seconds: f64,
}

/// One time that the job was handed out.
struct HandedOut {
    attempt: u32,
    worker: WorkerId,
    at: Instant,
}

pub struct Job {
    pub task: Arc<Task>,
    /// The channels in which whoever takes it will have described clouds.
    pub channels: Vec<u64>,
    /// Jobs are handed out in this order.
    pub position: QueuePosition,
    pub submitted: Instant,
    /// Two workers have to agree on the result.
    pub audited: bool,
    /// A result has been delivered.
    pub delivered: bool,
    /// Who works on it, on which attempt.
    pub leases: Vec<(WorkerId, u32)>,
    handed_out: Vec<HandedOut>,
    /// Attempts that an earlier start may have granted to some worker without a record of it.
    unrecorded: Range<u32>,
    pub votes: Vec<Vote>,
    pub failures: Vec<(WorkerId, WorkerFailure)>,
    pub losses: Vec<WorkerFailure>,
    /// From when on a second worker may take it beside the one that has it, as it stands in the scheduler's list.
    pub hedge_from: Option<Instant>,
}

impl Job {
    pub fn new(
        task: Arc<Task>,
        channels: Vec<u64>,
        position: QueuePosition,
        audited: bool,
        submitted: Instant,
    ) -> Self {
        Self {
            task,
            channels,
            position,
            submitted,
            audited,
            delivered: false,
            leases: Vec::new(),
            handed_out: Vec::new(),
            unrecorded: 0..0,
            votes: Vec::new(),
            failures: Vec::new(),
            losses: Vec::new(),
            hedge_from: None,
        }
    }

    /// When this attempt was handed out to this worker; `None` if it never was.
    pub fn handed_out_at(&self, worker: WorkerId, attempt: u32) -> Option<Instant> {
        let is_it = |handed_out: &&HandedOut| handed_out.attempt == attempt && handed_out.worker == worker;
        let recorded = self.handed_out.iter().find(is_it).map(|handed_out| handed_out.at);
        recorded.or_else(|| self.unrecorded.contains(&attempt).then_some(self.submitted))
    }

    /// Notes the attempts that earlier starts have made, in order.
    pub fn restore_attempts(&mut self, attempts: &[(WorkerId, u32)], now: Instant) {
        let kept = attempts.iter().rev().take(MAX_ATTEMPTS).rev();
        let handed_out = |&(worker, attempt): &(WorkerId, u32)| HandedOut { attempt, worker, at: now };
        self.handed_out = kept.map(handed_out).collect();
        let last = attempts.last().map_or(0, |(_, attempt)| *attempt);
        self.unrecorded = last + 1..last.saturating_add(UNRECORDED + 1);
    }

    /// Notes that the job is handed out once more, and returns which attempt that is.
    pub fn hand_out(&mut self, worker: WorkerId, at: Instant) -> u32 {
        let attempt = self.handed_out.last().map_or(1, |last| last.attempt.saturating_add(1));
        if self.handed_out.len() == MAX_ATTEMPTS {
            self.handed_out.remove(0);
        }
        self.handed_out.push(HandedOut { attempt, worker, at });
        attempt
    }

    /// The attempt on which this worker holds a lease.
    pub fn lease_of(&self, worker: WorkerId) -> Option<u32> {
        self.leases.iter().find(|(holder, _)| *holder == worker).map(|(_, attempt)| *attempt)
    }

    pub fn failed_on(&self, worker: WorkerId) -> bool {
        self.failures.iter().any(|(failed, _)| *failed == worker)
    }

    pub fn answered_by(&self, worker: WorkerId) -> bool {
        self.votes.iter().any(|vote| vote.worker == worker)
    }

    /// Whether two results differ.
    pub fn is_disputed(&self) -> bool {
        self.votes.iter().any(|vote| vote.fingerprint != self.votes[0].fingerprint)
    }

    fn agreeing(&self, fingerprint: Digest) -> usize {
        self.votes.iter().filter(|vote| vote.fingerprint == fingerprint).count()
    }

    /// The first of the votes for the result that most workers gave, the earliest on ties.
    pub fn leading(&self) -> Option<&Vote> {
        // Of several that are equally good, `max_by_key` takes the last.
        self.votes.iter().rev().max_by_key(|vote| self.agreeing(vote.fingerprint))
    }

    /// How many more equal results it needs. Two workers have to agree where the job is audited, or where results
    /// differ.
    pub fn needs(&self) -> usize {
        let agreeing = self.leading().map_or(0, |vote| self.agreeing(vote.fingerprint));
        let wanted = if self.audited || self.is_disputed() { 2 } else { 1 };
        wanted - agreeing.min(wanted)
    }
}
