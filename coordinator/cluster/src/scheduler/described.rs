//! What workers have described: clouds of whole splits, channel by channel. They keep these signatures, and others would
//! have to make them again.

use std::cmp::Reverse;
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use proto::task::{DescribedSplit, Description, DescriptorBytes, Evaluation, Scale, Task};
use proto::{Digest, WorkerId};

/// Evaluations that are looked at for each scale they need. More make the choice no better, and every poll longer.
const MOST_EVALUATIONS: usize = 4;
/// Splits that are remembered of a worker, each in one channel: about as many as it keeps in memory.
const MOST_DESCRIBED: usize = 1536;
/// Workers that are looked at for a job, to find who has least to describe.
const MOST_HOLDERS: usize = 16;
/// They are looked for in the lists of who has which channel of which split, as far as so many entries.
const MOST_SEEN: usize = 256;
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
    /// What was described before, which has only to be taken from the coordinator.
    at_coordinator: BTreeSet<Place>,
    /// It is best taken by a worker that has described most of one of these: an evaluation's channels, or, of a scale, the
    /// other channels of each evaluation that waits for it, as the same worker is then given that evaluation. Of
    /// each, the dearest come first.
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
            (Task::Evaluation(_), _) => vec![dearest_first(channels.clone())],
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

/// Channel and split.
type Place = (u64, u64);

/// What workers were last given to describe, or to take from the coordinator.
#[derive(Debug, Default)]
pub(super) struct Described {
    workers: BTreeMap<WorkerId, DescribedByOne>,
    /// The same by place.
    holders: BTreeMap<Place, BTreeSet<WorkerId>>,
}

#[derive(Debug, Default)]
struct DescribedByOne {
    all: BTreeSet<Place>,
    in_order: VecDeque<Place>,
}

impl Described {
    /// A job was given to a worker.
    pub(super) fn add(&mut self, id: WorkerId, job: &JobChannels) {
        let one = self.workers.entry(id).or_default();
        for place in named(&job.channels, &job.splits) {
            if one.all.insert(place) {
                one.in_order.push_back(place);
                self.holders.entry(place).or_default().insert(id);
            }
        }
        while one.in_order.len() > MOST_DESCRIBED {
            if let Some(oldest) = one.in_order.pop_front() {
                one.all.remove(&oldest);
                forget(&mut self.holders, oldest, id);
            }
        }
    }

    /// A job was not done after all.
    pub(super) fn remove(&mut self, id: WorkerId, job: &JobChannels) {
        let Some(one) = self.workers.get_mut(&id) else { return };
        for place in named(&job.channels, &job.splits) {
            if one.all.remove(&place) {
                one.in_order.retain(|other| *other != place);
                forget(&mut self.holders, place, id);
            }
        }
    }

    /// A worker has left.
    pub(super) fn remove_worker(&mut self, id: WorkerId) {
        for place in self.workers.remove(&id).map(|one| one.in_order).unwrap_or_default() {
            forget(&mut self.holders, place, id);
        }
    }

    /// Counted cost of describing what a job needs described and the worker has not.
    pub(super) fn missing(&self, id: WorkerId, job: &JobChannels) -> u64 {
        self.missing_in(id, &job.channels, job)
    }

    /// Counted cost of what a worker will have to describe if it takes the job and what follows from that, beyond what the
    /// best of those that may take it would have to. Of many, only the first that have the dearest channels are looked at.
    pub(super) fn beyond_least(
        &self,
        id: WorkerId,
        job: &JobChannels,
        may_take: impl Fn(WorkerId) -> bool,
    ) -> u64 {
        let own = self.again(id, job);
        if own == 0 {
            return 0;
        }
        let places = job.beside.iter().flat_map(|channels| named(channels, &job.splits));
        let holders = places.filter_map(|place| self.holders.get(&place)).flatten().take(MOST_SEEN);
        let mut seen = BTreeSet::new();
        let others = holders.filter(|holder| seen.insert(**holder) && may_take(**holder)).take(MOST_HOLDERS);
        let least = others.map(|other| self.again(*other, job)).min();
        own.saturating_sub(least.unwrap_or(own))
    }

    /// Counted cost of what a worker will have to describe if it takes the job and what follows from that, and another may
    /// have described already.
    fn again(&self, id: WorkerId, job: &JobChannels) -> u64 {
        job.beside.iter().map(|channels| self.missing_in(id, channels, job)).min().unwrap_or(0)
    }

    fn missing_in(&self, id: WorkerId, channels: &[Channel], job: &JobChannels) -> u64 {
        let described = self.workers.get(&id);
        let mut missing = 0u64;
        for channel in channels {
            for split in &job.splits {
                let place = (channel.number, split.number);
                if !described.is_some_and(|one| one.all.contains(&place)) {
                    let part = if job.at_coordinator.contains(&place) { TAKING } else { 1 };
                    missing = missing.saturating_add(split.clouds.saturating_mul(channel.cost) / part);
                }
            }
        }
        missing
    }
}

fn forget(holders: &mut BTreeMap<Place, BTreeSet<WorkerId>>, place: Place, id: WorkerId) {
    if let Entry::Occupied(mut entry) = holders.entry(place) {
        entry.get_mut().remove(&id);
        if entry.get().is_empty() {
            entry.remove();
        }
    }
}

fn dearest_first(mut channels: Vec<Channel>) -> Arc<[Channel]> {
    channels.sort_by_key(|channel| Reverse(channel.cost));
    channels.into()
}

fn named(channels: &[Channel], splits: &[Split]) -> impl Iterator<Item = Place> {
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
            expected.evaluations.push(dearest_first(channels));
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A job with one channel or several on some splits, or one that goes with others.
    fn jobs() -> impl Strategy<Value = JobChannels> {
        let channel = (0u64..6).prop_map(|number| Channel { number, cost: 1 + number * number });
        let channels = prop::collection::vec(channel, 1..4);
        let split = (0u64..3).prop_map(|number| Split { number, clouds: 10 + number });
        let beside = prop::collection::vec(channels.clone().prop_map(Arc::from), 0..3);
        let at_coordinator = prop::collection::btree_set((0u64..6, 0u64..3), 0..4);
        let parts = (channels, prop::collection::vec(split, 1..3), at_coordinator, beside);
        parts.prop_map(|(channels, splits, at_coordinator, beside)| JobChannels {
            channels,
            splits,
            at_coordinator,
            beside,
        })
    }

    /// What happens to one of six workers.
    fn happenings() -> impl Strategy<Value = Vec<(u8, Option<(bool, JobChannels)>)>> {
        let happening = (0u8..6, prop::option::weighted(0.9, (prop::bool::weighted(0.8), jobs())));
        prop::collection::vec(happening, 0..40)
    }

    fn worker(number: u8) -> WorkerId {
        WorkerId([number; 16])
    }

    proptest! {
        #[test]
        fn the_best_suited_worker_is_found_by_who_has_what(
            happenings in happenings(),
            asked in jobs(),
            away in 0u8..6,
        ) {
            let mut described = Described::default();
            for (number, happening) in happenings {
                match happening {
                    Some((true, job)) => described.add(worker(number), &job),
                    Some((false, job)) => described.remove(worker(number), &job),
                    None => described.remove_worker(worker(number)),
                }
            }
            for number in 0..6 {
                let own = described.again(worker(number), &asked);
                let others = (0..6).filter(|other| *other != away).map(|other| described.again(worker(other), &asked));
                let expected = own - others.min().unwrap().min(own);
                let may_take = |id| id != worker(away);
                prop_assert_eq!(described.beyond_least(worker(number), &asked, may_take), expected);
            }
            let held: usize = described.holders.values().map(BTreeSet::len).sum();
            let kept: usize = described.workers.values().map(|one| one.all.len()).sum();
            prop_assert_eq!(held, kept);
            prop_assert!(described.holders.values().all(|holders| !holders.is_empty()));
            for number in 0..6 {
                described.remove_worker(worker(number));
            }
            prop_assert!(described.holders.is_empty());
        }
    }
}
