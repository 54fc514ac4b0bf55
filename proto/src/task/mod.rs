//! The vocabulary of tasks: what a job asks of a worker. Coordinator, worker and journal use these types; `wire` turns
//! them into messages and back.

mod described;
mod manifest;
mod nearest;
mod opaque;
mod result;
mod rule;
#[cfg(test)]
mod tests;
mod wire;

use std::fmt;

use prost::Message as _;

pub use described::{DescribedShard, DescribedSplit};
pub use manifest::{CloudEntry, SplitManifest};
pub use nearest::{Nearest, is_nearer};
pub use opaque::{DescriptorBytes, MAX_DESCRIPTOR_BYTES, MAX_PREPARATION_BYTES, Preparation};
pub use result::{
    Described, EvaluationResult, Failure, FailureReason, InvalidResult, Match, Report, TaskResult,
};
pub use rule::{Exclusion, MatchingRule, Objective};
pub use wire::InvalidMessage;

use crate::{Digest, JobId, truncate, v2};

/// The longest label, bytes.
pub const MAX_LABEL_BYTES: usize = 256;

/// What one job asks for.
#[derive(Clone, Debug, PartialEq)]
pub enum Task {
    /// One descriptor on all clouds of some splits.
    Evaluation(Evaluation),
    /// Every descriptor of one cell of the grid.
    GridCell(GridCell),
    /// The clouds of a shard under one descriptor.
    Description(Description),
    /// One descriptor, on shards that are described.
    Tile(Tile),
    /// What the distances in a channel are divided by.
    Scale(Scale),
}

/// A kind of task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum TaskKind {
    /// [`Task::Evaluation`].
    Evaluation,
    /// [`Task::GridCell`].
    GridCell,
    /// [`Task::Description`].
    Description,
    /// [`Task::Tile`].
    Tile,
    /// [`Task::Scale`].
    Scale,
}

impl TaskKind {
    /// Every kind.
    pub const ALL: [Self; 5] = [Self::Evaluation, Self::GridCell, Self::Description, Self::Tile, Self::Scale];

    /// Its name.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Evaluation => "evaluation",
            Self::GridCell => "grid cell",
            Self::Description => "description",
            Self::Tile => "tile",
            Self::Scale => "scale",
        }
    }
}

/// What a cloud shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Label {
    /// Its category.
    pub category: u32,
    /// Its object; instances are numbered across categories.
    pub instance: u32,
}

/// The descriptor that a task is about, or all descriptors of a grid cell, with what scheduling has to know of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Subject {
    /// How clouds are prepared.
    pub preparation: Preparation,
    /// The descriptor or the cell.
    pub descriptor: DescriptorBytes,
    /// What follows from them.
    pub facts: Facts,
}

/// What whoever makes a task knows of its descriptor: no part of a job's name.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Facts {
    /// For people, at most [`MAX_LABEL_BYTES`].
    pub label: String,
    /// Bytes that one cloud takes in a description.
    pub description_bytes: u64,
    /// Counted cost of describing one cloud, as the crate `descriptor` counts: about a nanosecond a unit.
    pub cloud_cost: u64,
    /// Counted cost of matching one pair of clouds, in the same unit.
    pub pair_cost: u64,
}

/// Describe the clouds of some splits with one descriptor and match queries against the database.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// The descriptor.
    pub subject: Subject,
    /// Split manifests of the queries, in order.
    pub query: Vec<Digest>,
    /// Split manifests of the database, in order.
    pub database: Vec<Digest>,
    /// Clouds in `query`.
    pub queries: u32,
    /// Clouds in `database`.
    pub database_clouds: u32,
    /// Whether each query's match is wanted, or only the counts.
    pub want_matches: bool,
    /// Which clouds a query is compared with, and what is counted.
    pub rule: MatchingRule,
    /// What the distances in each channel are divided by, see [`is_scale`]; empty: by 1.
    pub scales: Vec<f64>,
    /// What of the clouds was described before. Workers describe the rest.
    pub described: Vec<DescribedSplit>,
}

/// Evaluate every descriptor of a grid cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GridCell {
    /// The cell; its costs are those of all its descriptors.
    pub subject: Subject,
    /// Split manifests of the queries, in order.
    pub query: Vec<Digest>,
    /// Split manifests of the database, in order.
    pub database: Vec<Digest>,
    /// Clouds in `query`.
    pub queries: u32,
    /// Clouds in `database`.
    pub database_clouds: u32,
    /// How many descriptors the cell has.
    pub descriptors: u32,
}

/// Describe the clouds of one shard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Description {
    /// The descriptor.
    pub subject: Subject,
    /// The shard: a split manifest.
    pub manifest: Digest,
    /// Clouds in it.
    pub clouds: u32,
}

/// Match some shards whose clouds were described before.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// Of these shards.
    pub evaluation: Evaluation,
    /// For each shard of the queries its description.
    pub query_descriptions: Vec<Digest>,
    /// For each shard of the database its description.
    pub database_descriptions: Vec<Digest>,
}

/// Compute the scale of a channel over all clouds of some splits: of the distances of all unordered pairs, sorted, the
/// one at index ⌊pairs / 20⌋; 1 if it is 0, or if there is no pair.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scale {
    /// A descriptor that has one channel. Its weight changes no scale, but the job's name: equal channels are asked for
    /// once if they are asked for with equal weights.
    pub subject: Subject,
    /// Split manifests, in order.
    pub splits: Vec<Digest>,
    /// Clouds in them.
    pub clouds: u32,
    /// What of them was described before: nothing, or all of it.
    pub described: Vec<DescribedSplit>,
}

/// Whether a number can be the scale of a channel: a distance, which is a 32-bit float, above 0. Distances that are
/// divided by it and weighted are finite.
pub fn is_scale(scale: f64) -> bool {
    let distance = scale as f32;
    distance.is_finite() && distance > 0.0
}

impl Facts {
    /// The start of a text as a label.
    pub fn label(text: &str) -> String {
        truncate(text, MAX_LABEL_BYTES).to_owned()
    }
}

impl Task {
    /// The job that asks for this task, for the first time in a run (0), the second (1), …: the same name whenever the
    /// run is started again, so that a lease handed out by one start means the same job to the next.
    pub fn job(&self, occurrence: u32) -> JobId {
        let asked = v2::Task { ask: Some(wire::ask(self)), facts: None };
        let mut hasher = blake3::Hasher::new_derive_key("descry job v2");
        hasher.update(&asked.encode_to_vec());
        hasher.update(&occurrence.to_le_bytes());
        let mut name = [0; 8];
        hasher.finalize_xof().fill(&mut name);
        JobId(u64::from_le_bytes(name))
    }

    /// Its bytes, with its facts.
    pub fn to_bytes(&self) -> Vec<u8> {
        v2::Task::from(self).encode_to_vec()
    }

    /// The inverse of [`Task::to_bytes`].
    ///
    /// # Errors
    /// If the bytes are no task of this release.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, InvalidMessage> {
        v2::Task::decode(bytes)?.try_into()
    }

    /// What it is about.
    pub fn subject(&self) -> &Subject {
        match self {
            Self::Evaluation(evaluation) => &evaluation.subject,
            Self::GridCell(cell) => &cell.subject,
            Self::Description(shard) => &shard.subject,
            Self::Tile(tile) => &tile.evaluation.subject,
            Self::Scale(scale) => &scale.subject,
        }
    }

    /// Its kind.
    pub fn kind(&self) -> TaskKind {
        match self {
            Self::Evaluation(_) => TaskKind::Evaluation,
            Self::GridCell(_) => TaskKind::GridCell,
            Self::Description(_) => TaskKind::Description,
            Self::Tile(_) => TaskKind::Tile,
            Self::Scale(_) => TaskKind::Scale,
        }
    }

    /// Counted cost, in the units of [`Facts`].
    pub fn cost(&self) -> u64 {
        self.describing_cost().saturating_add(self.matching_cost())
    }

    /// Of that for describing clouds.
    pub fn describing_cost(&self) -> u64 {
        self.counts().0.saturating_mul(self.subject().facts.cloud_cost)
    }

    /// Of that for matching pairs of clouds.
    pub fn matching_cost(&self) -> u64 {
        self.counts().1.saturating_mul(self.subject().facts.pair_cost)
    }

    /// Clouds to be described, and pairs of clouds to be matched.
    fn counts(&self) -> (u64, u64) {
        let pairs = |queries: u32, database: u32| u64::from(queries) * u64::from(database);
        match self {
            Self::Evaluation(Evaluation { queries, database_clouds, .. })
            | Self::GridCell(GridCell { queries, database_clouds, .. }) => {
                (u64::from(*queries) + u64::from(*database_clouds), pairs(*queries, *database_clouds))
            }
            Self::Description(shard) => (u64::from(shard.clouds), 0),
            Self::Tile(tile) => (0, pairs(tile.evaluation.queries, tile.evaluation.database_clouds)),
            Self::Scale(scale) => {
                let to_describe = if scale.described.is_empty() { u64::from(scale.clouds) } else { 0 };
                (to_describe, pairs(scale.clouds, scale.clouds) / 2)
            }
        }
    }

    /// The descriptions that it names.
    pub fn descriptions(&self) -> impl Iterator<Item = Digest> {
        let (tile, described) = match self {
            Self::Tile(tile) => (Some(tile), &[][..]),
            Self::Evaluation(Evaluation { described, .. }) | Self::Scale(Scale { described, .. }) => {
                (None, &described[..])
            }
            Self::GridCell(_) | Self::Description(_) => (None, &[][..]),
        };
        let of_tile = tile
            .into_iter()
            .flat_map(|tile| tile.query_descriptions.iter().chain(&tile.database_descriptions).copied());
        let of_splits = described.iter().flat_map(|split| &split.shards).map(|shard| shard.description);
        of_tile.chain(of_splits)
    }

    /// Refuses a result that cannot be one of this task: of another kind or size, impossible counts, indices out of
    /// range, distances that are no distances. What a description holds is not looked at.
    pub fn check(&self, result: &TaskResult) -> Result<(), InvalidResult> {
        match (self, result) {
            (Self::Evaluation(evaluation), TaskResult::Evaluation(result))
            | (Self::Tile(Tile { evaluation, .. }), TaskResult::Evaluation(result)) => {
                result.check(evaluation)
            }
            (Self::GridCell(cell), TaskResult::GridCell(counts)) => {
                result::check_counts(counts, cell.descriptors, cell.queries)
            }
            (Self::Description(shard), TaskResult::Description(described)) => {
                described.check(u64::from(shard.clouds).saturating_mul(shard.subject.facts.description_bytes))
            }
            (Self::Scale(_), TaskResult::Scale(got)) if is_scale(*got) => Ok(()),
            (Self::Scale(_), TaskResult::Scale(got)) => Err(InvalidResult::Scale { got: *got }),
            (_, result) => Err(InvalidResult::Kind { got: result.kind() }),
        }
    }
}

impl fmt::Display for Task {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (kind, label) = (self.kind().as_str(), &self.subject().facts.label);
        match self {
            Self::Evaluation(_) | Self::GridCell(_) => write!(f, "{kind} of {label}"),
            Self::Description(shard) => write!(f, "{kind} of {} clouds under {label}", shard.clouds),
            Self::Tile(Tile { evaluation: Evaluation { queries, database_clouds, .. }, .. }) => {
                write!(f, "{kind} of {queries} by {database_clouds} clouds of the evaluation of {label}")
            }
            Self::Scale(scale) => write!(f, "{kind} of {label} on {} clouds", scale.clouds),
        }
    }
}

impl Subject {
    /// For tests: a descriptor that differs from others in `number`.
    #[doc(hidden)]
    pub fn sample(number: u32) -> Self {
        let label = format!("descriptor {number}");
        Self {
            preparation: vec![1].into(),
            descriptor: number.to_le_bytes().to_vec().into(),
            facts: Facts { label, description_bytes: 8, cloud_cost: 60_000, pair_cost: 60 },
        }
    }
}

impl Evaluation {
    /// For tests: counts of [`Subject::sample`] on so many queries and database clouds, of no split in particular.
    #[doc(hidden)]
    pub fn sample(number: u32, queries: u32, database_clouds: u32) -> Self {
        Self {
            subject: Subject::sample(number),
            query: Vec::new(),
            database: Vec::new(),
            queries,
            database_clouds,
            want_matches: false,
            rule: MatchingRule::default(),
            scales: Vec::new(),
            described: Vec::new(),
        }
    }
}
