//! Tasks: what a job asks of a worker, and what comes of it.

use descriptor::{Correct, Descriptor, Match, Preprocess, SearchSpace};
use proto::Digest;

/// What is computed once for all descriptors of a run.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Preparation {
    /// Keypoints and normals.
    pub preprocess: Preprocess,
    /// What clouds are prepared for.
    pub space: SearchSpace,
}

/// What a job asks for.
#[derive(Clone, Debug)]
pub enum Task {
    /// One descriptor.
    Evaluation(Evaluation),
    /// All descriptors with one R1 and one R2.
    GridCell(GridCell),
    /// The clouds of one shard under one descriptor.
    Description(Description),
    /// One descriptor, on shards that were described before.
    Tile(Tile),
}

/// Splits to match with each other.
#[derive(Clone, Debug)]
pub struct Splits {
    /// Split manifests of the queries, in order.
    pub query: Vec<Digest>,
    /// Split manifests of the database, in order.
    pub database: Vec<Digest>,
}

/// One descriptor to be evaluated.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// How clouds are prepared.
    pub preparation: Preparation,
    /// The descriptor, one of the preparation's search space.
    pub descriptor: Descriptor,
    /// What is matched with what.
    pub splits: Splits,
    /// Whether each query's match is wanted, or only the counts.
    pub want_matches: bool,
}

/// One cell of the exhaustive search.
#[derive(Clone, Debug)]
pub struct GridCell {
    /// How clouds are prepared.
    pub preparation: Preparation,
    /// R1, micrometres.
    pub disk_um: u32,
    /// R2, micrometres.
    pub ring_um: u32,
    /// What is matched with what.
    pub splits: Splits,
}

/// One shard to be described.
#[derive(Clone, Debug)]
pub struct Description {
    /// How clouds are prepared.
    pub preparation: Preparation,
    /// The descriptor, one of the preparation's search space.
    pub descriptor: Descriptor,
    /// The shard: a split manifest.
    pub manifest: Digest,
}

/// One tile of the matrix of distances.
#[derive(Clone, Debug)]
pub struct Tile {
    /// Of some shards.
    pub evaluation: Evaluation,
    /// For each of them the digest of its encoded signatures.
    pub descriptions: Splits,
}

/// What comes of a task.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// Of an evaluation.
    Evaluation(Recognition),
    /// Of a grid cell: recognised queries (object), in the order of [`descriptor::grid::Cell::object_correct`].
    GridCell(Vec<u32>),
    /// Of a shard: the signatures of its clouds, see [`Descriptor::encode_signatures`].
    Description(Vec<u8>),
}

/// What an evaluation gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Recognition {
    /// How many queries were recognised.
    pub correct: Correct,
    /// One a query if they were wanted.
    pub matches: Vec<Match>,
}
