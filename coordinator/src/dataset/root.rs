//! The data root, and the only way from a path in a list to a file below it.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use super::error::{DatasetError, Place};

/// A larger cloud, list or manifest is refused rather than read: a depth camera's cloud is some megabytes.
pub(crate) const MAX_FILE_BYTES: u64 = 256 << 20;

/// An existing folder, without symbolic links.
#[derive(Clone, Debug)]
pub(super) struct Root(PathBuf);

/// A file below the root.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Located {
    /// Relative to the root, with `/`, as named but without `.` and doubled separators.
    pub path: String,
    /// Without symbolic links: equal for two names of one file.
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
        let file = fs::canonicalize(self.0.join(&path)).map_err(|source| missing(source.to_string()))?;
        if !file.starts_with(&self.0) {
            return Err(leaves("a symbolic link leads out"));
        }
        // Opening a pipe would wait for ever.
        if !file.is_file() {
            return Err(missing("not a regular file".to_owned()));
        }
        Ok(Located { path, file })
    }
}

/// All bytes of a regular file of bounded size, or why not.
pub(crate) fn read_file(file: &Path) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    // Before it is opened: opening a pipe waits for a writer.
    let metadata = fs::metadata(file).map_err(|error| error.to_string())?;
    if !metadata.is_file() {
        return Err("something that is no file".to_owned());
    }
    let opened = File::open(file).map_err(|error| error.to_string())?;
    let length = metadata.len();
    if length <= MAX_FILE_BYTES {
        bytes.reserve_exact(length as usize + 1);
    }
    opened.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(format!("file of at most {MAX_FILE_BYTES} bytes expected, got more"));
    }
    Ok(bytes)
}

/// A list or manifest as text.
pub(super) fn read_text(file: &Path) -> Result<String, DatasetError> {
    let error = |reason| DatasetError::List {
        key: "list".to_owned(),
        file: file.to_owned(),
        reason,
        advice: "correct the path, or the file",
    };
    let bytes = read_file(file).map_err(error)?;
    let text = String::from_utf8(bytes).map_err(|source| {
        let before = &source.as_bytes()[..source.utf8_error().valid_up_to()];
        let line = before.iter().filter(|&&byte| byte == b'\n').count() + 1;
        error(format!("other bytes in line {line}"))
    })?;
    Ok(match text.strip_prefix('\u{feff}') {
        Some(rest) => rest.to_owned(),
        None => text,
    })
}
