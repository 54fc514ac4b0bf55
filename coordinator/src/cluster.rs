//! The scheduler as several tasks share it: the service feeds it, the run waits on it, a clock expires leases.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use proto::{JobId, Lease, SessionId, WorkerId};
use tokio::sync::Notify;

use crate::blobs::BlobStore;
use crate::evaluation::Evaluation;
use crate::scheduler::{
    Answer, Arrival, Farewell, Finished, Introduction, JobFailed, Limits, Poll, PollRefusal, Scheduler,
    Staffing,
};

/// How often silence is looked for.
const TICK: Duration = Duration::from_millis(500);

/// Why evaluations stopped for good.
#[derive(Debug, thiserror::Error)]
pub enum ClusterError {
    /// A job failed as often as the limit allows.
    #[error("evaluation of {parameters}: failed {count} times, got\n  {failures}\nlook at the workers' logs; coordinator.max_failures and coordinator.job_seconds set the limits", parameters = .0.evaluation.parameters, count = .0.failures.len(), failures = first_lines(&.0.failures))]
    JobFailed(JobFailed),
    /// No worker is left, and none came back.
    #[error(
        "workers: the last one was lost {seconds} s ago and none has joined since\nstart workers, then run the same command again"
    )]
    NoWorkers {
        /// Since when.
        seconds: u64,
    },
}

/// What failed, a line each: advice given to one machine is not repeated for all.
fn first_lines(failures: &[String]) -> String {
    let lines: Vec<&str> = failures.iter().filter_map(|failure| failure.lines().next()).collect();
    lines.join("\n  ")
}

/// Scheduler, blobs and the signals between those who use them.
pub struct Cluster {
    /// Names this start of the coordinator.
    pub session: SessionId,
    /// What workers may fetch.
    pub blobs: BlobStore,
    limits: Limits,
    scheduler: Mutex<Scheduler>,
    /// There may be a job for a poll that is held back.
    work: Notify,
    /// Something was finished, failed or lost.
    news: Notify,
}

impl Cluster {
    /// A cluster without workers.
    pub fn new(limits: Limits) -> Arc<Self> {
        Arc::new(Self {
            session: SessionId(rand::random()),
            blobs: BlobStore::default(),
            limits,
            scheduler: Mutex::new(Scheduler::new(limits)),
            work: Notify::new(),
            news: Notify::new(),
        })
    }

    /// How often a busy worker has to poll: several polls may be lost before its lease ends.
    pub fn heartbeat(&self) -> Duration {
        (self.limits.lease / 6).min(Duration::from_secs(5))
    }

    /// How long a poll may be held back.
    pub fn hold(&self) -> Duration {
        (self.limits.lease / 3).min(Duration::from_secs(10))
    }

    /// See [`Scheduler::register`].
    pub fn register(&self, id: WorkerId, introduction: Introduction) -> Option<String> {
        let label = self.scheduler().register(id, introduction, Instant::now());
        self.news.notify_one();
        label
    }

    /// Answers a poll; holds the answer back while it would be empty and the worker wants jobs.
    pub async fn poll(&self, id: WorkerId, poll: Poll) -> Result<Answer, PollRefusal> {
        let (sequence, wanted, leaving) = (poll.sequence, poll.wanted, poll.leaving);
        let reports = !poll.finished.is_empty();
        let (mut answer, waiting) = {
            let mut scheduler = self.scheduler();
            let answer = scheduler.poll(id, poll, Instant::now())?;
            (answer, scheduler.has_waiting())
        };
        if reports || leaving {
            self.news.notify_one();
        }
        if waiting {
            // A failure, a goodbye or a lost reply has put jobs back that this worker did not take.
            self.work.notify_waiters();
        }
        let empty = answer.jobs.is_empty() && answer.acknowledged.is_empty() && answer.revoked.is_empty();
        if empty && wanted > 0 && !leaving {
            answer.jobs = self.wait_for_jobs(id, sequence, wanted).await?;
        }
        Ok(answer)
    }

    async fn wait_for_jobs(
        &self,
        id: WorkerId,
        sequence: u64,
        wanted: usize,
    ) -> Result<Vec<(Lease, Arc<Evaluation>)>, PollRefusal> {
        let deadline = tokio::time::Instant::now() + self.hold();
        loop {
            let mut work = std::pin::pin!(self.work.notified());
            work.as_mut().enable(); // before looking, so that a job submitted in between is not missed
            let jobs = self.scheduler().lease_later(id, sequence, wanted, Instant::now())?;
            if !jobs.is_empty() {
                return Ok(jobs);
            }
            if tokio::time::timeout_at(deadline, work).await.is_err() {
                return Ok(jobs);
            }
        }
    }

    /// Submits evaluations and waits for all of them; results are in the order of submission, whatever the order
    /// of arrival. `watch` is shown every piece of news.
    pub async fn evaluate(
        &self,
        evaluations: Vec<Evaluation>,
        mut watch: impl FnMut(&ClusterNews),
    ) -> Result<Vec<Finished>, ClusterError> {
        let jobs: Vec<JobId> = {
            let mut scheduler = self.scheduler();
            let now = Instant::now();
            evaluations.into_iter().map(|evaluation| scheduler.submit(Arc::new(evaluation), now)).collect()
        };
        self.work.notify_waiters();
        let mut results: Vec<Option<Finished>> = jobs.iter().map(|_| None).collect();
        loop {
            let news = self.look();
            for finished in &news.finished {
                if let Ok(place) = jobs.binary_search(&finished.job) {
                    results[place] = Some(finished.clone());
                }
            }
            watch(&news);
            if let Some(failed) = news.failed {
                return Err(ClusterError::JobFailed(failed));
            }
            if results.iter().all(Option::is_some) {
                return Ok(results.into_iter().flatten().collect());
            }
            if news.staffing == Staffing::GraceOver {
                return Err(ClusterError::NoWorkers { seconds: self.limits.worker_grace.as_secs() });
            }
            let _ = tokio::time::timeout(TICK, self.news.notified()).await; // the tick expires leases
        }
    }

    /// Waits until a worker has joined; calls `still_waiting` each minute.
    pub async fn wait_for_worker(&self, mut still_waiting: impl FnMut(Duration)) {
        let begun = Instant::now();
        let mut next = Duration::from_secs(60);
        // Without draining what happened: that is for whoever watches the evaluations.
        while self.scheduler().staffing(Instant::now()) != Staffing::Staffed {
            if begun.elapsed() >= next {
                still_waiting(begun.elapsed());
                next += Duration::from_secs(60);
            }
            let _ = tokio::time::timeout(TICK, self.news.notified()).await;
        }
    }

    fn look(&self) -> ClusterNews {
        let mut scheduler = self.scheduler();
        let now = Instant::now();
        scheduler.expire(now);
        let farewells = scheduler.drain_farewells();
        if !farewells.is_empty() {
            self.work.notify_waiters();
        }
        ClusterNews {
            finished: scheduler.drain_finished(),
            failed: scheduler.failed().cloned(),
            farewells,
            staffing: scheduler.staffing(now),
            arrivals: scheduler.drain_arrivals(),
            workers: scheduler.worker_count(),
        }
    }

    fn scheduler(&self) -> MutexGuard<'_, Scheduler> {
        // Decisions are made in one go: a panic in one of them is a bug, but leaves no half-made state to fear.
        self.scheduler.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What happened since the last look.
#[derive(Debug)]
pub struct ClusterNews {
    /// Evaluations that were finished.
    pub finished: Vec<Finished>,
    /// Workers that went.
    pub farewells: Vec<Farewell>,
    /// Workers that came.
    pub arrivals: Vec<Arrival>,
    /// How many workers are there.
    pub workers: usize,
    staffing: Staffing,
    failed: Option<JobFailed>,
}
