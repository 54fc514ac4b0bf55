//! Locks of what no panic leaves half changed.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks what one thread at a time may change, also after a thread has panicked under the lock: for what is changed in one
/// step. Shared state of the cluster has a lock of its own, which ends the process.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
