//! What can go wrong when a descriptor is taken away, or an artefact is added to or measured.

use std::io;
use std::path::{Path, PathBuf};

use artefact::{ArtefactError, CloudError};
use descriptor::Family;
use descriptor::recogniser;
use descriptor::weigh::WeighError;

use crate::dataset::DatasetError;
use crate::front::FrontError;
use crate::looks::LookError;
use crate::reference_clouds::ReferenceError;
use crate::reopen::ReopenError;
use crate::run::RunError;

/// Why there is no artefact, and no file of a weighed structure.
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
    /// A reference cloud.
    #[error(transparent)]
    Reference(ReferenceError),
    /// The run's descriptor cannot be used.
    #[error("{run}: {what}\nthis run's results are not those of this release: run its experiment again", run = .run.display())]
    Winner {
        /// The run.
        run: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// The descriptor describes the clouds, but nothing can recognise by it.
    #[error("{run}: {what}\nname another descriptor with --structure, or another recogniser with --recogniser", run = .run.display())]
    Recogniser {
        /// The run.
        run: PathBuf,
        /// What is wrong.
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
    /// No weights can be learned from the training clouds.
    #[error("{run}: {source}", run = .run.display())]
    Weigh {
        /// The run.
        run: PathBuf,
        /// Why.
        source: WeighError,
    },
    /// Only structures have weights of values.
    #[error(
        "{run}: values of a structure expected, got those of {got}\nname a file with --structure, such as experiments/descriptors/paper.toml", run = .run.display()
    )]
    NotStructure {
        /// The run.
        run: PathBuf,
        /// The family of its descriptor.
        got: Family,
    },
    /// Something is in the way.
    #[error("{file}: must be a new file, got one that exists\nchoose another name, or remove it", file = .file.display())]
    FileExists {
        /// The file.
        file: PathBuf,
    },
    /// The file cannot be written.
    #[error("{file}: cannot be written, got {source}\ncheck permissions and free space, or choose another place", file = .file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The artefact cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

impl ExportError {
    /// Why the reference clouds of a run cannot be described.
    pub(super) fn of_reference(run: &Path, error: ReferenceError) -> Self {
        match error {
            ReferenceError::Descriptor(what) => Self::Winner { run: run.to_owned(), what },
            cloud @ ReferenceError::Cloud { .. } => Self::Reference(cloud),
        }
    }
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
    #[error("{path}: must be what the artefact was written with, got {what}\nrestore it from a copy of the artefact, or export the run again", path = .path.display())]
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
    /// The run whose test clouds may be asked.
    #[error(transparent)]
    Look(#[from] LookError),
    /// Nothing can be asked.
    #[error("--query: must have a usable cloud, got {got}\nchoose other lists, or other clouds")]
    NoCloud {
        /// What there is instead.
        got: String,
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
