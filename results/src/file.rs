//! Files that are visible only whole: temporary file, sync, rename, sync of the folder.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::error::Error;

/// Ends the name of a file that is being written. It does not match `*.parquet`, so no reader takes it.
const TEMPORARY: &str = ".tmp";

/// Makes `path` hold `bytes`. A reader sees the former state or the new one, also after a crash.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    write_with(path, |file| file.write_all(bytes))
}

/// As [`write_whole`], with the bytes written by `fill`. What was written is removed if anything fails.
pub(crate) fn write_with(path: &Path, fill: impl FnOnce(&mut File) -> io::Result<()>) -> Result<(), Error> {
    let temporary = temporary_of(path);
    let result = File::create(&temporary)
        .and_then(|mut file| {
            fill(&mut file)?;
            file.sync_all()
        })
        .and_then(|()| fs::rename(&temporary, path))
        .map_err(|source| Error::io(path, "write this file", source));
    if result.is_err() {
        // The first failure is the one to report; leftovers are also removed when the folder is next opened.
        let _ = fs::remove_file(&temporary);
    }
    result?;
    sync_folder(path.parent().unwrap_or(Path::new(".")))
}

fn temporary_of(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}{TEMPORARY}"))
}

/// Whether the name is that of a file left half written by a process that was killed.
pub(crate) fn is_temporary(name: &str) -> bool {
    name.strip_prefix('.').is_some_and(|name| name.ends_with(&format!(".parquet{TEMPORARY}")))
}

/// Makes renames and removals in `folder` survive a power failure.
pub(crate) fn sync_folder(folder: &Path) -> Result<(), Error> {
    // Only Unix can open a folder; elsewhere the file system orders renames by itself.
    if cfg!(unix) {
        File::open(folder)
            .and_then(|folder| folder.sync_all())
            .map_err(|source| Error::io(folder, "sync this folder", source))?;
    }
    Ok(())
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
