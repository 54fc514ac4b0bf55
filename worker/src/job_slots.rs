//! What a worker holds: jobs to do, the running one, and reports that wait for their acknowledgement.

use std::collections::VecDeque;

use proto::task::Report;
use proto::{Lease, MAX_MESSAGE_BYTES};

use crate::wire::{Job, Reply};

/// Reports that go with one poll, …
const MOST_REPORTS: usize = 64;
/// … and their bytes, unless one alone is larger. While there are more, because they are acknowledged late, no further
/// job is taken: what waits must not grow beyond what a message holds.
const MOST_REPORT_BYTES: usize = MAX_MESSAGE_BYTES / 2;

/// Jobs and reports of one worker, without IO.
#[derive(Debug)]
pub struct JobSlots {
    /// Jobs taken in advance, so that the next one can start while the last report is in transit.
    ahead: usize,
    queue: VecDeque<Job>,
    /// The running job; `Some(None)` once its lease was revoked: its result is of no use any more, but it keeps
    /// the threads busy until it ends.
    running: Option<Option<Lease>>,
    /// With their bytes, oldest first.
    finished: Vec<(Report, usize)>,
}

impl JobSlots {
    /// Takes up to `ahead` jobs beside the running one.
    pub fn new(ahead: usize) -> Self {
        Self { ahead, queue: VecDeque::new(), running: None, finished: Vec::new() }
    }

    /// Every lease held: running, queued, or with a report that has to wait for a later poll.
    pub fn held(&self) -> Vec<Lease> {
        let waiting = self.finished.iter().skip(self.handed_in()).map(|(report, _)| report.lease);
        self.unfinished().chain(waiting).collect()
    }

    /// The oldest reports that are not acknowledged yet, as many as go with one poll.
    pub fn finished(&self) -> Vec<Report> {
        self.finished.iter().take(self.handed_in()).map(|(report, _)| report.clone()).collect()
    }

    /// How many more jobs are wanted now; none while a revoked one runs, or while reports have to wait for a later poll.
    pub fn wanted(&self) -> usize {
        let is_full = self.running == Some(None) || self.handed_in() < self.finished.len();
        if is_full { 0 } else { (1 + self.ahead).saturating_sub(self.unfinished().count()) }
    }

    /// Whether nothing is left to do but to hand in reports that have to wait for a later poll.
    pub fn only_reports(&self) -> bool {
        self.unfinished().next().is_none() && self.handed_in() < self.finished.len()
    }

    /// Whether a job is running that somebody waits for.
    pub fn has_job(&self) -> bool {
        self.running.flatten().is_some()
    }

    /// Leases that are running or queued.
    fn unfinished(&self) -> impl Iterator<Item = Lease> {
        self.running.flatten().into_iter().chain(self.queue.iter().map(|job| job.lease))
    }

    /// How many reports go with one poll.
    fn handed_in(&self) -> usize {
        let mut room = MOST_REPORT_BYTES;
        let fits = |(_, bytes): &&(Report, usize)| {
            let left = room.checked_sub(*bytes);
            room = left.unwrap_or(0);
            left.is_some()
        };
        let fitting = self.finished.iter().take(MOST_REPORTS).take_while(fits).count();
        fitting.max(self.finished.len().min(1))
    }

    /// Takes in a reply: drops what is acknowledged or revoked, queues what is new and was asked for.
    pub fn absorb(&mut self, reply: Reply) {
        let Reply { acknowledged, revoked, jobs, run_ended: _ } = reply;
        self.finished.retain(|(report, _)| !acknowledged.contains(&report.lease));
        self.queue.retain(|job| !revoked.contains(&job.lease));
        if let Some(running) = &mut self.running {
            *running = running.filter(|lease| !revoked.contains(lease));
        }
        for job in jobs {
            if self.unfinished().count() > self.ahead {
                break; // more than was asked for: what is not held is handed out again
            }
            if !self.held().contains(&job.lease) {
                self.queue.push_back(job);
            }
        }
    }

    /// The next job to start, if none is running; it is running from now on.
    pub fn start(&mut self) -> Option<Job> {
        if self.running.is_some() {
            return None;
        }
        let next = self.queue.pop_front()?;
        self.running = Some(Some(next.lease));
        Some(next)
    }

    /// The running job is done; its report is kept, unless its lease was revoked.
    pub fn finish(&mut self, report: Report) {
        if let Some(Some(_)) = self.running.take() {
            let bytes = report.encoded_len();
            self.finished.push((report, bytes));
        }
    }

    /// Forgets every lease and report: another run knows none of them. The running job goes on until it ends, and its result is dropped.
    pub fn clear(&mut self) {
        self.queue.clear();
        self.finished.clear();
        self.running = self.running.map(|_| None);
    }
}

#[cfg(test)]
mod tests {
    use proto::task::{Described, Failure, FailureReason, InvalidMessage, TaskResult};
    use proto::{JobId, LeaseNonce};

    use super::*;

    fn lease(job: u64) -> Lease {
        Lease { job: JobId(job), attempt: 1, nonce: LeaseNonce::default() }
    }

    fn reply(jobs: &[u64]) -> Reply {
        let job = |job: &u64| Job { lease: lease(*job), task: Err(InvalidMessage::Missing("task")) };
        Reply { jobs: jobs.iter().map(job).collect(), ..Reply::default() }
    }

    fn report(job: u64) -> Report {
        let outcome = Err(Failure::new(FailureReason::Data, "disk full"));
        Report { lease: lease(job), run_seconds: 0.5, outcome }
    }

    #[test]
    fn one_job_is_running_and_one_waits() {
        let mut slots = JobSlots::new(1);
        assert_eq!(slots.wanted(), 2);
        slots.absorb(reply(&[1, 2]));
        assert_eq!(slots.wanted(), 0);
        assert_eq!(slots.start().unwrap().lease, lease(1));
        assert!(slots.start().is_none());
        assert_eq!(slots.held(), [lease(1), lease(2)]);
        slots.finish(report(1));
        assert_eq!(slots.wanted(), 1);
        assert_eq!(slots.start().unwrap().lease, lease(2));
    }

    #[test]
    fn a_report_is_kept_until_it_is_acknowledged() {
        let mut slots = JobSlots::new(0);
        slots.absorb(reply(&[1]));
        slots.start();
        slots.finish(report(1));
        slots.absorb(Reply::default());
        assert_eq!(slots.finished().len(), 1);
        slots.absorb(Reply { acknowledged: vec![lease(1)], ..Default::default() });
        assert!(slots.finished().is_empty());
    }

    /// Slots with so many reports of so many bytes each, of which none is acknowledged.
    fn unacknowledged(reports: u64, bytes: usize) -> JobSlots {
        let mut slots = JobSlots::new(1);
        for job in 1..=reports {
            slots.absorb(reply(&[job]));
            slots.start();
            let result = TaskResult::Description(Described::new(vec![0; bytes]));
            slots.finish(Report { outcome: Ok(result), ..report(job) });
        }
        slots
    }

    #[test]
    fn a_coordinator_that_acknowledges_late_is_given_no_more_than_it_can_read() {
        let mut slots = unacknowledged(300, 10);
        assert_eq!((slots.finished().len(), slots.wanted()), (MOST_REPORTS, 0));
        // What waits is held, or it would be handed out again.
        let waiting: Vec<Lease> = (MOST_REPORTS as u64 + 1..=300).map(lease).collect();
        assert_eq!(slots.held(), waiting);
        assert!(slots.only_reports());
        let acknowledged = (1..=250).map(lease).collect();
        slots.absorb(Reply { acknowledged, ..Default::default() });
        assert_eq!((slots.finished().len(), slots.wanted(), slots.held()), (50, 2, vec![]));
        assert!(!slots.only_reports());

        let large = unacknowledged(5, MOST_REPORT_BYTES / 3);
        assert_eq!((large.finished().len(), large.wanted()), (2, 0));
        let largest = unacknowledged(2, 2 * MOST_REPORT_BYTES);
        assert_eq!((largest.finished().len(), largest.wanted()), (1, 0));
    }

    #[test]
    fn revoked_and_repeated_jobs_are_not_queued() {
        let mut slots = JobSlots::new(3);
        slots.absorb(reply(&[1, 2]));
        slots.absorb(Reply { revoked: vec![lease(1)], ..reply(&[2, 3]) });
        assert_eq!(slots.held(), [lease(2), lease(3)]);
    }

    #[test]
    fn no_more_jobs_are_queued_than_were_asked_for() {
        let mut slots = JobSlots::new(1);
        slots.absorb(reply(&(0..100_000).collect::<Vec<_>>()));
        assert_eq!(slots.held(), [lease(0), lease(1)]);
        // One that takes the place of a job that was revoked was asked for.
        slots.start();
        slots.absorb(Reply { revoked: vec![lease(0)], ..reply(&[2]) });
        assert_eq!(slots.held(), [lease(1), lease(2)]);
    }

    #[test]
    fn a_revoked_job_that_runs_is_not_held_and_blocks_the_slot_until_it_ends() {
        let revoke = |slots: &mut JobSlots| {
            slots.absorb(Reply { revoked: vec![lease(1)], ..Default::default() });
        };
        for drop_it in [revoke, JobSlots::clear] {
            let mut slots = JobSlots::new(1);
            slots.absorb(reply(&[1]));
            slots.start();
            drop_it(&mut slots);
            assert!(slots.held().is_empty());
            assert_eq!(slots.wanted(), 0);
            // The same numbers again, from another coordinator, are another job.
            slots.absorb(reply(&[1]));
            assert!(slots.start().is_none());
            slots.finish(report(1));
            assert!(slots.finished().is_empty());
            assert_eq!(slots.start().unwrap().lease, lease(1));
        }
    }
}
