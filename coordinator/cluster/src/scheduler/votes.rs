//! Votes: which result of a job counts, which principals are contradicted, and how one that was wrong is quarantined.

use std::sync::Arc;
use std::time::Instant;

use proto::task::{Described, Failure, InvalidResult, Report, Task, TaskResult};
use proto::{JobId, Lease, Principal, WorkerId};

use super::messages::Confirmed;
use super::{Doubt, Emitted, Finished, Scheduler};
use crate::events::{AttemptEnd, Departure, EventKind};
use crate::store::{Job, Quorum, Vote};

impl Scheduler {
    /// Takes one report; a valid result counts from whichever lease, once a worker.
    pub(super) fn accept(&mut self, id: WorkerId, report: Report, now: Instant) {
        let Lease { job: job_id, attempt, .. } = report.lease;
        let Some(principal) = self.workers.get(&id).map(|worker| worker.principal) else { return };
        let Some(job) = self.jobs.get(job_id) else {
            return; // answered before, by this worker or another
        };
        if !self.secret.granted(report.lease, (id, principal)) || job.answered_by_worker(id) {
            return;
        }
        let handed_out = job.handed_out_at(id, attempt);
        match report.outcome.and_then(|result| self.checked(&job.task, result)) {
            Ok(result) => {
                let vote = Vote {
                    worker: id,
                    principal,
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
                self.count_failure(job_id, id, failure, now);
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
        let principal = vote.principal;
        let held = job.lease_of(id);
        let end = match &job.votes[..] {
            [] => AttemptEnd::Answered,
            votes if votes.iter().all(|other| other.fingerprint == vote.fingerprint) => AttemptEnd::Agreed,
            _ => AttemptEnd::Disagreed,
        };
        let result = vote.result.filter(|_| !job.delivered);
        if self.trust.audits(principal, self.secret.draw(job_id)) {
            self.counters.audits += u64::from(job.require(Quorum::Two));
        }
        let is_first = !job.answered_by(principal);
        job.vote(Vote { result, ..vote });
        if is_first {
            for agreed in job.agreement_with(principal) {
                self.trust.agree(agreed);
            }
        }
        if is_first && (job.quorum() > Quorum::One || job.votes.len() > 1) {
            self.trust.count(principal);
        }
        if let Some(known) = self.identities.get_mut(&id) {
            known.answers += 1;
            known.busy_seconds += run_seconds.filter(|seconds| seconds.is_finite()).unwrap_or(0.0).max(0.0);
        }
        if let Some(worker) = self.workers.get_mut(&id) {
            worker.health.succeeded();
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
    pub(super) fn settle(&mut self, job_id: JobId, now: Instant) {
        let Some(job) = self.jobs.get_mut(job_id) else { return };
        let (settled, disputed) = (job.needs() == 0, job.is_disputed());
        job.was_disputed |= disputed;
        let Some(job) = self.jobs.get(job_id) else { return };
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
        if alone && !std::mem::replace(&mut self.unaudited, true) {
            self.events.push(Emitted { at: now, kind: EventKind::Unaudited });
        }
        let agreed = settled && !disputed && job.quorum() > Quorum::One && job.seconded().is_some();
        if settled && job.delivered {
            let confirmed = |leading: &Vote| {
                let (fingerprint, seconded) = (leading.fingerprint, job.seconded());
                let (assurance, was_disputed) = (job.assurance()?, job.was_disputed);
                Some(Confirmed { job: job_id, fingerprint, seconded, assurance, was_disputed })
            };
            self.confirmed.extend(job.leading().and_then(confirmed));
            if let Some(job) = self.jobs.get_mut(job_id) {
                job.was_disputed = false;
            }
        }
        if agreed && let Some(job) = self.jobs.get_mut(job_id) {
            self.counters.agreements += u64::from(!std::mem::replace(&mut job.agreed, true));
        }
        if settled || alone {
            self.deliver(job_id);
        }
        if settled {
            self.revoke_queued(job_id, now);
        }
        let contradicted = if settled { self.contradicted(job_id) } else { Vec::new() };
        self.refile(job_id);
        for (principal, id) in contradicted {
            self.quarantine(principal, Some(id), now);
        }
    }

    /// Quarantines a principal, whether its workers are here or gone: this one has given a wrong answer, or, if there is none,
    /// what it has stored for others was found wrong.
    pub fn quarantine(&mut self, principal: Principal, id: Option<WorkerId>, now: Instant) {
        if !self.quarantined.insert(principal) {
            return;
        }
        self.doubts.push(Doubt::Quarantined(principal));
        if let Some(id) = id.filter(|id| !self.knows(*id) && self.identities.contains_key(id)) {
            self.note_departure(id, Departure::Quarantined, 0, now);
        }
        let its_own = self.workers.iter().filter(|(_, worker)| worker.principal == principal);
        for id in its_own.map(|(id, _)| *id).collect::<Vec<_>>() {
            self.remove_worker(id, Departure::Quarantined, now);
        }
        self.retract_votes(principal, now);
        self.settle_for_want_of_others(now);
    }

    /// Delivers the leading result, once.
    fn deliver(&mut self, job_id: JobId) {
        let Some(job) = self.jobs.get_mut(job_id).filter(|job| !job.delivered) else { return };
        let Some(assurance) = job.assurance() else { return };
        let seconded = job.seconded();
        let Some(Vote {
            worker, principal, label, attempt, queued, run_seconds, result: Some(result), ..
        }) = job.leading()
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
            principal: *principal,
            seconded,
            assurance,
        });
        (job.delivered, job.was_disputed) = (true, false);
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

    /// Principals whose result to a settled job is not the one that counts, each with a worker that gave it.
    fn contradicted(&self, job_id: JobId) -> Vec<(Principal, WorkerId)> {
        let Some(job) = self.jobs.get(job_id) else { return Vec::new() };
        let Some(right) = job.leading().map(|vote| vote.fingerprint) else { return Vec::new() };
        let wrong = job.votes.iter().filter(|vote| vote.fingerprint != right);
        wrong.map(|vote| (vote.principal, vote.worker)).collect()
    }

    /// Takes back every result of a principal to jobs that are still open. What was accepted from it before is
    /// checked by jobs of its own.
    fn retract_votes(&mut self, principal: Principal, now: Instant) {
        let answered =
            self.jobs.iter().filter(|(_, job)| job.answered_by(principal)).map(|(job_id, _)| job_id);
        let answered: Vec<JobId> = answered.collect();
        for &job_id in &answered {
            if let Some(job) = self.jobs.get_mut(job_id) {
                job.retract_votes(principal);
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

    /// Whether there is a principal that has not answered this job and may.
    pub(super) fn somebody_else(&self, job: &Job) -> bool {
        let may_answer = |principal: &Principal| self.may_answer(*principal, job);
        match job.awaits_own() {
            true => self.has_own() && may_answer(&Principal::Coordinator),
            false => self.present.keys().any(may_answer),
        }
    }
}
