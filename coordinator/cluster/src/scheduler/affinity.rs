//! Which job suits a worker best, by what it has described.

use std::time::{Duration, Instant};

use proto::task::Task;
use proto::{JobId, WorkerId};

use super::described::{Expected, JobChannels};
use super::worker::Worker;
use super::{ClientId, Scheduler};
use crate::cost::{CountedCost, counted_cost};
use crate::store::Job;

/// A worker gets one of so many jobs, from the first that it may take.
const CHOICE: usize = 64;
/// A job that has waited for so long is handed out first, whoever is better suited.
const LONGEST_WAIT: Duration = Duration::from_secs(60);

impl Scheduler {
    /// A client is about to ask for scales, to evaluate this next.
    pub fn expect(&mut self, client: ClientId, expected: Expected) {
        self.expected.insert(client, expected);
    }

    /// It has asked.
    pub fn expect_nothing(&mut self, client: ClientId) {
        self.expected.remove(&client);
    }

    /// What a client's task has to do with channels.
    pub(super) fn channels(&self, task: &Task, client: ClientId) -> JobChannels {
        JobChannels::new(task, self.limits.channels_of, self.expected.get(&client))
    }

    /// What a job costs a worker, which need not describe what it has described.
    pub(super) fn cost_to(&self, id: WorkerId, job: &Job) -> CountedCost {
        if job.channels.is_empty() || !self.workers.contains_key(&id) {
            return counted_cost(&job.task);
        }
        let describing = self.described.missing(id, &job.channels).min(job.task.describing_cost());
        let units = job.task.matching_cost().saturating_add(describing);
        CountedCost { kind: job.task.kind(), units }
    }

    /// Of jobs that a worker may take, in order, the first for which no other worker that may take it is better suited, as
    /// it has to describe less: else the one for which others are the least better suited. What nobody has described is not
    /// put off, as it would be what all others wait for in the end. The first of all is taken if it has waited too long.
    pub(super) fn best_match<'a>(
        &self,
        id: WorkerId,
        jobs: impl Iterator<Item = (JobId, &'a Job)>,
        now: Instant,
    ) -> Option<JobId> {
        let mut best: Option<(u64, JobId)> = None;
        for (job_id, job) in jobs.take(CHOICE) {
            let has_waited = now.saturating_duration_since(job.submitted) > LONGEST_WAIT;
            let is_urgent = best.is_none() && has_waited && !job.is_foreseen();
            let may_take = |other| {
                self.workers.get(&other).is_some_and(Worker::is_available) && self.may_take(other, job_id)
            };
            let beyond_least =
                if is_urgent { 0 } else { self.described.beyond_least(id, &job.channels, may_take) };
            if beyond_least == 0 {
                return Some(job_id);
            }
            if best.is_none_or(|(least, _)| beyond_least < least) {
                best = Some((beyond_least, job_id));
            }
        }
        best.map(|(_, job_id)| job_id)
    }
}
