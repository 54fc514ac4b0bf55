//! A worker: takes evaluations from a coordinator, computes them, hands in the results.
//!
//! It needs nothing but the coordinator's address. It never decides anything about a run.

mod backoff;
mod blobs;
pub mod cli;
mod desk;
#[doc(hidden)]
pub mod hostile;
mod link;
mod session;
mod size;
mod storage;
pub mod store;
pub mod tls;
mod wire;
mod workshop;

#[cfg(test)]
mod log_capture;

use std::future::Future;
use std::sync::Arc;
use std::time::Duration;

use proto::WorkerId;

use backoff::Backoff;
use blobs::Blobs;
pub use link::{Credentials, Link, link};
use session::Session;
pub use size::{InvalidSize, Size};
pub use storage::{Storage, StorageArgs};
use store::Store;
use wire::Client;
pub use workshop::Lru;
use workshop::Workshop;

/// Which build this is, for the record.
pub const BUILD: &str = concat!("descry ", env!("CARGO_PKG_VERSION"));

/// How a worker presents itself.
#[derive(Clone, Debug)]
pub struct Identity {
    /// Label for people; made unique by the coordinator.
    pub name: String,
    /// Threads that evaluate.
    pub threads: u32,
}

/// What a worker needs beside its connection.
#[derive(Clone, Debug)]
pub struct Options {
    /// Name and threads.
    pub identity: Identity,
    /// Where derived entries are kept; one for all workers of a process, so that they share the work.
    pub store: Arc<Store>,
    /// Memory for prepared clouds and what is computed from them: this worker's own.
    pub memory: Size,
    /// Whether copies of source clouds are kept in the store and the coordinator is asked for its derived entries.
    /// Not for workers inside the coordinator's process: both are on the same disk.
    pub source_blobs: bool,
    /// How long the coordinator may be out of reach before the worker gives up; `None`: for ever.
    pub patience: Option<Duration>,
}

/// Why a worker stops on its own.
#[derive(Debug, thiserror::Error)]
pub enum WorkerError {
    /// The coordinator will never take this worker.
    #[error("coordinator: this worker is refused, got {message}")]
    Refused {
        /// The coordinator's words.
        message: String,
    },
    /// The coordinator was out of reach for longer than the worker's patience.
    #[error(
        "coordinator: out of reach for longer than the worker's patience, got {reason}\ncheck the address and that the coordinator runs, or raise --patience"
    )]
    OutOfReach {
        /// The last error.
        reason: String,
    },
    /// No threads to be had.
    #[error("threads: cannot start them, got {0}\nlower --threads")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// Works for the coordinator at the other end of `link` until `shutdown` is ready.
pub async fn run(
    link: Link,
    options: Options,
    shutdown: impl Future<Output = ()>,
) -> Result<(), WorkerError> {
    let client = Client::new(link);
    let Options { identity, store, memory, source_blobs, patience } = options;
    let blobs = Blobs::new(client.clone(), source_blobs.then(|| Arc::clone(&store)));
    let workshop = Arc::new(Workshop::new(identity.threads as usize, memory, blobs, store)?);
    // Identity and jitter must differ between workers started at the same instant; results rest on neither.
    let id = WorkerId(rand::random());
    let backoff = Backoff::new(descriptor::random::stream(rand::random(), "worker back-off", &[]));
    Session::new(client, identity, id, workshop).run(patience, backoff, shutdown).await
}
