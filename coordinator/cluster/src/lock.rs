//! Locks whose holders must not fail half-way.

use std::sync::{Mutex, MutexGuard};

/// Locks what one thread at a time may change. A panic under the lock may have left it half changed: then the process
/// ends, and the next start goes on from the journal.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|_| {
        tracing::error!(
            "cluster: a thread panicked while it changed shared state\nrun the same command again"
        );
        std::process::abort()
    })
}
