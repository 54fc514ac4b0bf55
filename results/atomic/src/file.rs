//! Single files, written and removed.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::Path;

use tempfile::NamedTempFile;

use crate::temporary::{self, Access};

/// Makes `path` hold `bytes`, also after a power failure.
///
/// # Errors
/// Those of the file system. A reader then sees the former file or already the new one.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_with(path, |file| file.write_all(bytes))
}

/// As [`write`], readable for its owner alone.
///
/// # Errors
/// As [`write`].
pub fn write_secret(path: &Path, bytes: &[u8]) -> io::Result<()> {
    finish(new_file(path, Access::Owner)?, path, |file| file.write_all(bytes))
}

/// As [`write`], with the bytes written by `fill`.
///
/// # Errors
/// As [`write`], and those of `fill`.
pub fn write_with<E: From<io::Error>>(
    path: &Path,
    fill: impl FnOnce(&mut File) -> Result<(), E>,
) -> Result<(), E> {
    finish(new_file(path, Access::Umask)?, path, fill)
}

fn finish<E: From<io::Error>>(
    mut file: NamedTempFile,
    path: &Path,
    fill: impl FnOnce(&mut File) -> Result<(), E>,
) -> Result<(), E> {
    fill(file.as_file_mut())?;
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(sync_folder(parent(path))?)
}

/// Makes `path` hold the bytes of `pieces`, one after the other. Faster than [`write`]: a power failure may damage the
/// file, and its reader must be able to tell.
///
/// # Errors
/// As [`write`].
pub fn write_unsynced(path: &Path, pieces: &[&[u8]]) -> io::Result<()> {
    let mut file = new_file(path, Access::Umask)?;
    pieces.iter().try_for_each(|piece| file.write_all(piece))?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

/// Removes a file, so that it is not there after a power failure either.
///
/// # Errors
/// Those of the file system; a file that is not there is one of them.
pub fn remove(path: &Path) -> io::Result<()> {
    fs::remove_file(path)?;
    sync_folder(parent(path))
}

/// Makes renames and removals in `folder` survive a power failure.
///
/// # Errors
/// Those of the file system.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    // Only Unix can open a folder; elsewhere the file system orders renames by itself.
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}

/// The folder in which `path` is.
pub(crate) fn parent(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A temporary file beside `path`, removed when dropped.
fn new_file(path: &Path, access: Access) -> io::Result<NamedTempFile> {
    temporary::named(access, 0o666, |builder| builder.tempfile_in(parent(path)))
}
