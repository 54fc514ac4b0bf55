//! Those who ask: what each of them has asked for, and what it has not been told yet.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use proto::JobId;
use proto::task::Task;
use tokio::sync::Notify;

use crate::job_names::JobNames;
use crate::scheduler::{ClientId, Event, Finished};

/// Doubts that are kept for a client that does not look: one that is finished needs none of them.
const MAX_DOUBTS: usize = 10_000;

/// All clients, and the jobs they wait for.
#[derive(Default)]
pub(super) struct Clients {
    accounts: BTreeMap<ClientId, Account>,
    /// Jobs without an answer. Who asks for the same as another shares the job.
    open: BTreeMap<JobId, Question>,
    /// Every job that somebody has asked for.
    asked: BTreeSet<JobId>,
    /// Jobs that check answers.
    checks: BTreeSet<JobId>,
    /// There may be others who have asked, and are gone.
    shared: bool,
    joined: u32,
}

struct Question {
    task: Arc<Task>,
    clients: Vec<ClientId>,
}

/// One client.
#[derive(Default)]
pub(super) struct Account {
    /// What it has asked for since it began.
    names: JobNames,
    /// What it had asked for before it began again.
    past: Vec<JobNames>,
    /// How many of its jobs have no answer.
    waits_for: usize,
    /// Answers that it has not been told.
    inbox: Vec<Finished>,
    /// What casts doubt on answers, since it last looked.
    pub(super) doubts: Vec<Event>,
    /// Tasks of which it was told an answer that turned out to be wrong.
    pub(super) corrected: Vec<Arc<Task>>,
    bell: Arc<Notify>,
    /// It has asked for something that had no answer, and for everything it could ask for beside that; or it has no more
    /// to ask.
    arrived: bool,
}

impl Account {
    /// Takes what it has not been told.
    pub(super) fn take_inbox(&mut self) -> Vec<Finished> {
        std::mem::take(&mut self.inbox)
    }

    /// Whether it was told every answer.
    pub(super) fn has_all(&self) -> bool {
        self.waits_for == 0 && self.inbox.is_empty()
    }

    /// Whether it has asked for this job, since it began or before.
    pub(super) fn has_asked(&self, job: JobId) -> bool {
        self.names.contains(job) || self.past.iter().any(|names| names.contains(job))
    }

    /// It begins again, and asks for the same in the same order. Returns what was corrected.
    pub(super) fn begin_again(&mut self) -> Vec<Arc<Task>> {
        self.past.push(std::mem::take(&mut self.names));
        std::mem::take(&mut self.corrected)
    }

    pub(super) fn arrive(&mut self) {
        self.arrived = true;
    }

    fn tell(&mut self, finished: Finished) {
        self.inbox.push(finished);
        self.bell.notify_one();
    }
}

impl Clients {
    /// Somebody new, and what wakes it when there is something to tell.
    pub(super) fn join(&mut self) -> (ClientId, Arc<Notify>) {
        self.joined += 1;
        let (id, account) = (ClientId(self.joined), Account::default());
        let bell = Arc::clone(&account.bell);
        self.accounts.insert(id, account);
        (id, bell)
    }

    pub(super) fn leave(&mut self, id: ClientId) {
        self.accounts.remove(&id);
    }

    pub(super) fn account(&mut self, id: ClientId) -> &mut Account {
        self.accounts.entry(id).or_default()
    }

    /// Whether all of them have asked for something that had no answer, or have no more to ask.
    pub(super) fn have_arrived(&self) -> bool {
        !self.accounts.is_empty() && self.accounts.values().all(|account| account.arrived)
    }

    /// Names the job by which this client asks for a task.
    pub(super) fn name(&mut self, id: ClientId, task: &Task) -> JobId {
        let job = self.account(id).names.next(task);
        self.asked.insert(job);
        job
    }

    /// Tells a client an answer that is there.
    pub(super) fn tell(&mut self, id: ClientId, finished: Finished) {
        self.account(id).tell(finished);
    }

    /// Lets a client wait for a job; `false` if another waits for it already.
    pub(super) fn wait_for(&mut self, id: ClientId, job: JobId, task: &Arc<Task>) -> bool {
        let account = self.account(id);
        account.waits_for += 1;
        let first = || Question { task: Arc::clone(task), clients: Vec::new() };
        let question = self.open.entry(job).or_insert_with(first);
        question.clients.push(id);
        question.clients.len() == 1
    }

    /// Tells an answer to all that wait for it. Returns its task, if anybody did.
    pub(super) fn deliver(&mut self, finished: &Finished) -> Option<Arc<Task>> {
        let Question { task, clients } = self.open.remove(&finished.job)?;
        for id in clients {
            if let Some(account) = self.accounts.get_mut(&id) {
                account.waits_for -= 1;
                account.tell(finished.clone());
            }
        }
        Some(task)
    }

    /// Notes for all that were told the answer to a job that it was wrong.
    pub(super) fn correct(&mut self, job: JobId, task: &Arc<Task>) {
        for account in self.accounts.values_mut().filter(|account| account.names.contains(job)) {
            account.corrected.push(Arc::clone(task));
        }
    }

    /// From here on there are others beside those who are here: members of a sweep that are finished.
    pub(super) fn share(&mut self) {
        self.shared = true;
    }

    /// Notes a job that checks an answer: it is for all.
    pub(super) fn note_check(&mut self, job: JobId) {
        self.checks.insert(job);
    }

    /// Whether somebody has asked for this job.
    pub(super) fn was_asked(&self, job: JobId) -> bool {
        self.asked.contains(&job)
    }

    /// Whether an attempt at this job belongs into the account of this client: it asked, or it was for all. Jobs of an
    /// earlier start that nobody has asked for again are those of whoever is alone.
    pub(super) fn concerns(&self, id: ClientId, job: JobId) -> bool {
        let is_its_own = || self.accounts.get(&id).is_some_and(|account| account.has_asked(job));
        self.checks.contains(&job) || is_its_own() || !self.shared && !self.was_asked(job)
    }

    /// Tells all of them that answers may be wrong.
    pub(super) fn doubt(&mut self, event: &Event) {
        for account in self.accounts.values_mut() {
            if account.doubts.len() < MAX_DOUBTS {
                account.doubts.push(event.clone());
            }
        }
    }

    /// Wakes all of them.
    pub(super) fn ring(&self) {
        for account in self.accounts.values() {
            account.bell.notify_one();
        }
    }
}
