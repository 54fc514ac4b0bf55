//! The vocabulary of tasks as messages, and back: the one conversion for wire and journal.

use super::{
    Described, DescribedShard, DescribedSplit, Description, DescriptorBytes, Evaluation, EvaluationResult,
    Exclusion, Facts, Failure, FailureReason, GridCell, MAX_DESCRIPTOR_BYTES, MAX_LABEL_BYTES,
    MAX_PREPARATION_BYTES, Match, MatchingRule, Nearest, Objective, Preparation, Report, Scale, Subject,
    Task, TaskResult, Tile, is_scale,
};
use crate::{Compressed, Digest, InvalidBlock, InvalidId, MAX_CELL, MAX_DESCRIPTION_BYTES, v2};

/// A message that does not make sense.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InvalidMessage {
    /// A field that must be set is not.
    #[error("{0}: missing\nuse a worker and a coordinator of the same release")]
    Missing(&'static str),
    /// An id or a digest of another length.
    #[error(transparent)]
    Id(#[from] InvalidId),
    /// More than allowed.
    #[error("{what}: must be at most {most}, got {got}\nuse a worker and a coordinator of the same release")]
    TooMany {
        /// Of what.
        what: &'static str,
        /// The most it may be.
        most: u64,
        /// How many there are.
        got: u64,
    },
    /// A value that this release does not know.
    #[error("{what}: must be known, got {got}\nuse a worker and a coordinator of the same release")]
    Unknown {
        /// Of what.
        what: &'static str,
        /// Its number.
        got: i32,
    },
    /// A number that no distances can be divided by.
    #[error("scale: must be a distance above 0, got {0}\nuse a worker and a coordinator of the same release")]
    Scale(f64),
    /// A block that is none.
    #[error("{0}\nuse a worker and a coordinator of the same release")]
    Block(#[from] InvalidBlock),
    /// Bytes that are no message at all.
    #[error("message: cannot be decoded, got {0}\nuse a worker and a coordinator of the same release")]
    Undecodable(String),
}

impl From<prost::DecodeError> for InvalidMessage {
    fn from(error: prost::DecodeError) -> Self {
        Self::Undecodable(error.to_string())
    }
}

/// What a task asks: what its job is named by.
pub(super) fn ask(task: &Task) -> v2::task::Ask {
    use v2::task::Ask;
    match task {
        Task::Evaluation(evaluation) => Ask::Evaluation(evaluation_message(evaluation)),
        Task::GridCell(cell) => Ask::GridCell(v2::GridCell {
            preparation: cell.subject.preparation.bytes().to_vec(),
            cell: cell.subject.descriptor.bytes().to_vec(),
            query: digests(&cell.query),
            database: digests(&cell.database),
        }),
        Task::Description(shard) => Ask::Description(v2::Description {
            preparation: shard.subject.preparation.bytes().to_vec(),
            descriptor: shard.subject.descriptor.bytes().to_vec(),
            manifest: shard.manifest.to_vec(),
        }),
        Task::Tile(tile) => Ask::Tile(v2::Tile {
            evaluation: Some(evaluation_message(&tile.evaluation)),
            query_descriptions: digests(&tile.query_descriptions),
            database_descriptions: digests(&tile.database_descriptions),
        }),
        Task::Scale(scale) => Ask::Scale(v2::Scale {
            preparation: scale.subject.preparation.bytes().to_vec(),
            descriptor: scale.subject.descriptor.bytes().to_vec(),
            splits: digests(&scale.splits),
            described: described_messages(&scale.described),
        }),
    }
}

fn evaluation_message(evaluation: &Evaluation) -> v2::Evaluation {
    v2::Evaluation {
        preparation: evaluation.subject.preparation.bytes().to_vec(),
        descriptor: evaluation.subject.descriptor.bytes().to_vec(),
        query: digests(&evaluation.query),
        database: digests(&evaluation.database),
        want_matches: evaluation.want_matches,
        // What is as the paper has it is not written: messages and names of jobs stay what they were without it.
        rule: (!evaluation.rule.is_default()).then(|| evaluation.rule.into()),
        scales: evaluation.scales.clone(),
        described: described_messages(&evaluation.described),
    }
}

fn described_messages(described: &[DescribedSplit]) -> Vec<v2::DescribedSplit> {
    let message = |DescribedSplit { channel, split, shards }: &DescribedSplit| v2::DescribedSplit {
        channel: *channel,
        split: split.to_vec(),
        shards: shards.iter().map(|shard| shard.manifest.to_vec()).collect(),
        descriptions: shards.iter().map(|shard| shard.description.to_vec()).collect(),
    };
    described.iter().map(message).collect()
}

fn described_splits(messages: Vec<v2::DescribedSplit>) -> Result<Vec<DescribedSplit>, InvalidMessage> {
    let split = |message: v2::DescribedSplit| {
        let descriptions = descriptions(&message.descriptions, message.shards.len())?;
        let shards = parsed_digests(&message.shards)?.into_iter().zip(descriptions);
        let shard = |(manifest, description)| DescribedShard { manifest, description };
        Ok(DescribedSplit {
            channel: message.channel,
            split: Digest::try_from(&message.split[..])?,
            shards: shards.map(shard).collect(),
        })
    };
    messages.into_iter().map(split).collect()
}

/// The descriptions of so many shards.
fn descriptions(digests: &[Vec<u8>], shards: usize) -> Result<Vec<Digest>, InvalidMessage> {
    if digests.len() < shards {
        return Err(InvalidMessage::Missing("description of a shard"));
    }
    bounded("descriptions of shards", digests.len() as u64, shards as u64)?;
    parsed_digests(digests)
}

impl From<MatchingRule> for v2::MatchingRule {
    fn from(MatchingRule { exclude, objective, margin }: MatchingRule) -> Self {
        let exclude = match exclude {
            Exclusion::None => v2::Exclusion::Unspecified,
            Exclusion::SameCloud => v2::Exclusion::SameCloud,
            Exclusion::SameSequence => v2::Exclusion::SameSequence,
        };
        let objective = match objective {
            Objective::Object => v2::Objective::Unspecified,
            Objective::Category => v2::Objective::Category,
        };
        Self { exclude: exclude.into(), objective: objective.into(), margin }
    }
}

impl TryFrom<v2::MatchingRule> for MatchingRule {
    type Error = InvalidMessage;

    fn try_from(message: v2::MatchingRule) -> Result<Self, InvalidMessage> {
        let unknown = |what, got| InvalidMessage::Unknown { what, got };
        let exclude = v2::Exclusion::try_from(message.exclude);
        let objective = v2::Objective::try_from(message.objective);
        Ok(Self {
            exclude: match exclude.map_err(|_| unknown("exclusion of a matching rule", message.exclude))? {
                v2::Exclusion::Unspecified => Exclusion::None,
                v2::Exclusion::SameCloud => Exclusion::SameCloud,
                v2::Exclusion::SameSequence => Exclusion::SameSequence,
            },
            objective: match objective
                .map_err(|_| unknown("objective of a matching rule", message.objective))?
            {
                v2::Objective::Unspecified => Objective::Object,
                v2::Objective::Category => Objective::Category,
            },
            margin: message.margin,
        })
    }
}

fn digests(digests: &[Digest]) -> Vec<Vec<u8>> {
    digests.iter().map(|digest| digest.to_vec()).collect()
}

impl From<&Task> for v2::Task {
    fn from(task: &Task) -> Self {
        let (queries, database_clouds, descriptors) = match task {
            Task::Evaluation(Evaluation { queries, database_clouds, .. })
            | Task::Tile(Tile { evaluation: Evaluation { queries, database_clouds, .. }, .. }) => {
                (*queries, *database_clouds, 0)
            }
            Task::GridCell(cell) => (cell.queries, cell.database_clouds, cell.descriptors),
            Task::Description(shard) => (shard.clouds, 0, 0),
            Task::Scale(scale) => (scale.clouds, 0, 0),
        };
        let Facts { label, description_bytes, cloud_cost, pair_cost } = task.subject().facts.clone();
        let facts = v2::Facts {
            label,
            queries,
            database_clouds,
            descriptors,
            description_bytes,
            cloud_cost,
            pair_cost,
        };
        Self { ask: Some(ask(task)), facts: Some(facts) }
    }
}

impl TryFrom<v2::Task> for Task {
    type Error = InvalidMessage;

    fn try_from(message: v2::Task) -> Result<Self, InvalidMessage> {
        use v2::task::Ask;
        let facts = message.facts.ok_or(InvalidMessage::Missing("task: facts"))?;
        Ok(match message.ask.ok_or(InvalidMessage::Missing("task: what is asked"))? {
            Ask::Evaluation(evaluation) => Self::Evaluation(self::evaluation(evaluation, &facts)?),
            Ask::GridCell(cell) => Self::GridCell(GridCell {
                query: parsed_digests(&cell.query)?,
                database: parsed_digests(&cell.database)?,
                queries: facts.queries,
                database_clouds: facts.database_clouds,
                descriptors: bounded("descriptors of a grid cell", facts.descriptors.into(), MAX_CELL)?
                    as u32,
                subject: subject(cell.preparation, cell.cell, &facts)?,
            }),
            Ask::Description(shard) => Self::Description(Description {
                manifest: Digest::try_from(&shard.manifest[..])?,
                clouds: facts.queries,
                subject: subject(shard.preparation, shard.descriptor, &facts)?,
            }),
            Ask::Scale(scale) => Self::Scale(Scale {
                splits: parsed_digests(&scale.splits)?,
                clouds: facts.queries,
                described: described_splits(scale.described)?,
                subject: subject(scale.preparation, scale.descriptor, &facts)?,
            }),
            Ask::Tile(tile) => {
                let evaluation = tile.evaluation.ok_or(InvalidMessage::Missing("tile: evaluation"))?;
                let evaluation = self::evaluation(evaluation, &facts)?;
                Self::Tile(Tile {
                    query_descriptions: descriptions(&tile.query_descriptions, evaluation.query.len())?,
                    database_descriptions: descriptions(
                        &tile.database_descriptions,
                        evaluation.database.len(),
                    )?,
                    evaluation,
                })
            }
        })
    }
}

fn evaluation(message: v2::Evaluation, facts: &v2::Facts) -> Result<Evaluation, InvalidMessage> {
    if let Some(got) = message.scales.iter().find(|scale| !is_scale(**scale)) {
        return Err(InvalidMessage::Scale(*got));
    }
    Ok(Evaluation {
        rule: message.rule.map(MatchingRule::try_from).transpose()?.unwrap_or_default(),
        scales: message.scales,
        described: described_splits(message.described)?,
        query: parsed_digests(&message.query)?,
        database: parsed_digests(&message.database)?,
        queries: facts.queries,
        database_clouds: facts.database_clouds,
        want_matches: message.want_matches,
        subject: subject(message.preparation, message.descriptor, facts)?,
    })
}

fn subject(preparation: Vec<u8>, descriptor: Vec<u8>, facts: &v2::Facts) -> Result<Subject, InvalidMessage> {
    bounded("bytes of a label", facts.label.len() as u64, MAX_LABEL_BYTES as u64)?;
    bounded("bytes of a preparation", preparation.len() as u64, MAX_PREPARATION_BYTES as u64)?;
    bounded("bytes of a descriptor", descriptor.len() as u64, MAX_DESCRIPTOR_BYTES as u64)?;
    Ok(Subject {
        preparation: Preparation::from(preparation),
        descriptor: DescriptorBytes::from(descriptor),
        facts: Facts {
            label: facts.label.clone(),
            description_bytes: facts.description_bytes,
            cloud_cost: facts.cloud_cost,
            pair_cost: facts.pair_cost,
        },
    })
}

fn bounded(what: &'static str, got: u64, most: u64) -> Result<u64, InvalidMessage> {
    if got > most {
        return Err(InvalidMessage::TooMany { what, most, got });
    }
    Ok(got)
}

fn parsed_digests(bytes: &[Vec<u8>]) -> Result<Vec<Digest>, InvalidMessage> {
    bytes.iter().map(|bytes| Ok(Digest::try_from(&bytes[..])?)).collect()
}

impl From<TaskResult> for v2::TaskResult {
    /// Of a description of which only the name is kept, nothing.
    fn from(result: TaskResult) -> Self {
        use v2::task_result::Result;
        Self {
            result: match result {
                TaskResult::Evaluation(result) => Some(Result::Evaluation(result.into())),
                TaskResult::GridCell(object_correct) => {
                    Some(Result::GridCell(v2::GridCellResult { object_correct }))
                }
                TaskResult::Description(described) => description_message(described).map(Result::Description),
                TaskResult::Scale(scale) => Some(Result::Scale(v2::ScaleResult { scale })),
            },
        }
    }
}

/// Compressed, if it is there like this.
fn description_message(Described { bytes, compressed, .. }: Described) -> Option<v2::DescriptionResult> {
    Some(match compressed {
        Some(compressed) => v2::DescriptionResult {
            lz4: compressed.block().to_vec(),
            lz4_length: compressed.length(),
            ..v2::DescriptionResult::default()
        },
        None => v2::DescriptionResult { bytes: bytes?.to_vec(), ..v2::DescriptionResult::default() },
    })
}

impl TryFrom<v2::DescriptionResult> for Described {
    type Error = InvalidMessage;

    fn try_from(message: v2::DescriptionResult) -> Result<Self, InvalidMessage> {
        if message.lz4.is_empty() {
            return Ok(Self::new(message.bytes));
        }
        // Before the bytes are there: a short block can be said to hold any number of them.
        bounded("bytes of a description", message.lz4_length.into(), MAX_DESCRIPTION_BYTES)?;
        let compressed = Compressed::of_block(message.lz4, message.lz4_length);
        let described = Self::new(compressed.decompress()?);
        Ok(Self { compressed: Some(compressed), ..described })
    }
}

impl TryFrom<v2::TaskResult> for TaskResult {
    type Error = InvalidMessage;

    fn try_from(message: v2::TaskResult) -> Result<Self, InvalidMessage> {
        Ok(match message.result.ok_or(InvalidMessage::Missing("result: what was asked"))? {
            v2::task_result::Result::Evaluation(result) => Self::Evaluation(result.into()),
            v2::task_result::Result::GridCell(result) => Self::GridCell(result.object_correct),
            v2::task_result::Result::Description(result) => Self::Description(result.try_into()?),
            v2::task_result::Result::Scale(result) => Self::Scale(result.scale),
        })
    }
}

impl From<EvaluationResult> for v2::EvaluationResult {
    fn from(result: EvaluationResult) -> Self {
        let neighbour = |(index, distance): (u32, f64)| v2::Neighbour { index, distance };
        let found = |found: Match| v2::Match {
            nearest: found.nearest,
            distance: found.distance,
            runner_up: found.runner_up.map(neighbour),
        };
        let nearest = |Nearest { same, other }: Nearest| v2::Nearest {
            same: same.map(neighbour),
            other: other.map(neighbour),
        };
        Self {
            queries: result.queries,
            object_correct: result.object_correct,
            category_correct: result.category_correct,
            matches: result.matches.into_iter().map(found).collect(),
            nearest: result.nearest.into_iter().map(nearest).collect(),
            margin: result.margin,
        }
    }
}

impl From<v2::EvaluationResult> for EvaluationResult {
    fn from(message: v2::EvaluationResult) -> Self {
        // A message cannot tell -0 from a distance that is not there.
        let neighbour = |found: v2::Neighbour| (found.index, found.distance + 0.0);
        let found = |found: v2::Match| Match {
            nearest: found.nearest,
            distance: found.distance + 0.0,
            runner_up: found.runner_up.map(neighbour),
        };
        let nearest = |found: v2::Nearest| Nearest {
            same: found.same.map(neighbour),
            other: found.other.map(neighbour),
        };
        Self {
            queries: message.queries,
            object_correct: message.object_correct,
            category_correct: message.category_correct,
            matches: message.matches.into_iter().map(found).collect(),
            nearest: message.nearest.into_iter().map(nearest).collect(),
            margin: message.margin,
        }
    }
}

impl From<Failure> for v2::Failure {
    fn from(Failure { reason, message }: Failure) -> Self {
        use v2::FailureReason as Wire;
        let reason = match reason {
            FailureReason::Other => Wire::Unspecified,
            FailureReason::Data => Wire::Data,
            FailureReason::Panic => Wire::Panic,
            FailureReason::InvalidJob => Wire::InvalidJob,
            FailureReason::Cloud => Wire::Cloud,
            FailureReason::Description => Wire::Description,
            FailureReason::InvalidResult => Wire::InvalidResult,
            FailureReason::Overdue => Wire::Overdue,
            FailureReason::Lost => Wire::Lost,
        };
        Self { reason: reason.into(), message }
    }
}

impl From<InvalidMessage> for Failure {
    /// Of a task that a worker cannot read.
    fn from(error: InvalidMessage) -> Self {
        Self::new(FailureReason::InvalidJob, error)
    }
}

impl From<v2::Failure> for Failure {
    fn from(message: v2::Failure) -> Self {
        use v2::FailureReason as Wire;
        let reason = match message.reason() {
            Wire::Unspecified => FailureReason::Other,
            Wire::Data => FailureReason::Data,
            Wire::Panic => FailureReason::Panic,
            Wire::InvalidJob => FailureReason::InvalidJob,
            Wire::Cloud => FailureReason::Cloud,
            Wire::Description => FailureReason::Description,
            Wire::InvalidResult => FailureReason::InvalidResult,
            Wire::Overdue => FailureReason::Overdue,
            Wire::Lost => FailureReason::Lost,
        };
        Self::new(reason, message.message)
    }
}

impl From<Report> for v2::JobReport {
    fn from(Report { lease, run_seconds, outcome }: Report) -> Self {
        use v2::job_report::Outcome;
        let outcome = match outcome {
            Ok(result) => Outcome::Result(result.into()),
            Err(failure) => Outcome::Failure(failure.into()),
        };
        Self { lease: Some(lease.into()), run_seconds, outcome: Some(outcome) }
    }
}

impl TryFrom<v2::JobReport> for Report {
    type Error = InvalidMessage;

    /// A report that names its lease is one, whatever the rest of it holds: then it is of a failure.
    fn try_from(message: v2::JobReport) -> Result<Self, InvalidMessage> {
        use v2::job_report::Outcome;
        let lease = message.lease.ok_or(InvalidMessage::Missing("report: lease"))?.into();
        let run_seconds = message.run_seconds;
        let run_seconds = if run_seconds.is_finite() && run_seconds >= 0.0 { run_seconds } else { 0.0 };
        let invalid = |error| Failure::new(FailureReason::InvalidResult, error);
        let outcome = match message.outcome {
            Some(Outcome::Result(result)) => TaskResult::try_from(result).map_err(invalid),
            Some(Outcome::Failure(failure)) => Err(failure.into()),
            None => Err(invalid(InvalidMessage::Missing("report: outcome"))),
        };
        Ok(Self { lease, run_seconds, outcome })
    }
}
