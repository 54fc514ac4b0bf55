//! Folders that become visible only whole: made beside their place, and moved there.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use crate::file::{parent, sync_folder};
use crate::temporary::{self, Access, is_abandoned};

/// A folder that is being made; removed when dropped.
#[derive(Debug)]
pub struct NewFolder {
    folder: TempDir,
    parent: PathBuf,
    access: Access,
}

impl NewFolder {
    /// Begins a folder beside `place`, whose parents are made if they are not there. What killed processes of this
    /// machine left half made there is removed.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn beside(place: &Path, access: Access) -> io::Result<Self> {
        let parent = parent(place).to_owned();
        fs::create_dir_all(&parent)?;
        remove_abandoned(&parent);
        Ok(Self { folder: new_folder(&parent, access)?, parent, access })
    }

    /// Where it is being made.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Writes a new file of it; `name` may lead through folders, which are made.
    ///
    /// # Errors
    /// Those of the file system; a file that is there already is one of them.
    pub fn write(&self, name: &str, bytes: &[u8]) -> io::Result<()> {
        let path = self.path().join(name);
        fs::create_dir_all(parent(&path))?;
        let mut options = File::options();
        options.write(true).create_new(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, self.access.mode(0o666));
        options.open(path)?.write_all(bytes)
    }

    /// Moves it to `place`, where nothing or an empty folder may stand, and makes all of it survive a power failure.
    ///
    /// # Errors
    /// Those of the file system; the place is then as it was.
    pub fn commit(self, place: &Path) -> io::Result<()> {
        sync_tree(self.path())?;
        fs::rename(self.path(), place)?;
        sync_folder(&self.parent)
    }

    /// As [`NewFolder::commit`]. A folder that is there already is removed, but not before the new one is in its place: on
    /// Linux, where the file system can, the two change places in one step, so that one of them is there also if this
    /// process is killed.
    ///
    /// # Errors
    /// Those of the file system; the former folder is then there, or the message says where it is.
    pub fn replace(self, place: &Path) -> io::Result<()> {
        if !place.is_dir() {
            return self.commit(place);
        }
        sync_tree(self.path())?;
        if exchange(self.path(), place) {
            return sync_folder(&self.parent); // what is dropped now is the former folder
        }
        let aside = new_folder(&self.parent, self.access)?;
        let former = aside.path().join("former");
        fs::rename(place, &former)?;
        if let Err(error) = fs::rename(self.path(), place) {
            if fs::rename(&former, place).is_err() {
                // What cannot be put back must not go with the temporary folder.
                let kept = aside.keep().join("former");
                let what = format!("{error}; the former folder is {}", kept.display());
                return Err(io::Error::other(what));
            }
            return Err(error);
        }
        sync_folder(&self.parent)
    }
}

/// Whether two folders have changed places; if not, for whatever reason, they are where they were.
#[cfg(target_os = "linux")]
fn exchange(one: &Path, other: &Path) -> bool {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    renameat_with(CWD, one, CWD, other, RenameFlags::EXCHANGE).is_ok()
}

#[cfg(not(target_os = "linux"))]
fn exchange(_: &Path, _: &Path) -> bool {
    false
}

fn new_folder(parent: &Path, access: Access) -> io::Result<TempDir> {
    temporary::named(access, 0o777, |builder| builder.tempdir_in(parent))
}

/// Makes every file and folder below `folder`, and itself, survive a power failure.
fn sync_tree(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            sync_tree(&entry.path())?;
        } else {
            File::open(entry.path())?.sync_all()?;
        }
    }
    sync_folder(folder)
}

/// Removes from `folder` the files and folders that processes of this machine left half made and that have ended.
pub fn remove_abandoned(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_name().to_str().is_some_and(is_abandoned) {
            // Another process may be removing it, too.
            let _ = fs::remove_file(entry.path()).or_else(|_| fs::remove_dir_all(entry.path()));
        }
    }
}
