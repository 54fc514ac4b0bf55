//! The threads that describe several clouds at once: of this process, also where it was forked from another.

use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::raised;

/// The process that has started the pool, and the pool.
static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// The pool of this process, of as many threads as rayon takes. A forked child has none of its parent's threads, so that
/// rayon's global pool would be waited for without end: it starts some of its own. The interpreter's lock is held, so that
/// no other thread forks meanwhile.
///
/// # Errors
/// If no thread can be started.
pub fn pool(_: Python<'_>) -> PyResult<Arc<ThreadPool>> {
    let mut held = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    match &*held {
        Some((owner, pool)) if *owner == process => Ok(Arc::clone(pool)),
        _ => {
            let started = ThreadPoolBuilder::new().build();
            let pool = Arc::new(started.map_err(|error| {
                raised(format!("threads: cannot be started, got {error}\nset RAYON_NUM_THREADS to fewer"))
            })?);
            if let Some((_, parents)) = held.replace((process, Arc::clone(&pool))) {
                // Its threads are not there to be told that it ends.
                std::mem::forget(parents);
            }
            Ok(pool)
        }
    }
}
