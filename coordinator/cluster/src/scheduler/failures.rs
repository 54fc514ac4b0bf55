//! Failures: when a job has failed for good, and when it is rather its workers that are at fault.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

use proto::task::{Failure, FailureReason};
use proto::{JobId, Principal, WorkerId};

use super::health::Health;
use super::messages::WorkerFailure;
use super::{Emitted, JobFailed, Scheduler};
use crate::events::EventKind;
use crate::store::{FailedAttempt, Job};

impl Scheduler {
    /// Counts a failure, against the job and against the worker.
    pub(super) fn count_failure(&mut self, job_id: JobId, id: WorkerId, failure: Failure, now: Instant) {
        let (label, max_failures) = (self.label(id), self.limits.max_failures as usize);
        self.count_against(id, now);
        // Once its result counts, a job has nothing to fail at.
        let Some(principal) = self.workers.get(&id).map(|worker| worker.principal) else { return };
        let Some(job) = self.jobs.get_mut(job_id).filter(|job| job.needs() > 0) else { return };
        let malformed = failure.reason == FailureReason::InvalidJob;
        let failure = WorkerFailure { worker: label, failure };
        job.failures.push(FailedAttempt { worker: id, principal, failure });
        let has_answer = !job.votes.is_empty();
        if malformed || job.failures.len() >= max_failures {
            self.failing.insert(job_id);
            self.fail_hopeless();
        }
        self.do_without_own(job_id);
        if has_answer {
            self.settle(job_id, now); // it may have been the last that could give another
        } else {
            self.refile(job_id);
        }
    }

    /// Counts a failure against a worker, which may exclude it for a while.
    pub(super) fn count_against(&mut self, id: WorkerId, now: Instant) {
        let Some(worker) = self.workers.get_mut(&id) else { return };
        let principal = worker.principal;
        let suspect = self.exclusions.get(&principal).is_some_and(|&count| count > 0);
        let (was_excluded, was_available) = (worker.health.is_excluded(), worker.is_available());
        let Some(length) = worker.health.failed(suspect, now) else { return };
        if was_excluded {
            return; // an answer to a job of before
        }
        *self.exclusions.entry(principal).or_default() += 1;
        if was_available {
            self.leave_present(principal);
        }
        if !self.has_fit_worker() {
            return self.include_all(); // where all fail, none is better than another
        }
        self.settle_for_want_of_others(now);
        let kind = EventKind::Excluded { worker: id, label: self.label(id), seconds: length.as_secs() };
        self.events.push(Emitted { at: now, kind });
    }

    /// Whether somebody is here who may be given jobs.
    fn has_fit_worker(&self) -> bool {
        !self.present.is_empty()
    }

    /// Ends the exclusions whose time is over.
    pub(super) fn end_exclusions(&mut self, now: Instant) {
        let over = self.workers.values_mut().filter_map(|worker| {
            (worker.health.end_exclusion(now) && worker.is_available()).then_some(worker.principal)
        });
        for principal in over.collect::<Vec<_>>() {
            self.join_present(principal);
        }
    }

    /// Ends all exclusions, because nobody else is left.
    pub(super) fn include_all(&mut self) {
        let excluded = self.workers.values_mut().filter(|worker| worker.health.is_excluded());
        let included = excluded.filter_map(|worker| {
            worker.health = Health::default();
            worker.is_available().then_some(worker.principal)
        });
        for principal in included.collect::<Vec<_>>() {
            self.join_present(principal);
        }
    }

    /// Fails the first job for which there is no hope.
    pub(super) fn fail_hopeless(&mut self) {
        if self.failed.is_some() {
            return;
        }
        let hopeless = |id: &&JobId| self.jobs.get(**id).is_some_and(|job| self.is_hopeless(job));
        let Some(job) = self.failing.iter().find(hopeless).and_then(|id| self.jobs.get(*id)) else { return };
        let failures = job.failures.iter().map(|failed| failed.failure.clone()).collect();
        self.failed = Some(JobFailed { task: Arc::clone(&job.task), failures });
    }

    /// Whether a job has failed for good: on as many workers as the limit says that have computed something else, of as many
    /// principals or of all that are here, or on all workers that are here. Neither three sick machines must end a run that
    /// two healthy ones could do, nor whoever runs under three names.
    fn is_hopeless(&self, job: &Job) -> bool {
        if !job.votes.is_empty() || job.delivered || job.is_given_up() {
            return false; // there is a result, and whoever could confirm it may come, or nobody waits for one
        }
        let is_able = |failed: &&FailedAttempt| {
            let has_answered = self.identities.get(&failed.worker).is_some_and(|known| known.answers > 0);
            let is_excluded =
                || self.workers.get(&failed.worker).is_some_and(|worker| worker.health.is_excluded());
            has_answered && !is_excluded()
        };
        // A job of this release that one worker cannot read is malformed for all of them, if it says the truth.
        let is_malformed =
            |failed: &&FailedAttempt| failed.failure.failure.reason == FailureReason::InvalidJob;
        let principals = |failed: &[&FailedAttempt]| -> BTreeSet<Principal> {
            failed.iter().map(|failed| failed.principal).collect()
        };
        let (able, malformed): (Vec<_>, Vec<_>) = (
            job.failures.iter().filter(is_able).collect(),
            job.failures.iter().filter(is_malformed).collect(),
        );
        let most = self.limits.max_failures as usize;
        let is_untried = self.workers.iter().any(|(id, worker)| worker.is_available() && !job.failed_on(*id));
        let has_failed =
            |principal: Principal| job.failures.iter().any(|failed| failed.principal == principal);
        let has_untried_principal =
            || self.workers.values().any(|worker| worker.is_available() && !has_failed(worker.principal));
        principals(&malformed).contains(&Principal::Coordinator)
            || principals(&malformed).len() >= 2
            || able.len() >= most && (principals(&able).len() >= most || !has_untried_principal())
            || !is_untried && (!malformed.is_empty() || job.failures.len() >= most)
    }

    /// A worker went with the job in hand: no fault of the job's, until it has happened too often. Where there is an answer
    /// already, it is nobody's but that of the principals whose workers go.
    pub(super) fn count_loss(&mut self, job_id: JobId, lost: FailedAttempt) {
        let Some(job) = self.jobs.get_mut(job_id).filter(|job| job.needs() > 0) else { return };
        job.losses.push(lost);
        let is_much = job.losses.len() >= self.limits.max_losses as usize;
        if is_much && !job.votes.is_empty() {
            self.failing.insert(job_id);
        } else if is_much && !job.is_given_up() && self.failed.is_none() {
            let failures = job.losses.iter().map(|lost| lost.failure.clone()).collect();
            self.failed = Some(JobFailed { task: Arc::clone(&job.task), failures });
        }
        self.refile(job_id);
    }

    /// Whether an answer of a principal would be one more. Where there is one already, a principal is asked no more whose
    /// workers have failed, or gone with it in hand, as often as a job may, or up to four times as often if it has as many
    /// workers: a job of which nobody can give a second answer would be tried without end.
    pub(super) fn may_answer(&self, principal: Principal, job: &Job) -> bool {
        let workers = self.present.get(&principal).copied().unwrap_or_default();
        let is_tried = |attempts: &[FailedAttempt], most: u32| {
            let most = most as usize;
            times_failed(attempts, principal) >= workers.clamp(most, most.saturating_mul(4))
        };
        let is_tried = || {
            is_tried(&job.failures, self.limits.max_failures) || is_tried(&job.losses, self.limits.max_losses)
        };
        !job.answered_by(principal) && (job.votes.is_empty() || !is_tried())
    }

    /// Has a second principal answer a job instead of the coordinator's own process, if that has shown that it cannot.
    pub(super) fn do_without_own(&mut self, job_id: JobId) {
        let most = self.limits.max_failures as usize;
        if let Some(job) = self.jobs.get_mut(job_id)
            && times_failed(&job.failures, Principal::Coordinator) >= most
        {
            job.do_without_own();
        }
    }
}

/// How often workers of a principal have failed.
fn times_failed(attempts: &[FailedAttempt], principal: Principal) -> usize {
    attempts.iter().filter(|failed| failed.principal == principal).count()
}
