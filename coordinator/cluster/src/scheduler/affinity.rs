//! Which worker has described the clouds in which channels: it keeps their signatures, and others would have to make them
//! again.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use proto::WorkerId;
use proto::task::{DescriptorBytes, Task};

use super::{ClientId, Scheduler};
use crate::cost::{CountedCost, counted_cost, counted_cost_describing};
use crate::store::Job;

/// A channel of a descriptor that workers keep signatures of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Equal for equal channels.
    pub number: u64,
    /// Counted cost of describing a cloud in it.
    pub cost: u64,
}

/// The channels of a descriptor that workers keep signatures of.
pub type ChannelsOf = fn(&DescriptorBytes) -> Vec<Channel>;

/// Of so many jobs, from the first that it may take, a worker gets the one after which it has least to describe that
/// another has described already.
const CHOICE: usize = 64;
/// Evaluations that are looked at for each scale they need. More make the choice no better, and every poll longer.
const MOST_EVALUATIONS: usize = 4;
/// A job that has waited for so long is handed out before those that a worker has more of.
const LONGEST_WAIT: Duration = Duration::from_secs(60);
/// Channels that are remembered of a worker: about as many as it keeps in memory.
const MOST_CHANNELS: usize = 512;

/// The channels in which a worker was last given clouds to describe.
#[derive(Debug, Default)]
pub(super) struct Described {
    channels: BTreeSet<u64>,
    in_order: VecDeque<u64>,
}

impl Described {
    pub(super) fn add(&mut self, channels: &[Channel]) {
        for &Channel { number, .. } in channels {
            if self.channels.insert(number) {
                self.in_order.push_back(number);
            }
        }
        while self.in_order.len() > MOST_CHANNELS {
            if let Some(oldest) = self.in_order.pop_front() {
                self.channels.remove(&oldest);
            }
        }
    }

    /// Counted cost of describing a cloud in those of these channels that it does not have.
    fn missing(&self, channels: &[Channel]) -> u64 {
        let missing = channels.iter().filter(|channel| !self.channels.contains(&channel.number));
        missing.map(|channel| channel.cost).fold(0, u64::saturating_add)
    }
}

/// What a job has to do with channels.
#[derive(Clone, Debug, Default)]
pub struct JobChannels {
    /// Whoever takes the job will have described whole splits in these.
    pub described: Vec<Channel>,
    /// It is best taken by a worker that has described most of one of these: an evaluation's channels, or, of a scale, the
    /// other channels of each evaluation that waits for it, as the same worker is then given that evaluation.
    beside: Vec<Arc<[Channel]>>,
}

impl JobChannels {
    /// Counted cost a cloud of what has to be described again if this worker takes the job, because others have it.
    fn again(&self, described: &Described) -> u64 {
        self.beside.iter().map(|channels| described.missing(channels)).min().unwrap_or(0)
    }
}

/// The evaluations for which a client asks for scales, by their channels.
#[derive(Debug, Default)]
pub(super) struct Expected {
    evaluations: Vec<Arc<[Channel]>>,
    /// The first evaluations with each channel.
    with: BTreeMap<u64, Vec<usize>>,
}

impl Expected {
    fn new(evaluations: impl Iterator<Item = Vec<Channel>>) -> Self {
        let mut expected = Self::default();
        for channels in evaluations {
            for channel in &channels {
                let with = expected.with.entry(channel.number).or_default();
                if with.len() < MOST_EVALUATIONS {
                    with.push(expected.evaluations.len());
                }
            }
            expected.evaluations.push(channels.into());
        }
        expected
    }

    /// The other channels of the evaluations with this one.
    fn beside(&self, channel: Channel) -> Vec<Arc<[Channel]>> {
        let with = self.with.get(&channel.number).into_iter().flatten();
        let others = |place: &usize| {
            let others = self.evaluations[*place].iter().filter(|other| other.number != channel.number);
            others.copied().collect()
        };
        with.map(others).collect()
    }
}

impl Scheduler {
    /// A client is about to ask for the scales that these descriptors need, to evaluate them next.
    pub fn expect_evaluations(&mut self, client: ClientId, descriptors: &[DescriptorBytes]) {
        let expected = Expected::new(descriptors.iter().map(self.limits.channels_of));
        self.expected.insert(client, expected);
    }

    /// What a task has to do with channels. Whoever describes a shard or matches a tile keeps nothing of whole splits.
    pub(super) fn channels(&self, task: &Task, client: ClientId) -> JobChannels {
        let described = match task {
            Task::Evaluation(_) | Task::Scale(_) => (self.limits.channels_of)(&task.subject().descriptor),
            Task::Description(_) | Task::Tile(_) | Task::GridCell(_) => return JobChannels::default(),
        };
        let beside = match (task, self.expected.get(&client)) {
            (Task::Scale(_), None) => Vec::new(),
            (Task::Scale(_), Some(expected)) => {
                described.iter().flat_map(|&channel| expected.beside(channel)).collect()
            }
            _ => vec![described.as_slice().into()],
        };
        JobChannels { described, beside }
    }

    /// What a job costs a worker, which need not describe what it has described.
    pub(super) fn cost_to(&self, id: WorkerId, job: &Job) -> CountedCost {
        match self.workers.get(&id) {
            Some(worker) if !job.channels.described.is_empty() => {
                counted_cost_describing(&job.task, worker.described.missing(&job.channels.described))
            }
            _ => counted_cost(&job.task),
        }
    }

    /// Of jobs that a worker may take, in order, the one after which it has least to describe that another has, the first of
    /// them; the first of all if that has waited too long.
    pub(super) fn best_match<'a, Id: Copy>(
        &self,
        id: WorkerId,
        jobs: impl Iterator<Item = (Id, &'a Job)>,
        now: Instant,
    ) -> Option<Id> {
        let described = &self.workers.get(&id)?.described;
        let mut best: Option<(u64, Id)> = None;
        for (job_id, job) in jobs.take(CHOICE) {
            let again = job.channels.again(described);
            let is_urgent = best.is_none() && now.saturating_duration_since(job.submitted) > LONGEST_WAIT;
            if again == 0 || is_urgent {
                return Some(job_id);
            }
            if best.is_none_or(|(least, _)| again < least) {
                best = Some((again, job_id));
            }
        }
        best.map(|(_, job_id)| job_id)
    }
}
