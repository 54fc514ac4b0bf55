//! A worker from its start to its end.

use std::future::Future;
use std::sync::Arc;
use std::time::Duration;

use cache::{ByteSize, Store};
use proto::WorkerSecret;

use crate::backoff::Backoff;
use crate::blobs::Blobs;
use crate::executor::Executor;
use crate::identity::Identity;
use crate::link::Link;
use crate::session::{Session, WorkerError};
use crate::wire::Client;

/// What a worker needs beside its connection.
#[derive(Clone, Debug)]
pub struct Options {
    /// Name and threads.
    pub identity: Identity,
    /// Where derived entries are kept; one for all workers of a process, so that they share the work.
    pub store: Arc<Store>,
    /// Memory for prepared clouds and what is computed from them: this worker's own.
    pub memory: ByteSize,
    /// Whether copies of source clouds are kept in the store and the coordinator is asked for its derived entries.
    /// Not for workers inside the coordinator's process: both are on the same disk.
    pub source_blobs: bool,
    /// How long the coordinator may be out of reach before the worker gives up; `None`: for ever.
    pub patience: Option<Duration>,
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
    let executor = Arc::new(Executor::new(identity.threads as usize, memory, blobs, store)?);
    // Identity and jitter must differ between workers started at the same instant; results rest on neither.
    let secret = WorkerSecret::new(rand::random());
    let backoff = Backoff::new(descriptor::random::stream(rand::random(), "worker back-off", &[]));
    Session::new(client, identity, secret, executor).run(patience, backoff, shutdown).await
}
