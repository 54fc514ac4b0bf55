//! Who computes what: workers, jobs and leases, as plain decisions with `now` as an argument.
//!
//! Nothing here does IO or waits. The service feeds polls in, the run driver submits jobs and drains outcomes.

mod affinity;
mod control;
mod described;
mod failures;
pub mod fair_queue;
pub mod fleet;
mod foresight;
mod health;
mod leases;
mod membership;
pub mod messages;
pub mod metrics;
mod provenance;
mod queue;
mod restore;
mod run_times;
mod trust;
mod votes;
mod worker;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use proto::journal::Assurance;
use proto::task::{DescriptorBytes, Subject, Task};
use proto::{JobId, Lease, Principal, WorkerId};

use crate::counters::Counters;
use crate::events::{AttemptEnd, Departure, EventKind};
pub use crate::secret::{Caller, RunSecret};
use crate::store::{Grounds, Job, JobStore, Part, Quorum, Vote};
pub use control::{Drained, MAX_PRIORITY};
use described::Described;
pub use described::{Channel, ChannelsOf, Expected, JobChannels};
pub use fair_queue::ClientId;
pub use fleet::{LeaseStatus, WorkerStatus};
pub use messages::{
    Answer, Confirmed, Doubt, Emitted, Finished, JobFailed, Poll, PollRefusal, RegisterRefusal, Staffing,
    WorkerFailure,
};
pub use metrics::{JobState, SchedulerMetrics, WorkerState};
pub use provenance::{Basis, Provenance, Provenances};
use queue::Queue;
use run_times::RunTimes;
pub use trust::Audit;
use trust::Trust;
use worker::{Worker, WorkerIdentity};

/// Workers that have been idle for so long are reported, …
const STARVING_AFTER: Duration = Duration::from_secs(10);
/// … and again after so long.
const STARVING_AGAIN: Duration = Duration::from_secs(120);

/// Workers that are looked at in vain each time that some are woken, so that this takes no longer the more there are. The
/// others hear of a job with their next poll.
const MOST_LOOKS: usize = 16;

/// How many workers may still be looked at for a job beside the one in hand, and for a second lease on one.
struct Looks {
    ahead: usize,
    hedges: usize,
}

/// Whether bytes can be the description of so many clouds under a descriptor; what is wrong with them, if not.
pub type CheckDescription = fn(&Subject, &[u8], u32) -> Result<(), String>;

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
    /// How long a run waits for another worker after it lost the last one, or one more is needed to decide.
    pub worker_grace: Duration,
    /// Registered workers beyond which registration is refused.
    pub max_workers: usize,
    /// How many answers two principals have to agree on.
    pub audit: Audit,
    /// Looks into descriptions, which only the crate `descriptor` reads.
    pub check_description: CheckDescription,
    /// Looks into descriptors, which only that crate reads.
    pub channels_of: ChannelsOf,
}

impl Limits {
    /// For tests, of this and other crates.
    #[doc(hidden)]
    pub const SAMPLE: Self = Self {
        lease: Duration::from_secs(30),
        job: Duration::from_secs(600),
        max_failures: 2,
        max_losses: 5,
        worker_grace: Duration::from_secs(300),
        max_workers: 4,
        audit: Audit::NONE,
        check_description: |_, _, _| Ok(()),
        channels_of: |_| Vec::new(),
    };
}

/// All workers and all unfinished jobs of one run.
pub struct Scheduler {
    limits: Limits,
    secret: RunSecret,
    workers: BTreeMap<WorkerId, Worker>,
    /// How many workers of each principal are here and may be given jobs: none only where there is no worker at all, all ask
    /// for nothing, or an operator drains all.
    present: BTreeMap<Principal, usize>,
    trust: Trust,
    /// How often workers of a principal were excluded because they failed.
    exclusions: BTreeMap<Principal, u32>,
    /// How many workers have no lease and may have one.
    idle: usize,
    /// All jobs; the scheduler works on those that are open.
    pub jobs: JobStore,
    queue: Queue,
    /// Jobs whose results differ and are not decided.
    disputed: BTreeSet<JobId>,
    /// Open jobs that have failed as often as the limit allows, if only on workers that may be at fault themselves.
    failing: BTreeSet<JobId>,
    /// Principals that gave a wrong result: their workers get no more jobs, and none of their results counts.
    quarantined: BTreeSet<Principal>,
    run_times: RunTimes,
    finished: Vec<Finished>,
    /// Jobs that were settled after a result of them was delivered.
    confirmed: Vec<Confirmed>,
    failed: Option<JobFailed>,
    events: Vec<Emitted>,
    doubts: Vec<Doubt>,
    /// Workers that are here and those that have reported a result: no label names two workers in the results, and a
    /// worker that returns keeps its own.
    identities: BTreeMap<WorkerId, WorkerIdentity>,
    used_labels: BTreeSet<String>,
    last_look: Option<Instant>,
    alone_since: Option<Instant>,
    undecided_since: Option<Instant>,
    starving_since: Option<Instant>,
    /// Whether the event that audits wait for another principal was emitted.
    unaudited: bool,
    /// What workers have described.
    described: Described,
    /// The evaluations for which each client has last asked for scales.
    expected: BTreeMap<ClientId, Expected>,
    /// Clients whose jobs are not handed out.
    paused: BTreeSet<ClientId>,
    /// Workers that an operator does not let in any more.
    denied: BTreeSet<WorkerId>,
    counters: Counters,
    /// There was an earlier start, which may have granted leases that are not recorded.
    restarted: bool,
    /// Nothing more will be asked, and workers are told so.
    run_ended: bool,
}

impl Scheduler {
    /// An empty scheduler. What its store of jobs has no memory for goes to files in `spill`, if there is such a directory.
    pub fn new(limits: Limits, secret: RunSecret, spill: Option<&Path>) -> Self {
        Self {
            limits,
            secret,
            workers: BTreeMap::new(),
            present: BTreeMap::new(),
            trust: Trust::new(limits.audit),
            exclusions: BTreeMap::new(),
            idle: 0,
            jobs: JobStore::new(limits.channels_of, spill),
            queue: Queue::default(),
            described: Described::default(),
            disputed: BTreeSet::new(),
            failing: BTreeSet::new(),
            quarantined: BTreeSet::new(),
            run_times: RunTimes::default(),
            finished: Vec::new(),
            confirmed: Vec::new(),
            failed: None,
            events: Vec::new(),
            doubts: Vec::new(),
            identities: BTreeMap::new(),
            used_labels: BTreeSet::new(),
            last_look: None,
            alone_since: None,
            undecided_since: None,
            starving_since: None,
            unaudited: false,
            expected: BTreeMap::new(),
            paused: BTreeSet::new(),
            denied: BTreeSet::new(),
            counters: Counters::default(),
            restarted: false,
            run_ended: false,
        }
    }

    /// Adds a job under its name ([`JobNames`](crate::job_names::JobNames)). Clients are served in turn; the jobs of one
    /// are handed out in the order of submission, but a worker is given first those for which no other is better suited, as
    /// it has to describe less. A job that a worker was given by an earlier start is still its own.
    pub fn submit(&mut self, id: JobId, task: Arc<Task>, client: ClientId, now: Instant) {
        self.abandon(id, now); // of the same name before the run began again
        let channels = self.channels(&task, client);
        let mut job = Job::new(task, channels, (client, self.queue.position(client)), now);
        let lease = self.restore_attempts(id, &mut job, now);
        self.jobs.open(id, job);
        match lease {
            Some((holder, attempt)) => self.add_lease(id, holder, attempt, now),
            None => self.refile(id),
        }
    }

    /// Has a job whose result was accepted before, or that is still open, answered by the coordinator's own process, where
    /// that works, or else by a second principal, unless it was.
    pub fn confirm(&mut self, task: &Arc<Task>, accepted: &Finished, client: ClientId, now: Instant) {
        self.require(if self.has_own() { Quorum::Own } else { Quorum::Two }, (task, accepted), client, now);
    }

    /// The same by a second principal.
    pub fn audit(&mut self, task: &Arc<Task>, accepted: &Finished, client: ClientId, now: Instant) {
        self.require(Quorum::Two, (task, accepted), client, now);
    }

    fn require(
        &mut self,
        quorum: Quorum,
        (task, accepted): (&Arc<Task>, &Finished),
        client: ClientId,
        now: Instant,
    ) {
        if accepted.assurance >= quorum.assurance() {
            return;
        }
        let id = accepted.job;
        if self.jobs.get(id).is_none() {
            let channels = self.channels(task, client);
            let mut job = Job::new(Arc::clone(task), channels, (client, self.queue.position(client)), now);
            job.delivered = true;
            job.restore_attempts(&[(accepted.worker_id, accepted.attempt)], now);
            let vote = |principal, worker, label| Vote {
                worker,
                principal,
                label,
                attempt: accepted.attempt,
                fingerprint: accepted.result.fingerprint(),
                result: None,
                queued: accepted.queued,
                run_seconds: accepted.run_seconds,
            };
            job.vote(vote(accepted.principal, accepted.worker_id, accepted.worker.clone()));
            // Which of its workers it was is not kept.
            let seconded =
                accepted.seconded.map(|second| vote(second, WorkerId([0; 16]), second.to_string()));
            seconded.into_iter().for_each(|second| job.vote(second));
            self.jobs.open(id, job);
        }
        if let Some(job) = self.jobs.get_mut(id) {
            self.counters.audits += u64::from(job.require(quorum));
            job.clients.insert(client);
        }
        self.do_without_own(id);
        self.settle(id, now);
    }

    /// Some of the accepted results, as [`JobStore::accepted_part`], with their provenances by their grounds.
    pub fn provenances_of_part(&self, number: u32) -> Option<(Part, BTreeMap<Grounds, Option<Provenance>>)> {
        let part = self.jobs.accepted_part(number)?;
        let grounds: BTreeSet<Grounds> = part.records().map(|record| record.grounds).collect();
        let of = |grounds| (grounds, Provenance::of(grounds, &self.trust));
        Some((part, grounds.into_iter().map(of).collect()))
    }

    /// The provenance of everything that is known about a descriptor; `None` if nothing is, or nothing to go on with for
    /// others than this run.
    pub fn provenance_about(&self, descriptor: &DescriptorBytes) -> Option<Provenance> {
        let about = self.jobs.about(descriptor).into_iter();
        about
            .filter(|(task, _)| task.subject().descriptor == *descriptor)
            .map(|(_, finished)| self.provenance(&finished))
            .reduce(|all, one| Some(all?.and(one?)))?
    }

    /// The provenance of a result; `None` if it is nothing to go on with for others than this run.
    pub fn provenance<R>(&self, finished: &Finished<R>) -> Option<Provenance> {
        Provenance::of(Grounds::of(finished), &self.trust)
    }

    /// The principals on whose word the accepted results of this start rest.
    pub fn answerers(&self) -> BTreeSet<Principal> {
        let principals = |grounds: Grounds| match grounds.assurance {
            Assurance::Own => [Some(Principal::Coordinator), None],
            _ => [Some(grounds.principal), grounds.seconded],
        };
        self.jobs.grounds().flat_map(principals).flatten().collect()
    }

    /// Whether what an earlier run has left about this job is computed again by this one: as often as answers are audited,
    /// and as little to be foreseen.
    pub fn spot_checks(&self, job: JobId) -> bool {
        self.secret.draw(job) < self.limits.audit.share
    }

    /// Notes a sign of life that cannot be answered yet.
    pub fn heard_from(&mut self, (id, principal): Caller, now: Instant) {
        if let Some(worker) = self.workers.get_mut(&id).filter(|worker| worker.principal == principal) {
            worker.last_seen = now;
        }
    }

    /// The worker that calls, if it is registered by this credential.
    fn caller(&mut self, (id, principal): Caller) -> Result<&mut Worker, PollRefusal> {
        let refusal = match self.quarantined.contains(&principal) {
            true => PollRefusal::Quarantined,
            false => PollRefusal::UnknownWorker,
        };
        self.workers.get_mut(&id).filter(|worker| worker.principal == principal).ok_or(refusal)
    }

    /// One poll: heartbeat, finished work, request for more.
    pub fn poll(&mut self, caller: Caller, poll: Poll, now: Instant) -> Result<Answer, PollRefusal> {
        let (id, principal) = caller;
        let worker = self.caller(caller)?;
        if poll.sequence <= worker.sequence {
            return Err(PollRefusal::Stale);
        }
        worker.sequence = poll.sequence;
        worker.last_seen = now;

        let mut answer = Answer::default();
        for report in poll.finished {
            let lease = report.lease;
            self.accept(id, report, now);
            // A vote counts when the result is delivered. Until then it is kept nowhere but here.
            let is_open = |job: &Job| !job.delivered && job.answered_by_worker(id);
            if !self.jobs.get(lease.job).is_some_and(is_open) {
                answer.acknowledged.push(lease);
            }
        }
        if self.quarantined.contains(&principal) {
            return Err(PollRefusal::Quarantined);
        }
        if poll.leaving {
            self.remove_worker(id, Departure::Left, now); // with its leases, whether it lists them or not
        } else {
            answer.revoked = self.reconcile(id, &poll.held, now);
            if self.workers.get_mut(&id).is_some_and(|worker| worker.wants(poll.wanted, now)) {
                self.join_present(principal);
            }
            answer.jobs = self.lease_jobs(id, poll.wanted, now);
        }
        answer.run_ended = self.run_ended;
        if !answer.is_empty() {
            self.queue.set_idle_poll(id, None); // it hears back at once, and will ask again
        }
        Ok(answer)
    }

    /// Hands out more jobs in answer to the poll with this sequence number, unless a newer one was seen.
    pub fn lease_later(
        &mut self,
        caller: Caller,
        sequence: u64,
        wanted: usize,
        now: Instant,
    ) -> Result<Vec<(Lease, Arc<Task>)>, PollRefusal> {
        let worker = self.caller(caller)?;
        if worker.sequence != sequence {
            return Err(PollRefusal::Stale);
        }
        worker.last_seen = now;
        Ok(self.lease_jobs(caller.0, wanted, now))
    }

    /// Gives up the workers that have been silent for longer than a lease lasts, and the leases that have gone on for
    /// longer than any job may; notices when work cannot go on.
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
            self.refile_all();
        }
        let silent = |worker: &Worker| now.saturating_duration_since(worker.last_seen) > self.limits.lease;
        let lost: Vec<WorkerId> =
            self.workers.iter().filter(|(_, worker)| silent(worker)).map(|(id, _)| *id).collect();
        for id in lost {
            self.remove_worker(id, Departure::Lost, now);
        }
        self.expire_leases(now);
        self.pass_over_passive(now);
        self.end_exclusions(now);
        self.fail_hopeless();
        self.queue.forget_wakeups();
        self.notice_undecided(now);
        self.notice_starving(now);
    }

    /// Whether there are workers, and enough of them to decide.
    pub fn staffing(&self, now: Instant) -> Staffing {
        let grace_over = |since: Instant| now.saturating_duration_since(since) > self.limits.worker_grace;
        match (self.alone_since, self.undecided_since) {
            (_, Some(since)) if grace_over(since) => Staffing::Undecided,
            _ if !self.workers.is_empty() => Staffing::Staffed,
            (None, _) => Staffing::NotYet,
            (Some(since), _) if grace_over(since) => Staffing::GraceOver,
            (Some(since), _) => Staffing::Lost(now.saturating_duration_since(since)),
        }
    }

    /// Jobs that were finished since the last call, in order of arrival.
    pub fn drain_finished(&mut self) -> Vec<Finished> {
        std::mem::take(&mut self.finished)
    }

    /// Jobs that were settled since the last call after a result of them was delivered.
    pub fn drain_confirmed(&mut self) -> Vec<Confirmed> {
        std::mem::take(&mut self.confirmed)
    }

    /// What happened since the last call.
    pub fn drain_events(&mut self) -> Vec<Emitted> {
        let events = std::mem::take(&mut self.events);
        events.iter().for_each(|event| self.counters.note(&event.kind));
        events
    }

    /// What came up since the last call that makes accepted results doubtful.
    pub fn drain_doubts(&mut self) -> Vec<Doubt> {
        std::mem::take(&mut self.doubts)
    }

    /// The first job that failed for good, if any.
    pub fn failed(&self) -> Option<&JobFailed> {
        self.failed.as_ref()
    }

    /// Who was quarantined, in this start or an earlier one.
    pub fn quarantined(&self) -> &BTreeSet<Principal> {
        &self.quarantined
    }

    /// How many workers there are.
    pub fn worker_count(&self) -> usize {
        self.workers.len()
    }

    /// Whether a worker of the coordinator's own process is here.
    pub fn has_own(&self) -> bool {
        self.present.contains_key(&Principal::Coordinator)
    }

    /// How many jobs have no result, of those that are only foreseen or of the others.
    pub fn open_jobs(&self, foreseen: bool) -> usize {
        self.jobs.iter().filter(|(_, job)| !job.delivered && job.is_foreseen() == foreseen).count()
    }

    /// Whether this worker is registered.
    pub fn knows(&self, id: WorkerId) -> bool {
        self.workers.contains_key(&id)
    }

    /// Whether a result that was delivered is still in doubt, and a worker may remove the doubt: two workers differ,
    /// or it is to be audited, and there is another principal than the one that gave it. What only clients wait for that are
    /// paused counts if it `concerns` whoever asks: nobody else is to wait for as long as they are.
    pub fn in_doubt(&self, concerns: impl Fn(JobId) -> bool) -> bool {
        self.doubtful().any(|(id, job)| !self.is_held(job) || concerns(id))
    }

    /// The jobs in doubt that are held back because everybody who asks for them is paused.
    pub fn held_in_doubt(&self) -> Vec<JobId> {
        self.doubtful().filter(|(_, job)| self.is_held(job)).map(|(id, _)| id).collect()
    }

    fn doubtful(&self) -> impl Iterator<Item = (JobId, &Job)> {
        let is_doubtful =
            |job: &Job| job.delivered && job.needs() > 0 && (job.is_disputed() || self.somebody_else(job));
        self.jobs.iter().filter(move |(_, job)| is_doubtful(job))
    }

    /// Ends all leases, because the run ends.
    pub fn close(&mut self, now: Instant) {
        let leases =
            self.jobs.iter().flat_map(|(id, job)| job.leases.iter().map(move |(holder, _)| (id, *holder)));
        for (job, holder) in leases.collect::<Vec<_>>() {
            self.end_lease(job, holder, AttemptEnd::Dropped, None, now);
        }
        self.jobs.close_all();
        self.disputed.clear();
        self.failing.clear();
        self.queue = Queue::default();
    }

    /// Workers whose poll found nothing and for which there is a job by now, idle ones first, and no more of them than there
    /// are jobs. Each should ask for it soon by [`Scheduler::lease_later`].
    pub fn wake(&mut self, now: Instant) -> Vec<WorkerId> {
        let mut wakeups = self.queue.wakeups(now);
        let (mut woken, mut waited_for) = (Vec::new(), self.queue.count_waited_for());
        let mut looks = Looks { ahead: MOST_LOOKS, hedges: MOST_LOOKS };
        if wakeups > 0 {
            for (busy, id) in self.queue.idle_polls() {
                // What is only foreseen is not for busy ones.
                if wakeups == 0 || busy && (looks.ahead == 0 || waited_for == 0) {
                    break;
                }
                if busy && !self.hands_out_ahead(id) {
                    // The others are as busy, and where a job costs all of them the same, as little allowed to take it.
                    looks.ahead = if self.first_is_alike_to_all() { 0 } else { looks.ahead - 1 };
                    continue;
                }
                let mut is_late = || {
                    let may_look = looks.hedges > 0;
                    looks.hedges = looks.hedges.saturating_sub(1);
                    may_look && self.next_hedge(id, now).is_some()
                };
                if self.next_waiting(id, now).is_some() || is_late() {
                    woken.push(id);
                    wakeups -= 1;
                    waited_for = waited_for.saturating_sub(1);
                }
            }
        }
        for id in &woken {
            self.queue.note_wakeup(*id);
        }
        woken
    }

    fn notice_undecided(&mut self, now: Instant) {
        let disputed = self.disputed.iter().filter_map(|id| self.jobs.get(*id));
        let mut needed = disputed.filter(|job| job.delivered || !job.is_foreseen());
        let undecided = needed.find(|job| !self.somebody_else(job));
        match (undecided, self.undecided_since) {
            (Some(job), None) => {
                let task = job.task.to_string();
                self.emit(now, EventKind::Undecided { task });
                self.undecided_since = Some(now);
            }
            (Some(_), Some(_)) => {}
            (None, _) => self.undecided_since = None,
        }
    }

    fn notice_starving(&mut self, now: Instant) {
        let is_free = |id: &WorkerId| self.workers.get(id).is_some_and(Worker::is_free);
        let polls = || self.queue.idle_polls().take_while(|(busy, _)| !busy);
        let idle = || polls().filter(|(_, id)| is_free(id)).count();
        let unfinished = || self.jobs.iter().filter(|(_, job)| !job.delivered && !self.is_held(job)).count();
        let waiting = self.queue.waiting() > 0;
        let (idle, unfinished) = if waiting { (0, 0) } else { (idle(), unfinished()) };
        if idle == 0 || unfinished == 0 {
            self.starving_since = None;
            return;
        }
        let since = *self.starving_since.get_or_insert(now);
        if now.saturating_duration_since(since) > STARVING_AFTER {
            self.emit(now, EventKind::Starving { idle, unfinished });
            self.starving_since = Some(now + (STARVING_AGAIN - STARVING_AFTER));
        }
    }

    fn emit(&mut self, at: Instant, kind: EventKind) {
        self.events.push(Emitted { at, kind });
    }

    /// The label of a worker that is here or has reported a result.
    pub fn label(&self, id: WorkerId) -> String {
        self.identities.get(&id).map_or_else(|| id.to_string(), |known| known.label.clone())
    }
}

#[cfg(test)]
mod simulation;
#[cfg(test)]
mod tests;
