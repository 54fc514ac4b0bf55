//! Keeps a cache folder within its limit: what was used least recently goes first.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

use crate::layout;
use crate::listing::{folders, is_folder, list};

/// A temporary file this old was left behind, whoever wrote it.
const ABANDONED: Duration = Duration::from_secs(24 * 60 * 60);
/// Clocks of machines that share a folder differ by less.
const SKEW: Duration = Duration::from_secs(60 * 60);

/// Watches over what one cache folder holds, other processes' files included.
#[derive(Debug)]
pub struct Evictor {
    limit: u64,
    /// Bytes written by this process since the last scan.
    written: AtomicU64,
    /// Bytes that the last scan left; `None` before the first.
    kept: Mutex<Option<u64>>,
}

impl Evictor {
    /// Keeps at most `limit` bytes. Nothing is looked at before the first file is written.
    pub fn new(limit: u64) -> Self {
        Self { limit, written: AtomicU64::new(0), kept: Mutex::new(None) }
    }

    /// Whether a file of this size can be kept at all.
    pub fn has_room_for(&self, bytes: u64) -> bool {
        bytes <= self.limit
    }

    /// Takes note of a file that was written below `root`, and evicts if there is too much.
    pub fn wrote(&self, root: &Path, bytes: u64) {
        let written = self.written.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes);
        // Whoever holds the lock is evicting already.
        let Ok(mut kept) = self.kept.try_lock() else { return };
        // Other processes write as well: a look now and then keeps what they add from going unnoticed.
        let due = |kept: u64| kept.saturating_add(written) > self.limit || written > self.limit / 16;
        if kept.is_none_or(due) {
            self.written.store(0, Ordering::Relaxed);
            *kept = Some(evict(root, self.limit, SystemTime::now()));
        }
    }
}

/// One file of a cache folder.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Kept {
    /// `false` of what was used in the future, which nothing that is used would ever outlive: it goes first. Whoever uses it
    /// once more puts that right.
    is_plausible: bool,
    used: SystemTime,
    path: PathBuf,
    bytes: u64,
}

/// Removes abandoned temporary files, and entries until at most nine tenths of the limit are left if they take more
/// than the limit. Returns the bytes that entries take afterwards.
fn evict(root: &Path, limit: u64, now: SystemTime) -> u64 {
    let mut files = Vec::new();
    for folder in fan_out_folders(root) {
        scan(&folder, now, &mut files);
    }
    let mut total: u64 = files.iter().map(|file| file.bytes).sum();
    if total <= limit {
        return total;
    }
    let target = limit - limit / 10;
    let before = total;
    files.sort_unstable();
    for file in files {
        if total <= target {
            break;
        }
        // What cannot be removed still takes room: others go instead.
        if remove(&file.path) {
            total -= file.bytes;
        }
    }
    tracing::debug!("cache {}: evicted {} of {before} bytes", root.display(), before - total);
    total
}

/// The folders in which blobs and entries lie.
fn fan_out_folders(root: &Path) -> Vec<PathBuf> {
    let kinds = folders(&root.join(layout::DERIVED), layout::is_slug);
    let parents = kinds.into_iter().chain([root.join(layout::BLOBS)]).filter(|folder| is_folder(folder));
    parents.flat_map(|folder| folders(&folder, layout::is_fan_out)).collect()
}

/// Lists the entries in `folder` and removes abandoned temporary files. Whatever vanishes meanwhile, because another
/// process evicts, is passed over.
fn scan(folder: &Path, now: SystemTime, files: &mut Vec<Kept>) {
    let start = folder.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    for entry in list(folder) {
        let name = entry.file_name();
        let (Some(name), Ok(metadata)) = (name.to_str(), entry.metadata()) else { continue };
        let (true, Ok(used)) = (metadata.is_file(), metadata.modified()) else { continue };
        if layout::is_digest(start, name) {
            let is_plausible = used.duration_since(now).unwrap_or_default() < SKEW;
            files.push(Kept { is_plausible, used, path: entry.path(), bytes: metadata.len() });
        } else if atomic::is_temporary(name) {
            let age = now.duration_since(used).unwrap_or_default();
            if age > ABANDONED || atomic::is_abandoned(name) {
                let _ = remove(&entry.path()); // the next scan tries again
            }
        }
    }
}

/// Whether the file is gone; if another process was faster, so much the better.
fn remove(path: &Path) -> bool {
    fs::remove_file(path).map_or_else(|error| error.kind() == io::ErrorKind::NotFound, |()| true)
}

#[cfg(test)]
mod tests {
    use proto::Digest;

    use super::*;

    /// A file below `root` that was last used `age` seconds before the epoch's ten thousandth.
    fn file(root: &Path, path: impl AsRef<Path>, bytes: usize, age: u64) -> PathBuf {
        let path = root.join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, vec![0; bytes]).unwrap();
        let used = now() - Duration::from_secs(age);
        fs::File::options().write(true).open(&path).unwrap().set_modified(used).unwrap();
        path
    }

    fn now() -> SystemTime {
        SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000)
    }

    fn entry(index: u8) -> PathBuf {
        layout::derived("test", Digest([index; 32])).unwrap()
    }

    #[test]
    fn the_least_recently_used_go_first_down_to_nine_tenths() {
        let root = tempfile::tempdir().unwrap();
        let files: Vec<PathBuf> = [(0, 30), (1, 50), (2, 10), (3, 40)]
            .map(|(index, age)| file(root.path(), entry(index), 100, age))
            .into();
        let blob = file(root.path(), layout::blob(Digest([9; 32])), 100, 20);
        assert_eq!(evict(root.path(), 500, now()), 500);
        assert_eq!(evict(root.path(), 499, now()), 400);
        let left = |path: &PathBuf| path.exists();
        assert_eq!(files.iter().map(left).collect::<Vec<_>>(), [true, false, true, true]);
        assert_eq!(evict(root.path(), 200, now()), 100);
        assert_eq!(files.iter().map(left).collect::<Vec<_>>(), [false, false, true, false]);
        assert!(!blob.exists());
    }

    #[test]
    fn what_was_used_in_the_future_goes_first_unless_clocks_differ_by_so_much() {
        let root = tempfile::tempdir().unwrap();
        let files = [0, 1, 2, 3].map(|index| file(root.path(), entry(index), 100, 10));
        for (path, ahead) in [(&files[0], 60), (&files[1], 1_000_000), (&files[2], 2_000_000)] {
            let used = now() + Duration::from_secs(ahead);
            fs::File::options().write(true).open(path).unwrap().set_modified(used).unwrap();
        }
        let left = || files.each_ref().map(|path| path.exists());
        assert_eq!(evict(root.path(), 399, now()), 300);
        assert_eq!(left(), [true, false, true, true]);
        assert_eq!(evict(root.path(), 299, now()), 200);
        assert_eq!(left(), [true, false, false, true]);
        assert_eq!(evict(root.path(), 199, now()), 100);
        assert_eq!(left(), [true, false, false, false]);
    }

    #[test]
    fn nothing_but_our_own_files_is_removed() {
        let root = tempfile::tempdir().unwrap();
        let elsewhere = tempfile::tempdir().unwrap();
        let name = Digest([0x11; 32]).to_string();
        let behind_link = file(elsewhere.path(), format!("11/{name}"), 1000, 9);
        let foreign = [
            file(root.path(), "notes.txt", 1000, 9),
            file(root.path(), "derived/notes.txt", 1000, 9),
            file(root.path(), "derived/test/11/notes.txt", 1000, 9),
            file(root.path(), format!("derived/test/22/{name}"), 1000, 9),
            file(root.path(), format!("derived/Test/11/{name}"), 1000, 9),
            file(root.path(), format!("other/test/11/{name}"), 1000, 9),
            file(root.path(), format!("blobs/11/{name}/inside"), 1000, 9),
        ];
        std::os::unix::fs::symlink(elsewhere.path(), root.path().join("derived/linked")).unwrap();
        fs::create_dir_all(root.path().join("derived/test/33")).unwrap();
        let link = root.path().join("derived/test/33").join(Digest([0x33; 32]).to_string());
        std::os::unix::fs::symlink(&behind_link, &link).unwrap();
        let ours = file(root.path(), entry(1), 1000, 1);

        assert_eq!(evict(root.path(), 10, now()), 0);
        assert!(!ours.exists());
        assert!(foreign.iter().all(|path| path.exists()));
        assert!(behind_link.exists() && fs::symlink_metadata(link).is_ok());
    }

    #[test]
    fn a_linked_top_folder_is_left_alone() {
        let (root, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let behind_link = file(elsewhere.path(), entry(1), 1000, 9);
        for name in [layout::DERIVED, layout::BLOBS] {
            std::os::unix::fs::symlink(elsewhere.path().join(layout::DERIVED), root.path().join(name))
                .unwrap();
        }
        assert_eq!(evict(root.path(), 10, now()), 0);
        assert!(behind_link.exists());
    }

    #[test]
    fn temporary_files_are_removed_once_their_writer_is_gone() {
        let root = tempfile::tempdir().unwrap();
        let temporary =
            |writer: &str, age| file(root.path(), format!("derived/test/11/{writer}-xxxxxxxxxxxx"), 10, age);
        let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap();
        let own = format!(".tmp-{}-{}", host.trim(), std::process::id());
        // No process has this number: it is above the largest that Linux gives.
        let gone = format!(".tmp-{}-4194305", host.trim());
        let (in_use, left_behind) = (temporary(&own, 60), temporary(&gone, 60));
        let of_other = temporary(".tmp-other.host-4194305", 60);
        let of_other_old = temporary("tmp-0123456789abcdef-4194305", 90_000);
        evict(root.path(), 1000, now());
        assert!(in_use.exists() && of_other.exists());
        assert!(!left_behind.exists() && !of_other_old.exists());
    }

    #[test]
    fn what_others_add_is_noticed() {
        let root = tempfile::tempdir().unwrap();
        let evictor = Evictor::new(1600);
        let first = file(root.path(), entry(1), 50, 30);
        evictor.wrote(root.path(), 50);
        let other = file(root.path(), entry(2), 1600, 20);
        evictor.wrote(root.path(), 50);
        assert!(other.exists(), "too early to look again");
        evictor.wrote(root.path(), 51);
        assert!(!first.exists() && !other.exists());
    }
}
