//! What workers answer: results, which of them can be one at all, and failures with their reason.

use std::fmt;
use std::sync::Arc;

use prost::Message as _;

use super::{Evaluation, Nearest};
use crate::{Compressed, Digest, Lease, MAX_TEXT_BYTES, printable_lines, truncate, v2};

/// What a task gives.
#[derive(Clone, Debug, PartialEq)]
pub enum TaskResult {
    /// Of one descriptor, on all clouds or those of a tile.
    Evaluation(EvaluationResult),
    /// How many queries each descriptor of the cell recognises (object), in the order in which the cell lists them.
    GridCell(Vec<u32>),
    /// Of a shard.
    Description(Described),
    /// Of a channel.
    Scale(f64),
}

/// What an evaluation gives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EvaluationResult {
    /// Number of queries; under a rule other than the default, of those that count.
    pub queries: u32,
    /// Of these, queries whose nearest cloud is of the same object.
    pub object_correct: u32,
    /// Of these, queries whose nearest cloud is of the same category.
    pub category_correct: u32,
    /// One a query if they were wanted, else none; none under a rule other than the default.
    pub matches: Vec<Match>,
    /// Under a rule other than the default one a query if matches were wanted, else none.
    pub nearest: Vec<Nearest>,
    /// The sum of the margins of the queries that count, if the rule asks for it: [`super::MatchingRule::count`].
    pub margin: Option<f64>,
}

/// A query's nearest database cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Index of the nearest cloud.
    pub nearest: u32,
    /// Its set distance.
    pub distance: f64,
    /// Index and set distance of the nearest cloud of another object, if there is one.
    pub runner_up: Option<(u32, f64)>,
}

/// What describing a shard gives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Described {
    /// Names the description.
    pub digest: Digest,
    /// The description itself; `None` of one of which only the name is kept.
    pub bytes: Option<Arc<[u8]>>,
    /// The description once more, to be sent and kept like this.
    pub compressed: Option<Compressed>,
}

/// A finished lease.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Which lease.
    pub lease: Lease,
    /// From taking up the job to its end, seconds on the worker's clock.
    pub run_seconds: f64,
    /// The result, or why there is none.
    pub outcome: Result<TaskResult, Failure>,
}

/// Why there is no result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// What kind of failure it is: what follows from it rests on this.
    pub reason: FailureReason,
    /// For people, at most [`MAX_TEXT_BYTES`], as [`printable_lines`] has it.
    pub message: String,
}

/// A kind of failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FailureReason {
    /// A reason that this release does not know.
    Other,
    /// A blob is not to be had, or is damaged.
    Data,
    /// The evaluation panicked.
    Panic,
    /// The job is malformed: no worker of this release can do it.
    InvalidJob,
    /// A cloud cannot be described.
    Cloud,
    /// A shard has another description than the job names.
    Description,
    /// The result cannot be one of this job.
    InvalidResult,
    /// No result in the time that a job may take.
    Overdue,
    /// The worker was lost with the job in hand.
    Lost,
}

/// A result that cannot be one of its task.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InvalidResult {
    /// Of another kind of task.
    #[error("result: must be of the kind that was asked for, got {got}")]
    Kind {
        /// Its kind.
        got: &'static str,
    },
    /// Too many or too few.
    #[error("{what}: must be {expected}, got {got}")]
    Number {
        /// Of what.
        what: &'static str,
        /// How many there must be.
        expected: u64,
        /// How many there are.
        got: u64,
    },
    /// The same object is of the same category, so the category can only be right more often.
    #[error("counts: must be object <= category <= {queries}, got {object} and {category}")]
    Counts {
        /// Number of queries.
        queries: u32,
        /// Recognised objects.
        object: u32,
        /// Recognised categories.
        category: u32,
    },
    /// More recognised queries than there are.
    #[error("count: must be at most {queries}, got {got}")]
    Count {
        /// Number of queries.
        queries: u32,
        /// Recognised ones.
        got: u32,
    },
    /// No cloud of the database, or no distance.
    #[error("match: must name one of {clouds} clouds at a finite distance, got {index} at {distance}")]
    Match {
        /// Clouds in the database.
        clouds: u32,
        /// Index that was given.
        index: u32,
        /// Distance that was given.
        distance: f64,
    },
    /// More than all margins can add up to, or no number at all.
    #[error("margin: must be a sum of {queries} margins from -1 to 1, got {got}")]
    Margin {
        /// Queries that count.
        queries: u32,
        /// The sum that was given.
        got: f64,
    },
    /// No distance that others can be divided by.
    #[error("scale: must be a distance above 0, got {got}")]
    Scale {
        /// What was given.
        got: f64,
    },
    /// Bytes that are no description.
    #[error("{0}")]
    Description(String),
}

impl TaskResult {
    /// Name of its kind, with an article.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Evaluation(_) => "an evaluation",
            Self::GridCell(_) => "a grid cell",
            Self::Description(_) => "a description",
            Self::Scale(_) => "a scale",
        }
    }

    /// What is kept of it to the end of the run. Cells of a grid are large, and have files of their own; of a
    /// description its name is enough, for it can be made again.
    pub fn kept(&self) -> Option<Self> {
        match self {
            Self::Evaluation(_) | Self::Scale(_) => Some(self.clone()),
            Self::GridCell(_) => None,
            Self::Description(described) => Some(Self::Description(Described::named(described.digest))),
        }
    }

    /// Equal for results that are equal bit for bit.
    pub fn fingerprint(&self) -> Digest {
        match self {
            Self::Description(described) => described.digest,
            _ => Digest::of(&v2::TaskResult::from(self.clone()).encode_to_vec()),
        }
    }
}

impl EvaluationResult {
    pub(super) fn check(&self, asked: &Evaluation) -> Result<(), InvalidResult> {
        let &Evaluation { queries: asked_for, database_clouds: clouds, want_matches, ref rule, .. } = asked;
        let queries = self.queries;
        if rule.is_default() {
            number("queries", asked_for.into(), queries.into())?;
        } else if queries > asked_for {
            return Err(InvalidResult::Count { queries: asked_for, got: queries });
        }
        let (object, category) = (self.object_correct, self.category_correct);
        if object > category || category > queries {
            return Err(InvalidResult::Counts { queries, object, category });
        }
        let listed = |wanted: bool| if want_matches && wanted { u64::from(asked_for) } else { 0 };
        number("matches", listed(rule.is_default()), self.matches.len() as u64)?;
        number("nearest clouds", listed(!rule.is_default()), self.nearest.len() as u64)?;
        if want_matches && !rule.is_default() {
            let of_own = self.nearest.iter().filter(|nearest| nearest.same.is_some()).count();
            number("queries", of_own as u64, queries.into())?;
        }
        for (index, distance) in self.named() {
            if index >= clouds || !distance.is_finite() || distance < 0.0 {
                return Err(InvalidResult::Match { clouds, index, distance });
            }
        }
        number("margins", rule.margin.into(), self.margin.is_some().into())?;
        match self.margin {
            // Of terms between -1 and 1 no partial sum is rounded beyond their number.
            Some(got) if got.is_nan() || got.abs() > f64::from(queries) => {
                Err(InvalidResult::Margin { queries, got })
            }
            _ => Ok(()),
        }
    }

    /// Every cloud that is named, with its distance.
    pub(crate) fn named(&self) -> impl Iterator<Item = (u32, f64)> {
        let matches = self
            .matches
            .iter()
            .flat_map(|found| std::iter::once((found.nearest, found.distance)).chain(found.runner_up));
        matches.chain(self.nearest.iter().flat_map(|nearest| nearest.same.into_iter().chain(nearest.other)))
    }
}

pub(super) fn check_counts(counts: &[u32], descriptors: u32, queries: u32) -> Result<(), InvalidResult> {
    number("counts", descriptors.into(), counts.len() as u64)?;
    match counts.iter().find(|&&count| count > queries) {
        Some(&got) => Err(InvalidResult::Count { queries, got }),
        None => Ok(()),
    }
}

fn number(what: &'static str, expected: u64, got: u64) -> Result<(), InvalidResult> {
    if got == expected { Ok(()) } else { Err(InvalidResult::Number { what, expected, got }) }
}

impl Described {
    /// A description as its bytes alone.
    pub fn new(bytes: Vec<u8>) -> Self {
        Self { digest: Digest::of(&bytes), bytes: Some(bytes.into()), compressed: None }
    }

    /// A description that a worker has made: its bytes, and compressed.
    pub fn made(bytes: Vec<u8>) -> Self {
        Self { compressed: Compressed::new(&bytes), ..Self::new(bytes) }
    }

    /// Its name alone.
    pub fn named(digest: Digest) -> Self {
        Self { digest, bytes: None, compressed: None }
    }

    pub(super) fn check(&self, length: u64) -> Result<(), InvalidResult> {
        let Some(bytes) = &self.bytes else { return Ok(()) };
        number("description: bytes", length, bytes.len() as u64)
    }
}

impl Report {
    /// Bytes that it takes in a message, if nothing is compressed.
    pub fn encoded_len(&self) -> usize {
        v2::JobReport::from(self.clone().uncompressed()).encoded_len()
    }

    /// The same for a coordinator that takes nothing compressed.
    #[must_use]
    pub fn uncompressed(mut self) -> Self {
        if let Ok(TaskResult::Description(described)) = &mut self.outcome {
            described.compressed = None;
        }
        self
    }
}

impl Failure {
    /// A failure with a message that is fit to be shown, whatever it holds.
    pub fn new(reason: FailureReason, message: impl fmt::Display) -> Self {
        let message = message.to_string();
        // Shortened before, as there may be much of it, and after, as codes are longer than characters.
        let message = printable_lines(truncate(&message, MAX_TEXT_BYTES));
        Self { reason, message: truncate(&message, MAX_TEXT_BYTES).to_owned() }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.reason, self.message)
    }
}

impl From<InvalidResult> for Failure {
    fn from(error: InvalidResult) -> Self {
        Self::new(FailureReason::InvalidResult, error)
    }
}

impl fmt::Display for FailureReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Other => "failed",
            Self::Data => "data",
            Self::Panic => "panic",
            Self::InvalidJob => "invalid job",
            Self::Cloud => "cloud",
            Self::Description => "description",
            Self::InvalidResult => "invalid result",
            Self::Overdue => "overdue",
            Self::Lost => "lost",
        })
    }
}
