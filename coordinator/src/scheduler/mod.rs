//! Who computes what: workers, jobs and leases, as plain decisions with `now` as an argument.
//!
//! Nothing here does IO or waits. The service feeds polls in, the run driver submits jobs and drains outcomes.

mod worker;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use proto::{JobId, Lease, WorkerId};

use crate::task::{Task, TaskResult};
use worker::Worker;
pub use worker::{Arrival, Farewell, Introduction};

/// Bounds that the experiment sets.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// A worker that has not polled for this long is given up, and its leases with it.
    pub lease: Duration,
    /// A lease without a result for this long counts as a failure, and its job is given to another worker, too.
    pub job: Duration,
    /// Failures after which a job stops the run.
    pub max_failures: u32,
    /// Workers lost with a job in hand after which that job stops the run.
    pub max_losses: u32,
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
    pub outcome: Result<TaskResult, String>,
}

/// What a poll is answered with.
#[derive(Debug, Default)]
pub struct Answer {
    /// Reports that need not be sent again.
    pub acknowledged: Vec<Lease>,
    /// Leases that are no longer wanted.
    pub revoked: Vec<Lease>,
    /// New leases.
    pub jobs: Vec<(Lease, Arc<Task>)>,
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
pub struct Finished<R = TaskResult> {
    /// Which job.
    pub job: JobId,
    /// The first valid answer.
    pub result: R,
    /// Label of the worker that gave it.
    pub worker: String,
    /// Which attempt it was.
    pub attempt: u32,
    /// From submission to the lease of the attempt that gave the answer.
    pub queued: Duration,
    /// Seconds on the worker's clock.
    pub run_seconds: f64,
}

/// A job that failed as often as the limit allows.
#[derive(Clone, Debug, PartialEq)]
pub struct JobFailed {
    /// What was asked.
    pub task: Arc<Task>,
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
    task: Arc<Task>,
    submitted: Instant,
    /// Who works on it now, on which attempt.
    lease: Option<(WorkerId, u32)>,
    /// When each attempt was handed out.
    handed_out: Vec<Instant>,
    failures: Vec<(WorkerId, String)>,
    losses: Vec<String>,
}

impl Job {
    /// Whether this attempt was ever handed out.
    fn has_attempt(&self, attempt: u32) -> bool {
        (1..=self.handed_out.len()).contains(&(attempt as usize))
    }

    fn failed_on(&self, worker: WorkerId) -> bool {
        self.failures.iter().any(|(failed, _)| *failed == worker)
    }
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
    arrivals: Vec<Arrival>,
    /// Labels of those who are here and of those who have finished a job: none names two workers in the results,
    /// and a worker that returns keeps its own.
    labels: BTreeMap<WorkerId, String>,
    used_labels: BTreeSet<String>,
    last_look: Option<Instant>,
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
            arrivals: Vec::new(),
            labels: BTreeMap::new(),
            used_labels: BTreeSet::new(),
            last_look: None,
            alone_since: None,
        }
    }

    /// Adds a job; jobs are handed out in the order of submission.
    pub fn submit(&mut self, task: Arc<Task>, now: Instant) -> JobId {
        let id = JobId(self.next_job);
        self.next_job += 1;
        let (handed_out, failures, losses) = (Vec::new(), Vec::new(), Vec::new());
        let job = Job { task, submitted: now, lease: None, handed_out, failures, losses };
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
            None => worker::unique_label(&introduction.name, &self.used_labels),
        };
        self.labels.insert(id, label.clone());
        self.used_labels.insert(label.clone());
        self.workers.insert(id, Worker::new(label.clone(), now));
        self.arrivals.push(Arrival { label: label.clone(), introduction });
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
            self.accept(id, report, now);
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
    ) -> Result<Vec<(Lease, Arc<Task>)>, PollRefusal> {
        let worker = self.workers.get_mut(&id).ok_or(PollRefusal::UnknownWorker)?;
        if worker.sequence != sequence {
            return Err(PollRefusal::Stale);
        }
        worker.last_seen = now;
        Ok(self.lease_jobs(id, wanted, now))
    }

    /// Gives up the workers that have been silent for longer than a lease lasts, and the leases that have gone on for
    /// longer than any job may.
    ///
    /// To be called often. After a pause between two calls of more than half a lease it was the coordinator that did
    /// not listen (it was stopped, or its machine slept), so no worker is blamed for that time.
    pub fn expire(&mut self, now: Instant) {
        let pause = self.last_look.map_or(Duration::ZERO, |last| now.saturating_duration_since(last));
        self.last_look = Some(now);
        if pause > self.limits.lease / 2 {
            for worker in self.workers.values_mut() {
                worker.forgive(pause, now);
            }
        }
        let silent = |worker: &Worker| now.saturating_duration_since(worker.last_seen) > self.limits.lease;
        let lost: Vec<WorkerId> =
            self.workers.iter().filter(|(_, worker)| silent(worker)).map(|(id, _)| *id).collect();
        for id in lost {
            self.remove_worker(id, Farewell::LOST, now);
        }
        let late: Vec<(JobId, WorkerId)> = self
            .workers
            .iter()
            .filter_map(|(id, worker)| worker.in_hand().map(|(job, since)| (job, *id, since)))
            .filter(|(_, _, since)| now.saturating_duration_since(*since) > self.limits.job)
            .map(|(job, holder, _)| (job, holder))
            .collect();
        for (job, holder) in late {
            self.release(job, now);
            let failure = format!("{}: no result within {} s", self.label(holder), self.limits.job.as_secs());
            self.count_failure(job, holder, failure);
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

    /// Workers that came since the last call.
    pub fn drain_arrivals(&mut self) -> Vec<Arrival> {
        std::mem::take(&mut self.arrivals)
    }

    /// How many workers there are.
    pub fn worker_count(&self) -> usize {
        self.workers.len()
    }

    /// Whether a job waits for somebody to take it.
    pub fn has_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// Takes one report; the first valid answer to a job counts, from whichever lease.
    fn accept(&mut self, id: WorkerId, report: Report, now: Instant) {
        let Lease { job: job_id, attempt } = report.lease;
        let Some(job) = self.jobs.get(&job_id) else {
            return; // answered before, by this worker or another
        };
        // An attempt that was never handed out is an invention.
        let known = job.has_attempt(attempt);
        let outcome = report.outcome.and_then(|result| job.task.check(&result).map(|()| result));
        let label = self.label(id);
        match outcome {
            Ok(result) if known => {
                let Some(job) = self.jobs.remove(&job_id) else { return };
                self.waiting.remove(&job_id);
                let leased = job.handed_out.get(attempt as usize - 1).copied().unwrap_or(job.submitted);
                if let Some((holder, _)) = job.lease {
                    self.forget_lease(holder, job_id, now);
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
                if job.lease == Some((id, attempt)) {
                    self.release(job_id, now);
                    self.count_failure(job_id, id, format!("{label}: {reason}"));
                }
            }
        }
    }

    /// Brings the leases on our books in line with those the worker says it holds.
    fn reconcile(&mut self, id: WorkerId, held: &[Lease], now: Instant, revoked: &mut Vec<Lease>) {
        let booked: Vec<(JobId, u32)> =
            self.workers.get(&id).map_or_else(Vec::new, |worker| worker.leases().to_vec());
        for (job, attempt) in booked {
            if !held.contains(&Lease { job, attempt }) {
                self.release(job, now); // the reply that carried it was lost
            }
        }
        for &lease in held {
            let Some(job) = self.jobs.get_mut(&lease.job) else {
                revoked.push(lease);
                continue;
            };
            match job.lease {
                Some(current) if current == (id, lease.attempt) => {}
                // Given up while the worker was out of reach, and nobody else has begun: it may go on.
                None if job.has_attempt(lease.attempt) && !job.failed_on(id) => {
                    job.lease = Some((id, lease.attempt));
                    self.waiting.remove(&lease.job);
                    if let Some(worker) = self.workers.get_mut(&id) {
                        worker.take(lease.job, lease.attempt, now);
                    }
                }
                _ => revoked.push(lease),
            }
        }
    }

    fn lease_jobs(&mut self, id: WorkerId, wanted: usize, now: Instant) -> Vec<(Lease, Arc<Task>)> {
        let mut leased = Vec::new();
        while leased.len() < wanted {
            // A job taken ahead waits behind another: as long as a worker has none at all, it is better off there.
            let (mut holds_one, mut idle) = (false, 0);
            for (other, worker) in &self.workers {
                if *other == id {
                    holds_one = !worker.leases().is_empty();
                } else if worker.leases().is_empty() {
                    idle += 1;
                }
            }
            if holds_one && self.waiting.len() <= idle {
                break;
            }
            let Some(job_id) = self.waiting.iter().copied().find(|job| self.may_try(id, *job)) else { break };
            let (Some(job), Some(worker)) = (self.jobs.get_mut(&job_id), self.workers.get_mut(&id)) else {
                break;
            };
            job.handed_out.push(now);
            let attempt = job.handed_out.len() as u32;
            job.lease = Some((id, attempt));
            worker.take(job_id, attempt, now);
            self.waiting.remove(&job_id);
            leased.push((Lease { job: job_id, attempt }, Arc::clone(&job.task)));
        }
        leased
    }

    /// A job that failed on a worker goes to another one, as long as there is one on which it has not failed.
    fn may_try(&self, id: WorkerId, job: JobId) -> bool {
        let job = &self.jobs[&job];
        !job.failed_on(id) || self.workers.keys().all(|worker| job.failed_on(*worker))
    }

    /// The one place where a worker goes, whoever noticed: its leases go back to the queue, and losing the last
    /// worker starts the grace.
    fn remove_worker(&mut self, id: WorkerId, reason: &'static str, now: Instant) {
        let Some(worker) = self.workers.remove(&id) else { return };
        for &(job, _) in worker.leases() {
            self.release(job, now);
            if reason == Farewell::LOST {
                self.count_loss(job, format!("{}: {reason}", worker.label));
            }
        }
        if self.workers.is_empty() {
            self.alone_since = Some(now);
        }
        if worker.finished == 0 {
            // It is in no result: strangers that come and go must not fill the memory with their names.
            self.labels.remove(&id);
            self.used_labels.remove(&worker.label);
        }
        let leases = worker.leases().len();
        self.farewells.push(Farewell { label: worker.label, reason, leases });
    }

    /// Ends a job's lease and queues it again.
    fn release(&mut self, job_id: JobId, now: Instant) {
        let Some(job) = self.jobs.get_mut(&job_id) else { return };
        if let Some((holder, _)) = job.lease.take() {
            self.waiting.insert(job_id);
            self.forget_lease(holder, job_id, now);
        }
    }

    fn forget_lease(&mut self, holder: WorkerId, job: JobId, now: Instant) {
        if let Some(worker) = self.workers.get_mut(&holder) {
            worker.put_down(job, now);
        }
    }

    fn count_failure(&mut self, job_id: JobId, id: WorkerId, failure: String) {
        let Some(job) = self.jobs.get_mut(&job_id) else { return };
        job.failures.push((id, failure));
        if job.failures.len() >= self.limits.max_failures as usize && self.failed.is_none() {
            let failures = job.failures.iter().map(|(_, failure)| failure.clone()).collect();
            self.failed = Some(JobFailed { task: Arc::clone(&job.task), failures });
        }
    }

    /// A worker went with the job in hand: no fault of the job's, until it has happened too often.
    fn count_loss(&mut self, job_id: JobId, loss: String) {
        let Some(job) = self.jobs.get_mut(&job_id) else { return };
        job.losses.push(loss);
        if job.losses.len() >= self.limits.max_losses as usize && self.failed.is_none() {
            let (task, failures) = (Arc::clone(&job.task), job.losses.clone());
            self.failed = Some(JobFailed { task, failures });
        }
    }

    fn label(&self, id: WorkerId) -> String {
        self.labels.get(&id).cloned().unwrap_or_else(|| id.to_string())
    }
}

#[cfg(test)]
mod tests;
