//! The workers as they are now, for people who watch a run.

use std::time::{Duration, Instant, SystemTime};

use proto::{JobId, WorkerId};

use super::Scheduler;
use super::worker::Worker;

/// One worker that is here.
#[derive(Clone, Debug, PartialEq)]
pub struct WorkerStatus {
    /// Its id.
    pub id: WorkerId,
    /// Its unique label.
    pub label: String,
    /// Threads that evaluate.
    pub threads: u32,
    /// Its build string.
    pub build: String,
    /// Who answers for it, as text.
    pub principal: String,
    /// Since when it has been here, as far as this start of the coordinator knows.
    pub joined: SystemTime,
    /// Valid results of jobs that were open.
    pub answers: u64,
    /// What computing them took on its clock, since this start of the coordinator.
    pub busy_seconds: f64,
    /// Whether an operator has said that it gets no more jobs.
    pub draining: bool,
    /// Whether it fails so often that it gets no jobs for a while.
    pub excluded: bool,
    /// What it has in hand: the first is what it works on.
    pub leases: Vec<LeaseStatus>,
}

/// A job that a worker has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeaseStatus {
    /// The job.
    pub job: JobId,
    /// Which attempt at it, from 1.
    pub attempt: u32,
    /// Label of the task.
    pub task: String,
    /// Since it was handed out.
    pub age: Duration,
}

impl Scheduler {
    /// Every worker that is here, by id; `time` is the time of day at a moment.
    pub fn fleet(&self, now: Instant, time: impl Fn(Instant) -> SystemTime) -> Vec<WorkerStatus> {
        let status = |(&id, worker): (&WorkerId, &Worker)| {
            let known = self.identities.get(&id);
            let lease = |&(job_id, attempt): &(JobId, u32)| {
                let job = self.jobs.get(job_id)?;
                let age = now.saturating_duration_since(job.handed_out_at(id, attempt));
                Some(LeaseStatus { job: job_id, attempt, task: job.task.to_string(), age })
            };
            WorkerStatus {
                id,
                label: self.label(id),
                threads: worker.threads,
                build: worker.build.clone(),
                principal: worker.principal.to_string(),
                joined: time(worker.joined),
                answers: known.map_or(0, |known| known.answers),
                busy_seconds: known.map_or(0.0, |known| known.busy_seconds),
                draining: worker.draining,
                excluded: worker.health.is_excluded(),
                leases: worker.leases().iter().filter_map(lease).collect(),
            }
        };
        self.workers.iter().map(status).collect()
    }
}
