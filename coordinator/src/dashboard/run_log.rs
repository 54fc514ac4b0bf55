//! Workers, attempts and events of a run: from its journal while it is unfinished, from its tables afterwards.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::time::{Instant, SystemTime};

use cluster::events::{ControlAction, Controlled, Event, EventKind};
use cluster::journal::{JOURNAL_FILE, JournalFollower};
use proto::JobId;
use results::{AttemptRow, EventRow, RunLog, WorkerRow};
use serde::Serialize;
use serde_json::json;

use super::folders::Found;
use crate::observers::tables::Tables;

/// A message to a viewer: its name, and its body as JSON.
pub type Message = (&'static str, String);

/// Attempts and events of one message beyond which the older ones are left out.
const MOST: usize = 20_000;

/// Reads the log of one run.
pub struct RunLogReader {
    folder: PathBuf,
    /// Its name in its sweep, if it is a member of one.
    member: Option<String>,
    source: Source,
    rows: Tables,
    /// What `rows` has, in the order in which it came.
    order: Vec<Entry>,
    /// By worker: seconds of reported jobs, and valid answers.
    busy: BTreeMap<String, (f64, u64)>,
    /// What operators have ordered of the coordinator at work.
    orders: Orders,
    /// When a lease was first seen here.
    leased: BTreeMap<(JobId, u32), Instant>,
    fleet: (String, u64),
}

enum Source {
    /// Nothing was read yet, or nothing is there.
    Nothing,
    /// A run that is not finished, or the sweep that it is a member of.
    Journal(Box<JournalFollower>),
    /// A finished run.
    Tables,
}

/// Orders that a coordinator obeys until it is told otherwise, or started again.
#[derive(Default)]
struct Orders {
    is_paused: bool,
    /// Labels of workers that get no more jobs.
    drained: BTreeSet<String>,
}

#[derive(Clone, Copy)]
enum Entry {
    Attempt(usize),
    Event(usize),
}

/// What a viewer has.
pub struct LogCursor {
    /// Entries.
    pub log: u64,
    /// Which state of the workers.
    pub fleet: u64,
}

/// What a read has found.
#[derive(Debug, Default)]
pub struct Read {
    /// What was there before is void.
    pub is_anew: bool,
    /// Why nothing can be said of some of it.
    pub problem: Option<String>,
}

#[derive(Serialize)]
struct EventJson<'a> {
    sequence: u64,
    at_ms: u64,
    event: &'a str,
    level: &'a str,
    worker: Option<&'a str>,
    generation: Option<u32>,
    message: &'a str,
}

impl RunLogReader {
    /// Of the run that was found in a folder.
    pub fn new(found: &Found) -> Self {
        let name = found.folder.file_name().map(|name| name.to_string_lossy().into_owned());
        Self {
            folder: found.folder.clone(),
            member: found.sweep.as_ref().and(name),
            source: Source::Nothing,
            rows: Tables::default(),
            order: Vec::new(),
            busy: BTreeMap::new(),
            orders: Orders::default(),
            leased: BTreeMap::new(),
            fleet: (String::new(), 0),
        }
    }

    /// Reads what is new.
    pub fn read(&mut self) -> Read {
        let mut read = Read::default();
        let is_finished = results::read_run(&self.folder).is_ok();
        match (&self.source, is_finished) {
            (Source::Tables, true) => {}
            (_, true) => {
                read.is_anew = !matches!(self.source, Source::Nothing);
                self.clear();
                read.problem = self.read_tables().err().map(|error| error.to_string());
                self.source = Source::Tables;
            }
            (source, false) => {
                if !matches!(source, Source::Journal(_)) {
                    read.is_anew = !matches!(self.source, Source::Nothing);
                    self.clear();
                    self.source = Source::Journal(Box::new(JournalFollower::new(&self.journal())));
                }
                self.follow(&mut read);
            }
        }
        let fleet = self.fleet_json();
        if fleet != self.fleet.0 {
            self.fleet = (fleet, self.fleet.1 + 1);
        }
        read
    }

    /// The journal of the run, or of the sweep that it is a member of.
    fn journal(&self) -> PathBuf {
        let own = self.folder.join(JOURNAL_FILE);
        match self.folder.parent().map(|sweep| sweep.join(JOURNAL_FILE)) {
            Some(sweep) if !own.exists() && sweep.exists() => sweep,
            _ => own,
        }
    }

    fn follow(&mut self, read: &mut Read) {
        let Source::Journal(follower) = &mut self.source else { return };
        match follower.read() {
            Ok(Some(followed)) => {
                if followed.is_anew && !self.order.is_empty() {
                    read.is_anew = true;
                    (self.rows, self.order, self.busy) = Default::default();
                    self.orders = Orders::default();
                }
                let now = Instant::now();
                let first_seen =
                    |lease: &(JobId, u32)| (*lease, self.leased.get(lease).copied().unwrap_or(now));
                self.leased = follower.leases().keys().map(first_seen).collect();
                let member = self.member.clone();
                for (place, event) in followed.events.iter().enumerate() {
                    if followed.starts.contains(&place) {
                        self.orders = Orders::default();
                    }
                    self.orders.take(event, member.as_deref());
                    let rows = self.rows.rows();
                    let before = (rows.attempts.len(), rows.events.len());
                    self.rows.add(event);
                    self.note_new(before);
                }
                if followed.starts.contains(&followed.events.len()) {
                    self.orders = Orders::default();
                }
            }
            Ok(None) => {}
            Err(error) => read.problem = Some(error.to_string()),
        }
    }

    fn read_tables(&mut self) -> Result<(), results::Error> {
        let log = results::read_log(&self.folder)?;
        let mut order: Vec<(SystemTime, Entry)> = Vec::new();
        order.extend(
            log.attempts.iter().enumerate().map(|(place, row)| (row.ended_at, Entry::Attempt(place))),
        );
        order.extend(log.events.iter().enumerate().map(|(place, row)| (row.at, Entry::Event(place))));
        order.sort_by_key(|(at, _)| *at);
        self.order = order.into_iter().map(|(_, entry)| entry).collect();
        for attempt in &log.attempts {
            note_busy(&mut self.busy, attempt);
        }
        self.rows = Tables::of(log);
        Ok(())
    }

    fn clear(&mut self) {
        (self.rows, self.order, self.busy) = Default::default();
        (self.orders, self.leased) = Default::default();
    }

    fn note_new(&mut self, (attempts, events): (usize, usize)) {
        let RunLog { attempts: all_attempts, events: all_events, .. } = self.rows.rows();
        for (place, attempt) in all_attempts.iter().enumerate().skip(attempts) {
            note_busy(&mut self.busy, attempt);
            self.order.push(Entry::Attempt(place));
        }
        self.order.extend((events..all_events.len()).map(Entry::Event));
    }

    /// Number of entries.
    pub fn end(&self) -> u64 {
        self.order.len() as u64
    }

    /// Workers that are here; `None` where nobody can be.
    pub fn present(&self) -> Option<usize> {
        let is_here = |worker: &&WorkerRow| worker.gone_at.is_none();
        matches!(self.source, Source::Journal(_))
            .then(|| self.rows.rows().workers.iter().filter(is_here).count())
    }

    /// Whether an operator has paused the coordinator at work.
    pub fn is_paused(&self) -> bool {
        self.orders.is_paused
    }

    /// The experiment of an unfinished run, or of its sweep, as it was started with.
    pub fn experiment(&self) -> Option<&str> {
        match &self.source {
            Source::Journal(follower) => follower.header().map(|header| header.experiment.as_str()),
            _ => None,
        }
    }

    /// When the run was started first, if it is unfinished.
    pub fn started_at(&self) -> Option<SystemTime> {
        match &self.source {
            Source::Journal(follower) => follower.header().map(|header| header.started_at),
            _ => None,
        }
    }

    /// What a viewer does not have yet.
    pub fn since(&self, cursor: &mut LogCursor) -> Vec<Message> {
        let mut messages = Vec::new();
        let from = (cursor.log as usize).max(self.order.len().saturating_sub(MOST));
        let (mut attempts, mut events) = (Vec::new(), Vec::new());
        for (place, entry) in self.order.iter().enumerate().skip(from) {
            let sequence = place as u64 + 1;
            match *entry {
                Entry::Attempt(row) => attempts.push((sequence, &self.rows.rows().attempts[row])),
                Entry::Event(row) => events.push(event_json(sequence, &self.rows.rows().events[row])),
            }
        }
        if !attempts.is_empty() {
            messages.push(("attempts", attempts_json(&attempts)));
        }
        if !events.is_empty() {
            messages.push(("events", json!(events).to_string()));
        }
        cursor.log = self.order.len() as u64;
        if cursor.fleet != self.fleet.1 {
            cursor.fleet = self.fleet.1;
            messages.push(("fleet", self.fleet.0.clone()));
        }
        messages
    }

    fn fleet_json(&self) -> String {
        let mut held: BTreeMap<String, Vec<serde_json::Value>> = BTreeMap::new();
        let is_live = match &self.source {
            Source::Journal(follower) => {
                for (lease, worker) in follower.leases() {
                    let (job, attempt) = lease;
                    let age = self.leased.get(lease).map(|since| since.elapsed().as_secs());
                    let lease = json!({
                        "job": job.0.to_string(), "attempt": attempt, "task": null, "age_seconds": age,
                    });
                    held.entry(worker.to_string()).or_default().push(lease);
                }
                true
            }
            _ => false,
        };
        let last = self.rows.rows().attempts.iter().map(|row| row.ended_at).max();
        let workers = self.rows.rows().workers.iter().map(|row| {
            let leases = if row.gone_at.is_none() { held.remove(&row.id) } else { None };
            let end = row.gone_at.or(last).unwrap_or(row.joined_at);
            let here = end.duration_since(row.joined_at).unwrap_or_default().as_secs_f64();
            let (busy, answers) = self.busy.get(&row.worker).copied().unwrap_or_default();
            let state = match (&row.gone_at, &leases) {
                (Some(_), _) => "gone",
                _ if self.orders.drained.contains(&row.worker) => "draining",
                (None, Some(_)) => "busy",
                (None, None) => "idle",
            };
            json!({
                "worker": row.worker, "id": row.id, "threads": row.threads, "build": row.build,
                "principal": row.principal, "joined_ms": milliseconds(row.joined_at),
                "gone_ms": row.gone_at.map(milliseconds), "departure": row.departure,
                "answers": row.answers.unwrap_or(answers), "busy_share": (here > 0.0).then(|| (busy / here).min(1.0)),
                "leases": if is_live { Some(leases.unwrap_or_default()) } else { None }, "state": state,
            })
        });
        json!({"live": is_live, "workers": workers.collect::<Vec<_>>()}).to_string()
    }
}

impl Orders {
    /// Takes what an event says of the run, which is this member if it is one of a sweep.
    fn take(&mut self, event: &Event, member: Option<&str>) {
        let EventKind::Controlled(Controlled { action, member: of, .. }) = &event.kind else { return };
        let is_ours = of.is_none() || of.as_deref() == member;
        match action {
            ControlAction::Pause if is_ours => self.is_paused = true,
            ControlAction::Resume { worker: None } if is_ours => self.is_paused = false,
            ControlAction::Drain { worker } => drop(self.drained.insert(worker.clone())),
            ControlAction::Resume { worker: Some(worker) } => drop(self.drained.remove(worker)),
            _ => {}
        }
    }
}

fn note_busy(busy: &mut BTreeMap<String, (f64, u64)>, attempt: &AttemptRow) {
    let (seconds, answers) = busy.entry(attempt.worker.clone()).or_default();
    *seconds += attempt.run_seconds.unwrap_or_default();
    *answers += u64::from(matches!(attempt.end.as_str(), "answered" | "agreed" | "disagreed" | "late"));
}

fn attempts_json(attempts: &[(u64, &AttemptRow)]) -> String {
    fn column<T: Serialize>(
        attempts: &[(u64, &AttemptRow)],
        cell: impl Fn(&AttemptRow) -> T,
    ) -> serde_json::Value {
        json!(attempts.iter().map(|(_, row)| cell(row)).collect::<Vec<T>>())
    }
    let sequences: Vec<u64> = attempts.iter().map(|(sequence, _)| *sequence).collect();
    json!({"rows": attempts.len(), "columns": {
        "sequence": sequences,
        // As text: JavaScript's numbers do not hold all of them.
        "job": column(attempts, |row| row.job.to_string()),
        "attempt": column(attempts, |row| row.attempt),
        "worker": column(attempts, |row| row.worker.clone()),
        "task": column(attempts, |row| row.task.clone()),
        "handed_out_ms": column(attempts, |row| milliseconds(row.handed_out_at)),
        "ended_ms": column(attempts, |row| milliseconds(row.ended_at)),
        "end": column(attempts, |row| row.end.clone()),
        "reason": column(attempts, |row| row.reason.clone()),
        "run_seconds": column(attempts, |row| row.run_seconds),
    }})
    .to_string()
}

fn event_json(sequence: u64, row: &EventRow) -> EventJson<'_> {
    let level = match row.event.as_str() {
        "quarantined" | "undecided" => "error",
        "paused" | "resumed" | "stopped" | "priority" | "drained" | "readmitted" => "info",
        _ => "warning",
    };
    EventJson {
        sequence,
        at_ms: milliseconds(row.at),
        event: &row.event,
        level,
        worker: row.worker.as_deref(),
        generation: row.generation,
        message: &row.message,
    }
}

/// Milliseconds since 1970.
pub fn milliseconds(at: SystemTime) -> u64 {
    at.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_millis() as u64
}
