//! One job: who works on it, what was reported, and how many results it still needs.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use proto::journal::Assurance;
use proto::task::{Task, TaskResult};
use proto::{Digest, Principal, WorkerId};

use crate::cost::{CountedCost, counted_cost};
use crate::scheduler::JobChannels;
use crate::scheduler::fair_queue::{ClientId, QueuePosition};
use crate::scheduler::messages::WorkerFailure;

/// Attempts that are remembered: a worker that never gets its replies must not fill the memory.
const MAX_ATTEMPTS: usize = 256;

/// One worker's result. All workers of one principal have one vote.
pub struct Vote {
    pub worker: WorkerId,
    pub principal: Principal,
    pub label: String,
    pub attempt: u32,
    /// Equal for results that are equal bit for bit.
    pub fingerprint: Digest,
    /// The result, until one is delivered.
    pub result: Option<TaskResult>,
    pub queued: Duration,
    pub run_seconds: f64,
}

/// An attempt that has failed.
pub struct FailedAttempt {
    pub worker: WorkerId,
    pub principal: Principal,
    pub failure: WorkerFailure,
}

/// Who has to give the same result before it counts. What the coordinator's own process gives counts in any case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quorum {
    /// Anybody.
    One,
    /// Two principals.
    Two,
    /// The coordinator's own process.
    Own,
}

impl Quorum {
    /// Why a result that it has given is believed.
    pub fn assurance(self) -> Assurance {
        match self {
            Self::One => Assurance::Unaudited,
            Self::Two => Assurance::Audited,
            Self::Own => Assurance::Own,
        }
    }
}

/// One time that the job was handed out.
struct HandedOut {
    attempt: u32,
    worker: WorkerId,
    at: Instant,
    /// What it costs this worker.
    cost: CountedCost,
}

pub struct Job {
    pub task: Arc<Task>,
    /// The channels in which whoever takes it will have described clouds, and by which it is handed out.
    pub channels: JobChannels,
    /// Who asks for it.
    pub clients: BTreeSet<ClientId>,
    /// Jobs are handed out in this order.
    pub position: QueuePosition,
    pub submitted: Instant,
    quorum: Quorum,
    /// A result has been delivered.
    pub delivered: bool,
    /// Results have differed, and that one was accepted since is not recorded.
    pub was_disputed: bool,
    /// Two principals were found to agree where they had to.
    pub agreed: bool,
    /// Who works on it, on which attempt.
    pub leases: Vec<(WorkerId, u32)>,
    handed_out: Vec<HandedOut>,
    pub votes: Vec<Vote>,
    /// The workers that have answered, whether or not that made another vote.
    voters: BTreeMap<WorkerId, Principal>,
    pub failures: Vec<FailedAttempt>,
    /// Workers that have gone with it in hand.
    pub losses: Vec<FailedAttempt>,
    /// From when on a second worker may take it beside the one that has it, as it stands in the scheduler's list.
    pub hedge_from: Option<Instant>,
}

impl Job {
    /// A job that this client asks for.
    pub fn new(
        task: Arc<Task>,
        channels: JobChannels,
        (client, position): (ClientId, QueuePosition),
        submitted: Instant,
    ) -> Self {
        Self {
            task,
            channels,
            clients: [client].into(),
            position,
            submitted,
            quorum: Quorum::One,
            delivered: false,
            was_disputed: false,
            agreed: false,
            leases: Vec::new(),
            handed_out: Vec::new(),
            votes: Vec::new(),
            voters: BTreeMap::new(),
            failures: Vec::new(),
            losses: Vec::new(),
            hedge_from: None,
        }
    }

    /// When this attempt was handed out to this worker; when the job was submitted, if an earlier start did so without a
    /// record of it.
    pub fn handed_out_at(&self, worker: WorkerId, attempt: u32) -> Instant {
        self.find(worker, attempt).map_or(self.submitted, |handed_out| handed_out.at)
    }

    /// Whether nobody waits for it yet.
    pub fn is_foreseen(&self) -> bool {
        self.clients.iter().all(|client| client.foresees())
    }

    /// Whether it has failed and is tried again when somebody waits for it: what may never be asked for must not go through
    /// all workers, nor end a run.
    pub fn is_given_up(&self) -> bool {
        let has_failed = !self.failures.is_empty() || !self.losses.is_empty();
        has_failed && !self.delivered && self.is_foreseen()
    }

    /// Notes the attempts that earlier starts have made, in order.
    pub fn restore_attempts(&mut self, attempts: &[(WorkerId, u32)], now: Instant) {
        let kept = attempts.iter().rev().take(MAX_ATTEMPTS).rev();
        let cost = counted_cost(&self.task);
        let handed_out = |&(worker, attempt): &(WorkerId, u32)| HandedOut { attempt, worker, at: now, cost };
        self.handed_out = kept.map(handed_out).collect();
    }

    /// How often the job was handed out to this worker, of the attempts that are remembered.
    pub fn times_handed_out(&self, worker: WorkerId) -> usize {
        self.handed_out.iter().filter(|handed_out| handed_out.worker == worker).count()
    }

    /// What this attempt costs this worker.
    pub fn cost_to(&self, worker: WorkerId, attempt: u32) -> CountedCost {
        self.find(worker, attempt).map_or_else(|| counted_cost(&self.task), |handed_out| handed_out.cost)
    }

    fn find(&self, worker: WorkerId, attempt: u32) -> Option<&HandedOut> {
        let is_it = |handed_out: &&HandedOut| handed_out.attempt == attempt && handed_out.worker == worker;
        self.handed_out.iter().find(is_it)
    }

    /// Notes that the job is handed out once more, to a worker that it costs this, and returns which attempt that is.
    pub fn hand_out(&mut self, worker: WorkerId, cost: CountedCost, at: Instant) -> u32 {
        let attempt = self.handed_out.last().map_or(1, |last| last.attempt.saturating_add(1));
        if self.handed_out.len() == MAX_ATTEMPTS {
            self.handed_out.remove(0);
        }
        self.handed_out.push(HandedOut { attempt, worker, at, cost });
        attempt
    }

    /// The attempt on which this worker holds a lease.
    pub fn lease_of(&self, worker: WorkerId) -> Option<u32> {
        self.leases.iter().find(|(holder, _)| *holder == worker).map(|(_, attempt)| *attempt)
    }

    pub fn failed_on(&self, worker: WorkerId) -> bool {
        self.failures.iter().any(|failed| failed.worker == worker)
    }

    /// Whether a worker of this principal has answered.
    pub fn answered_by(&self, principal: Principal) -> bool {
        self.votes.iter().any(|vote| vote.principal == principal)
    }

    /// Whether this worker has answered.
    pub fn answered_by_worker(&self, worker: WorkerId) -> bool {
        self.voters.contains_key(&worker)
    }

    /// Takes a worker's vote. What another worker of its principal has said already is no other vote, and two that differ are
    /// enough to dispute a result: whoever runs under thousands of names must not fill the memory.
    pub fn vote(&mut self, vote: Vote) {
        self.voters.insert(vote.worker, vote.principal);
        let of_principal = || self.votes.iter().filter(|other| other.principal == vote.principal);
        if of_principal().count() < 2 && of_principal().all(|other| other.fingerprint != vote.fingerprint) {
            self.votes.push(vote);
        }
    }

    /// Takes back all that workers of a principal have said.
    pub fn retract_votes(&mut self, principal: Principal) {
        self.votes.retain(|vote| vote.principal != principal);
        self.voters.retain(|_, of| *of != principal);
    }

    /// Whether two results differ.
    pub fn is_disputed(&self) -> bool {
        self.votes.iter().any(|vote| vote.fingerprint != self.votes[0].fingerprint)
    }

    /// How many principals gave this result.
    fn agreeing(&self, fingerprint: Digest) -> usize {
        let agreeing = self.votes.iter().filter(|vote| vote.fingerprint == fingerprint);
        agreeing.map(|vote| vote.principal).collect::<BTreeSet<_>>().len()
    }

    /// Of the principals that the last vote, of this principal, makes agree with another, each: itself, and the first with
    /// whom it agrees if nobody has before.
    pub fn agreement_with(&self, principal: Principal) -> Vec<Principal> {
        let Some(last) = self.votes.last() else { return Vec::new() };
        let same = self.votes.iter().filter(|vote| vote.fingerprint == last.fingerprint);
        let others: BTreeSet<Principal> =
            same.map(|vote| vote.principal).filter(|other| *other != principal).collect();
        match others.len() {
            0 => Vec::new(),
            1 => others.into_iter().chain([principal]).collect(),
            _ => vec![principal],
        }
    }

    /// The vote of the coordinator's own process, unless two of its workers differ.
    fn own(&self) -> Option<&Vote> {
        let mut own = self.votes.iter().filter(|vote| vote.principal == Principal::Coordinator);
        let first = own.next()?;
        own.all(|vote| vote.fingerprint == first.fingerprint).then_some(first)
    }

    /// The first of the votes for the coordinator's own result, or else for the one that most principals gave, the earliest
    /// on ties.
    pub fn leading(&self) -> Option<&Vote> {
        // Of several that are equally good, `max_by_key` takes the last.
        let most = || self.votes.iter().rev().max_by_key(|vote| self.agreeing(vote.fingerprint));
        self.own().or_else(most)
    }

    /// Who has to answer it.
    pub fn quorum(&self) -> Quorum {
        self.quorum
    }

    /// Whether it has to be answered by the coordinator's own process, which has not done so. Where two workers of that
    /// differ, anybody may decide.
    pub fn awaits_own(&self) -> bool {
        self.quorum == Quorum::Own && !self.answered_by(Principal::Coordinator)
    }

    /// Has it answered by this quorum, unless a higher one is required already; `true` if anybody was enough before.
    pub fn require(&mut self, quorum: Quorum) -> bool {
        let before = self.quorum;
        self.quorum = before.max(quorum);
        before == Quorum::One && self.quorum > before
    }

    /// Has a second principal answer it instead of the coordinator's own process, which has shown that it cannot.
    pub fn do_without_own(&mut self) {
        self.quorum = self.quorum.min(Quorum::Two);
    }

    /// How many more equal results it needs: none beside the coordinator's own; of two principals where results differ, or
    /// where they are required.
    pub fn needs(&self) -> usize {
        if self.own().is_some() {
            return 0;
        }
        let agreeing = self.leading().map_or(0, |vote| self.agreeing(vote.fingerprint));
        match self.quorum {
            _ if self.awaits_own() => 1,
            Quorum::One if !self.is_disputed() => 1 - agreeing.min(1),
            _ => 2 - agreeing.min(2),
        }
    }

    /// Another principal than the one that leads, of those that gave the same result.
    pub fn seconded(&self) -> Option<Principal> {
        let leading = self.leading()?;
        let same = self.votes.iter().filter(|vote| vote.fingerprint == leading.fingerprint);
        same.map(|vote| vote.principal).find(|principal| *principal != leading.principal)
    }

    /// Why the leading result would be believed now; `None` if there is none.
    pub fn assurance(&self) -> Option<Assurance> {
        let leading = self.leading()?;
        Some(match self.agreeing(leading.fingerprint) {
            _ if self.own().is_some() => Assurance::Own,
            _ if self.needs() > 0 => Assurance::Owed,
            1 => Assurance::Unaudited,
            _ => Assurance::Audited,
        })
    }
}
