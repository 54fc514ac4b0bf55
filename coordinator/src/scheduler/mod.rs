//! Who computes what: workers, jobs and leases, as plain decisions with `now` as an argument.
//!
//! Nothing here does IO or waits. The service feeds polls in, the run driver submits jobs and drains outcomes.

mod worker;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use proto::{JobId, Lease, WorkerId};

use crate::evaluation::{Evaluation, EvaluationResult};
use worker::Worker;
pub use worker::{Farewell, Introduction, WorkerSummary};

/// Bounds that the experiment sets.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// A worker that has not polled for this long is given up, and its leases with it.
    pub lease: Duration,
    /// Failures (reports of failure and lost workers) after which a job stops the run.
    pub max_failures: u32,
    /// How long a run waits for another worker after it lost the last one.
    pub worker_grace: Duration,
    /// Registered workers beyond which registration is refused.
    pub max_workers: usize,
}

/// What one worker says in one poll.
#[derive(Debug, Default)]
pub struct Poll {
    /// Grows with each poll of a worker.
    pub sequence: u64,
    /// Every lease the worker holds.
    pub held: Vec<Lease>,
    /// Finished and not acknowledged.
    pub finished: Vec<Report>,
    /// How many more jobs the worker would take.
    pub wanted: usize,
    /// The worker is about to stop.
    pub leaving: bool,
}

/// A finished lease.
#[derive(Clone, Debug)]
pub struct Report {
    /// Which lease.
    pub lease: Lease,
    /// Seconds on the worker's clock.
    pub run_seconds: f64,
    /// The answer, or why there is none.
    pub outcome: Result<EvaluationResult, String>,
}

/// What a poll is answered with.
#[derive(Debug, Default)]
pub struct Answer {
    /// Reports that need not be sent again.
    pub acknowledged: Vec<Lease>,
    /// Leases that are no longer wanted.
    pub revoked: Vec<Lease>,
    /// New leases.
    pub jobs: Vec<(Lease, Arc<Evaluation>)>,
}

/// Why a poll is not answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PollRefusal {
    /// The worker has to register first.
    UnknownWorker,
    /// A newer poll of the same worker was seen.
    Stale,
}

/// A job that is done.
#[derive(Clone, Debug)]
pub struct Finished {
    /// Which job.
    pub job: JobId,
    /// The first valid answer.
    pub result: EvaluationResult,
    /// Label of the worker that gave it.
    pub worker: String,
    /// Which attempt it was.
    pub attempt: u32,
    /// From submission to the answer's lease.
    pub queued: Duration,
    /// Seconds on the worker's clock.
    pub run_seconds: f64,
}

/// A job that failed as often as the limit allows.
#[derive(Clone, Debug, PartialEq)]
pub struct JobFailed {
    /// What was asked.
    pub evaluation: Arc<Evaluation>,
    /// `worker: reason` of every failure, oldest first.
    pub failures: Vec<String>,
}

/// Whether anybody is there to work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Staffing {
    /// At least one worker.
    Staffed,
    /// No worker has joined yet.
    NotYet,
    /// The last worker was lost this long ago, and there is still time for another to join.
    Lost(Duration),
    /// The grace after the loss of the last worker is over.
    GraceOver,
}

struct Job {
    evaluation: Arc<Evaluation>,
    submitted: Instant,
    attempts: u32,
    /// Who works on it now, on which attempt, since when.
    lease: Option<(WorkerId, u32, Instant)>,
    failures: Vec<(WorkerId, String)>,
}

/// All workers and all unfinished jobs of one run.
pub struct Scheduler {
    limits: Limits,
    workers: BTreeMap<WorkerId, Worker>,
    jobs: BTreeMap<JobId, Job>,
    /// Jobs without a lease; lowest id first.
    waiting: BTreeSet<JobId>,
    next_job: u64,
    finished: Vec<Finished>,
    failed: Option<JobFailed>,
    farewells: Vec<Farewell>,
    /// Every label ever given, so that none names two workers and a returning worker keeps its own.
    labels: BTreeMap<WorkerId, String>,
    alone_since: Option<Instant>,
}

impl Scheduler {
    /// An empty scheduler.
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            workers: BTreeMap::new(),
            jobs: BTreeMap::new(),
            waiting: BTreeSet::new(),
            next_job: 1,
            finished: Vec::new(),
            failed: None,
            farewells: Vec::new(),
            labels: BTreeMap::new(),
            alone_since: None,
        }
    }

    /// Adds a job; jobs are handed out in the order of submission.
    pub fn submit(&mut self, evaluation: Arc<Evaluation>, now: Instant) -> JobId {
        let id = JobId(self.next_job);
        self.next_job += 1;
        let job = Job { evaluation, submitted: now, attempts: 0, lease: None, failures: Vec::new() };
        self.jobs.insert(id, job);
        self.waiting.insert(id);
        id
    }

    /// Introduces a worker, or welcomes one back, and returns its unique label; `None` if there are too many.
    pub fn register(&mut self, id: WorkerId, introduction: Introduction, now: Instant) -> Option<String> {
        if let Some(worker) = self.workers.get_mut(&id) {
            worker.last_seen = now;
            return Some(worker.label.clone());
        }
        if self.workers.len() >= self.limits.max_workers {
            return None;
        }
        let label = match self.labels.get(&id) {
            Some(label) => label.clone(),
            None => worker::unique_label(&introduction.name, self.labels.values().map(String::as_str)),
        };
        self.labels.insert(id, label.clone());
        self.workers.insert(id, Worker::new(label.clone(), introduction, now));
        self.alone_since = None;
        Some(label)
    }

    /// One poll: heartbeat, finished work, request for more.
    pub fn poll(&mut self, id: WorkerId, poll: Poll, now: Instant) -> Result<Answer, PollRefusal> {
        let worker = self.workers.get_mut(&id).ok_or(PollRefusal::UnknownWorker)?;
        if poll.sequence <= worker.sequence {
            return Err(PollRefusal::Stale);
        }
        worker.sequence = poll.sequence;
        worker.last_seen = now;

        let mut answer = Answer::default();
        for report in poll.finished {
            answer.acknowledged.push(report.lease);
            self.accept(id, report);
        }
        self.reconcile(id, &poll.held, now, &mut answer.revoked);
        if poll.leaving {
            self.remove_worker(id, Farewell::LEFT, now);
        } else {
            answer.jobs = self.lease_jobs(id, poll.wanted, now);
        }
        Ok(answer)
    }

    /// Hands out more jobs in answer to the poll with this sequence number, unless a newer one was seen.
    pub fn lease_later(
        &mut self,
        id: WorkerId,
        sequence: u64,
        wanted: usize,
        now: Instant,
    ) -> Result<Vec<(Lease, Arc<Evaluation>)>, PollRefusal> {
        let worker = self.workers.get_mut(&id).ok_or(PollRefusal::UnknownWorker)?;
        if worker.sequence != sequence {
            return Err(PollRefusal::Stale);
        }
        worker.last_seen = now;
        Ok(self.lease_jobs(id, wanted, now))
    }

    /// Gives up the workers that have been silent for longer than a lease lasts.
    pub fn expire(&mut self, now: Instant) {
        let silent = |worker: &Worker| now.saturating_duration_since(worker.last_seen) > self.limits.lease;
        let lost: Vec<WorkerId> =
            self.workers.iter().filter(|(_, worker)| silent(worker)).map(|(id, _)| *id).collect();
        for id in lost {
            self.remove_worker(id, Farewell::LOST, now);
        }
    }

    /// Whether anybody is there to work.
    pub fn staffing(&self, now: Instant) -> Staffing {
        match self.alone_since {
            _ if !self.workers.is_empty() => Staffing::Staffed,
            None => Staffing::NotYet,
            Some(since) => {
                let alone = now.saturating_duration_since(since);
                if alone > self.limits.worker_grace { Staffing::GraceOver } else { Staffing::Lost(alone) }
            }
        }
    }

    /// Jobs that were finished since the last call, in order of arrival.
    pub fn drain_finished(&mut self) -> Vec<Finished> {
        std::mem::take(&mut self.finished)
    }

    /// Workers that went since the last call.
    pub fn drain_farewells(&mut self) -> Vec<Farewell> {
        std::mem::take(&mut self.farewells)
    }

    /// The first job that failed for good, if any.
    pub fn failed(&self) -> Option<&JobFailed> {
        self.failed.as_ref()
    }

    /// The workers that are there, by label.
    pub fn workers(&self) -> Vec<WorkerSummary> {
        let mut all: Vec<WorkerSummary> = self.workers.values().map(Worker::summary).collect();
        all.sort_by(|a, b| a.label.cmp(&b.label));
        all
    }

    /// Takes one report; the first valid answer to a job counts, from whichever lease.
    fn accept(&mut self, id: WorkerId, report: Report) {
        let Lease { job: job_id, attempt } = report.lease;
        let Some(job) = self.jobs.get(&job_id) else {
            return; // answered before, by this worker or another
        };
        // An attempt that was never handed out is an invention.
        let known = (1..=job.attempts).contains(&attempt);
        let outcome = report.outcome.and_then(|result| job.evaluation.check(&result).map(|()| result));
        let label = self.label(id);
        match outcome {
            Ok(result) if known => {
                let Some(job) = self.jobs.remove(&job_id) else { return };
                self.waiting.remove(&job_id);
                let mut leased = job.submitted;
                if let Some((holder, _, since)) = job.lease {
                    leased = since;
                    self.forget_lease(holder, job_id);
                }
                if let Some(worker) = self.workers.get_mut(&id) {
                    worker.finished += 1;
                }
                self.finished.push(Finished {
                    job: job_id,
                    result,
                    worker: label,
                    attempt,
                    queued: leased.saturating_duration_since(job.submitted),
                    run_seconds: report.run_seconds,
                });
            }
            Ok(_) => {}
            Err(reason) => {
                // A failure on a lease that was given up has been counted when it was.
                if job.lease.is_some_and(|(holder, current, _)| (holder, current) == (id, attempt)) {
                    self.release(job_id);
                    self.count_failure(job_id, id, format!("{label}: {reason}"));
                }
            }
        }
    }

    /// Brings the leases on our books in line with those the worker says it holds.
    fn reconcile(&mut self, id: WorkerId, held: &[Lease], now: Instant, revoked: &mut Vec<Lease>) {
        let booked: Vec<(JobId, u32)> =
            self.workers.get(&id).map_or_else(Vec::new, |w| w.leases.iter().map(|(j, a)| (*j, *a)).collect());
        for (job, attempt) in booked {
            if !held.contains(&Lease { job, attempt }) {
                self.release(job); // the reply that carried it was lost
            }
        }
        for &lease in held {
            let Some(job) = self.jobs.get_mut(&lease.job) else {
                revoked.push(lease);
                continue;
            };
            match job.lease {
                Some((holder, attempt, _)) if (holder, attempt) == (id, lease.attempt) => {}
                // Given up while the worker was out of reach, and nobody else has begun: it may go on.
                None if (1..=job.attempts).contains(&lease.attempt) => {
                    job.lease = Some((id, lease.attempt, now));
                    self.waiting.remove(&lease.job);
                    if let Some(worker) = self.workers.get_mut(&id) {
                        worker.leases.insert(lease.job, lease.attempt);
                    }
                }
                _ => revoked.push(lease),
            }
        }
    }

    fn lease_jobs(&mut self, id: WorkerId, wanted: usize, now: Instant) -> Vec<(Lease, Arc<Evaluation>)> {
        let mut leased = Vec::new();
        while leased.len() < wanted {
            let Some(job_id) = self.waiting.iter().copied().find(|job| self.may_try(id, *job)) else { break };
            let (Some(job), Some(worker)) = (self.jobs.get_mut(&job_id), self.workers.get_mut(&id)) else {
                break;
            };
            job.attempts += 1;
            job.lease = Some((id, job.attempts, now));
            worker.leases.insert(job_id, job.attempts);
            self.waiting.remove(&job_id);
            leased.push((Lease { job: job_id, attempt: job.attempts }, Arc::clone(&job.evaluation)));
        }
        leased
    }

    /// A job that failed on a worker goes to another one, as long as there is one on which it has not failed.
    fn may_try(&self, id: WorkerId, job: JobId) -> bool {
        let failed_on =
            |worker: WorkerId| self.jobs[&job].failures.iter().any(|(failed, _)| *failed == worker);
        !failed_on(id) || self.workers.keys().all(|worker| failed_on(*worker))
    }

    /// The one place where a worker goes, whoever noticed: its leases go back to the queue, and losing the last
    /// worker starts the grace.
    fn remove_worker(&mut self, id: WorkerId, reason: &'static str, now: Instant) {
        let Some(worker) = self.workers.remove(&id) else { return };
        for &job in worker.leases.keys() {
            self.release(job);
            if reason == Farewell::LOST {
                self.count_failure(job, id, format!("{}: {reason}", worker.label));
            }
        }
        if self.workers.is_empty() {
            self.alone_since = Some(now);
        }
        self.farewells.push(Farewell { label: worker.label, reason, leases: worker.leases.len() });
    }

    /// Ends a job's lease and queues it again.
    fn release(&mut self, job_id: JobId) {
        let Some(job) = self.jobs.get_mut(&job_id) else { return };
        if let Some((holder, _, _)) = job.lease.take() {
            self.waiting.insert(job_id);
            self.forget_lease(holder, job_id);
        }
    }

    fn forget_lease(&mut self, holder: WorkerId, job: JobId) {
        if let Some(worker) = self.workers.get_mut(&holder) {
            worker.leases.remove(&job);
        }
    }

    fn count_failure(&mut self, job_id: JobId, id: WorkerId, failure: String) {
        let Some(job) = self.jobs.get_mut(&job_id) else { return };
        job.failures.push((id, failure));
        if job.failures.len() >= self.limits.max_failures as usize && self.failed.is_none() {
            let failures = job.failures.iter().map(|(_, failure)| failure.clone()).collect();
            self.failed = Some(JobFailed { evaluation: Arc::clone(&job.evaluation), failures });
        }
    }

    fn label(&self, id: WorkerId) -> String {
        self.labels.get(&id).cloned().unwrap_or_else(|| id.to_string())
    }
}

#[cfg(test)]
mod tests;
