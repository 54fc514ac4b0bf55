//! What earlier starts of a run have left: workers that may still be there, and the jobs that they hold.

use std::collections::BTreeMap;
use std::time::Instant;

use proto::{JobId, WorkerId};

use super::Scheduler;
use super::event::What;
use super::job::Job;
use super::worker::{Acquaintance, Worker};
use crate::journal::{Member, Recorded};

impl Scheduler {
    /// Takes over workers that may still be there, their leases in order of attempts, and the labels under which results
    /// are recorded. Those that were quarantined stay so.
    pub fn restore(&mut self, recorded: &Recorded, now: Instant) {
        let Recorded { members, leases, .. } = recorded;
        let labels = recorded.labels();
        self.quarantined.extend(&recorded.quarantined);
        for (&id, Member { label, introduction }) in members {
            let (worker, introduction) = (label.clone(), introduction.clone());
            self.workers.insert(id, Worker::new(now));
            self.idle += 1;
            let answers = u64::from(labels.contains(label));
            self.known.insert(id, Acquaintance { label: worker.clone(), answers });
            self.used_labels.insert(worker.clone());
            self.events.add(now, What::Joined { worker, id, introduction });
        }
        self.used_labels.extend(labels);
        let mut earlier = BTreeMap::<_, Vec<_>>::new();
        for (lease, holder) in leases {
            earlier.entry(lease.job).or_default().push((*holder, lease.attempt));
        }
        self.earlier = Some(earlier);
    }

    /// Notes the attempts that earlier starts have made at a job; returns the last one whose holder may be there.
    pub(super) fn restore_attempts(
        &mut self,
        id: JobId,
        job: &mut Job,
        now: Instant,
    ) -> Option<(WorkerId, u32)> {
        let leases = self.earlier.as_mut()?.remove(&id).unwrap_or_default();
        job.restore_attempts(&leases, now);
        leases.into_iter().rev().find(|(holder, _)| self.workers.contains_key(holder))
    }
}
