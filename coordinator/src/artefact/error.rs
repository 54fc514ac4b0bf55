//! What can go wrong with an artefact.

use proto::Message;
use std::io;
use std::path::PathBuf;

use descriptor::cloud_file::CloudFileError;
use descriptor::recogniser;
use descriptor::{DescribeError, Family, Skip};

use crate::dataset::DatasetError;
use crate::experiment::ExperimentError;
use crate::front::FrontError;
use crate::reopen::ReopenError;
use crate::run::RunError;

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
    Descriptor(#[from] ExperimentError),
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
    Results(results::Error),
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

const RESTORE: &str = "restore it from a copy of the artefact, or export the run again";

impl From<results::Error> for ArtefactError {
    fn from(error: results::Error) -> Self {
        if !error.is_damage() {
            return Self::Results(error);
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
    Skip(Skip, &'static str),
    /// It cannot be described.
    #[error(transparent)]
    Describe(DescribeError),
}

/// Why there is no artefact.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The run, its experiment or its clouds.
    #[error(transparent)]
    Reopen(#[from] ReopenError),
    /// The run's files.
    #[error(transparent)]
    Results(#[from] results::Error),
    /// The run cannot be looked at.
    #[error(transparent)]
    Run(Box<RunError>),
    /// Several runs.
    #[error("{folder}: must be one run, got a sweep of {runs}\nname one of them, for example {first}", folder = .folder.display(), first = .first.display())]
    Sweep {
        /// The folder.
        folder: PathBuf,
        /// How many it has.
        runs: usize,
        /// One of them.
        first: PathBuf,
    },
    /// The run has no such point.
    #[error(transparent)]
    Front(#[from] FrontError),
    /// The run is not what was computed.
    #[error("{run}: run must be sound, got {problem}\nlook at all of it: coordinator verify", run = .run.display())]
    NotSound {
        /// The run.
        run: PathBuf,
        /// The first thing that is wrong with it.
        problem: String,
    },
    /// The clouds have changed.
    #[error("{run}: data digest must be {expected}, got {got}\n{difference}\nbring the run's clouds back, or name their place with --data", run = .run.display())]
    OtherData {
        /// The run.
        run: PathBuf,
        /// The run's.
        expected: String,
        /// Of the clouds as they are.
        got: String,
        /// Which clouds differ.
        difference: String,
    },
    /// A cloud that was usable when the data set was opened.
    #[error("{path}: {what}")]
    Cloud {
        /// Its file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// The run's descriptor cannot be used.
    #[error("{run}: {what}\nthis run's results are not those of this release: run its experiment again", run = .run.display())]
    Winner {
        /// The run.
        run: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A descriptor that an artefact has no columns for.
    #[error(
        "{run}: an artefact holds a descriptor of disk-ring or structure, got one of {got}\ntake the paper's with --descriptor paper, or run the experiment with one of these families", run = .run.display()
    )]
    Family {
        /// The run.
        run: PathBuf,
        /// The family of its descriptors.
        got: Family,
    },
    /// A structure for clouds whose colours the run does not look at.
    #[error(
        "{run}: the structure's features need a run with colours, got one without\nchoose features without colour, or run the experiment with colour = true", run = .run.display()
    )]
    NeedsColour {
        /// The run.
        run: PathBuf,
    },
    /// Nothing can be learned from the reference clouds.
    #[error("{run}: {source}", run = .run.display())]
    Learn {
        /// The run.
        run: PathBuf,
        /// Why.
        source: recogniser::LearnError,
    },
    /// The artefact cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// Why an artefact cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// Something else is in the way.
    #[error("{folder}: must be a new folder or an artefact, got {got}\nchoose another folder, or remove this one", folder = .folder.display())]
    Occupied {
        /// The folder.
        folder: PathBuf,
        /// What is there.
        got: String,
    },
    /// The artefact cannot be written.
    #[error("{folder}: cannot be written, got {source}\ncheck permissions and free space, or choose another folder", folder = .folder.display())]
    Write {
        /// Where.
        folder: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The settings have no text.
    #[error("{folder}: settings must have a text, got {what}\nthis is a defect of this program: please report it", folder = .folder.display())]
    Settings {
        /// Where.
        folder: PathBuf,
        /// Why.
        what: String,
    },
    /// The database cannot be written.
    #[error(transparent)]
    Database(#[from] results::Error),
    /// The example cannot be described.
    #[error("{example}: {source}")]
    Example {
        /// The example cloud.
        example: String,
        /// Why.
        source: CloudError,
    },
    /// What was written cannot be read again.
    #[error(transparent)]
    Artefact(#[from] ArtefactError),
    /// What was written does not give the answer that it should.
    #[error(
        "{example}: the artefact's answer must be {expected}, got {got}\nthis is a defect of this program or machine: please report it"
    )]
    Answer {
        /// The example cloud.
        example: String,
        /// Of the run, or of the computation before writing.
        expected: String,
        /// Of the artefact as written.
        got: String,
    },
}

/// Why nothing was added to an artefact, which is as it was.
#[derive(Debug, thiserror::Error)]
pub enum LearnError {
    /// The artefact cannot be used.
    #[error(transparent)]
    Artefact(#[from] ArtefactError),
    /// The example or its test vector is not what export has written.
    #[error("{path}: must be what the artefact was written with, got {what}\n{RESTORE}", path = .path.display())]
    Example {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// No folder of clouds.
    #[error("{folder}: must be a folder of clouds, got {reason}\nname a folder with <category>/<instance>/ folders of PCD files", folder = .folder.display())]
    Folder {
        /// What was named.
        folder: PathBuf,
        /// The system's words.
        reason: String,
    },
    /// The new clouds or their names.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// There is nothing to add.
    #[error("{folder}: must have clouds to add, got {got}\nput PCD or PLY files into <category>/<instance>/ folders, or describe others with --manifest", folder = .folder.display())]
    NoCloud {
        /// Where clouds were looked for.
        folder: PathBuf,
        /// What there is instead.
        got: String,
    },
    /// An object of two categories.
    #[error(
        "{cloud}: object {instance} must be of category {expected}, as in the artefact, got {got}\nrename the object or correct its category"
    )]
    Category {
        /// A new cloud.
        cloud: String,
        /// What it shows.
        instance: String,
        /// The artefact's.
        expected: String,
        /// The cloud's.
        got: String,
    },
    /// The name of a cloud that is there.
    #[error("{cloud}: name must be new, got that of a reference cloud\nrename the file: answers name clouds")]
    SameName {
        /// The new cloud.
        cloud: String,
    },
    /// Clouds that say nothing new.
    #[error(
        "{first}: content must be new, got that of {of} ({count} such clouds)\nremove from the new clouds those that are there already"
    )]
    SameContent {
        /// How many.
        count: usize,
        /// The first of them.
        first: String,
        /// Whose content it has.
        of: String,
    },
    /// The database with the new clouds is none to recognise by.
    #[error("{folder}: {what}", folder = .folder.display())]
    Together {
        /// The artefact.
        folder: PathBuf,
        /// Why.
        what: String,
    },
    /// The new artefact cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// Why an artefact was not assessed.
#[derive(Debug, thiserror::Error)]
pub enum AssessError {
    /// The artefact cannot be used.
    #[error(transparent)]
    Artefact(#[from] ArtefactError),
    /// The clouds or their names.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// Nothing can be asked.
    #[error(
        "--query: must have a usable cloud, got {skipped} skipped ones\nlook at the reasons, or choose other lists"
    )]
    NoCloud {
        /// Clouds that were skipped.
        skipped: usize,
    },
    /// The distances of all pairs would not fit.
    #[error(
        "--query: must have at most {most} clouds together with the artefact, got {got}\ngive fewer lists, or shorter ones"
    )]
    TooMany {
        /// Reference clouds and queries.
        got: usize,
        /// At most.
        most: usize,
    },
}
