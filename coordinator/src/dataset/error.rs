//! Why a data set cannot be used, and what to do about it.

use std::fmt;
use std::path::PathBuf;

use super::Clouds;
use super::pattern::Pattern;
use descriptor::spacing::WrongUnit;

/// Where a cloud was named.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// On a line of a list or manifest, counted from 1.
    Line {
        /// The list or manifest.
        file: PathBuf,
        /// Its line.
        line: u64,
    },
    /// In a row of a table without lines, counted from 0 as data frames count.
    Row {
        /// The table.
        file: PathBuf,
        /// Its row.
        row: u64,
    },
    /// Somewhere in a file.
    File {
        /// The file.
        file: PathBuf,
    },
    /// Found in the folders below the data root.
    Found {
        /// Relative to the root.
        path: String,
    },
}

impl fmt::Display for Place {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line { file, line } => write!(formatter, "{}, line {line}", file.display()),
            Self::Row { file, row } => write!(formatter, "{}, row {row} (from 0)", file.display()),
            Self::File { file } => write!(formatter, "{}", file.display()),
            Self::Found { path } => write!(formatter, "{path}"),
        }
    }
}

/// What is wrong with a data set. The first line of the text is `where: what, got value`, the last says what to
/// do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DatasetError {
    /// The root is not there, no folder or not readable.
    #[error(
        "dataset.root: readable folder expected, got {} ({reason})\n\
         correct the path (relative paths start at the experiment's folder) or make the data set there",
        .path.display()
    )]
    Root {
        /// As given.
        path: PathBuf,
        /// The system's words.
        reason: String,
    },

    /// A folder below the root that cannot be listed.
    #[error("{}: readable folder expected, got {reason}\ncorrect its permissions or move it out of the data root", .path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The system's words.
        reason: String,
    },

    /// A list or manifest that is not there, not readable or no text.
    #[error("{key}: readable UTF-8 text file expected, got {} ({reason})\n{advice}", .file.display())]
    List {
        /// The key or option that names it.
        key: String,
        /// The list or manifest.
        file: PathBuf,
        /// The system's words.
        reason: String,
        /// What to do.
        advice: &'static str,
    },

    /// A path that is absolute, goes up or leads out of the root through a symbolic link.
    #[error(
        "{place}: path below the data root expected, got {path} ({reason})\nname clouds relative to dataset.root, and copy what lies outside into it"
    )]
    LeavesRoot {
        /// Where it is named.
        place: Place,
        /// As written.
        path: String,
        /// How it leaves.
        reason: &'static str,
    },

    /// A listed cloud that is not there.
    #[error(
        "{place}: cloud file expected, got {path} ({reason})\ncorrect the line, or put the cloud below dataset.root"
    )]
    NotThere {
        /// Where it is named.
        place: Place,
        /// As written.
        path: String,
        /// What is there instead.
        reason: String,
    },

    /// A path from which the layout's labels cannot be read.
    #[error(
        "{place}: {expected} expected, got {path}\nmove the cloud, or set dataset.layout to what the folders are (a manifest can describe any)"
    )]
    NoLabel {
        /// Where it is named.
        place: Place,
        /// The layout's form.
        expected: &'static str,
        /// As written.
        path: String,
    },

    /// A path that a pattern does not read.
    #[error(
        "{place}: path of the form {pattern} expected, got {path}\nrename or move the cloud, or correct the pattern (a manifest can describe any path)"
    )]
    NoMatch {
        /// Where it is named.
        place: Place,
        /// The pattern.
        pattern: Pattern,
        /// As written.
        path: String,
    },

    /// An empty field of a manifest.
    #[error(
        "{place}: {column} expected, got nothing\nfill the field: every cloud needs a path, a category and an instance, and a set where there is such a column"
    )]
    EmptyField {
        /// The row.
        place: Place,
        /// The column.
        column: &'static str,
    },

    /// A manifest that is no table with the needed columns.
    #[error(
        "{place}: {expected}, got {got}\nwrite CSV or Parquet with the columns path, category and instance, and sequence, split and set if wanted"
    )]
    Manifest {
        /// The row.
        place: Place,
        /// What must be there.
        expected: String,
        /// What is there.
        got: String,
    },

    /// A file that says what is in a scene, and does not.
    #[error("{}: obj_id of each object of each image expected, got {got}\ncopy the scene again, or move it out of the data root", .file.display())]
    Scene {
        /// The file.
        file: PathBuf,
        /// What is there, in a line.
        got: String,
    },

    /// A listed cloud without a row in the manifest.
    #[error("{place}: cloud of the manifest expected, got {path}\nadd a row with its category and instance to {}", .manifest.display())]
    NotInManifest {
        /// Where it is listed.
        place: Place,
        /// As written.
        path: String,
        /// The manifest.
        manifest: PathBuf,
    },

    /// The same cloud twice in one list.
    #[error("{second}: each cloud once expected, got {path} again after {first}\nremove one of the two")]
    Twice {
        /// As written the second time.
        path: String,
        /// Where first.
        first: Place,
        /// Where again.
        second: Place,
    },

    /// One name with two endings of clouds.
    #[error(
        "{first}: each cloud in one file expected, got {second} beside it\nmove one of the two out of the data root"
    )]
    TwoFormats {
        /// Relative to the root.
        first: String,
        /// The other.
        second: String,
    },

    /// A root in which the layout finds no cloud.
    #[error(
        "{}: clouds at {expected} expected, got {found}\nclouds are read from PCD, PLY and RGB-D images: {advice}",
        .root.display()
    )]
    NoClouds {
        /// The root.
        root: PathBuf,
        /// Where the layout looks.
        expected: String,
        /// The files that are there, counted by the ending of their names.
        found: String,
        /// How to make clouds of them.
        advice: &'static str,
    },

    /// The same cloud in two splits.
    #[error(
        "{}: cloud of one split expected, got {path} in {second_split} and in {first_split} ({})\n\
         remove it from one of them: a query that is in its own database is always recognised. Where validation clouds are \
         to be training clouds, write `validation = []`",
        .places[1], .places[0]
    )]
    Overlap {
        /// As written the second time.
        path: String,
        /// The earlier split.
        first_split: &'static str,
        /// The later split.
        second_split: &'static str,
        /// Where in each.
        places: Box<[Place; 2]>,
    },

    /// One instance name in two categories.
    #[error(
        "{}: instance of one category expected, got {instance} in {} and in {} ({})\n\
         rename one of them or correct its category",
        .places[1], .categories[1], .categories[0], .places[0]
    )]
    TwoCategories {
        /// Its name.
        instance: String,
        /// The two, as met.
        categories: Box<[String; 2]>,
        /// A cloud of it in each.
        places: Box<[Place; 2]>,
    },

    /// A split without a cloud.
    #[error("split {split}: at least one usable cloud expected, got none of {listed} listed\n{advice}")]
    EmptySplit {
        /// The split.
        split: &'static str,
        /// Clouds in it before any was skipped.
        listed: usize,
        /// What to do, and why clouds were skipped.
        advice: String,
    },

    /// A rule that cannot split these clouds.
    #[error("dataset.splits: {expected}, got {got}\n{advice}")]
    Rule {
        /// What must be there.
        expected: &'static str,
        /// What is there.
        got: String,
        /// What to do.
        advice: &'static str,
    },

    /// Clouds that cannot be read.
    #[error(
        "dataset: readable clouds expected, got {count} unreadable\n{}\n\
         repair them, remove them from their lists, or set dataset.skip_unreadable = true to leave them out",
        .first.join("\n")
    )]
    Unreadable {
        /// How many.
        count: usize,
        /// The first of them, `path: reason` each.
        first: Vec<String>,
    },

    /// Clouds whose neighbourhoods would take minutes each.
    #[error(
        "dataset: clouds whose neighbourhoods take seconds at most expected, got {count} that are too dense\n{}\n\
         remove points that are all alike (invalid ones at the origin) and outliers far away, thin them out, remove them from \
         their lists, or choose a smaller preprocess.normal_radius_cm",
        .first.join("\n")
    )]
    TooDense {
        /// How many.
        count: usize,
        /// The first of them, `path: reason` each.
        first: Vec<String>,
    },

    /// Clouds whose points are as far apart as in no cloud of the declared unit.
    #[error(
        "dataset.unit: {wrong} in {cloud}, the median of {clouds} clouds\nset dataset.unit = \"{}\"",
        .wrong.other
    )]
    Unit {
        /// The cloud with the median spacing.
        cloud: String,
        /// Clouds that were looked at.
        clouds: usize,
        /// Its spacing.
        wrong: WrongUnit,
    },

    /// Clouds without colour where colour is wanted.
    #[error(
        "dataset: clouds with colours expected, got {count} without\n{}\n\
         set descriptor.colour = false for descriptors of shape alone, or add the colours",
        .first.join("\n")
    )]
    NoColour {
        /// How many.
        count: usize,
        /// Paths of the first of them.
        first: Vec<String>,
    },
}

/// What to do about a list of a split.
const LIST_ADVICE: &str = "write the list, or set dataset.splits: to other lists (relative paths start at dataset.root), \
                           or to a draw, for example `splits = { seeded = {} }`";

/// What to do about one of the validation split, which a search need not have.
const VALIDATION_ADVICE: &str = "write the list, or set dataset.splits: to other lists (relative paths start at dataset.root), \
                                 to none (`validation = []` with search.winner = \"fitness\" and \
                                 stop.validation_patience = \"off\"), or to a draw, for example `splits = { seeded = {} }`";

/// What to do about a manifest.
const MANIFEST_ADVICE: &str =
    "correct the path (a relative one starts at dataset.root) or write CSV or Parquet there";

/// What to do about a file that an option names.
const OPTION_ADVICE: &str = "correct the path, or the file";

/// Skipped clouds named in a message; the others are only counted.
const NAMED_SKIPS: usize = 5;

impl DatasetError {
    /// The same, if it is about a text file, with the split that names it as its list.
    pub(super) fn of_list(self, split: &str) -> Self {
        let advice = if split == "validation" { VALIDATION_ADVICE } else { LIST_ADVICE };
        self.named(format!("dataset.splits.{split}"), advice)
    }

    /// The same, if it is about a text file, with that being the manifest of an experiment.
    pub(super) fn of_manifest(self) -> Self {
        self.named("dataset.manifest".to_owned(), MANIFEST_ADVICE)
    }

    /// The same, if it is about a text file, with the option of a command that names it.
    pub(super) fn of_option(self, option: &str) -> Self {
        self.named(format!("--{option}"), OPTION_ADVICE)
    }

    fn named(self, key: String, advice: &'static str) -> Self {
        match self {
            Self::List { file, reason, .. } => Self::List { key, file, reason, advice },
            other => other,
        }
    }

    /// No cloud is assigned to a split.
    pub(super) fn no_cloud(split: &'static str) -> Self {
        Self::EmptySplit { split, listed: 0, advice: "assign clouds to it".to_owned() }
    }

    /// Every cloud of a split was skipped: says why, and what the whole set looks like.
    pub(super) fn all_skipped(split: &'static str, listed: usize, clouds: &Clouds) -> Self {
        let mut advice = "list other clouds, or mend these:".to_owned();
        let skipped: Vec<_> = clouds.skipped.iter().filter(|skipped| skipped.split == split).collect();
        for skipped in skipped.iter().take(NAMED_SKIPS) {
            advice += &format!("\n  {}: {}", skipped.path, skipped.reason);
        }
        if skipped.len() > NAMED_SKIPS {
            advice += &format!("\n  and {} more", skipped.len() - NAMED_SKIPS);
        }
        for warning in &clouds.warnings {
            advice += &format!("\n{warning}");
        }
        Self::EmptySplit { split, listed, advice }
    }
}
