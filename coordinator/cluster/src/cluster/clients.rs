//! Clients: what each of them has asked for, and what is to be delivered to it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use proto::JobId;
use proto::task::Task;
use tokio::sync::Notify;

use crate::job_names::JobNames;
use crate::scheduler::{ClientId, Doubt, Finished};
use crate::spill::SpillError;
use crate::store::JobStore;

/// Doubts that are kept for a client that does not look: one that has finished needs none of them.
const MAX_DOUBTS: usize = 10_000;

/// All clients.
pub(super) struct Clients {
    /// Where names go that outgrow memory.
    spill: Option<PathBuf>,
    accounts: BTreeMap<ClientId, Account>,
    /// Other clients may have submitted tasks and be gone.
    shared: bool,
    joined: u32,
}

/// One client.
pub(super) struct Account {
    /// Where names go that outgrow memory.
    spill: Option<PathBuf>,
    /// What it has asked for since it began.
    names: JobNames,
    /// What was asked for in its stead, because it was foreseen, and not by itself.
    foreseen: JobNames,
    /// What it had asked for each time before it began again.
    past: Vec<JobNames>,
    /// How many of its jobs have no result.
    waits_for: usize,
    /// It has all results, and waits until they are beyond doubt.
    pub(super) in_doubt: bool,
    /// Results to be delivered.
    inbox: Vec<Finished>,
    /// Why results may be wrong, since it last looked.
    pub(super) doubts: Vec<Doubt>,
    /// Tasks of which a wrong result was delivered to it.
    pub(super) corrected: Vec<Arc<Task>>,
    wakeup: Arc<Notify>,
    /// It waits for a result and has submitted everything else that it could; or it has nothing more to submit.
    arrived: bool,
}

impl Account {
    fn new(spill: Option<PathBuf>) -> Self {
        Self {
            names: JobNames::new(spill.as_deref()),
            foreseen: JobNames::new(spill.as_deref()),
            spill,
            past: Vec::new(),
            waits_for: 0,
            in_doubt: false,
            inbox: Vec::new(),
            doubts: Vec::new(),
            corrected: Vec::new(),
            wakeup: Arc::default(),
            arrived: false,
        }
    }

    /// Why some of what it has asked for cannot be looked up any more, if so.
    fn failure(&self) -> Option<&SpillError> {
        self.all_names().find_map(JobNames::failure)
    }

    /// All that it has asked for, or that was asked for in its stead.
    fn all_names(&self) -> impl Iterator<Item = &JobNames> {
        [&self.names, &self.foreseen].into_iter().chain(&self.past)
    }

    /// Takes the results to be delivered.
    pub(super) fn take_inbox(&mut self) -> Vec<Finished> {
        std::mem::take(&mut self.inbox)
    }

    /// Whether every result was delivered.
    pub(super) fn has_all(&self) -> bool {
        self.waits_for == 0 && self.inbox.is_empty()
    }

    /// Whether it has asked for this job, since it began or before.
    pub(super) fn has_asked(&self, job: JobId) -> bool {
        self.all_names().any(|names| names.contains(job))
    }

    /// It begins again, and asks for the same in the same order. Returns what was corrected.
    pub(super) fn begin_again(&mut self) -> Vec<Arc<Task>> {
        let names = JobNames::new(self.spill.as_deref());
        self.past.push(std::mem::replace(&mut self.names, names));
        std::mem::take(&mut self.corrected)
    }

    pub(super) fn arrive(&mut self) {
        self.arrived = true;
    }

    fn deliver_one(&mut self, finished: Finished) {
        self.inbox.push(finished);
        self.wakeup.notify_one();
    }
}

impl Clients {
    /// None yet. What they have asked for goes to files in `spill` where it outgrows memory, if there is such a directory.
    pub(super) fn new(spill: Option<&Path>) -> Self {
        Self { spill: spill.map(Path::to_owned), accounts: BTreeMap::new(), shared: false, joined: 0 }
    }

    /// Why some of what they have asked for cannot be looked up any more, if so.
    pub(super) fn failure(&self) -> Option<&SpillError> {
        self.accounts.values().find_map(Account::failure)
    }

    /// A new client, of another that will ask for what it asks for, if there is one; and what wakes it when there is news for
    /// it.
    pub(super) fn join(&mut self, owner: Option<ClientId>) -> (ClientId, Arc<Notify>) {
        self.joined += 1;
        let id = owner.map_or(ClientId::new(self.joined), |owner| owner.foresight(self.joined));
        // One that only foresees asks for little, which is its owner's when it leaves.
        let account = Account::new(self.spill.clone().filter(|_| owner.is_none()));
        let wakeup = Arc::clone(&account.wakeup);
        self.accounts.insert(id, account);
        (id, wakeup)
    }

    /// What one has foreseen concerns its owner from here on.
    pub(super) fn leave(&mut self, id: ClientId) {
        let Some(account) = self.accounts.remove(&id).filter(|_| id.foresees()) else { return };
        if let Some(Account { names, foreseen, .. }) = self.accounts.get_mut(&id.owner()) {
            let added = foreseen.add(&account.names, names);
            debug_assert_eq!(added, Ok(()), "names without a file can be read");
        }
    }

    pub(super) fn account(&mut self, id: ClientId) -> &mut Account {
        self.accounts.entry(id).or_insert_with(|| Account::new(self.spill.clone()))
    }

    /// Whether all of them wait for a result, or have nothing more to submit.
    pub(super) fn have_arrived(&self) -> bool {
        !self.accounts.is_empty() && self.accounts.values().all(|account| account.arrived)
    }

    /// Those that wait for a result, or until all are beyond doubt.
    pub(super) fn that_wait(&self) -> impl Iterator<Item = ClientId> {
        let waits = |account: &Account| account.waits_for > 0 || account.in_doubt;
        self.accounts.iter().filter(move |(_, account)| waits(account)).map(|(id, _)| *id)
    }

    /// Names the job by which this client asks for a task.
    pub(super) fn name(&mut self, id: ClientId, task: &Task) -> JobId {
        self.account(id).names.next(task)
    }

    /// Delivers a result that is there already.
    pub(super) fn deliver_one(&mut self, id: ClientId, finished: Finished) {
        self.account(id).deliver_one(finished);
    }

    /// A client waits for one more result.
    pub(super) fn wait(&mut self, id: ClientId) {
        self.account(id).waits_for += 1;
    }

    /// Delivers a result to those that waited for it.
    pub(super) fn deliver(&mut self, clients: Vec<ClientId>, finished: &Finished) {
        for id in clients {
            if let Some(account) = self.accounts.get_mut(&id) {
                account.waits_for -= 1;
                account.deliver_one(finished.clone());
            }
        }
    }

    /// Notes for all to which the result of a job was delivered that it was wrong.
    pub(super) fn correct(&mut self, job: JobId, task: &Arc<Task>) {
        for account in self.accounts.values_mut().filter(|account| account.names.contains(job)) {
            account.corrected.push(Arc::clone(task));
        }
    }

    /// From here on there are others beside those that are here: members of a sweep that are finished.
    pub(super) fn set_shared(&mut self) {
        self.shared = true;
    }

    /// Whether an attempt at this job concerns this client: it submitted the job, or the job checks a result for all. Jobs
    /// of an earlier start that nobody has submitted again concern a client that is alone.
    pub(super) fn concerns(&self, id: ClientId, job: JobId, jobs: &JobStore) -> bool {
        jobs.is_check(job) || self.has_asked(id, job) || !self.shared && !jobs.was_asked(job)
    }

    /// Whether a client has asked for a job, or it was asked for in its stead.
    pub(super) fn has_asked(&self, id: ClientId, job: JobId) -> bool {
        self.accounts.get(&id).is_some_and(|account| account.has_asked(job))
    }

    /// Who has asked for a job or will ask for it, the first of several.
    pub(super) fn asker(&self, job: JobId) -> Option<ClientId> {
        self.accounts.iter().find(|(_, account)| account.has_asked(job)).map(|(id, _)| id.owner())
    }

    /// Tells all of them that results may be wrong.
    pub(super) fn doubt(&mut self, doubt: &Doubt) {
        for account in self.accounts.values_mut() {
            if account.doubts.len() < MAX_DOUBTS {
                account.doubts.push(doubt.clone());
            }
        }
    }

    /// Wakes all of them.
    pub(super) fn wake_all(&self) {
        for account in self.accounts.values() {
            account.wakeup.notify_one();
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use proto::task::Evaluation;

    use super::*;
    use crate::spill::tests::on_failing_disk;

    pub fn task(number: u32) -> Task {
        Task::Evaluation(Evaluation::sample(number, 9, 9))
    }

    /// Has a client ask for 200 tasks, whose names are on a disk that fails once it is told to.
    pub fn ask_with_names_on_failing_disk(clients: &mut Clients, id: ClientId) -> Arc<AtomicBool> {
        let (disk, fails) = on_failing_disk();
        clients.account(id).names = JobNames::of(disk);
        for number in 0..200 {
            clients.name(id, &task(number));
        }
        fails
    }

    #[test]
    fn names_that_cannot_be_looked_up_are_a_failure_also_of_a_client_that_begins_again() {
        let mut clients = Clients::new(None);
        let (id, _) = clients.join(None);
        let fails = ask_with_names_on_failing_disk(&mut clients, id);
        clients.account(id).begin_again();
        let has_asked = |clients: &mut Clients, number| clients.account(id).has_asked(task(number).job(0));
        assert!((0..200).all(|number| has_asked(&mut clients, number)));
        assert_eq!(clients.failure(), None);
        fails.store(true, Ordering::Relaxed);
        assert!(!(0..200).all(|number| has_asked(&mut clients, number)));
        assert!(clients.failure().is_some());
    }

    #[test]
    fn what_was_foreseen_for_a_client_is_its_own_from_then_on() {
        let mut clients = Clients::new(None);
        let (owner, _) = clients.join(None);
        clients.name(owner, &task(1));
        for foreseen in [1..3, 3..5] {
            let (foresight, _) = clients.join(Some(owner));
            for number in foreseen {
                clients.name(foresight, &task(number));
            }
            clients.leave(foresight);
        }
        let asked = [0, 1, 2, 3, 4, 5].map(|number| clients.account(owner).has_asked(task(number).job(0)));
        assert_eq!(asked, [false, true, true, true, true, false]);
        assert_eq!(clients.name(owner, &task(2)), task(2).job(0), "it has not asked for it itself");
        assert_eq!(clients.accounts.len(), 1);
    }
}
