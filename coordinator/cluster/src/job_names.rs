//! The names of the jobs that one client has asked for.

use std::collections::BTreeSet;

use proto::JobId;
use proto::task::Task;

/// The names of all jobs that one client has asked for.
#[derive(Debug, Default)]
pub struct JobNames(BTreeSet<JobId>);

impl JobNames {
    /// Names the next job that asks for this task: equal for all who ask for the same as often, and in every start of
    /// a run.
    pub fn next(&mut self, task: &Task) -> JobId {
        let mut occurrence = 0;
        loop {
            let job = task.job(occurrence);
            if self.0.insert(job) {
                return job;
            }
            occurrence += 1;
        }
    }

    /// Those that are not among others; `None` if there are none.
    pub fn without(mut self, others: &Self) -> Option<Self> {
        self.0.retain(|job| !others.contains(*job));
        (!self.0.is_empty()).then_some(self)
    }

    /// Whether this job was asked for.
    pub fn contains(&self, job: JobId) -> bool {
        self.0.contains(&job)
    }
}
