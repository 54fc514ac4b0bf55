//! The one error of an experiment file, of the sections that artefacts share with it, and of the form of a structure file:
//! which file, where in it, what is wrong and what to do.

use std::path::{Path, PathBuf};

use crate::text::shortened;

/// What is wrong with a TOML file of settings: an experiment, a structure or those of an artefact.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}: {place}: {what}\n{advice}", .path.display())]
pub struct ConfigError {
    /// The file, as named by the user.
    pub path: PathBuf,
    /// Where in the file: a key such as `ga.population`, `line 3, column 7`, `top level`, or `file`.
    pub place: String,
    /// What is wrong, ending in the value that was found.
    pub what: String,
    /// What to do about it.
    pub advice: String,
}

/// An error whose file is not yet known: the checks see values, not files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    pub place: String,
    pub what: String,
    pub advice: String,
}

impl Fault {
    pub fn new(place: impl AsRef<str>, what: impl AsRef<str>, advice: impl AsRef<str>) -> Self {
        // What a file says appears in messages: bounded, it cannot flood the terminal or add lines of its own.
        Self {
            place: shortened(place.as_ref(), 200),
            what: shortened(what.as_ref(), 400),
            advice: shortened(advice.as_ref(), 400),
        }
    }

    /// From a message of another module, `place: what, got value` and advice on the second line; `section` is put
    /// before the place.
    pub fn from_message(section: &str, message: &str) -> Self {
        let (first, advice) = message.split_once('\n').unwrap_or((message, "correct the value"));
        let (place, what) = first.split_once(": ").unwrap_or(("", first));
        Self::new(format!("{section}{place}"), what, advice)
    }

    /// The same, found in a part of the file that stands for the whole.
    pub fn within(self, place: &str) -> Self {
        Self { place: format!("{place}.{}", self.place), ..self }
    }

    pub fn in_file(self, path: &Path) -> ConfigError {
        let Self { place, what, advice } = self;
        ConfigError { path: path.to_owned(), place, what, advice }
    }
}
