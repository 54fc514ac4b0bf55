//! A worker that keeps to the protocol and only waits, on a virtual clock: see the crate `worker`.

use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use proto::task::{
    Described, DescribedSplit, Description, Evaluation, EvaluationResult, Match, Report, Scale, Task,
    TaskResult, Tile,
};
use proto::{Digest, Introduction, Lease, WorkerId};

use super::generations::CLOUDS;
use super::structures::{PAIR, SIGNATURE, channels_of};
use crate::scheduler::{Answer, Caller, Channel, Poll};

/// Bytes that a cloud's description takes.
const DESCRIPTION: u64 = 1504;
/// Bytes that stand for them.
pub const STAND_IN: u64 = 8;

/// A nanosecond, which a unit of cost takes.
const UNIT: f64 = 1e-9;
/// To take a cloud's signature in one channel from the coordinator, seconds.
const TAKING: f64 = 3e-6;
/// To recognise all clouds by distances that are there, seconds.
const RECOGNISING: f64 = 2e-3;

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
    /// Splits and channels that it keeps signatures of, …
    signatures: BTreeSet<(u64, Digest)>,
    /// … and channels of which it keeps the distances of all clouds.
    distances: BTreeSet<u64>,
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
            signatures: BTreeSet::new(),
            distances: BTreeSet::new(),
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
    pub fn start(&mut self, now: Duration) -> Option<(Duration, Arc<Task>)> {
        if self.running.is_some() {
            return None;
        }
        let (lease, task) = self.queue.pop_front()?;
        if let Task::Tile(tile) = &*task {
            self.fetch(tile);
        }
        let took = Duration::from_secs_f64(self.seconds(&task) * self.slowness);
        self.running = Some((lease, Arc::clone(&task), now));
        Some((took, task))
    }

    /// What a task takes where nothing is done again that is kept.
    fn seconds(&mut self, task: &Task) -> f64 {
        let channels = channels_of(&task.subject().descriptor);
        match task {
            Task::Description(Description { manifest, clouds, .. }) if !channels.is_empty() => {
                let of_channel = |channel: &Channel| {
                    let is_new = self.signatures.insert((channel.number, *manifest));
                    if is_new { describing(channel, *clouds) } else { 0.0 }
                };
                channels.iter().map(of_channel).sum()
            }
            Task::Scale(Scale { splits, described, .. }) => {
                channels.iter().map(|channel| self.matching(channel, splits, described)).sum()
            }
            Task::Evaluation(Evaluation { query, described, .. }) if !channels.is_empty() => {
                let matching = (0..).zip(&channels).map(|(place, channel)| {
                    let described: Vec<DescribedSplit> =
                        described.iter().filter(|one| one.channel == place).cloned().collect();
                    self.matching(channel, query, &described)
                });
                matching.sum::<f64>() + RECOGNISING
            }
            Task::Description(_) | Task::Evaluation(_) | Task::Tile(_) | Task::GridCell(_) => {
                task.cost() as f64 * UNIT
            }
        }
    }

    /// To have the distances of the clouds of some splits among each other in a channel.
    fn matching(&mut self, channel: &Channel, splits: &[Digest], described: &[DescribedSplit]) -> f64 {
        if !self.distances.insert(channel.number) {
            return 0.0;
        }
        let mut seconds = f64::from(2 * CLOUDS * CLOUDS) * PAIR as f64 * UNIT;
        for split in splits {
            if !self.signatures.insert((channel.number, *split)) {
                continue;
            }
            let at_coordinator = described.iter().find(|one| one.split == *split);
            let Some(DescribedSplit { shards, .. }) = at_coordinator else {
                seconds += describing(channel, CLOUDS);
                continue;
            };
            let lacking = shards.iter().filter(|shard| self.known.insert(shard.description)).count();
            let clouds = CLOUDS as usize * lacking / shards.len();
            self.traffic[1] += clouds as u64 * SIGNATURE;
            seconds += clouds as f64 * TAKING;
        }
        seconds
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
                let bytes = shard.subject.facts.description_bytes;
                let words =
                    task.job(0).0.to_le_bytes().repeat((bytes / 8 * u64::from(shard.clouds)) as usize);
                let described = Described::new(words);
                self.known.insert(described.digest);
                let sent = if bytes == STAND_IN { DESCRIPTION } else { bytes };
                self.traffic[0] += u64::from(shard.clouds) * sent;
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
            Task::Scale(_) => TaskResult::Scale(1.0),
            Task::GridCell(_) => panic!("{task}"),
        };
        self.finished.push(Report { lease, run_seconds: (now - begun).as_secs_f64(), outcome: Ok(result) });
        Some((lease, begun))
    }
}

/// Seconds for describing so many clouds in a channel.
fn describing(channel: &Channel, clouds: u32) -> f64 {
    (channel.cost * u64::from(clouds)) as f64 * UNIT
}
