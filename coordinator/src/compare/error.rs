//! Why there is no comparison.

use std::path::PathBuf;

use descriptor::SignatureError;
use descriptor::recognise::RecogniseError;
use descriptor::recogniser::LearnError;
use proto::Message;

use super::foreign::ForeignFault;
use super::given::GivenError;
use crate::evaluate::EvaluateError;
use crate::reopen::{ReopenError, WinnerError};
use crate::run::RunError;

/// Why there is no comparison.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// The run.
    #[error(transparent)]
    Reopen(#[from] ReopenError),
    /// Workers, port, files.
    #[error(transparent)]
    Run(Box<RunError>),
    /// Nothing to compare on.
    #[error("{0}: has no test clouds to compare descriptors on\nlist some in [dataset] and run it again")]
    NoTest(PathBuf),
    /// Nothing can be learned from the database.
    #[error("{label}: {source}")]
    Learn {
        /// The label of the descriptor and recogniser.
        label: String,
        /// Why.
        source: LearnError,
    },
    /// The winner is not of this program's genes.
    #[error("{run}: {source}\nlook whether the run is sound: coordinator verify", run = .run.display())]
    Winner {
        /// The run.
        run: PathBuf,
        /// What is wrong with its winner.
        source: WinnerError,
    },
    /// A descriptor that these clouds do not allow.
    #[error("{name}: needs colours, got clouds without\nleave it out")]
    NeedsColour {
        /// Its name.
        name: String,
    },
    /// A descriptor that is given.
    #[error(transparent)]
    Given(#[from] GivenError),
    /// A descriptor from a file.
    #[error(transparent)]
    Foreign(#[from] ForeignFault),
    /// The comparison in the run folder cannot be read.
    #[error("{}\nbegin the comparison anew with --replace", Message::of(.0).what)]
    Earlier(results::Error),
    /// The comparison in the run folder has a descriptor that this program does not know.
    #[error(
        "{folder}: table comparison: has unknown descriptor {label}\nuse the release that made it, or begin the comparison anew with --replace"
    )]
    UnknownEarlier {
        /// The run folder.
        folder: PathBuf,
        /// As the table has it.
        label: String,
    },
    /// The comparison in the run folder is of other descriptors of the same name.
    #[error(
        "{folder}: table comparison: {label} must be of {then} as before, got {now}\n{advice}, or begin the comparison anew with --replace"
    )]
    OtherEarlier {
        /// The run folder.
        folder: PathBuf,
        /// Of the descriptor.
        label: String,
        /// Its parameters in the table.
        then: String,
        /// Its parameters now.
        now: String,
        /// How it can be what it was.
        advice: &'static str,
    },
    /// A worker's answer is no description.
    #[error(transparent)]
    Description(#[from] SignatureError),
    /// Nothing in the database.
    #[error("{label}: {source}")]
    Recognise {
        /// Of the descriptor.
        label: String,
        /// Why.
        source: RecogniseError,
    },
    /// Nothing could be counted.
    #[error("{label}: describes none of the test clouds\nleave it out, or choose a larger --radius-cm")]
    NothingDescribed {
        /// Of the descriptor.
        label: String,
    },
    /// Measuring times.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// Two computations of the same differ.
    #[error(
        "{label}: {what} must be what it was, {then}, got {now}\nlook whether the run is sound: coordinator verify"
    )]
    Contradiction {
        /// Of the descriptor.
        label: String,
        /// What was computed twice.
        what: &'static str,
        /// The first time.
        then: String,
        /// The second.
        now: String,
    },
}

impl From<RunError> for CompareError {
    fn from(error: RunError) -> Self {
        Self::Run(Box::new(error))
    }
}

impl From<results::Error> for CompareError {
    fn from(error: results::Error) -> Self {
        RunError::from(error).into()
    }
}
