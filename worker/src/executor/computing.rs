//! The threads that evaluate.

use std::sync::Arc;

/// A pool of threads for computations, apart from the threads that talk to the coordinator.
#[derive(Clone, Debug)]
pub struct Computing(Arc<rayon::ThreadPool>);

impl Computing {
    /// Starts the threads.
    ///
    /// # Errors
    /// If the system has none to give.
    pub fn new(threads: usize) -> Result<Self, rayon::ThreadPoolBuildError> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|index| format!("evaluate-{index}"))
            .build()?;
        Ok(Self(Arc::new(pool)))
    }

    /// Runs `work` on the pool; a panic in it goes on in the caller, which reports it.
    pub async fn run<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> T {
        let pool = Arc::clone(&self.0);
        match tokio::task::spawn_blocking(move || pool.install(work)).await {
            Ok(done) => done,
            Err(error) => match error.try_into_panic() {
                Ok(panic) => std::panic::resume_unwind(panic),
                // The runtime is going down, and with it whoever waits for this.
                Err(_) => std::future::pending().await,
            },
        }
    }
}
