//! Which worker has described the clouds in which channels: it keeps their signatures, and others would have to make them
//! again.

use std::collections::{BTreeSet, VecDeque};
use std::time::{Duration, Instant};

use proto::WorkerId;
use proto::task::{Subject, Task};

use super::Scheduler;
use crate::store::Job;

/// Names the channels of a subject that workers keep signatures by, by numbers that are equal for equal channels.
pub type ChannelsOf = fn(&Subject) -> Vec<u64>;

/// Of so many jobs, from the first that it may take, a worker gets the one with fewest channels left for it to describe.
const CHOICE: usize = 64;
/// A job that has waited for so long is handed out before those that a worker has more of.
const LONGEST_WAIT: Duration = Duration::from_secs(60);
/// Channels that are remembered of a worker: about as many as it keeps in memory.
const MOST_CHANNELS: usize = 512;

/// The channels in which a worker was last given clouds to describe.
#[derive(Debug, Default)]
pub(super) struct Described {
    channels: BTreeSet<u64>,
    in_order: VecDeque<u64>,
}

impl Described {
    pub(super) fn add(&mut self, channels: &[u64]) {
        for &channel in channels {
            if self.channels.insert(channel) {
                self.in_order.push_back(channel);
            }
        }
        while self.in_order.len() > MOST_CHANNELS {
            if let Some(oldest) = self.in_order.pop_front() {
                self.channels.remove(&oldest);
            }
        }
    }

    /// How many of these channels it has.
    fn count(&self, channels: &[u64]) -> usize {
        channels.iter().filter(|channel| self.channels.contains(channel)).count()
    }
}

impl Scheduler {
    /// The channels in which whoever takes this task will have described whole splits; of other tasks none.
    pub(super) fn channels(&self, task: &Task) -> Vec<u64> {
        match task {
            Task::Evaluation(_) | Task::Scale(_) => (self.limits.channels_of)(task.subject()),
            Task::Description(_) | Task::Tile(_) | Task::GridCell(_) => Vec::new(),
        }
    }

    /// Of jobs that a worker may take, in order, the one for which it has fewest channels left to describe, the first of
    /// them; the first of all if that has waited too long.
    pub(super) fn best_match<'a, Id: Copy>(
        &self,
        id: WorkerId,
        jobs: impl Iterator<Item = (Id, &'a Job)>,
        now: Instant,
    ) -> Option<Id> {
        let described = &self.workers.get(&id)?.described;
        let mut best: Option<(usize, Id)> = None;
        for (job_id, job) in jobs.take(CHOICE) {
            let missing = job.channels.len() - described.count(&job.channels);
            let is_urgent = best.is_none() && now.saturating_duration_since(job.submitted) > LONGEST_WAIT;
            if missing == 0 || is_urgent {
                return Some(job_id);
            }
            if best.is_none_or(|(least, _)| missing < least) {
                best = Some((missing, job_id));
            }
        }
        best.map(|(_, job_id)| job_id)
    }
}
