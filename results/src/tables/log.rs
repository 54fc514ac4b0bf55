//! Rows of a run's log: workers, attempts, events, and releases of test clouds.

use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use crate::record::record;

/// What happened in a run beside its results: the rows of `workers`, `attempts` and `events`, in order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunLog {
    /// Workers that registered.
    pub workers: Vec<WorkerRow>,
    /// Attempts that have ended.
    pub attempts: Vec<AttemptRow>,
    /// Everything else.
    pub events: Vec<EventRow>,
}

record! {
    /// A worker, from when it joined to when it went.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct WorkerRow {
        worker: String, "", "unique name of the worker";
        id: String, "", "id that it made when it started, hexadecimal";
        threads: u32, "", "threads that evaluate";
        build: String, "", "build of the worker";
        credential: Option<String>, "",
            "token, or certificate and fingerprint; null where nothing is asked for";
        principal: Option<String>, "",
            "who answers for it: certificate and fingerprint, token and address, address, or coordinator for its own process";
        joined_at: SystemTime, "UTC", "when it registered";
        gone_at: Option<SystemTime>, "UTC", "when it went; null if it was there to the end";
        departure: Option<String>, "",
            "left, lost, quarantined, denied, displaced (too many workers) or ended (with the coordinator's process); null as that";
        leases: Option<u32>, "", "jobs it had in hand when it went; null as that";
        answers: Option<u64>, "", "valid answers it had given when it went; null as that";
    }
}

record! {
    /// An attempt at a job.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct AttemptRow {
        job: u64, "", "number of the job";
        attempt: u32, "", "attempt at it, from 1";
        worker: String, "", "name of the worker";
        task: String, "", "what was asked";
        handed_out_at: SystemTime, "UTC", "when the worker got it";
        ended_at: SystemTime, "UTC", "when it ended";
        end: String, "",
            "answered (first), agreed or disagreed (with an earlier answer), late (after it was given up), failed, \
             overdue, undelivered, revoked, left, lost, quarantined, denied, displaced or dropped (the run ended)";
        reason: Option<String>, "", "what more there is to say of the end";
        run_seconds: Option<f64>, "s", "time on the worker, if it reported";
    }
}

record! {
    /// Something that happened beside registrations and attempts.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct EventRow {
        at: SystemTime, "UTC", "when";
        event: String, "",
            "lost, quarantined, denied, disagreement, undecided, rewind, unaudited, starving, omitted (rows that had no room), \
             or what an operator ordered: paused, resumed, stopped, priority, drained, denied";
        worker: Option<String>, "", "whom it is about";
        generation: Option<u32>, "", "generation that the run went back to";
        message: String, "", "what happened, for people";
    }
}

record! {
    /// A release of test clouds to workers, or another use of them.
    #[derive(Clone, Debug, PartialEq)]
    pub struct LookRow {
        at: SystemTime, "UTC", "when test clouds were released to workers, shown to people, or measured on";
        command: String, "", "by which command: run, compare (with --perturb and its kinds), dashboard, report, assess or evaluate";
        reason: String, "", "what for";
        descriptors: String, "", "which descriptors were measured, separated by spaces";
        => chain: Option<String>, "", "BLAKE3 that chains all looks before this one; null in those of earlier builds"
            = |_, _| None; // from the other files
    }
}
