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

#[cfg(test)]
mod tests {
    use std::os::unix::process::ExitStatusExt as _;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::process::Command;

    use super::*;

    const IN_CHILD: &str = "DESCRY_TEST_POISONED_LOCK";

    #[test]
    fn a_panic_under_the_lock_ends_the_process() {
        const NAME: &str = "lock::tests::a_panic_under_the_lock_ends_the_process";
        if std::env::var_os(IN_CHILD).is_some() {
            let mutex = Mutex::new(0);
            let panicked = catch_unwind(AssertUnwindSafe(|| {
                *lock(&mutex) = 1;
                let _guard = lock(&mutex);
                panic!("half-way");
            }));
            assert!(panicked.is_err());
            drop(lock(&mutex));
            return;
        }
        let mut child = Command::new(std::env::current_exe().unwrap());
        let ended = child.args(["--exact", NAME]).env(IN_CHILD, "1").output().unwrap();
        assert!(ended.status.signal().is_some(), "{ended:?}");
    }
}
