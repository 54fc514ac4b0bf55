//! The data root, and the only way from a path in a list to a file below it.

use std::fs;
use std::path::{Component, Path, PathBuf};

use super::error::{DatasetError, Place};
use super::file::read_file;
use super::images;

/// Why a path is no file below the root.
enum Outside {
    Missing(String),
    Leaves(&'static str),
}

/// An existing folder, without symbolic links.
#[derive(Clone, Debug)]
pub(super) struct Root(PathBuf);

/// A file below the root.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Located {
    /// Relative to the root, with `/`, as named but without `.` and doubled separators.
    pub path: String,
    /// Without symbolic links: equal for two names of one file. Files that belong to it lie beside its name, not here.
    pub file: PathBuf,
}

impl Root {
    pub(super) fn open(path: &Path) -> Result<Self, DatasetError> {
        let error = |reason: String| DatasetError::Root { path: path.to_owned(), reason };
        let root = fs::canonicalize(path).map_err(|source| error(source.to_string()))?;
        if !root.is_dir() {
            return Err(error("not a folder".to_owned()));
        }
        fs::read_dir(&root).map_err(|source| error(source.to_string()))?;
        Ok(Self(root))
    }

    pub(super) fn path(&self) -> &Path {
        &self.0
    }

    /// The file that `path`, named at `place`, stands for.
    pub(super) fn locate(&self, path: &str, place: &Place) -> Result<Located, DatasetError> {
        let leaves =
            |reason| DatasetError::LeavesRoot { place: place.clone(), path: path.to_owned(), reason };
        let missing =
            |reason: String| DatasetError::NotThere { place: place.clone(), path: path.to_owned(), reason };
        // Paths go to terminals and into tables.
        if path.chars().any(char::is_control) {
            let (place, path) = (place.clone(), path.escape_debug().to_string());
            return Err(DatasetError::NotThere { place, path, reason: "control character".to_owned() });
        }
        let mut parts = Vec::new();
        for component in Path::new(path).components() {
            match component {
                Component::Normal(part) => parts.extend(part.to_str()),
                Component::CurDir => {}
                Component::ParentDir => return Err(leaves("it goes up with `..`")),
                Component::RootDir | Component::Prefix(_) => return Err(leaves("it is absolute")),
            }
        }
        let path = parts.join("/");
        let named = self.0.join(&path);
        let file = self.inside(&named).map_err(|error| match error {
            Outside::Missing(reason) => missing(reason),
            Outside::Leaves(reason) => leaves(reason),
        })?;
        for other in images::others(&named) {
            self.inside(&other).map_err(|error| match error {
                Outside::Missing(reason) => missing(format!("{}: {reason}", other.display())),
                Outside::Leaves(_) => leaves("a symbolic link of an image beside it leads out"),
            })?;
        }
        Ok(Located { path, file })
    }

    /// A regular file below the root, without symbolic links.
    fn inside(&self, file: &Path) -> Result<PathBuf, Outside> {
        let file = fs::canonicalize(file).map_err(|source| Outside::Missing(source.to_string()))?;
        if !file.starts_with(&self.0) {
            return Err(Outside::Leaves("a symbolic link leads out"));
        }
        // Opening a pipe would wait for ever.
        if !file.is_file() {
            return Err(Outside::Missing("not a regular file".to_owned()));
        }
        Ok(file)
    }
}

/// The error of a list or manifest that cannot be read.
pub(super) fn unreadable(file: &Path, reason: String) -> DatasetError {
    DatasetError::List {
        key: "list".to_owned(),
        file: file.to_owned(),
        reason,
        advice: "correct the path, or the file",
    }
}

/// A list as text.
pub(super) fn read_text(file: &Path) -> Result<String, DatasetError> {
    text_of(file, read_file(file).map_err(|reason| unreadable(file, reason))?)
}

/// The bytes of a list or manifest as text.
pub(super) fn text_of(file: &Path, bytes: Vec<u8>) -> Result<String, DatasetError> {
    let text = String::from_utf8(bytes).map_err(|source| {
        let before = &source.as_bytes()[..source.utf8_error().valid_up_to()];
        let line = before.iter().filter(|&&byte| byte == b'\n').count() + 1;
        unreadable(file, format!("other bytes in line {line}"))
    })?;
    Ok(match text.strip_prefix('\u{feff}') {
        Some(rest) => rest.to_owned(),
        None => text,
    })
}
