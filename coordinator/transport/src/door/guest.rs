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

use proto::{Fingerprint, WorkerId};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore};
use tonic::Status;
use tonic::transport::server::Connected;

use crate::door::gate::{Gate, Presence};
use crate::door::limits::Rate;

/// A connection makes its first call within this time, handshake included, or is closed.
pub const ARRIVAL: Duration = Duration::from_secs(10);
/// A connection on which no call begins for this long is closed: workers poll every few seconds.
const IDLE: Duration = Duration::from_secs(120);
/// Time to read why, for a guest that is shown out.
const FAREWELL: Duration = Duration::from_millis(500);
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
pub struct Guest {
    presence: Presence,
    /// Of the certificate it has shown, which is one of the CA's.
    pub(super) certificate: Option<Fingerprint>,
    /// Whether it has shown the token.
    pub(super) shows_token: AtomicBool,
    books: Mutex<Books>,
    /// Bytes of requests that have begun and are not whole.
    pub(super) receiving: AtomicUsize,
    /// Places for blobs on their way.
    blobs: Arc<Semaphore>,
    closing: AtomicBool,
    close: Notify,
}

struct Books {
    calls: Rate,
    registrations: Rate,
    last_call: Instant,
    workers: BTreeSet<WorkerId>,
}

impl Guest {
    /// A guest that has not called yet, on the gate's list.
    pub fn new(presence: Presence, certificate: Option<Fingerprint>) -> Arc<Self> {
        let books = Books {
            calls: Rate::new(CALLS, CALL_INTERVAL),
            registrations: Rate::new(REGISTRATIONS, Duration::from_secs(1)),
            last_call: Instant::now(),
            workers: BTreeSet::new(),
        };
        let guest = Arc::new(Self {
            presence,
            certificate,
            shows_token: AtomicBool::new(false),
            books: Mutex::new(books),
            receiving: AtomicUsize::new(0),
            blobs: Arc::new(Semaphore::new(BLOBS)),
            closing: AtomicBool::new(false),
            close: Notify::new(),
        });
        guest.gate().enter(&guest);
        guest
    }

    /// Where it comes from.
    pub fn address(&self) -> IpAddr {
        self.presence.address()
    }

    /// What it was let in for, without the secret: what an operator writes on the deny list.
    pub fn credential(&self) -> Option<String> {
        match &self.certificate {
            Some(certificate) => Some(format!("certificate {certificate}")),
            None => self.shows_token.load(Ordering::Relaxed).then(|| "token".to_owned()),
        }
    }

    /// The gate through which it came.
    pub fn gate(&self) -> &Arc<Gate> {
        self.presence.gate()
    }

    /// A call was let in; the answer says how long it has to wait.
    pub fn call(&self, now: Instant) -> Duration {
        self.presence.settle();
        let mut books = self.books();
        books.last_call = now;
        let wait = books.calls.wait(now);
        books.calls.take(now);
        wait
    }

    /// Whether it may register another worker; else how long it should wait.
    pub fn registration(&self, now: Instant) -> Result<(), Duration> {
        let mut books = self.books();
        match books.registrations.wait(now) {
            Duration::ZERO => {
                books.registrations.take(now);
                Ok(())
            }
            wait => Err(wait),
        }
    }

    /// Waits for a place for one more blob on its way to this guest.
    pub async fn blob_place(&self) -> Option<OwnedSemaphorePermit> {
        Arc::clone(&self.blobs).acquire_owned().await.ok()
    }

    /// Notes that this worker speaks over this connection.
    pub fn note(&self, worker: WorkerId) -> Result<(), Status> {
        let mut books = self.books();
        if books.workers.len() >= MAX_WORKERS && !books.workers.contains(&worker) {
            return Err(Status::resource_exhausted(format!(
                "at most {MAX_WORKERS} workers over one connection\ngive each its own"
            )));
        }
        books.workers.insert(worker);
        Ok(())
    }

    /// The workers that speak over this connection.
    pub fn workers(&self) -> Vec<WorkerId> {
        self.books().workers.iter().copied().collect()
    }

    /// Ends the connection soon; false if that was decided before.
    pub(super) fn close(&self) -> bool {
        let first = !self.closing.swap(true, Ordering::Relaxed);
        self.close.notify_one();
        first
    }

    /// Ready when the connection has to end.
    async fn over(self: Arc<Self>) {
        loop {
            let (deadline, reason) = self.deadline();
            if deadline <= Instant::now() {
                self.gate().note_stopped(reason, self.address());
                return;
            }
            tokio::select! {
                () = self.close.notified() => return tokio::time::sleep(FAREWELL).await,
                () = tokio::time::sleep_until(deadline.into()) => {}
            }
        }
    }

    /// When the connection ends unless there is a call, and why.
    fn deadline(&self) -> (Instant, &'static str) {
        let last_call = self.books().last_call;
        if self.presence.is_settled() {
            (last_call + IDLE, "no call for two minutes")
        } else {
            (last_call + ARRIVAL, "no call after the handshake")
        }
    }

    fn books(&self) -> MutexGuard<'_, Books> {
        self.books.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A guest's connection, which ends when it has to.
pub struct GuestStream<S> {
    stream: S,
    guest: Arc<Guest>,
    /// `None` once it is over.
    over: Option<Pin<Box<dyn Future<Output = ()> + Send>>>,
}

impl<S> GuestStream<S> {
    /// The connection of this guest.
    pub fn new(stream: S, guest: Arc<Guest>) -> Self {
        let over: Pin<Box<dyn Future<Output = ()> + Send>> = Box::pin(Arc::clone(&guest).over());
        Self { stream, guest, over: Some(over) }
    }
}

impl<S> Connected for GuestStream<S> {
    type ConnectInfo = Arc<Guest>;

    fn connect_info(&self) -> Arc<Guest> {
        Arc::clone(&self.guest)
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for GuestStream<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if self.over.as_mut().is_none_or(|over| over.as_mut().poll(context).is_ready()) {
            self.over = None;
            return Poll::Ready(Err(io::ErrorKind::ConnectionAborted.into()));
        }
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for GuestStream<S> {
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
