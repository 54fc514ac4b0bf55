//! The worker's desk: jobs to do, the job in hand, and reports that wait for their acknowledgement.

use std::collections::VecDeque;

use proto::{Lease, v1};

/// What one worker holds, without IO.
#[derive(Debug)]
pub struct Desk {
    /// Jobs taken ahead, so that the next one can start while the last report is under way.
    ahead: usize,
    queue: VecDeque<(Lease, v1::Job)>,
    running: Option<Lease>,
    finished: Vec<(Lease, v1::JobReport)>,
}

impl Desk {
    /// An empty desk that takes up to `ahead` jobs beside the one in hand.
    pub fn new(ahead: usize) -> Self {
        Self { ahead, queue: VecDeque::new(), running: None, finished: Vec::new() }
    }

    /// Every lease held: in hand or queued.
    pub fn held(&self) -> Vec<Lease> {
        self.running.into_iter().chain(self.queue.iter().map(|(lease, _)| *lease)).collect()
    }

    /// Reports not acknowledged yet.
    pub fn finished(&self) -> Vec<v1::JobReport> {
        self.finished.iter().map(|(_, report)| report.clone()).collect()
    }

    /// How many more jobs this desk takes now.
    pub fn wanted(&self) -> usize {
        (1 + self.ahead).saturating_sub(self.held().len())
    }

    /// Takes in a reply: drops what is acknowledged or revoked, queues what is new.
    pub fn absorb(&mut self, reply: v1::PollReply) {
        let acknowledged: Vec<Lease> = reply.acknowledged.into_iter().map(Lease::from).collect();
        self.finished.retain(|(lease, _)| !acknowledged.contains(lease));
        let revoked: Vec<Lease> = reply.revoked.into_iter().map(Lease::from).collect();
        self.queue.retain(|(lease, _)| !revoked.contains(lease));
        for job in reply.jobs {
            // A job without a lease cannot be reported: it is as good as not sent.
            let Some(lease) = job.lease.map(Lease::from) else { continue };
            if !self.held().contains(&lease) {
                self.queue.push_back((lease, job));
            }
        }
    }

    /// The next job to start, if none is in hand; it is in hand from now on.
    pub fn start(&mut self) -> Option<(Lease, v1::Job)> {
        if self.running.is_some() {
            return None;
        }
        let next = self.queue.pop_front()?;
        self.running = Some(next.0);
        Some(next)
    }

    /// The job in hand is done.
    pub fn finish(&mut self, lease: Lease, report: v1::JobReport) {
        if self.running == Some(lease) {
            self.running = None;
            self.finished.push((lease, report));
        }
    }

    /// Forgets everything but the job in hand, whose report will be dropped: another coordinator knows none of it.
    pub fn clear(&mut self) {
        self.queue.clear();
        self.finished.clear();
        self.running = None;
    }
}

#[cfg(test)]
mod tests {
    use proto::JobId;

    use super::*;

    fn lease(job: u64) -> Lease {
        Lease { job: JobId(job), attempt: 1 }
    }

    fn reply(jobs: &[u64]) -> v1::PollReply {
        let job = |job: &u64| v1::Job { lease: Some(lease(*job).into()), evaluation: None };
        v1::PollReply { jobs: jobs.iter().map(job).collect(), ..Default::default() }
    }

    #[test]
    fn one_job_is_in_hand_and_one_waits() {
        let mut desk = Desk::new(1);
        assert_eq!(desk.wanted(), 2);
        desk.absorb(reply(&[1, 2]));
        assert_eq!(desk.wanted(), 0);
        assert_eq!(desk.start().unwrap().0, lease(1));
        assert!(desk.start().is_none());
        assert_eq!(desk.held(), [lease(1), lease(2)]);
        desk.finish(lease(1), v1::JobReport::default());
        assert_eq!(desk.wanted(), 1);
        assert_eq!(desk.start().unwrap().0, lease(2));
    }

    #[test]
    fn a_report_is_kept_until_it_is_acknowledged() {
        let mut desk = Desk::new(0);
        desk.absorb(reply(&[1]));
        desk.start();
        desk.finish(lease(1), v1::JobReport::default());
        desk.absorb(v1::PollReply::default());
        assert_eq!(desk.finished().len(), 1);
        desk.absorb(v1::PollReply { acknowledged: vec![lease(1).into()], ..Default::default() });
        assert!(desk.finished().is_empty());
    }

    #[test]
    fn revoked_and_repeated_jobs_are_not_queued() {
        let mut desk = Desk::new(3);
        desk.absorb(reply(&[1, 2]));
        desk.absorb(v1::PollReply { revoked: vec![lease(1).into()], ..reply(&[2, 3]) });
        assert_eq!(desk.held(), [lease(2), lease(3)]);
    }

    #[test]
    fn the_report_of_a_cleared_job_is_dropped() {
        let mut desk = Desk::new(1);
        desk.absorb(reply(&[1]));
        desk.start();
        desk.clear();
        desk.finish(lease(1), v1::JobReport::default());
        assert!(desk.finished().is_empty() && desk.held().is_empty());
    }
}
