//! What can go wrong with an artefact that is opened, or with a cloud that it is asked about.

use std::io;
use std::path::PathBuf;

use descriptor::cloud_file::CloudFileError;
use descriptor::spacing::WrongUnit;
use descriptor::{DescribeError, Skip, Unit};
use proto::Message;

use crate::database_file::DatabaseError;
use crate::sections::ConfigError;

/// Why a folder is no artefact that this program can use.
#[derive(Debug, thiserror::Error)]
pub enum ArtefactError {
    /// A file is not there, or cannot be read.
    #[error("{path}: cannot be read, got {source}\nname a folder that coordinator export has made", path = .path.display())]
    Read {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The settings are no TOML, or have other keys.
    #[error("{path}: must be the settings of an artefact, got {what}\n{RESTORE}", path = .path.display())]
    Settings {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// The settings mean nothing.
    #[error(transparent)]
    Descriptor(#[from] ConfigError),
    /// Another format.
    #[error("{path}: version must be {expected}, got {got}\nuse the release that wrote it, or export the run again", path = .path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// This program's.
        expected: String,
        /// The artefact's.
        got: String,
    },
    /// Summaries of a release that computes others.
    #[error("{path}: evaluation_version must be {expected}, got {got}\nuse the release that wrote it, or export the run again", path = .path.display())]
    EvaluationVersion {
        /// The file.
        path: PathBuf,
        /// This program's.
        expected: u32,
        /// The artefact's.
        got: u32,
    },
    /// The database cannot be opened.
    #[error(transparent)]
    Unreadable(DatabaseError),
    /// The database is damaged, foreign, or does not fit the descriptor.
    #[error("{what}\n{RESTORE}")]
    Database {
        /// The file, and what is wrong with it.
        what: String,
    },
    /// A sound file that is not the one that the settings speak of.
    #[error("{path}: digest must be {expected}, got {got}\n{RESTORE}", path = .path.display())]
    Digest {
        /// The file.
        path: PathBuf,
        /// By the settings.
        expected: String,
        /// Of the file.
        got: String,
    },
}

/// What to do about an artefact that is not as it was written.
pub(crate) const RESTORE: &str = "restore it from a copy of the artefact, or export the run again";

impl From<DatabaseError> for ArtefactError {
    fn from(error: DatabaseError) -> Self {
        if !error.is_damage() {
            return Self::Unreadable(error);
        }
        // Its advice speaks of run folders.
        Self::Database { what: Message::of(&error).what }
    }
}

/// Why a cloud has no answer.
#[derive(Debug, thiserror::Error)]
pub enum CloudError {
    /// The file cannot be read.
    #[error("cannot be read, got {0}\nname a file (.pcd or .ply), or - for standard input")]
    Read(String),
    /// It is no cloud.
    #[error(transparent)]
    File(#[from] CloudFileError),
    /// It is sound, but there is too little of it.
    #[error("{0}\nshow more of the object, and check the unit: the artefact's clouds are in {1}")]
    Skip(Skip, Unit),
    /// Its points are as far apart as in no cloud of the artefact's unit.
    #[error("{wrong}\nconvert it: the artefact's clouds are in {}", .wrong.unit)]
    Unit {
        /// Its spacing.
        wrong: WrongUnit,
    },
    /// It cannot be described.
    #[error(transparent)]
    Describe(DescribeError),
}
