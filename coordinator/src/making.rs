//! Folders that become visible only whole: made beside their place, and moved there.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use tempfile::TempDir;

/// Beginning of the name of a folder that is being made; the process that makes it follows.
const MAKING: &str = ".making-";

/// A folder that is being made; removed when dropped.
pub struct Making {
    folder: TempDir,
    parent: PathBuf,
}

impl Making {
    /// Begins a folder beside the place `folder`, whose parents are made if they are not there.
    pub fn beside(folder: &Path) -> io::Result<Self> {
        let parent = folder.parent().filter(|parent| !parent.as_os_str().is_empty());
        let parent = parent.unwrap_or(Path::new(".")).to_owned();
        fs::create_dir_all(&parent)?;
        remove_leftovers(&parent);
        Ok(Self { folder: temporary(&parent)?, parent })
    }

    /// Where it is being made.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Writes a file of it that stays after a power failure.
    pub fn write(&self, name: &str, bytes: &[u8]) -> io::Result<()> {
        let mut file = File::create(self.path().join(name))?;
        file.write_all(bytes)?;
        file.sync_all()
    }

    /// Moves it to `place`. A folder that is there already is removed, but not before the new one is in its place.
    pub fn replace(self, place: &Path) -> io::Result<()> {
        if place.is_dir() {
            let aside = temporary(&self.parent)?;
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
        } else {
            fs::rename(self.path(), place)?;
        }
        // Only Unix can open a folder; elsewhere the file system orders renames by itself.
        if cfg!(unix) { File::open(&self.parent)?.sync_all() } else { Ok(()) }
    }
}

/// A new folder in `parent`, as open to others as any new folder.
fn temporary(parent: &Path) -> io::Result<TempDir> {
    let prefix = format!("{MAKING}{}-", std::process::id());
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
    builder.prefix(&prefix).tempdir_in(parent)
}

/// Removes what processes left half-made that were killed. Where processes cannot be looked up, nothing is removed.
fn remove_leftovers(parent: &Path) {
    let processes = Path::new("/proc");
    let Ok(entries) = fs::read_dir(parent) else { return };
    if !processes.join("self").exists() {
        return;
    }
    for entry in entries.flatten() {
        let name = entry.file_name();
        let process = name.to_str().and_then(|name| name.strip_prefix(MAKING)?.split_once('-'));
        if let Some((process, _)) = process
            && process.parse::<u32>().is_ok()
            && !processes.join(process).exists()
        {
            let _ = fs::remove_dir_all(entry.path()); // somebody else may be removing it, too
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names in a folder, sorted.
    fn names(folder: &Path) -> Vec<String> {
        let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
        let mut names: Vec<String> = names.map(|name| name.into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn what_a_killed_process_left_half_made_is_removed_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let mine = format!("{MAKING}{}-x", std::process::id());
        // No process has this number: it is above the largest that Linux gives.
        for name in [".making-4194305-x", &mine, ".making-", ".making-word-x", "data"] {
            fs::create_dir(folder.path().join(name)).unwrap();
        }
        remove_leftovers(folder.path());
        let mut expected = [".making-", &mine, ".making-word-x", "data"];
        expected.sort();
        assert_eq!(names(folder.path()), expected);
    }

    #[test]
    fn a_folder_takes_the_place_of_a_former_one_whole_and_leaves_nothing_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("below/place");
        for text in ["first", "second"] {
            let making = Making::beside(&place).unwrap();
            making.write("both", text.as_bytes()).unwrap();
            making.write(text, b"").unwrap();
            making.replace(&place).unwrap();
            assert_eq!(fs::read_to_string(place.join("both")).unwrap(), text);
            assert_eq!(names(&place), ["both", text]);
            assert_eq!(names(&folder.path().join("below")), ["place"]);
        }
        drop(Making::beside(&place).unwrap());
        assert_eq!(names(&folder.path().join("below")), ["place"]);
    }

    #[test]
    fn a_place_that_cannot_be_taken_keeps_what_it_has() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("place");
        fs::write(&place, "a file").unwrap();
        let making = Making::beside(&place).unwrap();
        making.write("a", b"").unwrap();
        making.replace(&place).unwrap_err();
        assert_eq!(fs::read_to_string(&place).unwrap(), "a file");
        assert_eq!(names(folder.path()), ["place"]);
    }
}
