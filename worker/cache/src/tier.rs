//! The places that keep files of the cache: this machine's disk, and a folder that several machines share.

use std::fmt::Display;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Read as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

use crate::evictor::Evictor;

/// A file's time of use is written again after this long: often enough to tell old from fresh.
const TOUCH_AFTER: Duration = Duration::from_secs(60);

/// Where the files of a tier are. Another kind of place is another variant.
#[derive(Debug)]
enum Place {
    /// This machine's own folder, made when it is first needed, kept within its limit.
    Disk { root: PathBuf, evictor: Evictor },
    /// A folder of several machines, which must be there: a missing one may be a disk that is not mounted. It is for its
    /// owner to clear, and may be there to be read only.
    Shared { root: PathBuf, read_only: bool },
}

/// A place that keeps files by name. It may lose them, and may return anything: callers check what they get. Every fault
/// is a miss; the first one is also a warning.
#[derive(Debug)]
pub struct Tier {
    place: Place,
    warned: AtomicBool,
    /// Damaged files so far.
    damaged: AtomicU64,
    hits: AtomicU64,
    misses: AtomicU64,
    faults: AtomicU64,
}

/// How reads of a tier have ended, since the start of the process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TierReads {
    /// The file was there. Damaged ones are among them.
    pub hits: u64,
    /// There was none.
    pub misses: u64,
    /// The tier could not be read.
    pub faults: u64,
    /// Files that were there and damaged.
    pub damaged: u64,
}

impl Tier {
    /// This machine's folder `root`, which keeps at most `limit` bytes.
    pub fn disk(root: PathBuf, limit: u64) -> Self {
        Self::new(Place::Disk { root, evictor: Evictor::new(limit) })
    }

    /// The folder `root` of several machines, in which nothing is changed if it is read only.
    pub fn shared(root: PathBuf, read_only: bool) -> Self {
        Self::new(Place::Shared { root, read_only })
    }

    fn is_read_only(&self) -> bool {
        matches!(self.place, Place::Shared { read_only: true, .. })
    }

    fn new(place: Place) -> Self {
        Self {
            place,
            warned: AtomicBool::new(false),
            damaged: AtomicU64::new(0),
            hits: AtomicU64::new(0),
            misses: AtomicU64::new(0),
            faults: AtomicU64::new(0),
        }
    }

    /// How reads have ended so far.
    pub fn reads(&self) -> TierReads {
        let [hits, misses, faults, damaged] = [&self.hits, &self.misses, &self.faults, &self.damaged]
            .map(|count| count.load(Ordering::Relaxed));
        TierReads { hits, misses, faults, damaged }
    }

    /// Whether nobody but this machine writes to it.
    pub fn is_local(&self) -> bool {
        matches!(self.place, Place::Disk { .. })
    }

    /// The bytes of a file, at most one more than `most`, and marks it as used.
    pub fn get(&self, name: &Path, most: u64) -> Option<Vec<u8>> {
        let bytes = read(&self.root().join(name), most, !self.is_read_only());
        let ended = match &bytes {
            Ok(Some(_)) => &self.hits,
            Ok(None) => &self.misses,
            Err(_) => &self.faults,
        };
        ended.fetch_add(1, Ordering::Relaxed);
        self.ok(bytes).flatten()
    }

    /// Keeps a file that consists of `pieces`, in place of one that is there.
    pub fn put(&self, name: &Path, pieces: &[&[u8]]) {
        self.ok(self.write(name, pieces));
    }

    /// Removes a file, if it is there.
    pub fn remove(&self, name: &Path) {
        if self.is_read_only() {
            return;
        }
        self.ok(there(fs::remove_file(self.root().join(name))));
    }

    /// Removes a file that turned out damaged, where that may be, and says so, of many at 1, 2, 4, …
    pub fn remove_damaged(&self, name: &Path, what: &dyn Display) {
        let path = self.root().join(name);
        if !self.is_read_only() && self.ok(there(fs::remove_file(&path))).flatten().is_none() {
            return; // another process was faster
        }
        let path = path.display();
        match self.damaged.fetch_add(1, Ordering::Relaxed) + 1 {
            1 => tracing::warn!("cache {path}: {what}, making it again"),
            damaged if damaged.is_power_of_two() => {
                tracing::warn!("cache {path}: {what}, making it again; {damaged} entries so far");
            }
            _ => {}
        }
    }

    /// Whole or not at all: others use the folder too, and this process may be killed at any time. Not synced: what a
    /// power cut damages is found by its checksum.
    fn write(&self, name: &Path, pieces: &[&[u8]]) -> io::Result<()> {
        let path = self.root().join(name);
        let bytes = pieces.iter().map(|piece| piece.len() as u64).sum();
        match &self.place {
            Place::Disk { evictor, .. } if !evictor.has_room_for(bytes) => return Ok(()),
            Place::Disk { .. } => {}
            Place::Shared { read_only: true, .. } => return Ok(()),
            Place::Shared { root, .. } => {
                fs::metadata(root)?;
            }
        }
        fs::create_dir_all(path.parent().unwrap_or(self.root()))?;
        atomic::write_unsynced(&path, pieces)?;
        if let Place::Disk { root, evictor } = &self.place {
            evictor.wrote(root, bytes);
        }
        Ok(())
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        match &self.place {
            Place::Disk { root, .. } | Place::Shared { root, .. } => root,
        }
    }

    /// What was done; `None` if it failed, with a warning if that is the first fault.
    fn ok<T>(&self, done: io::Result<T>) -> Option<T> {
        let error = match done {
            Ok(done) => return Some(done),
            Err(_) if self.warned.swap(true, Ordering::Relaxed) => return None,
            Err(error) => error,
        };
        let root = self.root().display();
        match self.place {
            Place::Disk { .. } => tracing::warn!(
                "cache {root}: cannot keep entries, got {error}; going on in memory\nfree some space or choose another --cache"
            ),
            Place::Shared { .. } => tracing::warn!(
                "shared folder {root}: cannot be used, got {error}; going on without it\nmount it, make it writable or choose another --shared"
            ),
        }
        None
    }
}

/// What was done with a file; `None` if there was none.
fn there<T>(done: io::Result<T>) -> io::Result<Option<T>> {
    match done {
        Ok(done) => Ok(Some(done)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

/// The bytes of a plain file, at most one more than `most`, which is marked as used where `marks` says so: links and folders
/// are no entries.
fn read(path: &Path, most: u64, marks: bool) -> io::Result<Option<Vec<u8>>> {
    let Some(metadata) = there(fs::symlink_metadata(path))?.filter(fs::Metadata::is_file) else {
        return Ok(None);
    };
    let Some(file) = there(File::open(path))? else { return Ok(None) };
    let now = SystemTime::now();
    let is_fresh = |used| now.duration_since(used).is_ok_and(|age| age < TOUCH_AFTER);
    if marks && !metadata.modified().is_ok_and(is_fresh) {
        let _ = file.set_modified(now); // someone else's file: it will be evicted sooner
    }
    let mut bytes = Vec::with_capacity(metadata.len().min(most) as usize + 1);
    file.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    Ok(Some(bytes))
}
