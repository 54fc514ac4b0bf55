//! Workers inside the coordinator's process: the same client as remote ones, over memory instead of a network.

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::thread::available_parallelism;

use cache::{ByteSize, Store};
use tokio::sync::watch;
use tokio::task::{JoinError, JoinSet};
use worker::{Credentials, Identity, LifetimeLimits, Link, Options, WorkerError};

use crate::experiment::LocalWorkers;
use transport::Servers;

/// Threads of each in-process worker: the cores are shared out, and each worker has at least one.
pub fn threads(workers: LocalWorkers) -> Vec<u32> {
    let cores = available_parallelism().map_or(1, NonZeroUsize::get) as u32;
    let count = match workers {
        LocalWorkers::Auto => 1,
        LocalWorkers::Count(count) => count,
    };
    (0..count).map(|index| (cores / count + u32::from(index < cores % count)).max(1)).collect()
}

/// Why an in-process worker ended that was not told to.
#[derive(Debug, thiserror::Error)]
pub enum InProcessError {
    /// It gave up.
    #[error("in-process worker: {0}")]
    Worker(#[from] WorkerError),
    /// It panicked.
    #[error("in-process worker: panicked, got {0}\nplease report this with the log above")]
    Panic(#[from] JoinError),
}

/// The workers of this process.
#[derive(Default)]
pub struct InProcessWorkers {
    stop: watch::Sender<bool>,
    tasks: JoinSet<Result<(), WorkerError>>,
}

impl InProcessWorkers {
    /// Starts a worker for each entry of `threads`. They share the store, and `memory` in equal parts.
    pub fn start(servers: &mut Servers, threads: &[u32], store: &Arc<Store>, memory: ByteSize) -> Self {
        let memory = ByteSize(memory.as_u64() / threads.len().max(1) as u64);
        let stop = watch::Sender::new(false);
        let mut tasks = JoinSet::new();
        for &threads in threads {
            let link = Link::new(servers.connect_in_process(), Credentials::default());
            let store = Arc::clone(store);
            let mut stopped = stop.subscribe();
            tasks.spawn(async move {
                let options = Options {
                    identity: Identity { name: "local".to_owned(), threads },
                    store,
                    memory,
                    // The files are on this machine: a copy of them would serve nobody.
                    source_blobs: false,
                    patience: None,
                    lifetime: LifetimeLimits::default(),
                    stay: false,
                    join_file: None,
                };
                let stop = async move {
                    let _ = stopped.wait_for(|stop| *stop).await; // the sender is gone: stop as well
                };
                worker::run(link, options, stop).await.map(drop)
            });
        }
        Self { stop, tasks }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.tasks.is_empty()
    }

    /// Does `work`, unless a worker ends before it is done: the wait for its results would never end.
    pub async fn during<T, E: From<InProcessError>>(
        &mut self,
        work: impl Future<Output = Result<T, E>>,
    ) -> Result<T, E> {
        let ended = async {
            while let Some(ended) = self.tasks.join_next().await {
                match ended.map_err(InProcessError::from)? {
                    // It was wrong, and others can go on. If there are none, the grace for the last worker ends the run.
                    Err(error @ WorkerError::Refused { .. }) => tracing::error!("in-process worker: {error}"),
                    ended => ended.map_err(InProcessError::from)?,
                }
            }
            // Only `stop` lets a worker end well, and nobody can call it meanwhile.
            std::future::pending::<Result<T, E>>().await
        };
        tokio::select! {
            done = work => done,
            failed = ended => failed,
        }
    }

    /// Lets every worker say goodbye.
    pub async fn stop(mut self) {
        self.stop.send_replace(true);
        while self.tasks.join_next().await.is_some() {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cores_are_shared_out_and_nobody_is_left_without() {
        let cores = available_parallelism().unwrap().get() as u32;
        assert_eq!(threads(LocalWorkers::Auto), [cores]);
        assert!(threads(LocalWorkers::Count(0)).is_empty());
        for count in 1..=9 {
            let shares = threads(LocalWorkers::Count(count));
            assert_eq!(shares.len() as u32, count);
            assert_eq!(shares.iter().sum::<u32>(), cores.max(count));
        }
    }
}
