//! The tables `workers`, `attempts` and `events`, made of a run's events.

use std::collections::BTreeMap;
use std::time::SystemTime;

use cluster::events::{Attempt, Controlled, Departure, Event, EventKind, MAX_KEPT, Omitted};
use cluster::{Client, ClusterError};
use proto::WorkerId;
use results::{AttemptRow, EventRow, RunLog, WorkerRow};

/// The rows of everything that concerns a client so far.
///
/// # Errors
/// If what it has asked for cannot be looked up any more.
pub async fn rows(client: &Client) -> Result<RunLog, ClusterError> {
    let mut tables = Tables::default();
    client.events().await?.iter().for_each(|event| tables.add(event));
    Ok(tables.finish(client.omitted_events(), SystemTime::now()))
}

/// Rows of the tables, event by event.
#[derive(Default)]
pub struct Tables {
    rows: RunLog,
    /// Rows of the workers that are here.
    present: BTreeMap<WorkerId, usize>,
}

impl Tables {
    /// With the rows that a run has written.
    pub fn of(rows: RunLog) -> Self {
        Self { rows, present: BTreeMap::new() }
    }

    /// The rows so far.
    pub fn rows(&self) -> &RunLog {
        &self.rows
    }

    /// Adds what an event says.
    pub fn add(&mut self, event: &Event) {
        if event.omitted {
            return;
        }
        match &event.kind {
            // Registered before the coordinator was started again: the same stay.
            EventKind::Joined { worker, .. } if self.present.contains_key(worker) => {}
            EventKind::Joined { worker, label, introduction } => {
                self.present.insert(*worker, self.rows.workers.len());
                self.rows.workers.push(WorkerRow {
                    worker: label.clone(),
                    id: worker.to_string(),
                    threads: introduction.threads,
                    build: introduction.build.clone(),
                    credential: introduction.principal.credential(),
                    principal: Some(introduction.principal.to_string()),
                    joined_at: event.at,
                    gone_at: None,
                    departure: None,
                    leases: None,
                    answers: None,
                });
            }
            EventKind::Departed { worker, label, departure, leases, answers } => {
                if let Some(row) = self.end_stay(worker, event.at, departure.as_str()) {
                    row.leases = Some(u32::try_from(*leases).unwrap_or(u32::MAX));
                    row.answers = Some(*answers);
                }
                if *departure != Departure::Left {
                    let message = departure.reason().to_owned();
                    self.tell(event, departure.as_str(), Some(label), None, message);
                }
            }
            EventKind::Ended { worker, .. } => {
                self.end_stay(worker, event.at, "ended");
            }
            EventKind::Attempt(attempt) => self.rows.attempts.push(attempt_row(attempt, event.at)),
            EventKind::Rewind { generation, why } => {
                self.tell(event, "rewind", None, Some(*generation), why.clone());
            }
            EventKind::Disagreement { .. } => self.describe(event, "disagreement"),
            EventKind::Excluded { label, .. } => {
                self.tell(event, "excluded", Some(label), None, event.kind.to_string());
            }
            EventKind::Controlled(controlled) => self.rows.events.push(control_row(event.at, controlled)),
            EventKind::Readmitted { .. } => self.describe(event, "readmitted"),
            EventKind::Undecided { .. } => self.describe(event, "undecided"),
            EventKind::Unaudited => self.describe(event, "unaudited"),
            EventKind::Starving { .. } => self.describe(event, "starving"),
        }
    }

    fn end_stay(&mut self, worker: &WorkerId, at: SystemTime, departure: &str) -> Option<&mut WorkerRow> {
        let row = &mut self.rows.workers[self.present.remove(worker)?];
        row.gone_at = Some(at);
        row.departure = Some(departure.to_owned());
        Some(row)
    }

    fn describe(&mut self, event: &Event, word: &str) {
        self.tell(event, word, None, None, event.kind.to_string());
    }

    fn tell(
        &mut self,
        event: &Event,
        word: &str,
        worker: Option<&String>,
        generation: Option<u32>,
        message: String,
    ) {
        let (at, word, worker) = (event.at, word.to_owned(), worker.cloned());
        self.rows.events.push(EventRow { at, event: word, worker, generation, message });
    }

    fn finish(mut self, omitted: Omitted, at: SystemTime) -> RunLog {
        let Omitted { workers, attempts, others } = omitted;
        for (table, omitted) in [("workers", workers), ("attempts", attempts), ("events", others)] {
            if omitted > 0 {
                let message = format!("{table}: {omitted} more rows, beyond the {MAX_KEPT} that are kept");
                let event = "omitted".to_owned();
                self.rows.events.push(EventRow { at, event, worker: None, generation: None, message });
            }
        }
        self.rows
    }
}

/// The row of table `events` of an order.
pub fn control_row(at: SystemTime, controlled: &Controlled) -> EventRow {
    EventRow {
        at,
        event: controlled.action.as_done().to_owned(),
        worker: controlled.action.worker().cloned(),
        generation: None,
        message: controlled.to_string(),
    }
}

fn attempt_row(attempt: &Attempt, ended_at: SystemTime) -> AttemptRow {
    AttemptRow {
        job: attempt.job.0,
        attempt: attempt.number,
        worker: attempt.label.clone(),
        task: attempt.task.clone(),
        handed_out_at: attempt.leased_at(ended_at),
        ended_at,
        end: attempt.end.as_str().to_owned(),
        reason: attempt.end.reason().map(str::to_owned),
        run_seconds: attempt.run_seconds,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::Duration;

    use cluster::events::{AttemptEnd, EventLog};
    use proto::Introduction;
    use proto::JobId;

    use super::*;

    fn at(seconds: u64) -> SystemTime {
        SystemTime::UNIX_EPOCH + Duration::from_secs(seconds)
    }

    fn joined(worker: WorkerId) -> EventKind {
        let introduction = Introduction { threads: 4, ..Introduction::sample("host", 1) };
        EventKind::Joined { worker, label: "host".to_owned(), introduction }
    }

    fn departed(worker: WorkerId, departure: Departure) -> EventKind {
        EventKind::Departed { worker, label: "host".to_owned(), departure, leases: 1, answers: 3 }
    }

    fn tables(log: &Arc<EventLog>) -> RunLog {
        let mut tables = Tables::default();
        log.follow_from_first().read_to_end().iter().for_each(|event| tables.add(event));
        tables.finish(log.omitted(), at(99))
    }

    #[test]
    fn a_worker_that_comes_back_has_a_row_for_each_stay() {
        let (log, id) = (Arc::new(EventLog::new(Vec::new())), WorkerId([7; 16]));
        log.append(at(1), joined(id));
        log.append(at(2), departed(id, Departure::Lost));
        log.append(at(3), joined(id));
        log.append(at(3), departed(id, Departure::Quarantined));
        let rows = tables(&log);
        let stays: Vec<_> =
            rows.workers.iter().map(|row| (row.joined_at, row.gone_at, row.departure.as_deref())).collect();
        assert_eq!(stays, [(at(1), Some(at(2)), Some("lost")), (at(3), Some(at(3)), Some("quarantined"))]);
        assert_eq!((rows.workers[0].leases, rows.workers[0].answers), (Some(1), Some(3)));
        let events: Vec<_> =
            rows.events.iter().map(|row| (row.event.as_str(), row.worker.as_deref())).collect();
        assert_eq!(events, [("lost", Some("host")), ("quarantined", Some("host"))]);
        assert_eq!(rows.events[0].message, "no sign of life within the lease");
    }

    #[test]
    fn a_start_goes_on_with_what_the_one_before_has_kept() {
        let [own, other] = [WorkerId([1; 16]), WorkerId([2; 16])];
        let first = Arc::new(EventLog::new(Vec::new()));
        first.append(at(0), joined(own));
        first.append(at(0), joined(other));
        first.append(at(0), EventKind::Unaudited);
        let kept: Vec<Event> = first.follow().read_to_end().iter().map(|event| Event::clone(event)).collect();
        let second = Arc::new(EventLog::new(kept));
        assert_eq!(tables(&second), tables(&first));

        // The worker of its own process ended with it; the other is there, and has one row.
        let label = "host".to_owned();
        second.append(at(60), EventKind::Ended { worker: own, label });
        second.append(at(60), joined(other));
        let rows = tables(&second);
        let ends = rows.workers.iter().map(|row| (row.gone_at, row.departure.as_deref()));
        assert_eq!(ends.collect::<Vec<_>>(), [(Some(at(60)), Some("ended")), (None, None)]);
        assert_eq!(rows.workers[0].leases, None);
        assert_eq!(rows.events.len(), 1);
    }

    #[test]
    fn every_event_but_those_of_good_order_has_a_row_that_says_what_people_are_told() {
        let log = Arc::new(EventLog::new(Vec::new()));
        let id = WorkerId([1; 16]);
        log.append(at(1), joined(id));
        let task = || "evaluation of x".to_owned();
        log.append(
            at(2),
            EventKind::Attempt(Attempt {
                job: JobId(5),
                number: 2,
                task: task(),
                kind: None,
                worker: id,
                label: "host".to_owned(),
                held_seconds: 1.5,
                run_seconds: Some(0.5),
                end: AttemptEnd::Failed("out of memory".to_owned()),
            }),
        );
        log.append(at(3), EventKind::Undecided { task: task() });
        let workers = vec!["one".to_owned(), "two".to_owned()];
        log.append(at(4), EventKind::Disagreement { job: JobId(5), task: task(), workers });
        log.append(at(5), EventKind::Starving { idle: 1, unfinished: 2 });
        log.append(at(6), EventKind::Rewind { generation: 3, why: "why".to_owned() });
        log.append(at(7), departed(id, Departure::Left));
        let rows = tables(&log);
        let attempt = &rows.attempts[0];
        assert_eq!((attempt.job, attempt.attempt, attempt.worker.as_str()), (5, 2, "host"));
        assert_eq!((attempt.end.as_str(), attempt.reason.as_deref()), ("failed", Some("out of memory")));
        assert_eq!(attempt.handed_out_at, SystemTime::UNIX_EPOCH + Duration::from_millis(500));
        assert_eq!((attempt.ended_at, attempt.run_seconds), (at(2), Some(0.5)));
        let told: Vec<_> = rows
            .events
            .iter()
            .map(|row| (row.at, row.event.as_str(), row.generation, row.message.as_str()))
            .collect();
        assert_eq!(
            told,
            [
                (
                    at(3),
                    "undecided",
                    None,
                    "evaluation of x: workers differ and no other is there to decide; waiting for one to join"
                ),
                (
                    at(4),
                    "disagreement",
                    None,
                    "evaluation of x: different answers of one and two; another worker decides"
                ),
                (
                    at(5),
                    "starving",
                    None,
                    "1 worker is idle: only 2 evaluations are left before the next can be chosen"
                ),
                (at(6), "rewind", Some(3), "why"),
            ]
        );
    }

    #[test]
    fn what_has_no_room_is_counted() {
        let log = Arc::new(EventLog::new(Vec::new()));
        for _ in 0..=MAX_KEPT {
            log.append(at(1), EventKind::Unaudited);
        }
        let rows = tables(&log);
        assert_eq!(rows.events.len(), MAX_KEPT + 1);
        let last = rows.events.last().unwrap();
        let message = "events: 1 more rows, beyond the 100000 that are kept";
        assert_eq!((last.event.as_str(), last.message.as_str(), last.at), ("omitted", message, at(99)));
    }
}
