//! What workers have described: clouds of whole splits, channel by channel. They keep these signatures, and others would
//! have to make them again.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use proto::Digest;
use proto::task::{DescribedSplit, Description, DescriptorBytes, Evaluation, Scale, Task};

/// Evaluations that are looked at for each scale they need. More make the choice no better, and every poll longer.
const MOST_EVALUATIONS: usize = 4;
/// Splits that are remembered of a worker, each in one channel: about as many as it keeps in memory.
const MOST_DESCRIBED: usize = 1536;
/// Taking descriptions from the coordinator is counted as one such part of describing: only channels that take long to
/// describe are there.
const TAKING: u64 = 8;

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

/// A split whose clouds are described together.
#[derive(Clone, Copy, Debug)]
struct Split {
    /// The start of its manifest's digest.
    number: u64,
    clouds: u64,
}

/// What a job has to do with channels; nothing, if its subject has none that are kept.
#[derive(Clone, Debug, Default)]
pub struct JobChannels {
    /// Whoever takes the job will have described the splits in these.
    channels: Vec<Channel>,
    splits: Vec<Split>,
    /// Channel and split of what was described before, which has only to be taken from the coordinator.
    at_coordinator: BTreeSet<(u64, u64)>,
    /// It is best taken by a worker that has described most of one of these: an evaluation's channels, or, of a scale, the
    /// other channels of each evaluation that waits for it, as the same worker is then given that evaluation.
    beside: Vec<Arc<[Channel]>>,
}

impl JobChannels {
    /// Of a task whose client has told what it will evaluate next. A shard is a split here: it may be a whole one. Whoever
    /// matches a tile keeps nothing of splits.
    pub(super) fn new(task: &Task, channels_of: ChannelsOf, expected: Option<&Expected>) -> Self {
        let (splits, described) = match task {
            Task::Evaluation(evaluation) => (splits_of(evaluation), &evaluation.described[..]),
            Task::Scale(Scale { splits, clouds, described, .. }) => {
                (side(splits, *clouds).collect(), &described[..])
            }
            Task::Description(Description { manifest, clouds, .. }) => {
                (side(&[*manifest], *clouds).collect(), &[][..])
            }
            Task::Tile(_) | Task::GridCell(_) => return Self::default(),
        };
        let channels = channels_of(&task.subject().descriptor);
        let beside = match (task, expected) {
            (Task::Evaluation(_), _) => vec![channels.as_slice().into()],
            (_, None) => Vec::new(),
            (_, Some(expected)) => channels.iter().flat_map(|&channel| expected.beside(channel)).collect(),
        };
        let place = |described: &DescribedSplit| {
            let channel = channels.get(described.channel as usize)?;
            Some((channel.number, number(&described.split)))
        };
        let at_coordinator = described.iter().filter_map(place).collect();
        Self { channels, splits, at_coordinator, beside }
    }

    /// Whether whoever takes the job keeps nothing that another job could use.
    pub(super) fn is_empty(&self) -> bool {
        self.channels.is_empty()
    }
}

/// The splits of an evaluation, each once.
fn splits_of(evaluation: &Evaluation) -> Vec<Split> {
    let query = side(&evaluation.query, evaluation.queries);
    let database = side(&evaluation.database, evaluation.database_clouds);
    let by_number: BTreeMap<u64, Split> = query.chain(database).map(|split| (split.number, split)).collect();
    by_number.into_values().collect()
}

/// The splits of one side. How its clouds fall to them is not known here: equally.
fn side(splits: &[Digest], clouds: u32) -> impl Iterator<Item = Split> {
    let clouds = u64::from(clouds).div_ceil(splits.len().max(1) as u64);
    splits.iter().map(move |split| Split { number: number(split), clouds })
}

fn number(Digest(bytes): &Digest) -> u64 {
    bytes.iter().take(8).fold(0, |number, &byte| number << 8 | u64::from(byte))
}

/// What a worker was last given to describe, or to take from the coordinator.
#[derive(Debug, Default)]
pub(super) struct Described {
    /// Channel and split.
    all: BTreeSet<(u64, u64)>,
    in_order: VecDeque<(u64, u64)>,
}

impl Described {
    /// A job was given to it.
    pub(super) fn add(&mut self, job: &JobChannels) {
        for one in named(&job.channels, &job.splits) {
            if self.all.insert(one) {
                self.in_order.push_back(one);
            }
        }
        while self.in_order.len() > MOST_DESCRIBED {
            if let Some(oldest) = self.in_order.pop_front() {
                self.all.remove(&oldest);
            }
        }
    }

    /// A job was not done after all.
    pub(super) fn remove(&mut self, job: &JobChannels) {
        for one in named(&job.channels, &job.splits) {
            if self.all.remove(&one) {
                self.in_order.retain(|other| *other != one);
            }
        }
    }

    /// Counted cost of describing what a job needs described and the worker has not.
    pub(super) fn missing(&self, job: &JobChannels) -> u64 {
        self.missing_in(&job.channels, job)
    }

    /// Counted cost of what the worker will have to describe if it takes the job and what follows from that, and another
    /// may have described already.
    pub(super) fn again(&self, job: &JobChannels) -> u64 {
        job.beside.iter().map(|channels| self.missing_in(channels, job)).min().unwrap_or(0)
    }

    fn missing_in(&self, channels: &[Channel], job: &JobChannels) -> u64 {
        let mut missing = 0u64;
        for channel in channels {
            for split in &job.splits {
                let one = (channel.number, split.number);
                if !self.all.contains(&one) {
                    let part = if job.at_coordinator.contains(&one) { TAKING } else { 1 };
                    missing = missing.saturating_add(split.clouds.saturating_mul(channel.cost) / part);
                }
            }
        }
        missing
    }
}

fn named(channels: &[Channel], splits: &[Split]) -> impl Iterator<Item = (u64, u64)> {
    channels.iter().flat_map(|channel| splits.iter().map(|split| (channel.number, split.number)))
}

/// The evaluations for which a client asks for scales, by their channels.
#[derive(Debug, Default)]
pub struct Expected {
    evaluations: Vec<Arc<[Channel]>>,
    /// The first evaluations with each channel.
    with: BTreeMap<u64, Vec<usize>>,
}

impl Expected {
    /// Evaluations of these descriptors.
    pub fn new(descriptors: &[DescriptorBytes], channels_of: ChannelsOf) -> Self {
        let mut expected = Self::default();
        for channels in descriptors.iter().map(channels_of) {
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
