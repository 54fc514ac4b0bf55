//! What a journal's records come to, and what a start finds.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::sync::Arc;
use std::time::Duration;

use proto::journal::Member;
use proto::{JobId, Principal, WorkerId};

use super::records::{Record, Tally, encode};
use super::results::RecordedResults;
use super::{Entry, Recorded};
use crate::events::Event;
use crate::sharding::plan::ShardPlan;

/// What all records together say.
#[derive(Debug, Default)]
pub struct Contents {
    /// The highest counts.
    pub tally: Tally,
    /// Results that hold.
    pub accepted: RecordedResults,
    /// Principals that were wrong.
    pub quarantined: BTreeSet<Principal>,
    members: BTreeMap<WorkerId, Member>,
    plans: BTreeMap<JobId, ShardPlan>,
    leases: BTreeMap<(JobId, u32), WorkerId>,
    events: BTreeMap<u64, Arc<Event>>,
}

impl Contents {
    /// Nothing yet, of a file whose results will be these.
    pub fn new(accepted: RecordedResults) -> Self {
        Self { accepted, ..Self::default() }
    }

    /// Takes a record that follows on those before, with its place in the file and the length of its payload.
    pub fn take(&mut self, record: Record, at: (u64, usize)) {
        match record {
            Record::Padding => {}
            Record::Tally(later) => self.count(later),
            Record::Entry(entry) => self.enter(entry, at),
        }
    }

    /// Takes an entry that is not in the file yet.
    pub fn append(&mut self, entry: &Entry) {
        let at = match entry {
            Entry::Accepted(..) => {
                let Some(payload) = encode(entry) else { return };
                self.accepted.append(&payload)
            }
            _ => (0, 0), // nobody reads it again
        };
        self.enter(entry.clone(), at);
    }

    /// Takes counts. They only grow; where the last are lost, those before hold.
    pub fn count(&mut self, later: Tally) {
        self.tally.starts = self.tally.starts.max(later.starts);
        self.tally.milliseconds = self.tally.milliseconds.max(later.milliseconds);
        self.tally.repairs = self.tally.repairs.max(later.repairs);
    }

    fn enter(&mut self, entry: Entry, at: (u64, usize)) {
        match entry {
            Entry::Accepted(job, answer) => {
                self.accepted.insert(job, &answer, at);
                self.leases.extract_if((job, 0)..=(job, u32::MAX), |_, _| true).for_each(drop);
            }
            Entry::Joined(id, member) => drop(self.members.insert(id, member)),
            Entry::Left(id) => drop(self.members.remove(&id)),
            Entry::Leased(job, attempt, id) => drop(self.leases.insert((job, attempt), id)),
            Entry::Assured(job, assurance, seconded) => self.accepted.assure(job, assurance, seconded),
            Entry::Readmitted(principal) => drop(self.quarantined.remove(&principal)),
            Entry::Retracted(job) => drop(self.accepted.remove(job)),
            Entry::Quarantined(principal) => {
                // Each of them is retracted, too, but the run may end before all of that is written.
                self.accepted.remove_resting_on(principal);
                self.quarantined.insert(principal);
            }
            Entry::Event(event) => drop(self.events.insert(event.sequence, event)),
            Entry::Sharded(job, plan) => drop(self.plans.insert(job, plan)),
        }
    }

    /// Shows entries to `see` that say all of it but who was quarantined.
    ///
    /// # Errors
    /// Those of `see`, and if a result cannot be read any more.
    pub fn for_each_entry(&self, mut see: impl FnMut(Entry) -> io::Result<()>) -> io::Result<()> {
        let members = self.members.iter().map(|(&id, member)| Entry::Joined(id, member.clone()));
        let plans = self.plans.iter().map(|(&job, &plan)| Entry::Sharded(job, plan));
        members.chain(plans).try_for_each(&mut see)?;
        self.accepted.for_each(|job, accepted| see(Entry::Accepted(job, Box::new(accepted))))?;
        let leases = self.leases.iter().map(|(&(job, attempt), &id)| Entry::Leased(job, attempt, id));
        let events = self.events.values().map(|event| Entry::Event(Arc::clone(event)));
        leases.chain(events).try_for_each(see)
    }

    /// What a start finds.
    pub fn recorded(self) -> Recorded {
        let lease = |((job, attempt), id)| (job, attempt, id);
        Recorded {
            starts: self.tally.starts,
            at_work: Duration::from_millis(self.tally.milliseconds),
            accepted: self.accepted,
            members: self.members,
            plans: self.plans,
            leases: self.leases.into_iter().map(lease).collect(),
            quarantined: self.quarantined,
            events: self.events.into_values().map(Arc::unwrap_or_clone).collect(),
            repairs: self.tally.repairs,
        }
    }
}
