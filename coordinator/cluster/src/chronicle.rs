//! What happened in a run, as the rows of its tables: workers, attempts and events.

use std::collections::BTreeMap;
use std::time::{Instant, SystemTime};

use proto::{JobId, WorkerId};
use results::{AttemptRow, EventRow, Proceedings, WorkerRow};

use crate::journal::{Recorded, Told};
use crate::scheduler::{Attempt, Departure, Event, What};

/// Rows that a table has room for: the rest is counted, so that no run fills the memory with what is said about it.
const ROOM: usize = 100_000;

/// Collects rows.
pub struct Chronicle {
    /// Two readings of the clocks at one moment: decisions are timed by one, rows by the other.
    begun: (Instant, SystemTime),
    rows: Proceedings,
    /// Rows of the workers that are here.
    present: BTreeMap<WorkerId, usize>,
    omitted: [u64; 3],
    trusted: bool,
    /// Rows that are new or changed, with their places, until somebody keeps them.
    unkept: Vec<(u32, Told)>,
}

impl Chronicle {
    /// Goes on after what earlier starts of the run have told.
    pub fn begin(now: Instant, time: SystemTime, recorded: &Recorded) -> Self {
        let Recorded { proceedings, members, trusted, .. } = recorded;
        let (present, unkept) = (BTreeMap::new(), Vec::new());
        let (rows, trusted) = (proceedings.clone(), *trusted);
        let mut chronicle = Self { begun: (now, time), rows, present, omitted: [0; 3], trusted, unkept };
        for place in 0..chronicle.rows.workers.len() {
            let row = &mut chronicle.rows.workers[place];
            if row.gone_at.is_some() {
                continue;
            }
            if let Some(id) = members.keys().find(|id| id.to_string() == row.id) {
                chronicle.present.insert(*id, place);
            } else {
                // A worker of the coordinator's own process ends with it.
                (row.gone_at, row.departure) = (Some(time), Some("ended".to_owned()));
                chronicle.unkept.push((place as u32, Told::Worker(row.clone())));
            }
        }
        chronicle
    }

    /// What was told since the last call.
    pub fn drain_unkept(&mut self) -> Vec<(u32, Told)> {
        std::mem::take(&mut self.unkept)
    }

    /// Adds what an event has to tell.
    pub fn note(&mut self, event: &Event) {
        let at = self.time(event.at);
        match &event.what {
            // One that earlier starts have told of.
            What::Joined { id, .. } if self.present.contains_key(id) => {}
            What::Joined { worker, id, introduction } => {
                let row = WorkerRow {
                    worker: worker.clone(),
                    id: id.to_string(),
                    threads: introduction.threads,
                    build: introduction.build.clone(),
                    credential: introduction.credential.clone(),
                    joined_at: at,
                    gone_at: None,
                    departure: None,
                    leases: None,
                    answers: None,
                };
                if add(&mut self.rows.workers, row.clone(), &mut self.omitted[0]) {
                    let place = self.rows.workers.len() - 1;
                    self.present.insert(*id, place);
                    self.unkept.push((place as u32, Told::Worker(row)));
                }
            }
            What::Gone { worker, id, why, leases, answers } => {
                if let Some(place) = self.present.remove(id) {
                    let row = &mut self.rows.workers[place];
                    row.gone_at = Some(at);
                    row.departure = Some(why.as_str().to_owned());
                    row.leases = Some(u32::try_from(*leases).unwrap_or(u32::MAX));
                    row.answers = Some(*answers);
                    self.unkept.push((place as u32, Told::Worker(row.clone())));
                }
                self.trusted &= *why != Departure::Quarantined;
                if *why != Departure::Left {
                    self.tell(at, why.as_str(), Some(worker), why.reason().to_owned());
                }
            }
            What::Attempt(attempt) => self.note_attempt(attempt, at),
            What::Disagreement { .. } => self.tell(at, "disagreement", None, event.what.to_string()),
            What::Undecided { .. } => self.tell(at, "undecided", None, event.what.to_string()),
            What::Unaudited => self.tell(at, "unaudited", None, event.what.to_string()),
            What::Starving { .. } => self.tell(at, "starving", None, event.what.to_string()),
        }
    }

    /// Notes that a run goes back to the beginning of a generation.
    pub fn note_rewind(&mut self, now: Instant, generation: u32, why: String) {
        let (at, event) = (self.time(now), "rewind".to_owned());
        self.add_event(EventRow { at, event, worker: None, generation: Some(generation), message: why });
    }

    /// Whether no worker of this run was quarantined.
    pub fn is_trusted(&self) -> bool {
        self.trusted
    }

    /// Everything so far, with the attempts at these jobs only.
    pub fn rows(&self, now: Instant, concerns: impl Fn(JobId) -> bool) -> Proceedings {
        let at = self.time(now);
        let Proceedings { workers, attempts, events } = &self.rows;
        let attempts = attempts.iter().filter(|attempt| concerns(JobId(attempt.job)));
        let mut rows = Proceedings {
            workers: workers.clone(),
            attempts: attempts.cloned().collect(),
            events: events.clone(),
        };
        for (table, omitted) in ["workers", "attempts", "events"].into_iter().zip(self.omitted) {
            if omitted > 0 {
                let message = format!("{table}: {omitted} more rows, beyond the {ROOM} that are kept");
                let event = "omitted".to_owned();
                rows.events.push(EventRow { at, event, worker: None, generation: None, message });
            }
        }
        rows
    }

    fn note_attempt(&mut self, attempt: &Attempt, at: SystemTime) {
        let row = AttemptRow {
            job: attempt.job.0,
            attempt: attempt.number,
            worker: attempt.worker.clone(),
            task: attempt.task.to_string(),
            handed_out_at: self.time(attempt.handed_out),
            ended_at: at,
            end: attempt.end.as_str().to_owned(),
            reason: attempt.end.reason(),
            run_seconds: attempt.run_seconds,
        };
        if add(&mut self.rows.attempts, row.clone(), &mut self.omitted[1]) {
            self.unkept.push((self.rows.attempts.len() as u32 - 1, Told::Attempt(row)));
        }
    }

    fn tell(&mut self, at: SystemTime, event: &str, worker: Option<&String>, message: String) {
        let event = event.to_owned();
        self.add_event(EventRow { at, event, worker: worker.cloned(), generation: None, message });
    }

    fn add_event(&mut self, row: EventRow) {
        if add(&mut self.rows.events, row.clone(), &mut self.omitted[2]) {
            self.unkept.push((self.rows.events.len() as u32 - 1, Told::Event(row)));
        }
    }

    fn time(&self, at: Instant) -> SystemTime {
        self.begun.1 + at.saturating_duration_since(self.begun.0)
    }
}

/// Adds a row if there is room, and returns whether there was.
fn add<T>(rows: &mut Vec<T>, row: T, omitted: &mut u64) -> bool {
    let room = rows.len() < ROOM;
    if room {
        rows.push(row);
    } else {
        *omitted += 1;
    }
    room
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::journal::Member;
    use crate::scheduler::Introduction;

    #[test]
    fn a_worker_that_comes_back_has_a_row_for_each_stay() {
        let (now, time) = (Instant::now(), SystemTime::UNIX_EPOCH);
        let mut chronicle = Chronicle::begin(now, time, &Recorded::default());
        let id = WorkerId([7; 16]);
        let mut note = |seconds, what| {
            chronicle.note(&Event { at: now + Duration::from_secs(seconds), what });
        };
        let introduction = Introduction::sample("host");
        let joined = || What::Joined { worker: "host".to_owned(), id, introduction: introduction.clone() };
        let gone = |why| What::Gone { worker: "host".to_owned(), id, why, leases: 1, answers: 3 };
        note(1, joined());
        note(2, gone(Departure::Lost));
        note(3, joined());
        assert!(chronicle.is_trusted());
        chronicle.note(&Event { at: now, what: gone(Departure::Quarantined) });
        assert!(!chronicle.is_trusted());
        let rows = chronicle.rows(now, |_| true);
        let stays: Vec<_> =
            rows.workers.iter().map(|row| (row.joined_at, row.departure.as_deref())).collect();
        let at = |seconds| time + Duration::from_secs(seconds);
        assert_eq!(stays, [(at(1), Some("lost")), (at(3), Some("quarantined"))]);
        let events: Vec<&str> = rows.events.iter().map(|row| row.event.as_str()).collect();
        assert_eq!(events, ["lost", "quarantined"]);
    }

    #[test]
    fn a_start_goes_on_with_what_the_one_before_has_kept() {
        let (now, time) = (Instant::now(), SystemTime::UNIX_EPOCH);
        let [own, other] = [WorkerId([1; 16]), WorkerId([2; 16])];
        let introduction = Introduction::sample("host");
        let joined = |id: WorkerId| {
            let (worker, introduction) = (id.to_string(), introduction.clone());
            Event { at: now, what: What::Joined { worker, id, introduction } }
        };
        let mut first = Chronicle::begin(now, time, &Recorded::default());
        first.note(&joined(own));
        first.note(&joined(other));
        first.note(&Event { at: now, what: What::Unaudited });
        let mut kept = Proceedings::default();
        for (place, told) in first.drain_unkept() {
            match told {
                Told::Worker(row) => kept.workers.insert(place as usize, row),
                Told::Attempt(row) => kept.attempts.insert(place as usize, row),
                Told::Event(row) => kept.events.insert(place as usize, row),
            }
        }
        assert_eq!(kept, first.rows(now, |_| true));
        assert!(first.drain_unkept().is_empty());

        // The worker of its own process ended with it; the other is there, and is told of once.
        let member = Member { label: other.to_string(), introduction: introduction.clone() };
        let recorded =
            Recorded { proceedings: kept, members: [(other, member)].into(), ..Recorded::default() };
        let later = time + Duration::from_secs(60);
        let mut second = Chronicle::begin(now, later, &recorded);
        second.note(&joined(other));
        let changed = second.drain_unkept();
        assert_eq!(changed.len(), 1, "{changed:?}");
        let rows = second.rows(now, |_| true);
        let ends = rows.workers.iter().map(|row| (row.gone_at, row.departure.as_deref()));
        assert_eq!(ends.collect::<Vec<_>>(), [(Some(later), Some("ended")), (None, None)]);
        assert_eq!(rows.events.len(), 1);
    }

    #[test]
    fn what_has_no_room_is_counted() {
        let (mut rows, mut omitted) = (vec![(); ROOM - 1], 0);
        assert!(add(&mut rows, (), &mut omitted));
        assert!(!add(&mut rows, (), &mut omitted));
        assert_eq!((rows.len(), omitted), (ROOM, 1));
    }
}
