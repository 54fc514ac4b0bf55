//! Why a task has no result.

use descriptor::recognise::RecogniseError;
use descriptor::{ChannelError, SignatureError};
use proto::task::{Failure, FailureReason};
use proto::{Digest, MAX_DESCRIPTION_BYTES};

use crate::blobs::BlobError;
use crate::executor::decoded::InvalidTask;

/// Why an evaluation has no result.
#[derive(Debug, thiserror::Error)]
pub enum EvaluationError {
    /// The task cannot be read.
    #[error(transparent)]
    Invalid(#[from] InvalidTask),
    /// A blob is not to be had.
    #[error(transparent)]
    Blob(#[from] BlobError),
    /// A split manifest is no manifest.
    #[error("split manifest {digest}: {what}")]
    Manifest {
        /// Which blob.
        digest: Digest,
        /// What is wrong with it.
        what: String,
    },
    /// Clouds cannot be prepared for the search space, or not for the descriptor, which is not of it.
    #[error(transparent)]
    Quantise(#[from] ChannelError),
    /// There is nothing to match with.
    #[error(transparent)]
    Recognise(#[from] RecogniseError),
    /// A rule is about sequences, and they are not numbered.
    #[error("split manifest {digest}: {path} must have a sequence under this matching rule, got none")]
    Sequence {
        /// Which blob.
        digest: Digest,
        /// The cloud.
        path: String,
    },
    /// A shard has more clouds than one message has room for.
    #[error(
        "split manifest {digest}: its description must have at most {MAX_DESCRIPTION_BYTES} bytes, got {got}"
    )]
    TooLarge {
        /// Of the shard.
        digest: Digest,
        /// How many it would be.
        got: u64,
    },
    /// Whoever described the shard for this job was wrong, or this worker is.
    #[error("split manifest {digest}: its description must be {expected}, got {got}")]
    Description {
        /// Of the shard.
        digest: Digest,
        /// What the job names.
        expected: Digest,
        /// What the shard's clouds have here.
        got: Digest,
    },
    /// What the task names are no signatures of its shard.
    #[error(transparent)]
    Undecodable(#[from] SignatureError),
    /// A cloud that others have prepared is not what its source gives: whatever was computed here may be wrong.
    #[error("{0}")]
    Distrusted(String),
    /// A cloud that the coordinator listed cannot be described.
    #[error("{path}: {what}")]
    Cloud {
        /// Its path in the data set.
        path: String,
        /// What is wrong with it.
        what: String,
    },
}

impl EvaluationError {
    fn reason(&self) -> FailureReason {
        match self {
            Self::Invalid(_)
            | Self::Manifest { .. }
            | Self::Quantise(_)
            | Self::Recognise(_)
            | Self::Sequence { .. }
            | Self::TooLarge { .. } => FailureReason::InvalidJob,
            Self::Blob(_) | Self::Distrusted(_) => FailureReason::Data,
            Self::Cloud { .. } => FailureReason::Cloud,
            Self::Description { .. } | Self::Undecodable(_) => FailureReason::Description,
        }
    }
}

impl From<EvaluationError> for Failure {
    fn from(error: EvaluationError) -> Self {
        Self::new(error.reason(), error)
    }
}
