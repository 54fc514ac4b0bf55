//! Locks of files: held by one process as long as it has the file open, looked at by others without being taken for it.

use std::fs::{File, TryLockError};
use std::io::{self, ErrorKind};
use std::thread;
use std::time::Duration;

/// How often a file is tried that is locked, …
const TRIES: u32 = 10;
/// … and how long in between.
const PAUSE: Duration = Duration::from_millis(10);

/// Locks a file for this process alone, also if somebody just looks whether it is locked ([`is_locked`]), for which it is
/// locked for a moment. The operating system ends the lock with the file, also if the process is killed.
///
/// # Errors
/// [`TryLockError::WouldBlock`] if another holds it; else those of the file system, which may know no locks.
pub fn try_lock(file: &File) -> Result<(), TryLockError> {
    for _ in 0..TRIES {
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => thread::sleep(PAUSE),
            done => return done,
        }
    }
    file.try_lock()
}

/// Whether a process holds a file locked by [`try_lock`]; `None` where the file system knows no locks. Several may look at
/// once.
///
/// # Errors
/// Those of the file system.
pub fn is_locked(file: &File) -> io::Result<Option<bool>> {
    // Shared, so that several that look do not take each other for its process.
    match file.try_lock_shared() {
        Ok(()) => file.unlock().map(|()| Some(false)),
        Err(TryLockError::WouldBlock) => Ok(Some(true)),
        Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Unsupported => Ok(None),
        Err(TryLockError::Error(error)) => Err(error),
    }
}
