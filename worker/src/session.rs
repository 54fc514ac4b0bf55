//! A worker's session with its coordinator: register, poll, work, come back after an interruption.

use std::future::Future;
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

use proto::task::{Failure, FailureReason, Report};
use proto::{SessionId, WorkerSecret};
use tokio::sync::mpsc;
use tonic::{Code, Status};

use crate::backoff::Backoff;
use crate::executor::Executor;
use crate::identity::Identity;
use crate::job_slots::JobSlots;
use crate::link::hopeless;
use crate::wire::{Accepted, Client, Job, Poll, Registration};

/// Until reports that are not acknowledged yet are handed in again, when they keep a worker from taking a job.
const REPORTS_PAUSE: Duration = Duration::from_millis(50);
/// A call that takes this much longer than the coordinator may hold it back is given up.
const CALL_MARGIN: Duration = Duration::from_secs(10);
/// Leaving must not keep a process alive that was asked to stop.
const LEAVE_TIMEOUT: Duration = Duration::from_secs(5);

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

/// Why a session ended.
enum End {
    /// The worker was asked to stop and has left.
    Left,
    /// The coordinator does not know this worker (any more).
    Unknown,
    /// The coordinator is out of reach.
    Lost(Status),
    /// The coordinator will never take this worker.
    Refused(String),
}

/// One worker.
pub struct Session {
    client: Client,
    identity: Identity,
    secret: WorkerSecret,
    executor: Arc<Executor>,
    slots: JobSlots,
    sequence: u64,
    current: Option<SessionId>,
    done_sender: mpsc::UnboundedSender<Report>,
    done: mpsc::UnboundedReceiver<Report>,
}

impl Session {
    /// A worker that is not registered yet.
    pub fn new(client: Client, identity: Identity, secret: WorkerSecret, executor: Arc<Executor>) -> Self {
        // At most one job is running, so the queue holds at most a few stale reports.
        let (done_sender, done) = mpsc::unbounded_channel();
        Self {
            client,
            identity,
            secret,
            executor,
            slots: JobSlots::new(1),
            sequence: 0,
            current: None,
            done_sender,
            done,
        }
    }

    /// Works until `shutdown` is ready, the coordinator refuses this worker, or it has been out of reach for
    /// longer than `patience`.
    pub async fn run(
        self,
        patience: Option<Duration>,
        backoff: Backoff,
        shutdown: impl Future<Output = ()>,
    ) -> Result<(), WorkerError> {
        let executor = Arc::clone(&self.executor);
        let ended = self.work_until(patience, backoff, shutdown).await;
        executor.settle().await;
        ended
    }

    async fn work_until(
        mut self,
        patience: Option<Duration>,
        mut backoff: Backoff,
        shutdown: impl Future<Output = ()>,
    ) -> Result<(), WorkerError> {
        tokio::pin!(shutdown);
        let mut last_contact = Instant::now();
        loop {
            match self.attend(shutdown.as_mut(), &mut backoff, &mut last_contact).await {
                End::Left => return Ok(()),
                End::Refused(message) => {
                    let lines: Vec<_> = message.lines().map(proto::printable).collect();
                    return Err(WorkerError::Refused { message: lines.join("\n") });
                }
                End::Unknown => {
                    tracing::info!("the coordinator does not know this worker, registering again")
                }
                End::Lost(status) => {
                    if patience.is_some_and(|patience| last_contact.elapsed() > patience) {
                        return Err(WorkerError::OutOfReach { reason: reason(&status) });
                    }
                    let pause = backoff.next_pause();
                    if backoff.is_first() {
                        tracing::warn!("coordinator out of reach: {}, trying again", reason(&status));
                    }
                    tokio::select! {
                        () = &mut shutdown => return Ok(()),
                        () = self.work_on() => {}
                        () = tokio::time::sleep(pause) => {}
                    }
                }
            }
        }
    }

    async fn attend<S: Future<Output = ()>>(
        &mut self,
        mut shutdown: Pin<&mut S>,
        backoff: &mut Backoff,
        last_contact: &mut Instant,
    ) -> End {
        let accepted = tokio::select! {
            () = &mut shutdown => return End::Left,
            registered = self.register() => match registered {
                Ok(accepted) => accepted,
                Err(end) => return end,
            },
        };
        let timeout = accepted.hold + CALL_MARGIN;

        loop {
            self.start_next();
            let request = self.request(false);
            let reply = self.client.clone().poll(request, timeout);
            tokio::select! {
                biased;
                () = &mut shutdown => {
                    self.leave().await;
                    return End::Left;
                }
                Some(done) = self.done.recv() => {
                    // The poll under way is dropped; should its reply carry jobs, the next poll does not list
                    // them and they are handed out again.
                    self.slots.finish(done);
                    continue;
                }
                reply = reply => match reply {
                    Ok(reply) => {
                        *last_contact = Instant::now();
                        backoff.reset();
                        self.slots.absorb(reply);
                    }
                    Err(status) if status.code() == Code::NotFound => return End::Unknown,
                    Err(status) => return failed(status),
                },
            }
            self.start_next();
            if self.slots.wanted() == 0 {
                // Busy: the next poll is due when a job is done, or as a heartbeat. Reports that were handed in and are
                // not acknowledged yet go with it; where there is nothing else to do, they wait for a slow disk.
                let pause = if self.slots.only_reports() { REPORTS_PAUSE } else { accepted.heartbeat };
                tokio::select! {
                    () = &mut shutdown => {
                        self.leave().await;
                        return End::Left;
                    }
                    Some(done) = self.done.recv() => self.slots.finish(done),
                    () = tokio::time::sleep(pause) => {}
                }
            }
        }
    }

    /// Does the jobs that were taken, for ever: a coordinator that is started again takes their reports.
    async fn work_on(&mut self) {
        loop {
            self.start_next();
            match self.done.recv().await {
                Some(done) => self.slots.finish(done),
                None => std::future::pending().await, // this session holds a sender
            }
        }
    }

    async fn register(&mut self) -> Result<Accepted, End> {
        let registered = self.client.register(&self.secret, &self.identity, CALL_MARGIN).await;
        let accepted = match registered.map_err(failed)? {
            Registration::Accepted(accepted) => accepted,
            Registration::Refused(message) => return Err(End::Refused(message)),
        };
        if self.current != Some(accepted.session) {
            self.slots.clear();
            self.current = Some(accepted.session);
            self.executor.name_run(accepted.session.to_string()).await;
            self.executor.set_audit(accepted.audit);
            tracing::info!("joined as {}", proto::printable(&accepted.name));
        }
        Ok(accepted)
    }

    fn request(&mut self, leaving: bool) -> Poll {
        self.sequence += 1;
        Poll {
            secret: self.secret.clone(),
            session: self.current,
            sequence: self.sequence,
            held: if leaving { vec![] } else { self.slots.held() },
            finished: self.slots.finished(),
            wanted: if leaving { 0 } else { self.slots.wanted() },
            leaving,
        }
    }

    /// Hands back every lease and hands in every report.
    async fn leave(&mut self) {
        while let Ok(done) = self.done.try_recv() {
            self.slots.finish(done);
        }
        let request = self.request(true);
        match self.client.clone().poll(request, LEAVE_TIMEOUT).await {
            Ok(_) => tracing::info!("left"),
            Err(status) => tracing::warn!("left, but the coordinator could not be told: {}", reason(&status)),
        }
    }

    /// Starts the next job if none is running.
    fn start_next(&mut self) {
        let Some(Job { lease, task }) = self.slots.start() else { return };
        tracing::debug!("job {}, attempt {}: begun", lease.job, lease.attempt);
        let executor = Arc::clone(&self.executor);
        let sender = self.done_sender.clone();
        tokio::spawn(async move {
            let started = Instant::now();
            let outcome = match task {
                Ok(task) => match tokio::spawn(executor.carry_out(task)).await {
                    Ok(outcome) => outcome.map_err(Failure::from),
                    Err(error) => Err(Failure::new(
                        FailureReason::Panic,
                        format_args!("evaluation panicked: {}", panic_message(error)),
                    )),
                },
                Err(error) => Err(Failure::from(error)),
            };
            if let Err(failure) = &outcome {
                tracing::error!("job {}: {failure}", lease.job);
            }
            let report = Report { lease, run_seconds: started.elapsed().as_secs_f64(), outcome };
            let _ = sender.send(report); // the receiver is gone only when the worker has stopped
        });
    }
}

/// What a call that failed means for the session.
fn failed(status: Status) -> End {
    hopeless(&status).map_or(End::Lost(status), End::Refused)
}

/// The innermost cause says most: "connection refused" rather than "transport error".
fn reason(status: &Status) -> String {
    let mut innermost: &dyn std::error::Error = status;
    while let Some(source) = innermost.source() {
        innermost = source;
    }
    if std::ptr::eq(innermost, status as &dyn std::error::Error) {
        return proto::printable(status.message()).into_owned();
    }
    // rustls is wordy about a coordinator that was killed and so did not close the connection.
    let ended = |error: &io::Error| error.kind() == io::ErrorKind::UnexpectedEof;
    if innermost.downcast_ref().is_some_and(ended) {
        return "the connection was closed".to_owned();
    }
    proto::printable(&innermost.to_string()).into_owned()
}

fn panic_message(error: tokio::task::JoinError) -> String {
    let Ok(panic) = error.try_into_panic() else { return "the task was cancelled".to_owned() };
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "no message".to_owned())
}
