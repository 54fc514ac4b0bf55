//! Why a cloud of a run cannot be looked at.

use std::path::PathBuf;

use descriptor::DescriberError;

/// Why a cloud of a run cannot be looked at.
#[derive(Debug, thiserror::Error)]
pub enum ExamineError {
    /// The run keeps no list of its clouds.
    #[error(
        "{folder}: no list of clouds in this run folder\nruns of earlier builds have none: run it again to look at its clouds"
    )]
    NotListed {
        /// The run.
        folder: PathBuf,
    },
    /// No cloud of the run has this path.
    #[error("{path}: no cloud of this run\ntake a path of the run's list, clouds.tsv")]
    UnknownCloud {
        /// What was asked for.
        path: String,
    },
    /// Its file.
    #[error("{path}: {what}\nput the clouds back where the experiment says they are")]
    Cloud {
        /// Its path below the data root.
        path: String,
        /// What is wrong.
        what: String,
    },
    /// The descriptor says nothing about it.
    #[error("{path}: takes no part under this descriptor\nchoose another cloud; table skipped says why")]
    NoPart {
        /// Its path below the data root.
        path: String,
    },
    /// No experiment may use the descriptor.
    #[error(transparent)]
    Descriptor(#[from] DescriberError),
}
