//! Files of a results folder: written whole, and listed.

use std::fs;
use std::io;
use std::path::Path;

use crate::error::Error;

/// Makes `path` hold `bytes`. A reader sees the former state or the new one, also after a crash.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    atomic::write(path, bytes).map_err(|source| Error::io(path, "write this file", source))
}

/// Makes renames and removals in `folder` survive a power failure.
pub(crate) fn sync_folder(folder: &Path) -> Result<(), Error> {
    atomic::sync_folder(folder).map_err(|source| Error::io(folder, "sync this folder", source))
}

/// Names of the entries of `folder`, shorter first, then by bytes: `generation-100000` follows
/// `generation-99999`. A folder that is not there has none.
pub(crate) fn names(folder: &Path) -> Result<Vec<String>, Error> {
    let failed = |source| Error::io(folder, "list this folder", source);
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(failed(error)),
    };
    let mut names = Vec::new();
    for entry in entries {
        // A name that is not UTF-8 is none of ours.
        if let Ok(name) = entry.map_err(failed)?.file_name().into_string() {
            names.push(name);
        }
    }
    names.sort_by(|a, b| (a.len(), a).cmp(&(b.len(), b)));
    Ok(names)
}
