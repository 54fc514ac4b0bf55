//! The one store of jobs: all that is known of a job is here, whoever needs it.
//!
//! Nothing here waits for anybody or reads a clock. Accepted results that outgrow memory are written to files and read from
//! them, as memory that is slower and never synced, and results of earlier starts are read from the journal's file when they
//! are asked for; there is no other IO. The scheduler works on the entries of open jobs; clients, journal, rechecks and
//! sharding have their parts of the same entries.

mod accepted_index;
mod archive;
mod job;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use proto::task::{DescriptorBytes, Task, TaskResult};
use proto::{Digest, JobId, Lease, Principal, WorkerId};

use accepted_index::AcceptedIndex;
use archive::Archive;
use archive::Record;
pub use archive::{Grounds, Part};
pub use job::{FailedAttempt, Job, Quorum, Vote};

use crate::journal::{LogSequence, Recorded, RecordedResults};
use crate::scheduler::ChannelsOf;
use crate::scheduler::fair_queue::ClientId;
use crate::scheduler::messages::{Confirmed, Finished};
use crate::sharding::plan::ShardPlan;
use crate::spill::{SpillError, SpillMap};

/// All jobs of a run, through all starts of the coordinator.
pub struct JobStore {
    /// Of jobs what is not in the archive: most that are done have no entry.
    entries: BTreeMap<JobId, Entry>,
    /// Index: the entries whose job is open.
    open: BTreeSet<JobId>,
    /// Accepted by an earlier start; nobody has asked for them since, so that their tasks are not known.
    recorded: RecordedResults,
    /// Accepted results whose task is known.
    archive: Archive,
    /// Index: what is in the archive, by what it is about.
    about: AcceptedIndex,
    /// Reports by job and attempt that were accepted and are not known to be on the disk: the worker keeps them.
    pending: BTreeMap<(JobId, u32), LogSequence>,
    /// Jobs that check an accepted result so far, which names the next.
    checks: u32,
    /// How many of them have no result.
    unchecked: usize,
}

/// What is known of one job, except what is in the archive.
#[derive(Default)]
struct Entry {
    /// Some client of this start has asked for it. A job in the archive without an entry was asked for.
    asked: bool,
    /// Whether it is in the archive. It stands here because the archive may have to read a file to say so.
    archived: bool,
    /// Whether and how the evaluation is sharded, once that is decided.
    plan: Option<Option<ShardPlan>>,
    /// What only a job has that is not done, or that checks another.
    unfinished: Option<Box<Unfinished>>,
}

/// What is known of a job that is not done, or that checks another.
#[derive(Default)]
struct Unfinished {
    /// Its task and the clients that wait for its result, while there are any.
    waiting: Option<(Arc<Task>, Vec<ClientId>)>,
    /// While the scheduler works on it: leases, attempts, votes, failures. A job may be open although its result is
    /// accepted, as long as an audit is to confirm it.
    open: Option<Job>,
    /// Leases that an earlier start granted, until this one asks for the job.
    earlier_leases: Vec<(WorkerId, u32)>,
    /// The job whose accepted result it checks, and whether it still has to.
    check: Option<(JobId, bool)>,
}

impl Entry {
    /// Takes something of what is unfinished, and gives its memory back once there is nothing left.
    fn take<T>(&mut self, take: impl FnOnce(&mut Unfinished) -> T) -> Option<T> {
        let unfinished = self.unfinished.as_deref_mut()?;
        let taken = take(unfinished);
        let Unfinished { waiting, open, earlier_leases, check } = unfinished;
        if waiting.is_none() && open.is_none() && earlier_leases.is_empty() && check.is_none() {
            self.unfinished = None;
        }
        Some(taken)
    }

    fn unfinished(&mut self) -> &mut Unfinished {
        self.unfinished.get_or_insert_default()
    }
}

/// A job that checks an accepted result.
pub struct Recheck {
    /// The job.
    pub job: JobId,
    /// The job whose result it checks.
    pub of: JobId,
    /// The task of both.
    pub task: Arc<Task>,
}

/// The result of a job that checks another.
pub struct Checked {
    /// As a result of the job that it checks.
    pub finished: Finished,
    /// The task, if the result that was accepted before was wrong.
    pub corrected: Option<Arc<Task>>,
}

#[cfg(test)]
impl Default for JobStore {
    /// Of tasks whose descriptors have no channels.
    fn default() -> Self {
        Self::new(|_| Vec::new(), None)
    }
}

impl JobStore {
    /// An empty store of tasks whose descriptors have these channels. What outgrows memory goes to files in `spill`, if there
    /// is such a directory.
    pub fn new(channels_of: ChannelsOf, spill: Option<&Path>) -> Self {
        let map = || SpillMap::new(spill);
        Self {
            entries: BTreeMap::new(),
            open: BTreeSet::new(),
            recorded: RecordedResults::default(),
            archive: Archive::new([map(), map(), map()]),
            about: AcceptedIndex::new(channels_of, map()),
            pending: BTreeMap::new(),
            checks: 0,
            unchecked: 0,
        }
    }

    /// Why some accepted results cannot be read any more, if so.
    pub fn failure(&self) -> Option<&SpillError> {
        self.archive.failure().or_else(|| self.about.failure())
    }

    /// Changes the entry of a job, and drops it if it says no more than the archive: of millions of jobs that are done, no
    /// entry is left.
    fn change<T>(&mut self, job: JobId, change: impl FnOnce(&mut Entry) -> T) -> T {
        let entry = self.entries.entry(job).or_insert_with(|| {
            let archived = self.archive.contains(job);
            Entry { asked: archived, archived, ..Entry::default() }
        });
        let changed = change(entry);
        let Entry { asked, archived, plan, unfinished } = entry;
        let is_plain = plan.flatten().is_none() && unfinished.is_none();
        if *archived && *asked && is_plain {
            self.entries.remove(&job);
        }
        changed
    }

    /// Changes the entry of a job if there is one.
    fn change_if_any<T>(&mut self, job: JobId, change: impl FnOnce(&mut Entry) -> Option<T>) -> Option<T> {
        self.entries.contains_key(&job).then(|| self.change(job, change))?
    }
}

// Open jobs, for the scheduler.
impl JobStore {
    /// An open job.
    pub fn get(&self, job: JobId) -> Option<&Job> {
        self.entries.get(&job)?.unfinished.as_deref()?.open.as_ref()
    }

    /// An open job.
    pub fn get_mut(&mut self, job: JobId) -> Option<&mut Job> {
        self.entries.get_mut(&job)?.unfinished.as_deref_mut()?.open.as_mut()
    }

    /// All open jobs.
    pub fn iter(&self) -> impl Iterator<Item = (JobId, &Job)> {
        self.open.iter().filter_map(|&job| Some((job, self.get(job)?)))
    }

    /// How many jobs are open.
    pub fn len(&self) -> usize {
        self.open.len()
    }

    /// Whether no job is open.
    pub fn is_empty(&self) -> bool {
        self.open.is_empty()
    }

    /// Opens a job.
    pub fn open(&mut self, id: JobId, job: Job) {
        self.change(id, |entry| entry.unfinished().open = Some(job));
        self.open.insert(id);
    }

    /// Closes a job; what else is known of it stays.
    pub fn close(&mut self, id: JobId) -> Option<Job> {
        self.open.remove(&id);
        self.change_if_any(id, |entry| entry.take(|unfinished| unfinished.open.take())?)
    }

    /// Closes all jobs.
    pub fn close_all(&mut self) {
        for id in std::mem::take(&mut self.open) {
            self.close(id);
        }
    }

    /// Takes the leases on a job that an earlier start granted.
    pub fn take_earlier_leases(&mut self, job: JobId) -> Vec<(WorkerId, u32)> {
        let take =
            |entry: &mut Entry| entry.take(|unfinished| std::mem::take(&mut unfinished.earlier_leases));
        self.change_if_any(job, take).unwrap_or_default()
    }
}

// Who asks.
impl JobStore {
    /// A client asks for a job.
    pub fn ask(&mut self, job: JobId) {
        self.change(job, |entry| entry.asked = true);
    }

    /// Whether a client of this start has asked for a job.
    pub fn was_asked(&self, job: JobId) -> bool {
        self.entries.get(&job).map_or_else(|| self.archive.contains(job), |entry| entry.asked)
    }

    /// Lets a client wait for the result of a job; `false` if another waits for it already.
    pub fn wait_for(&mut self, job: JobId, task: &Arc<Task>, client: ClientId) -> bool {
        self.change(job, |entry| {
            let waiting = &mut entry.unfinished().waiting;
            let (_, clients) = waiting.get_or_insert_with(|| (Arc::clone(task), Vec::new()));
            clients.push(client);
            clients.len() == 1
        })
    }

    /// Nobody waits for the result of a job any more, nor will.
    pub fn give_up(&mut self, job: JobId) {
        self.take_waiting(job);
        let says_nothing = |entry: &mut Entry| {
            entry.asked = false;
            entry.plan.flatten().is_none() && entry.unfinished.is_none()
        };
        if self.entries.get_mut(&job).is_some_and(says_nothing) {
            self.entries.remove(&job);
        }
    }

    /// The clients that wait for the result of a job, and its task: they wait no longer.
    pub fn take_waiting(&mut self, job: JobId) -> Option<(Arc<Task>, Vec<ClientId>)> {
        self.change_if_any(job, |entry| entry.take(|unfinished| unfinished.waiting.take())?)
    }
}

// Accepted results.
impl JobStore {
    /// Takes over what earlier starts have left.
    pub fn restore(&mut self, recorded: Recorded) {
        let Recorded { leases, accepted, plans, .. } = recorded;
        for (job, attempt, worker) in leases {
            self.change(job, |entry| entry.unfinished().earlier_leases.push((worker, attempt)));
        }
        self.recorded = accepted;
        for (job, plan) in plans {
            self.set_plan(job, Some(plan));
        }
    }

    /// Accepts a result of a job of this task. Cells of a grid are not kept here: they are large, and have files of their
    /// own.
    pub fn accept(&mut self, task: &Task, finished: &Finished) {
        let is_there = self.is_archived(finished.job);
        let is_kept = match is_there {
            true => self.archive.replace(task, finished),
            false => self.archive.insert(task, finished),
        };
        if is_kept {
            self.about.insert(finished.job, task);
            if self.forget_recorded(finished.job) {
                self.entries.entry(finished.job).or_default(); // without it, it would count as asked for
            }
            self.change_if_any(finished.job, |entry| {
                entry.archived = true;
                Some(())
            });
        }
    }

    /// Whether an earlier start's result of this job was there.
    fn forget_recorded(&mut self, job: JobId) -> bool {
        let was_there = self.recorded.remove(job);
        self.close_recorded();
        was_there
    }

    /// Closes the file of an earlier start's results once it is of no use: if another has replaced it, it takes room on the
    /// disk for as long as it is open.
    fn close_recorded(&mut self) {
        if self.recorded.is_empty() {
            self.recorded = RecordedResults::default();
        }
    }

    /// The result of a job that was accepted before, by this start or an earlier one, if it is one to this task.
    pub fn recall(&mut self, job: JobId, task: &Task) -> Option<Finished> {
        if self.is_archived(job) {
            return self.archive.get(job).map(|(_, finished)| finished);
        }
        let recorded =
            self.recorded.get(job).map_err(|error| format!("cannot be read: {error}")).transpose()?;
        let recorded = recorded.and_then(|accepted| {
            let recorded = Finished::recorded(job, accepted);
            let check = task.check(&recorded.result);
            check.map(|()| recorded).map_err(|what| format!("cannot be one: {what}"))
        });
        match recorded {
            Ok(recorded) => {
                self.accept(task, &recorded);
                Some(recorded)
            }
            Err(what) => {
                tracing::warn!("journal: {task} is computed again, its answer {what}");
                self.forget_recorded(job);
                None
            }
        }
    }

    /// Whether a result of this job was accepted, by this start or an earlier one.
    pub fn has_result(&self, job: JobId) -> bool {
        self.recorded.contains(job) || self.is_archived(job)
    }

    fn is_archived(&self, job: JobId) -> bool {
        self.entries.get(&job).map_or_else(|| self.archive.contains(job), |entry| entry.archived)
    }

    /// Whether this job was asked for before: it has a result, or an earlier start has granted a lease on it and this one
    /// has not asked for it yet. The entry that this leaves of a job that is not archived spares whoever sets its plan next another look into the archive.
    pub fn is_known(&mut self, job: JobId) -> bool {
        let is_recorded = self.recorded.contains(job);
        self.change(job, |entry| {
            let was_leased = |unfinished: &Unfinished| !unfinished.earlier_leases.is_empty();
            entry.archived || is_recorded || entry.unfinished.as_deref().is_some_and(was_leased)
        })
    }

    /// Notes why the accepted result of a job is believed by now, and returns it, if it is the one that counts.
    pub fn assure(&mut self, confirmed: &Confirmed) -> Option<Finished> {
        let accepted = self.archive.get(confirmed.job);
        let (task, mut finished) =
            accepted.filter(|(_, finished)| finished.result.fingerprint() == confirmed.fingerprint)?;
        let before = Grounds::of(&finished);
        if confirmed.assurance >= finished.assurance {
            (finished.assurance, finished.seconded) = (confirmed.assurance, confirmed.seconded);
        }
        if Grounds::of(&finished) != before {
            self.archive.replace(&task, &finished);
        }
        Some(finished)
    }

    /// Some of the accepted results that somebody has asked for in this start; `None` after the last. Whoever takes part
    /// after part, from 0 on, sees all that are there when the first is taken, some of those that are replaced meanwhile
    /// twice: as they were, and as they are then.
    pub fn accepted_part(&self, number: u32) -> Option<Part> {
        self.archive.part(number)
    }

    /// The grounds that some accepted result has that somebody has asked for in this start.
    pub fn grounds(&self) -> impl Iterator<Item = Grounds> {
        self.archive.grounds()
    }

    /// The accepted results about a descriptor, by job, with their tasks, among them the scales of its channels and what was
    /// described for them.
    pub fn about(&self, descriptor: &DescriptorBytes) -> Vec<(Task, Finished)> {
        self.about.find(descriptor, &self.archive)
    }

    /// The jobs whose accepted results are these descriptions.
    pub fn describing(&self, descriptions: &BTreeSet<Digest>) -> Vec<JobId> {
        let mut describing = Vec::new();
        for part in self.archive.parts() {
            let is_describing = |record: &Record<'_>| match record.finished().result {
                TaskResult::Description(described) => descriptions.contains(&described.digest),
                _ => false,
            };
            describing.extend(part.records().filter(is_describing).map(|record| record.job));
        }
        describing
    }

    /// Drops the results that rest on a principal's word and that nobody has asked for in this start. Returns their jobs.
    pub fn drop_recorded(&mut self, principal: Principal) -> Vec<JobId> {
        let dropped = self.recorded.remove_resting_on(principal);
        self.close_recorded();
        dropped
    }

    /// Jobs that ask again for all accepted results that rest on a principal's word. First askings are numbered from 0,
    /// these from the other end.
    pub fn recheck(&mut self, principal: Principal) -> Vec<Recheck> {
        let mut of_principal = BTreeMap::new();
        for part in self.archive.parts() {
            let resting = part.records().filter(|record| record.grounds.rest_on(principal));
            of_principal.extend(resting.map(|record| (record.job, record.task())));
        }
        let mut rechecks = Vec::new();
        for (of, task) in of_principal {
            let job = task.job(u32::MAX - self.checks);
            self.checks += 1;
            rechecks.push(Recheck { job, of, task: Arc::new(task) });
        }
        for Recheck { job, of, .. } in &rechecks {
            self.change(*job, |entry| entry.unfinished().check = Some((*of, true)));
        }
        self.unchecked += rechecks.len();
        rechecks
    }

    /// Accepts the result of a job that checks another; `None` if it checks none, or has done so.
    pub fn check(&mut self, finished: &Finished) -> Option<Checked> {
        let (of, unchecked) = self.entries.get_mut(&finished.job)?.unfinished.as_mut()?.check.as_mut()?;
        if !std::mem::take(unchecked) {
            return None;
        }
        self.unchecked -= 1;
        let finished = Finished { job: *of, ..finished.clone() };
        let mut corrected = None;
        if let Some((task, before)) = self.archive.get(finished.job)
            && self.archive.replace(&task, &finished)
        {
            let is_same = before.result.fingerprint() == finished.result.fingerprint();
            corrected = (!is_same).then(|| Arc::new(task));
        }
        Some(Checked { finished, corrected })
    }

    /// Whether this job checks the result of another.
    pub fn is_check(&self, job: JobId) -> bool {
        self.checked_by(job).is_some()
    }

    /// The job whose accepted result an answer to this one is about: another, if it checks the result of that.
    pub fn result_of(&self, job: JobId) -> JobId {
        self.checked_by(job).unwrap_or(job)
    }

    fn checked_by(&self, job: JobId) -> Option<JobId> {
        self.entries.get(&job)?.unfinished.as_deref()?.check.map(|(of, _)| of)
    }

    /// Whether results are still being checked.
    pub fn is_checking(&self) -> bool {
        self.unchecked > 0
    }
}

// Which reports are on the disk: no worker is told that its report was accepted before that.
impl JobStore {
    /// Notes that the report on a lease was accepted, and will be on the disk with this entry of the journal.
    pub fn set_pending(&mut self, job: JobId, attempt: u32, sequence: LogSequence) {
        self.pending.insert((job, attempt), sequence);
    }

    /// Takes out of `acknowledged` the reports that are not on the disk.
    pub fn withhold(
        &mut self,
        acknowledged: &mut Vec<Lease>,
        is_durable: impl Fn(LogSequence) -> bool,
    ) -> Vec<Lease> {
        let is_pending = |lease: &mut Lease| {
            let report = (lease.job, lease.attempt);
            let pending = self.pending.get(&report).copied();
            if pending.is_some_and(&is_durable) {
                self.pending.remove(&report);
                return false;
            }
            pending.is_some()
        };
        acknowledged.extract_if(.., is_pending).collect()
    }

    /// The entry of the journal with which the last of these reports is on the disk.
    pub fn last_pending(&self, leases: &[Lease]) -> Option<LogSequence> {
        let pending = |lease: &Lease| self.pending.get(&(lease.job, lease.attempt)).copied();
        leases.iter().filter_map(pending).max()
    }
}

// How evaluations are sharded.
impl JobStore {
    /// Whether and how the evaluation of this job is sharded; `None` before that is decided.
    pub fn plan(&self, job: JobId) -> Option<Option<ShardPlan>> {
        self.entries.get(&job)?.plan
    }

    /// Decides whether and how the evaluation of this job is sharded.
    pub fn set_plan(&mut self, job: JobId, plan: Option<ShardPlan>) {
        self.change(job, |entry| entry.plan = Some(plan));
    }
}

#[cfg(test)]
pub(crate) mod tests;
