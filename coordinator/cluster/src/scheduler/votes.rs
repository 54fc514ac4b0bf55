//! Votes: which result of a job counts, which workers are contradicted, and how a worker that was wrong is quarantined.

use std::sync::Arc;
use std::time::Instant;

use proto::task::{Described, Failure, FailureReason, InvalidResult, Report, Task, TaskResult};
use proto::{JobId, Lease, WorkerId};

use super::messages::WorkerFailure;
use super::{Doubt, Emitted, Finished, JobFailed, Scheduler};
use crate::events::{AttemptEnd, Departure, EventKind};
use crate::store::{Job, Vote};

impl Scheduler {
    /// Takes one report; a valid result counts from whichever lease, once a worker.
    pub(super) fn accept(&mut self, id: WorkerId, report: Report, now: Instant) {
        let Lease { job: job_id, attempt } = report.lease;
        let Some(job) = self.jobs.get(job_id) else {
            return; // answered before, by this worker or another
        };
        // This worker was never given such an attempt.
        let Some(handed_out) = job.handed_out_at(id, attempt).filter(|_| !job.answered_by(id)) else {
            return;
        };
        match report.outcome.and_then(|result| self.checked(&job.task, result)) {
            Ok(result) => {
                let vote = Vote {
                    worker: id,
                    label: self.label(id),
                    attempt,
                    fingerprint: result.fingerprint(),
                    result: Some(result),
                    queued: handed_out.saturating_duration_since(job.submitted),
                    run_seconds: report.run_seconds,
                };
                self.count_vote(job_id, vote, now);
            }
            // A failure on a lease that was given up has been counted when it was.
            Err(failure) if job.lease_of(id) == Some(attempt) => {
                let end = AttemptEnd::Failed(failure.to_string());
                self.end_lease(job_id, id, end, Some(report.run_seconds), now);
                self.refile(job_id);
                self.count_failure(job_id, id, failure);
            }
            Err(_) => {}
        }
    }

    /// The result, if it can be one of this task.
    fn checked(&self, task: &Task, result: TaskResult) -> Result<TaskResult, Failure> {
        task.check(&result)?;
        if let (Task::Description(shard), TaskResult::Description(Described { bytes: Some(bytes), .. })) =
            (task, &result)
        {
            (self.limits.check_description)(&shard.subject, bytes, shard.clouds)
                .map_err(InvalidResult::Description)?;
        }
        Ok(result)
    }

    fn count_vote(&mut self, job_id: JobId, vote: Vote, now: Instant) {
        let Some(job) = self.jobs.get_mut(job_id) else { return };
        let (id, attempt, run_seconds) = (vote.worker, vote.attempt, Some(vote.run_seconds));
        let held = job.lease_of(id);
        let end = match &job.votes[..] {
            [] => AttemptEnd::Answered,
            votes if votes.iter().all(|other| other.fingerprint == vote.fingerprint) => AttemptEnd::Agreed,
            _ => AttemptEnd::Disagreed,
        };
        let result = vote.result.filter(|_| !job.delivered);
        job.votes.push(Vote { result, ..vote });
        if let Some(known) = self.identities.get_mut(&id) {
            known.answers += 1;
        }
        if held == Some(attempt) {
            self.end_lease(job_id, id, end, run_seconds, now);
        } else {
            self.note_attempt(job_id, id, attempt, AttemptEnd::Late, run_seconds, now);
            self.end_lease(job_id, id, AttemptEnd::Revoked, None, now); // a later attempt of its own, if it has one
        }
        self.settle(job_id, now);
    }

    /// Draws the consequences of the results that a job has.
    fn settle(&mut self, job_id: JobId, now: Instant) {
        let Some(job) = self.jobs.get(job_id) else { return };
        let (settled, disputed) = (job.needs() == 0, job.is_disputed());
        if disputed && self.disputed.insert(job_id) {
            let (workers, task) =
                (job.votes.iter().map(|vote| vote.label.clone()).collect(), Arc::clone(&job.task));
            let kind = EventKind::Disagreement { job: job_id, task: task.to_string(), workers };
            self.events.push(Emitted { at: now, kind });
            self.doubts.push(Doubt::Disagreement { job: job_id, task });
        }
        if !disputed || settled {
            self.disputed.remove(&job_id);
        }
        let alone = !settled && !disputed && !job.votes.is_empty() && !self.somebody_else(job);
        if alone && !job.delivered && !std::mem::replace(&mut self.unaudited, true) {
            self.events.push(Emitted { at: now, kind: EventKind::Unaudited });
        }
        if settled || alone {
            self.deliver(job_id);
        }
        if settled {
            self.revoke_queued(job_id, now);
        }
        let contradicted = if settled { self.contradicted(job_id) } else { Vec::new() };
        self.refile(job_id);
        for id in contradicted {
            self.quarantine(id, now);
        }
    }

    /// Quarantines a worker that was wrong, whether it is here or gone.
    fn quarantine(&mut self, id: WorkerId, now: Instant) {
        if !self.quarantined.insert(id) {
            return;
        }
        self.doubts.push(Doubt::Quarantined(id));
        if self.knows(id) {
            self.remove_worker(id, Departure::Quarantined, now);
        } else {
            self.note_departure(id, Departure::Quarantined, 0, now);
        }
        self.retract_votes(id, now);
        self.settle_for_want_of_others(now);
    }

    /// Delivers the leading result, once.
    fn deliver(&mut self, job_id: JobId) {
        let Some(job) = self.jobs.get_mut(job_id).filter(|job| !job.delivered) else { return };
        let settled = job.needs() == 0;
        let Some(Vote { worker, label, attempt, queued, run_seconds, result: Some(result), .. }) =
            job.leading()
        else {
            return;
        };
        self.finished.push(Finished {
            job: job_id,
            result: result.clone(),
            worker_id: *worker,
            worker: label.clone(),
            attempt: *attempt,
            queued: *queued,
            run_seconds: *run_seconds,
            settled,
        });
        job.delivered = true;
        for vote in &mut job.votes {
            vote.result = None;
        }
    }

    /// Ends the leases on a settled job that wait behind another. Those in hand go on: a worker cannot drop what it
    /// computes, and its result is one more to compare.
    fn revoke_queued(&mut self, job_id: JobId, now: Instant) {
        let Some(job) = self.jobs.get(job_id) else { return };
        let works =
            |id: &WorkerId| self.workers.get(id).is_some_and(|worker| worker.works_on(job_id).is_some());
        let queued = job.leases.iter().map(|(holder, _)| *holder).filter(|holder| !works(holder));
        for holder in queued.collect::<Vec<_>>() {
            self.end_lease(job_id, holder, AttemptEnd::Revoked, None, now);
        }
    }

    /// Workers whose result to a settled job is not the one that counts.
    fn contradicted(&self, job_id: JobId) -> Vec<WorkerId> {
        let Some(job) = self.jobs.get(job_id) else { return Vec::new() };
        let Some(right) = job.leading().map(|vote| vote.fingerprint) else { return Vec::new() };
        job.votes.iter().filter(|vote| vote.fingerprint != right).map(|vote| vote.worker).collect()
    }

    /// Takes back every result of a worker to jobs that are still open. What was accepted from it before is
    /// checked by jobs of its own.
    fn retract_votes(&mut self, id: WorkerId, now: Instant) {
        let answered = self.jobs.iter().filter(|(_, job)| job.answered_by(id)).map(|(job_id, _)| job_id);
        let answered: Vec<JobId> = answered.collect();
        for &job_id in &answered {
            if let Some(job) = self.jobs.get_mut(job_id) {
                job.votes.retain(|vote| vote.worker != id);
            }
        }
        for job_id in answered {
            // Settling one may end another.
            match self.jobs.get(job_id) {
                Some(job) if job.delivered && job.votes.is_empty() => self.abandon(job_id, now),
                _ => self.settle(job_id, now),
            }
        }
    }

    /// Ends a job and all leases on it.
    pub(super) fn abandon(&mut self, job_id: JobId, now: Instant) {
        let Some(job) = self.jobs.get(job_id) else { return };
        for (holder, _) in job.leases.clone() {
            self.end_lease(job_id, holder, AttemptEnd::Revoked, None, now);
        }
        self.forget(job_id);
    }

    /// Delivers the results that were to be audited by somebody who has gone.
    pub(super) fn settle_for_want_of_others(&mut self, now: Instant) {
        let waiting = |job: &Job| !job.delivered && !job.votes.is_empty() && !self.somebody_else(job);
        let alone = self.jobs.iter().filter(|(_, job)| waiting(job)).map(|(id, _)| id);
        for job_id in alone.collect::<Vec<_>>() {
            self.settle(job_id, now);
        }
    }

    /// Whether there is a worker that has not answered this job.
    pub(super) fn somebody_else(&self, job: &Job) -> bool {
        self.workers.keys().any(|id| !job.answered_by(*id))
    }

    /// Counts a failure by its reason. A malformed job is as malformed to every other worker, so that it fails at once;
    /// whatever else went wrong may go right elsewhere.
    pub(super) fn count_failure(&mut self, job_id: JobId, id: WorkerId, failure: Failure) {
        let (worker, max_failures) = (self.label(id), self.limits.max_failures as usize);
        // Once its result counts, a job has nothing to fail at.
        let Some(job) = self.jobs.get_mut(job_id).filter(|job| job.needs() > 0) else { return };
        let malformed = failure.reason == FailureReason::InvalidJob;
        job.failures.push((id, WorkerFailure { worker, failure }));
        if (malformed || job.failures.len() >= max_failures) && self.failed.is_none() {
            let failures = job.failures.iter().map(|(_, failure)| failure.clone()).collect();
            self.failed = Some(JobFailed { task: Arc::clone(&job.task), failures });
        }
    }

    /// A worker went with the job in hand: no fault of the job's, until it has happened too often.
    pub(super) fn count_loss(&mut self, job_id: JobId, loss: WorkerFailure) {
        let Some(job) = self.jobs.get_mut(job_id).filter(|job| job.needs() > 0) else { return };
        job.losses.push(loss);
        if job.losses.len() >= self.limits.max_losses as usize && self.failed.is_none() {
            let (task, failures) = (Arc::clone(&job.task), job.losses.clone());
            self.failed = Some(JobFailed { task, failures });
        }
    }
}
