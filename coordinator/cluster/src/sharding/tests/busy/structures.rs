//! A search for structures: generations of evaluations of one channel or two, most of which their parents had, and the
//! scales of the channels that are new.

use std::collections::{BTreeMap, BTreeSet};

use chacha20::ChaCha8Rng;
use descriptor::random::stream;
use proto::Digest;
use proto::task::{DescriptorBytes, Evaluation, Facts, Scale, Subject};
use rand::RngExt;

use super::generations::{Asked, CLOUDS, Generations};
use crate::scheduler::{Channel, Finished};
use crate::sharding::{AwaitingScales, FoundScale};

/// Bytes of a cloud's signature in one channel.
pub const SIGNATURE: u64 = 400;
/// Counted cost of matching a pair of clouds in one channel, nanoseconds.
pub const PAIR: u64 = 20;
/// Individuals of a population.
const PARENTS: usize = 60;
/// Of a hundred children so many are better than a parent, and take its place.
const SUCCESSES: u32 = 30;
/// Seconds that one thread describes all clouds in a channel, by percentile: `experiments/structure.toml`, seed 1, on an
/// AMD EPYC (family 26).
const DESCRIBING: [(f64, f64); 9] = [
    (0.0, 0.008),
    (0.05, 0.013),
    (0.1, 0.016),
    (0.25, 0.022),
    (0.5, 0.033),
    (0.75, 0.055),
    (0.9, 0.072),
    (0.95, 0.086),
    (1.0, 0.120),
];

/// Its settings.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// Populations side by side.
    pub members: u32,
    /// Evaluations of a generation.
    pub evaluations: u32,
    /// Of a hundred evaluations those with so many channels, of which so many are new.
    pub kinds: [(u32, usize, usize); 5],
    /// What describing takes, times what it takes with [`DESCRIBING`].
    pub describing: f64,
}

/// A channel by its number.
type Number = u64;

/// What such a search has found so far.
pub struct Structures {
    setting: Setting,
    /// Of each member.
    random: Vec<ChaCha8Rng>,
    /// Counted cost of describing a cloud in each channel so far, by number.
    costs: Vec<u64>,
    /// Of each member.
    parents: Vec<Vec<Vec<Number>>>,
    /// The children that each has already in the next generation.
    foreseen: Vec<Option<Vec<Vec<Number>>>>,
    /// What was evaluated.
    met: BTreeSet<Vec<Number>>,
    scales: BTreeMap<Number, FoundScale>,
    /// Channels whose scales were asked for last.
    asked: Vec<Number>,
}

impl Structures {
    pub fn new(setting: Setting) -> Self {
        let mut structures = Self {
            setting,
            random: (0..setting.members).map(|member| stream(1, "structures", &[member.into()])).collect(),
            costs: Vec::new(),
            parents: Vec::new(),
            foreseen: vec![None; setting.members as usize],
            met: BTreeSet::new(),
            scales: BTreeMap::new(),
            asked: Vec::new(),
        };
        for member in 0..setting.members as usize {
            let parents =
                (0..PARENTS).map(|_| vec![structures.new_channel(member), structures.new_channel(member)]);
            let parents = parents.collect();
            structures.parents.push(parents);
        }
        structures
    }

    fn new_channel(&mut self, member: usize) -> Number {
        let percentile = self.random[member].random_range(0.0..1.0);
        let above = DESCRIBING.iter().position(|(share, _)| *share > percentile).unwrap();
        let [(from, least), (to, most)] = [DESCRIBING[above - 1], DESCRIBING[above]];
        let seconds = least + (most - least) * (percentile - from) / (to - from);
        self.costs.push((self.setting.describing * seconds * 1e9 / f64::from(2 * CLOUDS)) as u64);
        self.costs.len() as Number - 1
    }

    /// A child of a member: channels of one parent or two, and new ones.
    fn child(&mut self, member: usize) -> Vec<Number> {
        let mut left = self.random[member].random_range(0..100);
        let kinds = self.setting.kinds.iter();
        let kind = kinds.copied().find(|(share, ..)| {
            let is_it = left < *share;
            left = left.saturating_sub(*share);
            is_it
        });
        let (_, channels, new) = kind.unwrap();
        let mut child = BTreeSet::new();
        while child.len() < channels - new {
            let parent = &self.parents[member][self.random[member].random_range(0..PARENTS)];
            child.insert(parent[self.random[member].random_range(0..parent.len())]);
        }
        child.extend((0..new).map(|_| self.new_channel(member)));
        let child: Vec<Number> = child.into_iter().collect();
        if self.random[member].random_range(0..100) < SUCCESSES {
            let place = self.random[member].random_range(0..PARENTS);
            self.parents[member][place].clone_from(&child);
        }
        child
    }

    /// The next children of a member, once.
    fn children(&mut self, member: usize) -> Vec<Vec<Number>> {
        if let Some(children) = self.foreseen[member].take() {
            return children;
        }
        let Setting { members, evaluations, .. } = self.setting;
        let numbers = (0..evaluations).filter(|number| number % members == member as u32);
        numbers.map(|_| self.child(member)).collect::<BTreeSet<_>>().into_iter().collect()
    }

    /// Asks for children, each of a member, and gives the channels whose scales are asked for.
    fn ask(&self, children: &[(usize, Vec<Number>)], sides: [Digest; 2]) -> (Asked, Vec<Number>) {
        let channels = children.iter().flat_map(|(_, child)| child).copied();
        let new: BTreeSet<Number> = channels.filter(|channel| !self.scales.contains_key(channel)).collect();
        let mut new: Vec<Number> = new.into_iter().collect();
        new.sort_by_key(|&channel| std::cmp::Reverse(self.costs[channel as usize]));
        let scale = |&channel: &Number| Scale {
            subject: self.subject(&[channel]),
            splits: sides.into(),
            clouds: 2 * CLOUDS,
            described: Vec::new(),
        };
        let evaluation = |(_, channels): &(usize, Vec<Number>)| {
            let mut evaluation = Evaluation {
                subject: self.subject(channels),
                query: sides.into(),
                database: sides.into(),
                scales: vec![1.0; channels.len()],
                ..Evaluation::sample(0, 2 * CLOUDS, 2 * CLOUDS)
            };
            let mut awaited = Vec::new();
            for (place, channel) in (0..).zip(channels) {
                match self.scales.get(channel) {
                    Some(found) => found.scale(place, &mut evaluation),
                    None => awaited.push((place, new.iter().position(|one| one == channel).unwrap())),
                }
            }
            AwaitingScales { evaluation, awaited }
        };
        let asked = Asked {
            evaluations: children.iter().map(evaluation).collect(),
            parts: children.iter().map(|(member, _)| *member).collect(),
            scales: new.iter().map(scale).collect(),
            needed_by: children.iter().map(|(_, child)| self.subject(child).descriptor).collect(),
        };
        (asked, new)
    }

    fn subject(&self, channels: &[Number]) -> Subject {
        let costs = channels.iter().map(|&channel| self.costs[channel as usize]);
        let described = channels.iter().zip(costs.clone());
        let bytes =
            described.flat_map(|(channel, cost)| [channel.to_le_bytes(), cost.to_le_bytes()]).flatten();
        let count = channels.len() as u64;
        let facts = Facts {
            label: format!("{channels:?}"),
            description_bytes: count * SIGNATURE,
            cloud_cost: costs.sum(),
            pair_cost: count * PAIR,
        };
        Subject { descriptor: bytes.collect::<Vec<u8>>().into(), facts, ..Subject::sample(0) }
    }
}

/// The channels of a descriptor of [`Structures`]; none of any other.
pub fn channels_of(descriptor: &DescriptorBytes) -> Vec<Channel> {
    let number = |bytes: &[u8]| u64::from_le_bytes(bytes.try_into().unwrap());
    let channel = |bytes: &[u8]| Channel { number: number(&bytes[..8]), cost: number(&bytes[8..]) };
    descriptor.bytes().chunks_exact(16).map(channel).collect()
}

impl Generations for Structures {
    fn next(&mut self, sides: [Digest; 2]) -> Asked {
        let members = 0..self.setting.members as usize;
        let mut children: Vec<(usize, Vec<Number>)> = Vec::new();
        for member in members {
            children.extend(self.children(member).into_iter().map(|child| (member, child)));
        }
        children.retain(|(_, child)| self.met.insert(child.clone()));
        let (asked, new) = self.ask(&children, sides);
        self.asked = new;
        asked
    }

    fn foresee(&mut self, part: usize, sides: [Digest; 2]) -> Option<Asked> {
        let children = self.children(part);
        let new = children.iter().filter(|child| !self.met.contains(*child));
        let (asked, _) = self.ask(&new.map(|child| (part, child.clone())).collect::<Vec<_>>(), sides);
        self.foreseen[part] = Some(children);
        Some(asked)
    }

    fn found(&mut self, scales: Vec<Finished<FoundScale>>) {
        let scales = scales.into_iter().map(|finished| finished.result);
        self.scales.extend(std::mem::take(&mut self.asked).into_iter().zip(scales));
    }
}
