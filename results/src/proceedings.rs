//! What happened in a run beside its results: who worked, on what, how it ended, and what else is worth telling.

use std::time::SystemTime;

use polars::prelude::{DataFrame, Int64Chunked, IntoColumn as _, NewChunkedArray as _, TimeUnit};
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::frame::{Cell, assemble, cells, milliseconds};

/// The rows of the tables `workers`, `attempts` and `events`, in order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Proceedings {
    /// Those who registered.
    pub workers: Vec<WorkerRow>,
    /// Attempts that have ended.
    pub attempts: Vec<AttemptRow>,
    /// What else happened.
    pub events: Vec<EventRow>,
}

/// A worker, from when it joined to when it went.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorkerRow {
    /// Its unique name.
    pub worker: String,
    /// Its id, hexadecimal.
    pub id: String,
    /// Threads that evaluate.
    pub threads: u32,
    /// Which build it is.
    pub build: String,
    /// What it showed to be let in, if anything was asked for.
    pub credential: Option<String>,
    /// When it registered.
    pub joined_at: SystemTime,
    /// When it went; `None` if it was there to the end.
    pub gone_at: Option<SystemTime>,
    /// Why it went, one word.
    pub departure: Option<String>,
    /// Leases it held when it went.
    pub leases: Option<u32>,
    /// Valid answers it has given since its id was first seen; `None` if it was there to the end.
    pub answers: Option<u64>,
}

/// An attempt at a job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AttemptRow {
    /// Number of the job.
    pub job: u64,
    /// Which attempt at it, from 1.
    pub attempt: u32,
    /// Name of the worker.
    pub worker: String,
    /// What was asked.
    pub task: String,
    /// When the worker got it.
    pub handed_out_at: SystemTime,
    /// When it ended.
    pub ended_at: SystemTime,
    /// How it ended, one word.
    pub end: String,
    /// Why, where there is more to say.
    pub reason: Option<String>,
    /// Time on the worker, seconds, if it reported.
    pub run_seconds: Option<f64>,
}

/// Something worth telling.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EventRow {
    /// When.
    pub at: SystemTime,
    /// What, one word.
    pub event: String,
    /// Whom it is about.
    pub worker: Option<String>,
    /// The generation that it goes back to.
    pub generation: Option<u32>,
    /// For people.
    pub message: String,
}

fn times(name: &str, times: impl Iterator<Item = Option<SystemTime>>) -> Cell {
    let times: Vec<Option<i64>> = times.map(|at| at.map(milliseconds)).collect();
    Int64Chunked::from_slice_options(name.into(), &times)
        .into_datetime(TimeUnit::Milliseconds, None)
        .into_column()
}

pub(crate) fn workers(rows: &[WorkerRow]) -> Result<DataFrame, Error> {
    assemble(
        rows.len(),
        vec![
            cells("worker", rows.iter().map(|row| row.worker.as_str())),
            cells("id", rows.iter().map(|row| row.id.as_str())),
            cells("threads", rows.iter().map(|row| row.threads)),
            cells("build", rows.iter().map(|row| row.build.as_str())),
            cells("credential", rows.iter().map(|row| row.credential.as_deref())),
            times("joined_at", rows.iter().map(|row| Some(row.joined_at))),
            times("gone_at", rows.iter().map(|row| row.gone_at)),
            cells("departure", rows.iter().map(|row| row.departure.as_deref())),
            cells("leases", rows.iter().map(|row| row.leases)),
            cells("answers", rows.iter().map(|row| row.answers)),
        ],
    )
}

pub(crate) fn attempts(rows: &[AttemptRow]) -> Result<DataFrame, Error> {
    assemble(
        rows.len(),
        vec![
            cells("job", rows.iter().map(|row| row.job)),
            cells("attempt", rows.iter().map(|row| row.attempt)),
            cells("worker", rows.iter().map(|row| row.worker.as_str())),
            cells("task", rows.iter().map(|row| row.task.as_str())),
            times("handed_out_at", rows.iter().map(|row| Some(row.handed_out_at))),
            times("ended_at", rows.iter().map(|row| Some(row.ended_at))),
            cells("end", rows.iter().map(|row| row.end.as_str())),
            cells("reason", rows.iter().map(|row| row.reason.as_deref())),
            cells("run_seconds", rows.iter().map(|row| row.run_seconds)),
        ],
    )
}

pub(crate) fn events(rows: &[EventRow]) -> Result<DataFrame, Error> {
    assemble(
        rows.len(),
        vec![
            times("at", rows.iter().map(|row| Some(row.at))),
            cells("event", rows.iter().map(|row| row.event.as_str())),
            cells("worker", rows.iter().map(|row| row.worker.as_deref())),
            cells("generation", rows.iter().map(|row| row.generation)),
            cells("message", rows.iter().map(|row| row.message.as_str())),
        ],
    )
}
