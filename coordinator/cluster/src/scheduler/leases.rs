//! Leases: who gets a job, and how a lease ends.

#[cfg(test)]
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use proto::task::{Failure, FailureReason, Task};
use proto::{JobId, Lease, Principal, WorkerId};

use super::Scheduler;
use super::worker::Worker;
use crate::events::{Attempt, AttemptEnd, EventKind};
use crate::store::{Job, Quorum};

/// A job is given to an idle second worker when it has run for this many times the median of its kind.
const PATIENCE: f64 = 1.5;
/// That a worker does not hold a job that it was handed out so often, or more often, counts against it. Replies get lost,
/// but a worker that asks for the same job again and again would keep it from all others.
const MOST_TIMES_HANDED_OUT: usize = 5;
/// A job that takes longer than this is not taken ahead.
const LONGEST_AHEAD: Duration = Duration::from_millis(100);

impl Scheduler {
    /// Leases of up to `wanted` jobs.
    pub(super) fn lease_jobs(
        &mut self,
        id: WorkerId,
        wanted: usize,
        now: Instant,
    ) -> Vec<(Lease, Arc<Task>)> {
        let mut leased = Vec::new();
        while leased.len() < wanted
            && let Some(job) = self.next_job(id, now)
        {
            leased.extend(self.lease(id, job, now));
        }
        let busy = self.workers.get(&id).is_some_and(|worker| !worker.is_idle());
        self.queue.set_idle_poll(id, (wanted > 0 && leased.is_empty()).then_some(busy));
        leased
    }

    /// The job that this worker should take next.
    pub(super) fn next_job(&self, id: WorkerId, now: Instant) -> Option<JobId> {
        self.next_waiting(id, now).or_else(|| self.next_hedge(id, now))
    }

    /// Of the jobs that wait, the one that this worker should take next.
    pub(super) fn next_waiting(&self, id: WorkerId, now: Instant) -> Option<JobId> {
        let worker = self.workers.get(&id)?;
        if !worker.is_available() || !worker.is_idle() && !self.hands_out_ahead(id) {
            return None;
        }
        // What is only foreseen comes last, and must not lie behind a job in hand when it is asked for.
        let best = |jobs: &mut dyn Iterator<Item = JobId>| {
            let may_take = jobs.filter(|job| self.may_take(id, *job));
            self.best_match(id, may_take.filter_map(|job| Some((job, self.jobs.get(job)?))), now)
        };
        let foreseen = || worker.is_idle().then(|| best(&mut self.queue.foreseen())).flatten();
        best(&mut self.queue.waited_for()).or_else(foreseen)
    }

    /// The job of another that this worker should take as well: only an idle one doubles the work of another.
    pub(super) fn next_hedge(&self, id: WorkerId, now: Instant) -> Option<JobId> {
        let worker = self.workers.get(&id)?;
        if !worker.is_available() || !worker.is_idle() {
            return None;
        }
        self.queue.overdue(now).find(|job| self.may_take(id, *job) && self.is_late_for(id, *job, now))
    }

    /// Whether a job that is overdue has been worked on for so long that this worker may well be done with it first: what
    /// somebody else has described, it may have to describe.
    fn is_late_for(&self, id: WorkerId, job_id: JobId, now: Instant) -> bool {
        let Some(job) = self.jobs.get(job_id) else { return false };
        let Some(&(holder, attempt)) = job.leases.first() else { return false };
        let Some(since) = self.workers.get(&holder).and_then(|worker| worker.works_on(job_id)) else {
            return true; // nobody has begun it
        };
        let (here, there) = (self.cost_to(id, job), job.cost_to(holder, attempt));
        let expected = self.run_times.expected(here).or_else(|| {
            let ratio = here.units as f64 / there.units.max(1) as f64;
            self.run_times.expected(there).map(|expected| expected.mul_f64(ratio))
        });
        expected.is_some_and(|expected| since + expected.mul_f64(PATIENCE) <= now)
    }

    /// Whether a worker may take a job beside the one in hand. It waits behind that: as long as a worker has none at all, it
    /// is better off there. Nor is one taken ahead that is known to take long, beside which a poll takes no time: jobs that
    /// are begun out of turn, or twice, keep a generation waiting.
    pub(super) fn hands_out_ahead(&self, id: WorkerId) -> bool {
        let expected = self.first_waiting().and_then(|job| self.run_times.expected(self.cost_to(id, job)));
        self.queue.count_waited_for() > self.idle && expected.is_none_or(|expected| expected <= LONGEST_AHEAD)
    }

    /// Whether the first job that waits takes all workers about as long.
    pub(super) fn first_is_alike_to_all(&self) -> bool {
        self.first_waiting().is_none_or(|job| job.channels.is_empty())
    }

    fn first_waiting(&self) -> Option<&Job> {
        self.jobs.get(self.queue.waited_for().next()?)
    }

    /// Whether a worker may take a job that wants one: it must not work on it, nor anybody of its principal have reported a
    /// result of it, and a job that failed on it goes to another, as long as there is one that may take it. Of a job that
    /// two principals have to answer, each has one lease.
    pub(super) fn may_take(&self, id: WorkerId, job: JobId) -> bool {
        let (Some(job), Some(worker)) = (self.jobs.get(job), self.workers.get(&id)) else { return false };
        let principal = worker.principal;
        if job.awaits_own() && principal != Principal::Coordinator {
            return false;
        }
        let tried = |(id, worker): (&WorkerId, &Worker)| {
            let cannot = job.awaits_own() && worker.principal != Principal::Coordinator;
            cannot || worker.is_left_out() || !self.may_answer(worker.principal, job) || job.failed_on(*id)
        };
        let of_principal =
            |holder: &WorkerId| self.workers.get(holder).is_some_and(|worker| worker.principal == principal);
        let has_lease = match self.wanted(job) {
            2.. => job.leases.iter().any(|(holder, _)| of_principal(holder)),
            _ => job.lease_of(id).is_some(),
        };
        self.may_answer(principal, job)
            && !has_lease
            && (!job.failed_on(id) || self.workers.iter().all(tried))
    }

    /// How many results a job needs that somebody who is here can give.
    pub(super) fn wanted(&self, job: &Job) -> usize {
        let needs = job.needs();
        if needs == 0 || job.awaits_own() {
            return needs.min(usize::from(self.somebody_else(job)));
        }
        self.present.keys().filter(|principal| self.may_answer(**principal, job)).take(needs).count()
    }

    fn lease(&mut self, id: WorkerId, job_id: JobId, now: Instant) -> Option<(Lease, Arc<Task>)> {
        let principal = self.workers.get(&id)?.principal;
        let cost = self.cost_to(id, self.jobs.get(job_id)?);
        let job = self.jobs.get_mut(job_id)?;
        let (attempt, task) = (job.hand_out(id, cost, now), Arc::clone(&job.task));
        if attempt == 1 {
            self.counters.queue_times.observe(now.saturating_duration_since(job.submitted).as_secs_f64());
        }
        self.queue.serve(job.position);
        self.add_lease(job_id, id, attempt, now);
        Some((self.secret.lease(job_id, attempt, (id, principal)), task))
    }

    pub(super) fn add_lease(&mut self, job_id: JobId, id: WorkerId, attempt: u32, now: Instant) {
        if let (Some(job), Some(worker)) = (self.jobs.get_mut(job_id), self.workers.get_mut(&id)) {
            job.leases.push((id, attempt));
            // Its second answer is asked for at once, not when the first is there.
            if self.trust.audits(worker.principal, self.secret.draw(job_id)) {
                self.counters.audits += u64::from(job.require(Quorum::Two));
            }
            *self.counters.leases.entry(job.task.kind()).or_default() += 1;
            self.idle -= usize::from(worker.is_free());
            worker.take(job_id, attempt, now);
            self.described.add(id, &job.channels);
            self.refile(job_id);
        }
    }

    /// Reconciles the leases that are recorded with those the worker says it holds; returns those that it should drop.
    pub(super) fn reconcile(&mut self, id: WorkerId, held: &[Lease], now: Instant) -> Vec<Lease> {
        let Some(worker) = self.workers.get(&id) else { return Vec::new() };
        let principal = worker.principal;
        for (job_id, attempt) in worker.leases().to_vec() {
            if held.contains(&self.secret.lease(job_id, attempt, (id, principal))) {
                continue;
            }
            self.release(job_id, id, AttemptEnd::Undelivered, now);
            if self.jobs.get(job_id).is_some_and(|job| job.times_handed_out(id) >= MOST_TIMES_HANDED_OUT) {
                self.count_against(id, now);
            }
        }
        let mut revoked = Vec::new();
        for &lease in held {
            let job = self.jobs.get(lease.job).filter(|_| self.secret.granted(lease, (id, principal)));
            match job.and_then(|job| job.lease_of(id)) {
                Some(attempt) if attempt == lease.attempt => {}
                // Given up while the worker was out of reach, and nobody else has begun: it may go on.
                None if job.is_some_and(|job| self.may_go_on(job, id, principal)) => {
                    self.add_lease(lease.job, id, lease.attempt, now);
                }
                _ => revoked.push(lease),
            }
        }
        revoked
    }

    /// Gives up the leases that have gone on for longer than any job may.
    pub(super) fn expire_leases(&mut self, now: Instant) {
        let in_hand = self.workers.iter().filter_map(|(id, worker)| Some((*id, worker.in_hand()?)));
        let late = in_hand.filter(|(_, (_, since))| now.saturating_duration_since(*since) > self.limits.job);
        for (holder, (job, _)) in late.collect::<Vec<_>>() {
            self.release(job, holder, AttemptEnd::Overdue, now);
            let seconds = self.limits.job.as_secs();
            let failure = Failure::new(FailureReason::Overdue, format_args!("no result within {seconds} s"));
            self.count_failure(job, holder, failure, now);
        }
    }

    /// Ends a lease without a result.
    pub(super) fn release(&mut self, job: JobId, holder: WorkerId, end: AttemptEnd, now: Instant) {
        self.end_lease(job, holder, end, None, now);
        self.refile(job);
    }

    /// Removes a lease. The caller files the job anew.
    pub(super) fn end_lease(
        &mut self,
        job_id: JobId,
        id: WorkerId,
        end: AttemptEnd,
        run_seconds: Option<f64>,
        now: Instant,
    ) {
        let Some(job) = self.jobs.get_mut(job_id) else { return };
        let Some(attempt) = job.lease_of(id) else { return };
        job.leases.retain(|(holder, _)| *holder != id);
        let (cost, mut ran) = (job.cost_to(id, attempt), None);
        let mut next = None;
        if let Some(worker) = self.workers.get_mut(&id) {
            ran = worker.works_on(job_id).map(|since| now.saturating_duration_since(since));
            worker.put_down(job_id, now);
            let is_done = matches!(end, AttemptEnd::Answered | AttemptEnd::Agreed | AttemptEnd::Disagreed);
            if !is_done {
                self.described.remove(id, &job.channels);
            }
            if worker.is_idle() {
                self.idle += usize::from(worker.is_free());
                self.queue.comes_free(id);
            }
            next = worker.in_hand().map(|(job, _)| job);
        }
        self.note_attempt(job_id, id, attempt, end.clone(), run_seconds, now);
        if let Some(next) = next {
            self.refile(next);
        }
        let answered = matches!(end, AttemptEnd::Answered | AttemptEnd::Agreed);
        if let Some(ran) = ran.filter(|_| answered)
            && self.run_times.add(cost, ran)
        {
            self.refile_all(); // until then nobody knew how long is too long
        }
    }

    pub(super) fn note_attempt(
        &mut self,
        job_id: JobId,
        id: WorkerId,
        number: u32,
        end: AttemptEnd,
        run_seconds: Option<f64>,
        now: Instant,
    ) {
        let Some(job) = self.jobs.get(job_id) else { return };
        let handed_out = job.handed_out_at(id, number);
        let (task, kind, label) = (job.task.to_string(), job.task.kind(), self.label(id));
        self.counters.attempt_ended(kind, end.as_str(), run_seconds);
        let held_seconds = now.saturating_duration_since(handed_out).as_secs_f64();
        let kind = Some(kind);
        let attempt =
            Attempt { job: job_id, number, task, kind, worker: id, label, held_seconds, run_seconds, end };
        self.emit(now, EventKind::Attempt(attempt));
    }

    /// Puts a job where it belongs after any change: among those that wait, among those a second worker may take, or
    /// away, when its result is delivered and nobody works on it.
    pub(super) fn refile(&mut self, id: JobId) {
        let Some(job) = self.jobs.get(id) else { return };
        let needs = job.needs();
        if job.delivered && needs == 0 && job.leases.is_empty() {
            return self.forget(id);
        }
        let (wanted, is_held) = (self.wanted(job), self.is_held(job));
        let waits = self.waits(job);
        let hedge_from = match job.leases[..] {
            // Nobody waits for what is only foreseen.
            [(holder, attempt)] if wanted == 1 && !is_held && !job.is_foreseen() => {
                self.hedge_from(id, job, holder, attempt)
            }
            _ => None,
        };
        let position = job.position;
        let Some(job) = self.jobs.get_mut(id) else { return };
        let before = std::mem::replace(&mut job.hedge_from, hedge_from);
        self.queue.move_covered(id, before, hedge_from);
        self.queue.set_waiting(position, id, waits);
    }

    /// Whether a job is to be handed out.
    fn waits(&self, job: &Job) -> bool {
        self.wanted(job) > job.leases.len() && !self.is_held(job) && !job.is_given_up()
    }

    /// From when on an idle worker may take the job that this one has: at once while it waits behind another; when it
    /// takes too long otherwise, as far as it is known what that is.
    fn hedge_from(&self, id: JobId, job: &Job, holder: WorkerId, attempt: u32) -> Option<Instant> {
        match self.workers.get(&holder)?.works_on(id) {
            None => Some(job.handed_out_at(holder, attempt)),
            Some(since) => {
                let expected = self.run_times.expected(job.cost_to(holder, attempt))?;
                Some(since + expected.mul_f64(PATIENCE).max(Duration::from_millis(1)))
            }
        }
    }

    pub(super) fn refile_all(&mut self) {
        for id in self.jobs.iter().map(|(id, _)| id).collect::<Vec<_>>() {
            self.refile(id);
        }
    }

    /// Drops a job from every list.
    pub(super) fn forget(&mut self, id: JobId) {
        let Some(job) = self.jobs.close(id) else { return };
        self.queue.move_covered(id, job.hedge_from, None);
        self.queue.set_waiting(job.position, id, false);
        self.disputed.remove(&id);
        self.failing.remove(&id);
    }

    /// Whether a worker that was out of reach may go on with an attempt that was given up.
    fn may_go_on(&self, job: &Job, id: WorkerId, principal: Principal) -> bool {
        self.wanted(job) > job.leases.len() && self.may_answer(principal, job) && !job.failed_on(id)
    }
}

#[cfg(test)]
impl Scheduler {
    /// Asserts that all lists agree.
    pub(super) fn check_invariants(&self) {
        let idle = self.workers.values().filter(|worker| worker.is_free()).count();
        assert_eq!(self.idle, idle, "idle workers");
        let mut present = BTreeMap::new();
        for worker in self.workers.values().filter(|worker| worker.is_available()) {
            *present.entry(worker.principal).or_default() += 1;
        }
        assert_eq!(self.present, present, "principals");
        for (id, worker) in &self.workers {
            for (job, attempt) in worker.leases() {
                assert_eq!(self.jobs.get(*job).unwrap().lease_of(*id), Some(*attempt), "{id} and job {job}");
            }
        }
        for (id, job) in self.jobs.iter() {
            for (holder, attempt) in &job.leases {
                assert!(self.workers[holder].leases().contains(&(id, *attempt)), "job {id} and {holder}");
            }
            let waits = self.queue.waited_for().chain(self.queue.foreseen()).any(|waiting| waiting == id);
            assert_eq!(waits, self.waits(job), "job {id} waits");
            let mut here = self.workers.iter().filter(|(_, worker)| worker.is_available());
            let is_needed = |(_, worker): &(&WorkerId, &Worker)| {
                let may_decide = !job.awaits_own() || worker.principal == Principal::Coordinator;
                may_decide && self.may_answer(worker.principal, job)
            };
            assert!(!waits || here.any(|worker| is_needed(&worker)), "nobody can answer job {id}");
            assert!(!job.delivered || job.needs() > 0 || !job.leases.is_empty(), "job {id} is over");
        }
        assert!(self.queue.waiting() <= self.jobs.len());
        let disputed = |job: &Job| job.is_disputed() && job.needs() > 0;
        assert!(self.disputed.iter().all(|id| self.jobs.get(*id).is_some_and(disputed)));
    }
}
