//! A folder of files that are whole or not there, and that nobody depends on.

use std::fs::{self, File, Permissions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

use crate::size::Size;
use crate::store::layout;
use crate::store::upkeep::Upkeep;

/// A file's time of use is written again after this long: often enough to tell old from fresh.
const TOUCH_AFTER: Duration = Duration::from_secs(60);

/// One tier of the cache on disk. Every fault of the disk is a missing file; the first one is also a warning.
#[derive(Debug)]
pub struct Folder {
    root: PathBuf,
    /// Only a machine's own folder has one; what several machines share is for its owner to clear.
    upkeep: Option<Upkeep>,
    warned: AtomicBool,
    /// Damaged entries so far.
    dropped: AtomicU64,
}

impl Folder {
    /// This machine's own folder, made when it is first needed, kept within `limit`.
    pub fn own(root: PathBuf, limit: Size) -> Self {
        Self {
            root,
            upkeep: Some(Upkeep::new(limit)),
            warned: AtomicBool::new(false),
            dropped: AtomicU64::new(0),
        }
    }

    /// A folder of several machines, which must be there: a missing one may be a disk that is not mounted.
    pub fn shared(root: PathBuf) -> Self {
        Self { root, upkeep: None, warned: AtomicBool::new(false), dropped: AtomicU64::new(0) }
    }

    /// The bytes of a file, at most one more than `most`, and marks it as used.
    pub fn read(&self, path: &Path, most: u64) -> Option<Vec<u8>> {
        match read(&self.root.join(path), most) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => {
                self.warn(&error);
                None
            }
        }
    }

    /// Keeps a file that consists of `pieces`, in place of one that is there.
    pub fn write(&self, path: &Path, pieces: &[&[u8]]) {
        let bytes = pieces.iter().map(|piece| piece.len() as u64).sum();
        if self.upkeep.as_ref().is_some_and(|upkeep| !upkeep.has_room_for(bytes)) {
            return;
        }
        match self.try_write(&self.root.join(path), pieces) {
            Ok(()) => {
                if let Some(upkeep) = &self.upkeep {
                    upkeep.wrote(&self.root, bytes);
                }
            }
            Err(error) => self.warn(&error),
        }
    }

    /// Removes a file that turned out damaged, and says so: once, as it is gone afterwards, and of many at 1, 2, 4, …
    pub fn drop_damaged(&self, path: &Path, what: &dyn std::fmt::Display) {
        let path = self.root.join(path);
        match fs::remove_file(&path) {
            Ok(()) => {
                let dropped = self.dropped.fetch_add(1, Ordering::Relaxed) + 1;
                let path = path.display();
                match dropped {
                    1 => tracing::warn!("cache {path}: {what}, making it again"),
                    _ if dropped.is_power_of_two() => {
                        tracing::warn!("cache {path}: {what}, making it again; {dropped} entries so far");
                    }
                    _ => {}
                }
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {} // another process was faster
            Err(error) => self.warn(&error),
        }
    }

    /// Whole or not at all: others use the folder too, and this process may be killed at any time. Not synced: what a
    /// power cut damages is found by its checksum.
    fn try_write(&self, path: &Path, pieces: &[&[u8]]) -> io::Result<()> {
        if self.upkeep.is_none() {
            fs::metadata(&self.root)?;
        }
        let parent = path.parent().unwrap_or(&self.root);
        fs::create_dir_all(parent)?;
        let mut file = tempfile::Builder::new()
            .prefix(&layout::temporary_prefix())
            .rand_bytes(layout::TEMPORARY_DIGITS)
            .permissions(Permissions::from_mode(0o666)) // less the umask: others may read what is shared
            .tempfile_in(parent)?;
        for piece in pieces {
            file.write_all(piece)?;
        }
        file.persist(path)?;
        Ok(())
    }

    fn warn(&self, error: &io::Error) {
        if self.warned.swap(true, Ordering::Relaxed) {
            return;
        }
        let root = self.root.display();
        match self.upkeep {
            Some(_) => tracing::warn!(
                "cache {root}: cannot keep entries, got {error}; going on in memory\nfree some space or choose another --cache"
            ),
            None => tracing::warn!(
                "shared folder {root}: cannot be used, got {error}; going on without it\nmount it, make it writable or choose another --shared"
            ),
        }
    }
}

/// Links and folders are no entries: only plain files are read.
fn read(path: &Path, most: u64) -> io::Result<Option<Vec<u8>>> {
    let metadata = fs::symlink_metadata(path)?;
    if !metadata.is_file() {
        return Ok(None);
    }
    let file = File::open(path)?;
    let now = SystemTime::now();
    let is_fresh = |used| now.duration_since(used).is_ok_and(|age| age < TOUCH_AFTER);
    if !metadata.modified().is_ok_and(is_fresh) {
        let _ = file.set_modified(now); // someone else's file: it will be evicted sooner
    }
    let mut bytes = Vec::with_capacity(metadata.len().min(most) as usize + 1);
    file.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    Ok(Some(bytes))
}
