//! A worker from its start to its end.

use std::future::Future;
use std::sync::Arc;
use std::time::{Duration, Instant};

use cache::{ByteSize, Store};
use proto::WorkerSecret;

use crate::backoff::Backoff;
use crate::blobs::Blobs;
use crate::bucket::{Access, Bucket, Patience};
use crate::executor::Executor;
use crate::identity::Identity;
use crate::join_file::JoinFile;
use crate::lifetime::{Leaving, Lifetime, LifetimeLimits};
use crate::link::Link;
use crate::session::{Conduct, Session, WorkerError};
use crate::wire::Client;

/// What a worker needs beside its connection.
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
    /// When it leaves of its own accord.
    pub lifetime: LifetimeLimits,
    /// Whether it waits for the next run when one has ended.
    pub stay: bool,
    /// Where the address of the coordinator may change.
    pub join_file: Option<JoinFile>,
}

/// Works for the coordinator at the other end of `link` until `shutdown` is ready, the run has ended or the worker's
/// lifetime is over: why it left.
pub async fn run(
    link: Link,
    options: Options,
    shutdown: impl Future<Output = ()>,
) -> Result<Leaving, WorkerError> {
    let client = Client::new(link);
    let Options { identity, store, memory, source_blobs, patience, lifetime, stay, join_file } = options;
    // What decides in the end, the coordinator's own process makes: it takes nothing that another worker has stored.
    let access = Access { reads: source_blobs, writes: !store.is_shared_read_only() };
    let bucket = Bucket::new(client.clone(), access, Patience::default());
    let blobs = Blobs::new(client.clone(), source_blobs.then(|| Arc::clone(&store)), bucket);
    let executor = Arc::new(Executor::new(identity.threads as usize, memory, blobs, store)?);
    // Identity and jitter must differ between workers started at the same instant; results rest on neither.
    let secret = WorkerSecret::new(rand::random());
    let backoff = Backoff::new(descriptor::random::stream(rand::random(), "worker back-off", &[]));
    let lifetime = Lifetime::new(lifetime, rand::random(), Instant::now());
    let conduct = Conduct { patience, lifetime, stay, join_file };
    Session::new(client, identity, secret, executor, conduct).run(backoff, shutdown).await
}
