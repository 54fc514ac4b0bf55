//! One connection: who is at its other end, what it has asked for, and when it ends.

use std::collections::BTreeSet;
use std::future::Future;
use std::io;
use std::net::IpAddr;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use proto::{Fingerprint, Origin, Principal, WorkerId};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore};
use tonic::Status;
use tonic::transport::server::Connected;

use crate::limiter::{ConnectionPermit, RateLimit};
use crate::refusals::RefusalLog;

/// A connection makes its first call within this time, handshake included, or is closed.
pub const FIRST_CALL: Duration = Duration::from_secs(10);
/// A connection on which no call begins for this long is closed: workers poll every few seconds.
const IDLE: Duration = Duration::from_secs(120);
/// Time to read why, for a peer whose connection is closed.
const CLOSE_DELAY: Duration = Duration::from_millis(500);
/// Workers of one connection: each `worker` has its own.
const MAX_WORKERS: usize = 64;
/// Calls that one connection may make at once, and one more each [`CALL_INTERVAL`]; what comes faster waits.
const CALLS: u32 = 2000;
/// See [`CALLS`].
const CALL_INTERVAL: Duration = Duration::from_micros(500);
/// Blobs on their way over one connection: as many as a worker asks for at once, and a part of those that the
/// coordinator sends at once to all.
const BLOBS: usize = 16;
/// Registrations that one connection may make at once, and one more a second; what comes faster is refused.
const REGISTRATIONS: u32 = 20;

/// The other end of a connection.
pub struct Connection {
    permit: ConnectionPermit,
    refusals: Arc<RefusalLog>,
    /// Of the certificate it has shown, which is one of the CA's.
    pub certificate: Option<Fingerprint>,
    /// Whether it has shown the token.
    pub shows_token: AtomicBool,
    usage: Mutex<Usage>,
    /// Bytes of requests that have begun and are not whole.
    pub receiving: AtomicUsize,
    /// Permits for blobs being sent.
    blobs: Arc<Semaphore>,
    closing: AtomicBool,
    close: Notify,
}

struct Usage {
    calls: RateLimit,
    registrations: RateLimit,
    last_call: Instant,
    workers: BTreeSet<WorkerId>,
}

/// The connection over which a call came; none from workers of this process.
pub type Caller = Option<Arc<Connection>>;

impl Connection {
    /// A connection without calls yet.
    pub fn new(
        permit: ConnectionPermit,
        certificate: Option<Fingerprint>,
        refusals: Arc<RefusalLog>,
    ) -> Arc<Self> {
        let usage = Usage {
            calls: RateLimit::new(CALLS, CALL_INTERVAL),
            registrations: RateLimit::new(REGISTRATIONS, Duration::from_secs(1)),
            last_call: Instant::now(),
            workers: BTreeSet::new(),
        };
        Arc::new(Self {
            permit,
            refusals,
            certificate,
            shows_token: AtomicBool::new(false),
            usage: Mutex::new(usage),
            receiving: AtomicUsize::new(0),
            blobs: Arc::new(Semaphore::new(BLOBS)),
            closing: AtomicBool::new(false),
            close: Notify::new(),
        })
    }

    /// Where it comes from.
    pub fn address(&self) -> IpAddr {
        self.permit.address()
    }

    /// Who answers for what is said over it.
    pub fn principal(&self) -> Principal {
        let origin = Origin::of(self.address());
        match self.certificate {
            Some(certificate) => Principal::Certificate(certificate),
            None if self.shows_token.load(Ordering::Relaxed) => Principal::Token(origin),
            None => Principal::Anonymous(origin),
        }
    }

    /// A call was let in; the answer says how long it has to wait.
    pub fn call(&self, now: Instant) -> Duration {
        self.permit.establish();
        let mut usage = self.usage();
        usage.last_call = now;
        let wait = usage.calls.wait(now);
        usage.calls.take(now);
        wait
    }

    /// Whether it may register another worker; else how long it should wait.
    pub fn registration(&self, now: Instant) -> Result<(), Duration> {
        let mut usage = self.usage();
        match usage.registrations.wait(now) {
            Duration::ZERO => {
                usage.registrations.take(now);
                Ok(())
            }
            wait => Err(wait),
        }
    }

    /// Waits until one more blob may be sent over this connection.
    pub async fn blob_permit(&self) -> Option<OwnedSemaphorePermit> {
        Arc::clone(&self.blobs).acquire_owned().await.ok()
    }

    /// Notes that this worker, which has proven its id, speaks over this connection.
    pub fn note(&self, worker: WorkerId) -> Result<(), Status> {
        let mut usage = self.usage();
        if usage.workers.len() >= MAX_WORKERS && !usage.workers.contains(&worker) {
            return Err(Status::resource_exhausted(format!(
                "at most {MAX_WORKERS} workers over one connection\ngive each its own"
            )));
        }
        usage.workers.insert(worker);
        Ok(())
    }

    /// Counts a worker that was not registered, for a reason in a few words.
    pub fn note_refusal(&self, reason: &'static str) {
        self.refusals.note(reason, self.address());
    }

    /// The workers that speak over this connection.
    pub fn workers(&self) -> Vec<WorkerId> {
        self.usage().workers.iter().copied().collect()
    }

    /// Ends the connection soon; false if that was decided before.
    pub fn close(&self) -> bool {
        let first = !self.closing.swap(true, Ordering::Relaxed);
        self.close.notify_one();
        first
    }

    /// Ready when the connection has to end.
    async fn ended(self: Arc<Self>) {
        loop {
            let (deadline, reason) = self.deadline();
            if deadline <= Instant::now() {
                self.refusals.note(reason, self.address());
                return;
            }
            tokio::select! {
                () = self.close.notified() => return tokio::time::sleep(CLOSE_DELAY).await,
                () = tokio::time::sleep_until(deadline.into()) => {}
            }
        }
    }

    /// When the connection ends unless there is a call, and why.
    fn deadline(&self) -> (Instant, &'static str) {
        let last_call = self.usage().last_call;
        if self.permit.is_established() {
            (last_call + IDLE, "no call for two minutes")
        } else {
            (last_call + FIRST_CALL, "no call after the handshake")
        }
    }

    fn usage(&self) -> MutexGuard<'_, Usage> {
        self.usage.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A stream of any kind.
pub trait Stream: AsyncRead + AsyncWrite + Send + Unpin {}
impl<T: AsyncRead + AsyncWrite + Send + Unpin> Stream for T {}

/// The bytes of a connection, which end when it has to.
pub struct ConnectionStream<S> {
    stream: S,
    connection: Arc<Connection>,
    /// `None` once it has ended.
    ended: Option<Pin<Box<dyn Future<Output = ()> + Send>>>,
}

impl<S> ConnectionStream<S> {
    /// The stream of this connection.
    pub fn new(stream: S, connection: Arc<Connection>) -> Self {
        let ended: Pin<Box<dyn Future<Output = ()> + Send>> = Box::pin(Arc::clone(&connection).ended());
        Self { stream, connection, ended: Some(ended) }
    }
}

impl<S> Connected for ConnectionStream<S> {
    type ConnectInfo = Arc<Connection>;

    fn connect_info(&self) -> Arc<Connection> {
        Arc::clone(&self.connection)
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for ConnectionStream<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if self.ended.as_mut().is_none_or(|ended| ended.as_mut().poll(context).is_ready()) {
            self.ended = None;
            return Poll::Ready(Err(io::ErrorKind::ConnectionAborted.into()));
        }
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for ConnectionStream<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}
