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
use tracing::Instrument as _;

use crate::backoff::Backoff;
use crate::executor::Executor;
use crate::identity::Identity;
use crate::job_slots::JobSlots;
use crate::join_file::JoinFile;
use crate::lifetime::{Leaving, Lifetime, Stage};
use crate::link::{hopeless, warn_if_plain};
use crate::trace;
use crate::wire::{Accepted, Client, Job, Poll, Registration, Reply};

/// Until reports that are not acknowledged yet are handed in again, when they keep a worker from taking a job.
const REPORTS_PAUSE: Duration = Duration::from_millis(50);
/// A call that takes this much longer than the coordinator may hold it back is given up.
const CALL_MARGIN: Duration = Duration::from_secs(10);
/// Until a worker that stays looks for the next run.
const NEXT_RUN_PAUSE: Duration = Duration::from_secs(1);
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

/// How a worker behaves where it is not told.
pub struct Conduct {
    /// How long the coordinator may be out of reach before it gives up; `None`: for ever.
    pub patience: Option<Duration>,
    /// When it leaves of its own accord.
    pub lifetime: Lifetime,
    /// Whether it waits for the next run when one has ended.
    pub stay: bool,
    /// Where the address of the coordinator may change.
    pub join_file: Option<JoinFile>,
}

/// Why a session ended.
enum End {
    /// The worker has left.
    Left(Leaving),
    /// Its lifetime has to be looked at.
    Due,
    /// The run has ended, and the worker has left it.
    RunEnded,
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
    conduct: Conduct,
    /// Near the end of its lifetime: no further job is begun.
    ending: bool,
    sequence: u64,
    current: Option<SessionId>,
    /// Whether its coordinator takes descriptions compressed.
    takes_compressed: bool,
    done_sender: mpsc::UnboundedSender<Report>,
    done: mpsc::UnboundedReceiver<Report>,
}

impl Session {
    /// A worker that is not registered yet.
    pub fn new(
        client: Client,
        identity: Identity,
        secret: WorkerSecret,
        executor: Arc<Executor>,
        conduct: Conduct,
    ) -> Self {
        // At most one job is running, so the queue holds at most a few stale reports.
        let (done_sender, done) = mpsc::unbounded_channel();
        Self {
            client,
            identity,
            secret,
            executor,
            slots: JobSlots::new(1),
            conduct,
            ending: false,
            sequence: 0,
            current: None,
            takes_compressed: false,
            done_sender,
            done,
        }
    }

    /// Works until `shutdown` is ready, the run has ended, its lifetime is over, the coordinator refuses this worker, or it
    /// has been out of reach for too long.
    pub async fn run(
        self,
        backoff: Backoff,
        shutdown: impl Future<Output = ()>,
    ) -> Result<Leaving, WorkerError> {
        let executor = Arc::clone(&self.executor);
        let ended = self.work_until(backoff, shutdown).await;
        executor.settle().await;
        if let Ok(why) = &ended {
            tracing::info!("left: {why}");
        }
        ended
    }

    async fn work_until(
        mut self,
        mut backoff: Backoff,
        shutdown: impl Future<Output = ()>,
    ) -> Result<Leaving, WorkerError> {
        tokio::pin!(shutdown);
        let mut last_contact = Instant::now();
        let (mut told, mut unknown_since) = (None, None);
        loop {
            // Where a coordinator can be told that the worker leaves, `attend` has done so.
            if let Stage::Over(why) = self.stage() {
                return Ok(why);
            }
            let end = match self.attend(shutdown.as_mut(), &mut backoff, &mut last_contact).await {
                // It would be asked without end.
                End::Unknown if unknown_since == Some(last_contact) => {
                    End::Lost(Status::unavailable("it knows no worker that it has just let in"))
                }
                end => end,
            };
            match end {
                End::Left(why) => return Ok(why),
                End::Due => {}
                End::RunEnded if self.conduct.stay => {
                    self.slots.clear();
                    if self.current.take().is_some() {
                        tracing::info!("the run has ended, waiting for the next");
                    }
                    last_contact = Instant::now();
                    tokio::select! {
                        () = &mut shutdown => return Ok(Leaving::Stopped),
                        () = self.due() => {}
                        () = tokio::time::sleep(NEXT_RUN_PAUSE) => {}
                    }
                }
                End::RunEnded => return Ok(Leaving::RunEnded),
                End::Refused(message) => {
                    let lines: Vec<_> = message.lines().map(proto::printable).collect();
                    return Err(WorkerError::Refused { message: lines.join("\n") });
                }
                End::Unknown => {
                    unknown_since = Some(last_contact);
                    tracing::info!("the coordinator does not know this worker, registering again");
                }
                End::Lost(status) => {
                    let reason = reason(&status);
                    if self.conduct.patience.is_some_and(|patience| last_contact.elapsed() > patience) {
                        return Err(WorkerError::OutOfReach { reason });
                    }
                    let pause = backoff.next_pause();
                    // Not each time; but what was put right must not hide what is wrong beside it.
                    if backoff.is_first() || told.as_ref() != Some(&reason) {
                        tracing::warn!("coordinator out of reach: {reason}, trying again");
                        told = Some(reason);
                    }
                    let due = self.due();
                    tokio::select! {
                        () = &mut shutdown => return Ok(Leaving::Stopped),
                        () = due => {}
                        () = self.work_on() => {}
                        () = tokio::time::sleep(pause) => {}
                    }
                }
            }
        }
    }

    /// Registers, and works until something ends the session.
    async fn attend<S: Future<Output = ()>>(
        &mut self,
        mut shutdown: Pin<&mut S>,
        backoff: &mut Backoff,
        last_contact: &mut Instant,
    ) -> End {
        let due = self.due();
        tokio::select! {
            () = &mut shutdown => return End::Left(Leaving::Stopped),
            () = due => return End::Due,
            looked = self.look_for_coordinator() => if let Err(reason) = looked {
                return End::Lost(Status::unavailable(reason));
            },
        }
        let due = self.due();
        let accepted = tokio::select! {
            () = &mut shutdown => return End::Left(Leaving::Stopped),
            () = due => return End::Due,
            registered = self.register() => match registered {
                Ok(accepted) => accepted,
                Err(end) => return end,
            },
        };
        let timeout = accepted.hold + CALL_MARGIN;

        loop {
            if let Stage::Over(why) = self.stage() {
                return self.leave(why).await;
            }
            self.start_next();
            let request = self.request(false);
            let reply = self.client.clone().poll(request, timeout);
            let due = self.due();
            tokio::select! {
                biased;
                () = &mut shutdown => return self.leave(Leaving::Stopped).await,
                Some(done) = self.done.recv() => {
                    // The poll under way is dropped; should its reply carry jobs, the next poll does not list
                    // them and they are handed out again.
                    self.finish(done);
                    continue;
                }
                reply = reply => match reply {
                    Ok(reply) => {
                        *last_contact = Instant::now();
                        backoff.reset();
                        if reply.run_ended {
                            // The coordinator waits for this, and may be gone by then.
                            let _ = self.hand_back().await;
                            return End::RunEnded;
                        }
                        self.slots.absorb(reply);
                    }
                    Err(status) if status.code() == Code::NotFound => return End::Unknown,
                    Err(status) => return failed(status),
                },
                () = due => continue,
            }
            self.start_next();
            if self.wanted() == 0 {
                // Busy: the next poll is due when a job is done, or as a heartbeat. Reports that were handed in and are
                // not acknowledged yet go with it; where there is nothing else to do, they wait for a slow disk.
                let pause = if self.slots.only_reports() { REPORTS_PAUSE } else { accepted.heartbeat };
                let due = self.due();
                tokio::select! {
                    () = &mut shutdown => return self.leave(Leaving::Stopped).await,
                    Some(done) = self.done.recv() => self.finish(done),
                    () = due => {}
                    () = tokio::time::sleep(pause) => {}
                }
            }
        }
    }

    /// Reads the file again that says where the coordinator is, if there is one.
    async fn look_for_coordinator(&mut self) -> Result<(), String> {
        if let Some(file) = &mut self.conduct.join_file
            && let Some(address) = file.refresh().await?
        {
            tracing::info!("looking for the coordinator at {address}");
            warn_if_plain(&address);
        }
        Ok(())
    }

    /// What this worker may do now.
    fn stage(&mut self) -> Stage {
        let stage = self.conduct.lifetime.stage(self.slots.has_job(), Instant::now());
        self.ending = stage != Stage::Working;
        stage
    }

    /// Ready when that changes, if nothing else happens.
    fn due(&self) -> impl Future<Output = ()> + use<> {
        let next = self.conduct.lifetime.next_change(self.slots.has_job(), Instant::now());
        async move {
            match next {
                Some(next) => tokio::time::sleep_until(next.into()).await,
                None => std::future::pending().await,
            }
        }
    }

    /// Does the jobs that were taken, for ever: a coordinator that is started again takes their reports.
    async fn work_on(&mut self) {
        loop {
            self.start_next();
            match self.done.recv().await {
                Some(done) => self.finish(done),
                None => std::future::pending().await, // this session holds a sender
            }
        }
    }

    async fn register(&mut self) -> Result<Accepted, End> {
        let registered = self.client.register(&self.secret, &self.identity, CALL_MARGIN).await;
        let accepted = match registered.map_err(failed)? {
            Registration::Accepted(accepted) => accepted,
            Registration::Refused(message) => return Err(End::Refused(message)),
            Registration::RunEnded => return Err(End::RunEnded),
        };
        self.takes_compressed = accepted.takes_compressed;
        if self.current != Some(accepted.session) {
            self.slots.clear();
            self.current = Some(accepted.session);
            self.executor.name_run(accepted.session.to_string()).await;
            self.executor.set_audit(accepted.audit);
            self.executor.offer_bucket(accepted.has_bucket);
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
            takes_compressed: self.takes_compressed,
            wanted: if leaving { 0 } else { self.wanted() },
            leaving,
        }
    }

    /// How many more jobs are wanted now.
    fn wanted(&self) -> usize {
        if self.ending { 0 } else { self.slots.wanted() }
    }

    /// Leaves, and tells the coordinator.
    async fn leave(&mut self, why: Leaving) -> End {
        if let Err(status) = self.hand_back().await {
            tracing::warn!("leaving, but the coordinator could not be told: {}", reason(&status));
        }
        End::Left(why)
    }

    /// Hands back every lease and hands in every report.
    async fn hand_back(&mut self) -> Result<Reply, Status> {
        while let Ok(done) = self.done.try_recv() {
            self.finish(done);
        }
        let request = self.request(true);
        self.client.clone().poll(request, LEAVE_TIMEOUT).await
    }

    /// Takes in the report of the running job.
    fn finish(&mut self, done: Report) {
        self.slots.finish(done);
        self.conduct.lifetime.note_job(Instant::now());
    }

    /// Starts the next job if none is running, unless the end is near.
    fn start_next(&mut self) {
        if self.ending {
            return;
        }
        let Some(Job { lease, task }) = self.slots.start() else { return };
        tracing::debug!("job {}, attempt {}: begun", lease.job, lease.attempt);
        let executor = Arc::clone(&self.executor);
        let sender = self.done_sender.clone();
        let span = trace::job(self.current, self.secret.id(), &lease, task.as_ref().ok());
        tokio::spawn(async move {
            let started = Instant::now();
            let outcome = match task {
                Ok(task) => match tokio::spawn(executor.carry_out(task).instrument(span.clone())).await {
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
            trace::end_job(&span, &outcome);
            let report = Report { lease, run_seconds: started.elapsed().as_secs_f64(), outcome };
            let _ = sender.send(report); // the receiver is gone only when the worker has stopped
        });
    }
}

/// What a call that failed means for the session.
fn failed(status: Status) -> End {
    hopeless(&status).map_or(End::Lost(status), End::Refused)
}

/// Why a call failed, as it may be shown.
fn reason(status: &Status) -> String {
    let innermost = proto::root_cause(status);
    if std::ptr::eq(innermost, status as &dyn std::error::Error) {
        return on_one_line(status.message());
    }
    // rustls is wordy about a coordinator that was killed and so did not close the connection.
    let ended = |error: &io::Error| error.kind() == io::ErrorKind::UnexpectedEof;
    if innermost.downcast_ref().is_some_and(ended) {
        return "the connection was closed".to_owned();
    }
    on_one_line(&innermost.to_string())
}

/// A message with its advice behind it.
fn on_one_line(text: &str) -> String {
    text.lines().map(proto::printable).collect::<Vec<_>>().join("; ")
}

fn panic_message(error: tokio::task::JoinError) -> String {
    let Ok(panic) = error.try_into_panic() else { return "the task was cancelled".to_owned() };
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "no message".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reason_is_one_line_with_its_advice() {
        let told = |text: &str| reason(&Status::unavailable(text));
        assert_eq!(
            told("join: no such file, got tls/join\ncopy it again"),
            "join: no such file, got tls/join; copy it again"
        );
        assert_eq!(told("\u{202e}one\rline"), "\\u{202e}one\\rline");
    }
}
