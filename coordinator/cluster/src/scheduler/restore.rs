//! Restores what earlier starts of a run have left: workers that may still be there, and the jobs that they hold.

use std::collections::BTreeSet;
use std::time::Instant;

use proto::journal::{Assurance, Member};
use proto::{JobId, WorkerId};

use super::Scheduler;
use super::worker::WorkerIdentity;
use crate::events::EventKind;
use crate::journal::{Attribution, Recorded};
use crate::store::Job;

impl Scheduler {
    /// Takes over workers that may still be there, and the labels under which results
    /// are recorded. Those that were quarantined stay so.
    pub fn restore(&mut self, recorded: &Recorded, now: Instant) {
        let answered: BTreeSet<WorkerId> =
            recorded.accepted.attributions().map(|(attribution, _)| attribution.worker_id).collect();
        self.quarantined.extend(&recorded.quarantined);
        // Who may have gone on with what a liar has given is not recorded: after one, everybody is a newcomer.
        if recorded.quarantined.is_empty() {
            self.restore_trust(recorded);
        }
        for (&id, Member { label, introduction }) in &recorded.members {
            let worker = label.clone();
            self.add_worker(id, introduction, now);
            let answers = u64::from(answered.contains(&id));
            self.identities.insert(id, WorkerIdentity { label: worker.clone(), answers, busy_seconds: 0.0 });
            self.used_labels.insert(worker.clone());
            self.emit(
                now,
                EventKind::Joined { worker: id, label: worker, introduction: introduction.clone() },
            );
        }
        self.used_labels.extend(recorded.labels());
        self.restarted = true;
    }

    fn restore_trust(&mut self, recorded: &Recorded) {
        for (Attribution { grounds, .. }, results) in recorded.accepted.attributions() {
            for _ in 0..results {
                if matches!(grounds.assurance, Assurance::Owed | Assurance::Audited) {
                    self.trust.count(grounds.principal);
                }
                if grounds.assurance == Assurance::Audited {
                    let agreed = [Some(grounds.principal), grounds.seconded];
                    agreed.into_iter().flatten().for_each(|one| self.trust.agree(one));
                }
            }
        }
    }

    /// Notes the attempts that earlier starts have made at a job; returns the last one whose holder may be there.
    pub(super) fn restore_attempts(
        &mut self,
        id: JobId,
        job: &mut Job,
        now: Instant,
    ) -> Option<(WorkerId, u32)> {
        if !self.restarted {
            return None;
        }
        let leases = self.jobs.take_earlier_leases(id);
        job.restore_attempts(&leases, now);
        leases.into_iter().rev().find(|(holder, _)| self.workers.contains_key(holder))
    }
}
