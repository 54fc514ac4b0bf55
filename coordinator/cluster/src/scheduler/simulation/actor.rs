//! A worker as the protocol knows it, with a slot for one job beside the one it works on.

use std::collections::VecDeque;
use std::time::Duration;

use proto::task::{EvaluationResult, Failure, FailureReason, Report, Task, TaskResult};
use proto::{Introduction, Lease, Principal, WorkerId};

use super::super::{Answer, Poll};

/// What a worker makes of its jobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Nature {
    /// The right result.
    Honest,
    /// The right result, or none.
    Failing,
    /// A result of its own; all of one principal have the same.
    Lying,
    /// None.
    Sick,
}

/// The principal at the address that has this last byte.
pub fn by_address(number: u8) -> Principal {
    Introduction::sample("", number).principal
}

/// One worker.
pub struct Actor {
    pub id: WorkerId,
    pub principal: Principal,
    pub nature: Nature,
    /// Jobs take so many times as long as on others.
    pub slowness: u32,
    pub registered: bool,
    pub quarantined: bool,
    pub dead: bool,
    /// It asks for no jobs.
    pub hangs: bool,
    /// Messages from and to it are lost until then.
    pub cut_until: Duration,
    pub sequence: u64,
    /// Grows when the poll under way is given up.
    pub call: u64,
    queue: VecDeque<(Lease, u32)>,
    /// The job in hand; without its lease once that was revoked.
    running: Option<(Option<Lease>, u32)>,
    finished: Vec<Report>,
}

/// The descriptor of a task stands for the task, and its number decides the result.
pub fn number(task: &Task) -> u32 {
    u32::from_le_bytes(task.subject().descriptor.bytes().try_into().unwrap())
}

/// The right result.
pub fn truth(number: u32) -> u32 {
    number * 7 % 100
}

impl Actor {
    pub fn new(index: usize, (nature, principal): (Nature, Principal), slowness: u32) -> Self {
        let mut id = [0; 16];
        id[..8].copy_from_slice(&(index as u64 + 1).to_be_bytes());
        Self {
            id: WorkerId(id),
            principal,
            nature,
            slowness,
            registered: false,
            quarantined: false,
            dead: false,
            hangs: false,
            cut_until: Duration::ZERO,
            sequence: 0,
            call: 0,
            queue: VecDeque::new(),
            running: None,
            finished: Vec::new(),
        }
    }

    pub fn held(&self) -> Vec<Lease> {
        let running = self.running.and_then(|(lease, _)| lease);
        running.into_iter().chain(self.queue.iter().map(|(lease, _)| *lease)).collect()
    }

    pub fn wanted(&self) -> usize {
        let is_free = !self.hangs && self.running.is_none_or(|(lease, _)| lease.is_some());
        if is_free { 2usize.saturating_sub(self.held().len()) } else { 0 }
    }

    pub fn has_reports(&self) -> bool {
        !self.finished.is_empty()
    }

    /// The next poll.
    pub fn poll(&mut self, leaving: bool) -> Poll {
        self.sequence += 1;
        let (held, wanted) = if leaving { (Vec::new(), 0) } else { (self.held(), self.wanted()) };
        Poll { sequence: self.sequence, held, finished: self.finished.clone(), wanted, leaving }
    }

    pub fn absorb(&mut self, answer: &Answer) {
        self.finished.retain(|report| !answer.acknowledged.contains(&report.lease));
        self.queue.retain(|(lease, _)| !answer.revoked.contains(lease));
        if let Some((lease, _)) = &mut self.running {
            *lease = lease.filter(|lease| !answer.revoked.contains(lease));
        }
        for (lease, task) in &answer.jobs {
            if !self.held().contains(lease) {
                self.queue.push_back((*lease, number(task)));
            }
        }
    }

    /// Takes up the next job, if none is in hand; returns whether it did.
    pub fn start(&mut self) -> bool {
        if self.running.is_some() {
            return false;
        }
        self.running = self.queue.pop_front().map(|(lease, number)| (Some(lease), number));
        self.running.is_some()
    }

    /// The job in hand is done; `fails` says whether a worker that may fail does, `is_sick` whether a sick one does.
    pub fn finish(&mut self, fails: bool, is_sick: bool) {
        let Some((Some(lease), number)) = self.running.take() else { return };
        let report = match self.nature {
            Nature::Failing if fails => failed(lease),
            Nature::Sick if is_sick => failed(lease),
            Nature::Lying => self.lie_about(lease),
            _ => counted(lease, truth(number)),
        };
        self.finished.push(report);
    }

    /// A report that is wrong.
    pub fn lie_about(&self, lease: Lease) -> Report {
        let [.., last] = *self.principal.to_string().as_bytes() else { unreachable!("a text") };
        counted(lease, 100 + u32::from(last))
    }
}

fn failed(lease: Lease) -> Report {
    Report { lease, run_seconds: 1.0, outcome: Err(Failure::new(FailureReason::Panic, "out of memory")) }
}

fn counted(lease: Lease, correct: u32) -> Report {
    let result = EvaluationResult {
        queries: 1000,
        object_correct: correct,
        category_correct: correct,
        ..EvaluationResult::default()
    };
    Report { lease, run_seconds: 1.0, outcome: Ok(TaskResult::Evaluation(result)) }
}
