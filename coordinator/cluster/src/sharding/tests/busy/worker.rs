//! A worker that keeps to the protocol and only waits, on a virtual clock: see the crate `worker`.

use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use proto::task::{Described, Evaluation, EvaluationResult, Match, Report, Task, TaskResult, Tile};
use proto::{Digest, Introduction, Lease, WorkerId};

use crate::scheduler::{Answer, Caller, Poll};

/// Bytes that a cloud's description takes.
const DESCRIPTION: u64 = 1504;
/// Bytes that stand for them.
pub const STAND_IN: u64 = 8;

/// One worker.
pub struct Worker {
    pub caller: Caller,
    /// Its jobs take so many times as long as there is to do.
    slowness: f64,
    ahead: usize,
    sequence: u64,
    /// Grows when the poll under way is given up.
    pub call: u64,
    queue: VecDeque<(Lease, Arc<Task>)>,
    running: Option<(Lease, Arc<Task>, Duration)>,
    finished: Vec<Report>,
    /// Descriptions that it has made or fetched.
    known: BTreeSet<Digest>,
    /// Bytes of descriptions that it has handed in and fetched.
    pub traffic: [u64; 2],
}

impl Worker {
    pub fn new(number: usize, slowness: f64, ahead: usize) -> Self {
        let mut id = [0; 16];
        id[..8].copy_from_slice(&(number as u64 + 1).to_be_bytes());
        Self {
            caller: (WorkerId(id), Self::introduction().principal),
            slowness,
            ahead,
            sequence: 0,
            call: 0,
            queue: VecDeque::new(),
            running: None,
            finished: Vec::new(),
            known: BTreeSet::new(),
            traffic: [0; 2],
        }
    }

    /// All are at one address.
    pub fn introduction() -> Introduction {
        Introduction::sample("worker", 1)
    }

    fn held(&self) -> impl Iterator<Item = Lease> {
        let running = self.running.as_ref().map(|(lease, ..)| *lease);
        running.into_iter().chain(self.queue.iter().map(|(lease, _)| *lease))
    }

    pub fn wanted(&self) -> usize {
        (1 + self.ahead).saturating_sub(self.held().count())
    }

    pub fn is_idle(&self) -> bool {
        self.running.is_none()
    }

    /// The next poll.
    pub fn poll(&mut self) -> Poll {
        (self.sequence, self.call) = (self.sequence + 1, self.call + 1);
        let (held, finished, wanted) = (self.held().collect(), self.finished.clone(), self.wanted());
        Poll { sequence: self.sequence, held, finished, wanted, leaving: false }
    }

    pub fn absorb(&mut self, answer: Answer) {
        self.finished.retain(|report| !answer.acknowledged.contains(&report.lease));
        self.queue.retain(|(lease, _)| !answer.revoked.contains(lease));
        self.queue.extend(answer.jobs);
    }

    /// Takes up the next job, if none is in hand; how long it takes, and which it is.
    pub fn start(&mut self, now: Duration, seconds: impl Fn(&Task) -> f64) -> Option<(Duration, Arc<Task>)> {
        if self.running.is_some() {
            return None;
        }
        let (lease, task) = self.queue.pop_front()?;
        if let Task::Tile(tile) = &*task {
            self.fetch(tile);
        }
        let took = Duration::from_secs_f64(seconds(&task) * self.slowness);
        self.running = Some((lease, Arc::clone(&task), now));
        Some((took, task))
    }

    /// Fetches the descriptions that it lacks.
    fn fetch(&mut self, tile: &Tile) {
        let Evaluation { queries, database_clouds, .. } = tile.evaluation;
        for (descriptions, clouds) in
            [(&tile.query_descriptions, queries), (&tile.database_descriptions, database_clouds)]
        {
            let lacking = descriptions.iter().filter(|digest| self.known.insert(**digest)).count() as u64;
            self.traffic[1] += lacking * u64::from(clouds) * DESCRIPTION / descriptions.len() as u64;
        }
    }

    /// The job in hand is done. Returns its lease and when it was begun.
    pub fn finish(&mut self, now: Duration) -> Option<(Lease, Duration)> {
        let (lease, task, begun) = self.running.take()?;
        let result = match &*task {
            Task::Description(shard) => {
                let described = Described::new(task.job(0).0.to_le_bytes().repeat(shard.clouds as usize));
                self.known.insert(described.digest);
                self.traffic[0] += u64::from(shard.clouds) * DESCRIPTION;
                TaskResult::Description(described)
            }
            Task::Evaluation(evaluation) | Task::Tile(Tile { evaluation, .. }) => {
                let found = Match { nearest: 0, distance: 1.0, runner_up: Some((1, 1.0)) };
                let matches = if evaluation.want_matches { evaluation.queries as usize } else { 0 };
                TaskResult::Evaluation(EvaluationResult {
                    queries: evaluation.queries,
                    object_correct: 0,
                    category_correct: 0,
                    matches: vec![found; matches],
                    ..EvaluationResult::default()
                })
            }
            Task::GridCell(_) | Task::Scale(_) => panic!("{task}"),
        };
        self.finished.push(Report { lease, run_seconds: (now - begun).as_secs_f64(), outcome: Ok(result) });
        Some((lease, begun))
    }
}
