//! What there is to measure of a scheduler: its jobs and workers as they are now, and what it has counted.

use std::collections::BTreeMap;

use proto::task::TaskKind;

use super::Scheduler;
use super::worker::Worker;
use crate::counters::Counters;
use crate::store::Job;

/// What an open job waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum JobState {
    /// A worker that takes it.
    Queued,
    /// A worker that has it.
    Leased,
    /// An operator: everybody who asks for it is paused.
    Paused,
    /// A worker of another principal: none of those that are here may take it.
    Blocked,
}

impl JobState {
    /// Every state.
    pub const ALL: [Self; 4] = [Self::Queued, Self::Leased, Self::Paused, Self::Blocked];

    /// One word for it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Leased => "leased",
            Self::Paused => "paused",
            Self::Blocked => "blocked",
        }
    }
}

/// What a worker does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum WorkerState {
    /// It has no job and may have one.
    Idle,
    /// It has a job.
    Busy,
    /// It gets no jobs for a while, because it has failed too often.
    Excluded,
    /// It gets no more jobs, because an operator has said so.
    Draining,
}

impl WorkerState {
    /// Every state.
    pub const ALL: [Self; 4] = [Self::Idle, Self::Busy, Self::Excluded, Self::Draining];

    /// One word for it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Busy => "busy",
            Self::Excluded => "excluded",
            Self::Draining => "draining",
        }
    }

    fn of(worker: &Worker) -> Self {
        match worker {
            _ if worker.draining => Self::Draining,
            _ if worker.health.is_excluded() => Self::Excluded,
            _ if worker.is_idle() => Self::Idle,
            _ => Self::Busy,
        }
    }
}

/// A scheduler at one moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SchedulerMetrics {
    /// Open jobs.
    pub jobs: BTreeMap<(TaskKind, JobState), u64>,
    /// Workers that are here, and their threads.
    pub workers: BTreeMap<WorkerState, (u64, u64)>,
    /// Principals that may not work any more.
    pub quarantined: u64,
    /// Results that jobs need and that somebody may compute now: one worker each, as a worker gives all of its threads to
    /// one job at a time. Neither jobs that are paused or blocked count, nor a job again that a second worker has taken
    /// because the first is slow.
    pub wanted_workers: u64,
    /// The same in threads, at the mean of the workers that are here, rounded up; one thread each while none is here.
    pub wanted_threads: u64,
    /// What has happened.
    pub counters: Counters,
}

impl Scheduler {
    /// Measures it. Looks at all open jobs and all workers.
    pub fn metrics(&self) -> SchedulerMetrics {
        let mut jobs = BTreeMap::<_, u64>::new();
        let mut wanted_workers = 0;
        for (_, job) in self.jobs.iter() {
            let state = self.state_of(job);
            *jobs.entry((job.task.kind(), state)).or_default() += 1;
            let wanted = match state {
                JobState::Queued if job.is_given_up() => 0,
                JobState::Queued => self.wanted_now(job),
                // What is in hand ends, also of those who are paused; nothing beside it is handed out.
                JobState::Leased if self.is_held(job) => self.wanted_now(job).min(job.leases.len()),
                JobState::Leased => self.wanted_now(job),
                JobState::Paused | JobState::Blocked => 0,
            };
            wanted_workers += wanted as u64;
        }
        let mut workers = BTreeMap::<_, (u64, u64)>::new();
        for worker in self.workers.values() {
            let (count, threads) = workers.entry(WorkerState::of(worker)).or_default();
            *count += 1;
            *threads += u64::from(worker.threads);
        }
        let threads: u64 = workers.values().map(|(_, threads)| threads).sum();
        let here = self.workers.len() as u64;
        let wanted_threads = match here {
            0 => wanted_workers,
            here => (wanted_workers * threads).div_ceil(here),
        };
        let quarantined = self.quarantined.len() as u64;
        let counters = self.counters.clone();
        SchedulerMetrics { jobs, workers, quarantined, wanted_workers, wanted_threads, counters }
    }

    fn state_of(&self, job: &Job) -> JobState {
        match job {
            _ if !job.leases.is_empty() => JobState::Leased,
            _ if self.is_held(job) => JobState::Paused,
            _ if self.wanted_now(job) > 0 => JobState::Queued,
            _ => JobState::Blocked,
        }
    }

    /// How many results a job needs that somebody can give who is here; while nobody is, one that whoever comes may give.
    fn wanted_now(&self, job: &Job) -> usize {
        if self.present.is_empty() && !job.awaits_own() { job.needs().min(1) } else { self.wanted(job) }
    }
}
