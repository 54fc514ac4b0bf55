//! The worker's desk: jobs to do, the job in hand, and reports that wait for their acknowledgement.

use std::collections::VecDeque;

use proto::{Lease, v1};

/// What one worker holds, without IO.
#[derive(Debug)]
pub struct Desk {
    /// Jobs taken ahead, so that the next one can start while the last report is under way.
    ahead: usize,
    queue: VecDeque<(Lease, v1::Job)>,
    /// The job in hand; without its lease once that was revoked: nobody wants its result any more, but the threads
    /// are busy until it ends.
    running: Option<Option<Lease>>,
    finished: Vec<(Lease, v1::JobReport)>,
}

impl Desk {
    /// An empty desk that takes up to `ahead` jobs beside the one in hand.
    pub fn new(ahead: usize) -> Self {
        Self { ahead, queue: VecDeque::new(), running: None, finished: Vec::new() }
    }

    /// Every lease held: in hand or queued.
    pub fn held(&self) -> Vec<Lease> {
        self.running.flatten().into_iter().chain(self.queue.iter().map(|(lease, _)| *lease)).collect()
    }

    /// Reports not acknowledged yet.
    pub fn finished(&self) -> Vec<v1::JobReport> {
        self.finished.iter().map(|(_, report)| report.clone()).collect()
    }

    /// How many more jobs this desk takes now; none while it works on one that nobody wants.
    pub fn wanted(&self) -> usize {
        if self.running == Some(None) { 0 } else { (1 + self.ahead).saturating_sub(self.held().len()) }
    }

    /// Takes in a reply: drops what is acknowledged or revoked, queues what is new.
    pub fn absorb(&mut self, reply: v1::PollReply) {
        let acknowledged: Vec<Lease> = reply.acknowledged.into_iter().map(Lease::from).collect();
        self.finished.retain(|(lease, _)| !acknowledged.contains(lease));
        let revoked: Vec<Lease> = reply.revoked.into_iter().map(Lease::from).collect();
        self.queue.retain(|(lease, _)| !revoked.contains(lease));
        if let Some(running) = &mut self.running {
            *running = running.filter(|lease| !revoked.contains(lease));
        }
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
        self.running = Some(Some(next.0));
        Some(next)
    }

    /// The job in hand is done; its report is kept, unless its lease was revoked.
    pub fn finish(&mut self, report: v1::JobReport) {
        if let Some(Some(lease)) = self.running.take() {
            self.finished.push((lease, report));
        }
    }

    /// Forgets every lease and report: another coordinator knows none of them, and numbers its jobs from 1 again. The
    /// job in hand goes on until it ends, for nobody.
    pub fn clear(&mut self) {
        self.queue.clear();
        self.finished.clear();
        self.running = self.running.map(|_| None);
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
        let job = |job: &u64| v1::Job { lease: Some(lease(*job).into()), evaluation: None, grid_cell: None };
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
        desk.finish(v1::JobReport::default());
        assert_eq!(desk.wanted(), 1);
        assert_eq!(desk.start().unwrap().0, lease(2));
    }

    #[test]
    fn a_report_is_kept_until_it_is_acknowledged() {
        let mut desk = Desk::new(0);
        desk.absorb(reply(&[1]));
        desk.start();
        desk.finish(v1::JobReport::default());
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
    fn a_job_in_hand_that_nobody_wants_is_not_held_and_blocks_the_desk_until_it_ends() {
        let revoke = |desk: &mut Desk| {
            desk.absorb(v1::PollReply { revoked: vec![lease(1).into()], ..Default::default() });
        };
        for drop_it in [revoke, Desk::clear] {
            let mut desk = Desk::new(1);
            desk.absorb(reply(&[1]));
            desk.start();
            drop_it(&mut desk);
            assert!(desk.held().is_empty());
            assert_eq!(desk.wanted(), 0);
            // The same numbers again, from another coordinator, are another job.
            desk.absorb(reply(&[1]));
            assert!(desk.start().is_none());
            desk.finish(v1::JobReport::default());
            assert!(desk.finished().is_empty());
            assert_eq!(desk.start().unwrap().0, lease(1));
        }
    }
}
