//! The event log: append-only and bounded. Each observer reads at its own pace; none can delay another or the log.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime};

use proto::WorkerId;
use tokio::sync::watch;

use super::event::{Departure, Event, EventKind};
use crate::lock::lock;

/// Events of each kind that are kept, so that no run fills the memory with what happened in it.
pub const MAX_KEPT: usize = 100_000;
/// Events beyond that, of all kinds, that an observer may lag behind before it misses some.
const MAX_OMITTED: usize = 10_000;
/// Most events of one read.
const BATCH: usize = 1024;

/// How many events of each kind were not kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Omitted {
    /// Workers that joined.
    pub workers: u64,
    /// Attempts that ended.
    pub attempts: u64,
    /// All other events.
    pub others: u64,
}

/// The log of one run, through all starts of the coordinator.
pub struct EventLog {
    state: Mutex<State>,
    /// Sequence number of the next event.
    end: watch::Sender<u64>,
    /// Sequence number of the first event of this start.
    begin: u64,
}

/// Kinds of events with a bound of their own.
#[derive(Clone, Copy)]
enum Bound {
    Workers,
    Attempts,
    Others,
}

#[derive(Default)]
struct State {
    events: BTreeMap<u64, Arc<Event>>,
    /// Sequence numbers of those that are not to be kept, oldest first.
    passing: VecDeque<u64>,
    /// By [`Bound`].
    kept: [usize; 3],
    omitted: [u64; 3],
    /// Labels of workers that have joined and not departed.
    present: BTreeMap<WorkerId, String>,
    next: u64,
}

/// One observer's place in the log.
pub struct EventCursor {
    log: Arc<EventLog>,
    next: u64,
    end: watch::Receiver<u64>,
}

impl EventLog {
    /// A log that goes on after the events of earlier starts, in order.
    pub fn new(earlier: Vec<Event>) -> Self {
        let mut state = State::default();
        for event in earlier {
            if let Some(bound) = state.bound(&event.kind) {
                state.kept[bound as usize] += 1;
            }
            state.add(event);
        }
        let begin = state.next;
        Self { state: Mutex::new(state), end: watch::Sender::new(begin), begin }
    }

    /// Appends an event, and returns it as the log has it.
    pub fn append(&self, at: SystemTime, kind: EventKind) -> Arc<Event> {
        let mut state = lock(&self.state);
        let mut omitted = false;
        if let Some(bound) = state.bound(&kind) {
            omitted = state.kept[bound as usize] >= MAX_KEPT;
            if omitted {
                state.omitted[bound as usize] += 1;
            } else {
                state.kept[bound as usize] += 1;
            }
        }
        let sequence = state.next;
        let event = state.add(Event { sequence, at: to_millisecond(at), kind, omitted });
        self.end.send_replace(state.next);
        event
    }

    /// A cursor at the first event of this start.
    pub fn follow(self: &Arc<Self>) -> EventCursor {
        self.cursor(self.begin)
    }

    /// A cursor at the first event of all.
    pub fn follow_from_first(self: &Arc<Self>) -> EventCursor {
        self.cursor(0)
    }

    /// How many events were not kept since this start.
    pub fn omitted(&self) -> Omitted {
        let [workers, attempts, others] = lock(&self.state).omitted;
        Omitted { workers, attempts, others }
    }

    /// Workers that have joined and not departed, with their labels.
    pub fn present(&self) -> BTreeMap<WorkerId, String> {
        lock(&self.state).present.clone()
    }

    fn cursor(self: &Arc<Self>, next: u64) -> EventCursor {
        EventCursor { log: Arc::clone(self), next, end: self.end.subscribe() }
    }
}

impl State {
    /// The bound that an event counts towards; `None`: it is always kept, because a stay that the log has the beginning
    /// of gets an end.
    fn bound(&self, kind: &EventKind) -> Option<Bound> {
        match kind {
            EventKind::Joined { worker, .. }
            | EventKind::Departed { worker, .. }
            | EventKind::Ended { worker, .. }
                if self.present.contains_key(worker) =>
            {
                None
            }
            EventKind::Departed { departure: Departure::Quarantined, .. } => Some(Bound::Others),
            EventKind::Joined { .. } | EventKind::Departed { .. } | EventKind::Ended { .. } => {
                Some(Bound::Workers)
            }
            EventKind::Attempt(_) => Some(Bound::Attempts),
            _ => Some(Bound::Others),
        }
    }

    fn add(&mut self, event: Event) -> Arc<Event> {
        let (sequence, event) = (event.sequence, Arc::new(event));
        self.next = sequence + 1;
        self.events.insert(sequence, Arc::clone(&event));
        if event.omitted {
            self.passing.push_back(sequence);
            if self.passing.len() > MAX_OMITTED
                && let Some(oldest) = self.passing.pop_front()
            {
                self.events.remove(&oldest);
            }
            return event;
        }
        match &event.kind {
            EventKind::Joined { worker, label, .. } => {
                self.present.insert(*worker, label.clone());
            }
            EventKind::Departed { worker, .. } | EventKind::Ended { worker, .. } => {
                self.present.remove(worker);
            }
            _ => {}
        }
        event
    }
}

impl EventCursor {
    /// The next events, at most a batch of them; none if this is the end for now.
    pub fn read(&mut self) -> Vec<Arc<Event>> {
        let state = lock(&self.log.state);
        let batch: Vec<_> =
            state.events.range(self.next..).take(BATCH).map(|(_, event)| Arc::clone(event)).collect();
        self.next = batch.last().map_or(self.next, |event| event.sequence + 1);
        batch
    }

    /// All events up to the end for now.
    pub fn read_to_end(&mut self) -> Vec<Arc<Event>> {
        let mut events = Vec::new();
        loop {
            let batch = self.read();
            if batch.is_empty() {
                return events;
            }
            events.extend(batch);
        }
    }

    /// Waits until there is an event to read.
    pub async fn wait(&mut self) {
        let next = self.next;
        // The sender lives in the log, which this holds.
        let _ = self.end.wait_for(|end| *end > next).await;
    }
}

fn to_millisecond(at: SystemTime) -> SystemTime {
    let since = at.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    SystemTime::UNIX_EPOCH + Duration::from_millis(since.as_millis() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::Introduction;

    use crate::events::{Attempt, AttemptEnd, ControlAction, Controlled};

    fn joined(number: u8) -> EventKind {
        let introduction = Introduction::sample("host", number);
        EventKind::Joined { worker: WorkerId([number; 16]), label: format!("host-{number}"), introduction }
    }

    fn departed(number: u8, departure: Departure) -> EventKind {
        let (worker, label) = (WorkerId([number; 16]), format!("host-{number}"));
        EventKind::Departed { worker, label, departure, leases: 1, answers: 3 }
    }

    fn attempt(end: AttemptEnd) -> EventKind {
        EventKind::Attempt(Attempt {
            job: proto::JobId(u64::MAX),
            number: 2,
            task: "evaluation".to_owned(),
            kind: None,
            worker: WorkerId([1; 16]),
            label: "host".to_owned(),
            held_seconds: 1.25,
            run_seconds: None,
            end,
        })
    }

    fn controlled(action: ControlAction, member: Option<&str>) -> EventKind {
        let (reason, by) = ("the disk is full".to_owned(), "jo@lab".to_owned());
        EventKind::Controlled(Controlled { action, member: member.map(str::to_owned), reason, by })
    }

    fn log() -> Arc<EventLog> {
        Arc::new(EventLog::new(Vec::new()))
    }

    fn sequences(events: &[Arc<Event>]) -> Vec<u64> {
        events.iter().map(|event| event.sequence).collect()
    }

    #[tokio::test]
    async fn each_observer_has_a_cursor_of_its_own_and_sees_every_event_once_and_in_order() {
        let (log, at) = (log(), SystemTime::UNIX_EPOCH);
        let [mut quick, mut slow] = [(); 2].map(|()| log.follow());
        for number in 0..3000u32 {
            log.append(at, EventKind::Rewind { generation: number, why: String::new() });
            if number % 7 == 0 {
                quick.wait().await;
                assert_eq!(quick.read_to_end().last().unwrap().sequence, u64::from(number));
            }
        }
        let (batch, all) = (slow.read(), log.follow().read_to_end());
        assert_eq!(batch.len(), BATCH);
        assert_eq!(sequences(&[batch, slow.read_to_end()].concat()), (0..3000).collect::<Vec<u64>>());
        assert_eq!(sequences(&all), (0..3000).collect::<Vec<u64>>());
        assert!(slow.read().is_empty());
        let waited = tokio::spawn(async move {
            slow.wait().await;
            slow.read().len()
        });
        log.append(at, EventKind::Unaudited);
        assert_eq!(waited.await.unwrap(), 1);
    }

    #[test]
    fn what_is_beyond_the_bound_is_seen_by_who_follows_and_kept_by_nobody() {
        let (log, at) = (log(), SystemTime::UNIX_EPOCH);
        log.append(at, joined(1));
        for _ in 0..MAX_KEPT {
            assert!(!log.append(at, attempt(AttemptEnd::Answered)).omitted);
        }
        let mut follower = log.follow();
        follower.next = MAX_KEPT as u64 + 1;
        for _ in 0..MAX_OMITTED + 5 {
            assert!(log.append(at, attempt(AttemptEnd::Answered)).omitted);
        }
        // Other kinds have room of their own.
        assert!(!log.append(at, EventKind::Unaudited).omitted);
        assert!(!log.append(at, departed(1, Departure::Lost)).omitted);
        assert_eq!(log.omitted(), Omitted { attempts: MAX_OMITTED as u64 + 5, ..Omitted::default() });
        assert_eq!(follower.read_to_end().len(), MAX_OMITTED + 2, "only the latest");
        assert_eq!(lock(&log.state).events.len(), 1 + MAX_KEPT + MAX_OMITTED + 2);
    }

    #[test]
    fn the_end_of_a_stay_is_kept_if_its_beginning_is_and_not_otherwise() {
        let (log, at) = (log(), SystemTime::UNIX_EPOCH);
        log.append(at, joined(1));
        lock(&log.state).kept = [MAX_KEPT; 3];
        for (kind, omitted) in [
            (joined(2), true),
            (joined(1), false),
            (departed(2, Departure::Lost), true),
            (departed(1, Departure::Left), false),
            (departed(1, Departure::Quarantined), true),
        ] {
            assert_eq!(log.append(at, kind.clone()).omitted, omitted, "{kind:?}");
        }
        assert_eq!(log.omitted(), Omitted { workers: 2, attempts: 0, others: 1 });
    }

    #[test]
    fn a_log_goes_on_where_an_earlier_start_ended() {
        let (first, at) = (log(), SystemTime::UNIX_EPOCH + Duration::from_micros(1_234_567));
        first.append(at, joined(1));
        first.append(at, joined(2));
        first.append(at, departed(2, Departure::Left));
        let kept: Vec<Event> = first.follow().read_to_end().iter().map(|event| (**event).clone()).collect();
        let second = Arc::new(EventLog::new(kept.clone()));
        assert_eq!(second.present(), [(WorkerId([1; 16]), "host-1".to_owned())].into());
        assert_eq!(second.append(at, EventKind::Unaudited).sequence, 3);
        assert_eq!(sequences(&second.follow().read_to_end()), [3], "what is new to this start");
        assert_eq!(sequences(&second.follow_from_first().read_to_end()), [0, 1, 2, 3]);
        assert_eq!(kept[0].at, SystemTime::UNIX_EPOCH + Duration::from_millis(1_234));
    }

    #[test]
    fn every_kind_of_event_is_read_as_it_was_written() {
        let kinds = [
            joined(1),
            departed(7, Departure::Quarantined),
            EventKind::Ended { worker: WorkerId([255; 16]), label: "host".to_owned() },
            attempt(AttemptEnd::Failed("out of memory".to_owned())),
            attempt(AttemptEnd::Gone(Departure::Denied)),
            attempt(AttemptEnd::Late),
            EventKind::Disagreement {
                job: proto::JobId(3),
                task: "evaluation".to_owned(),
                workers: vec!["one".to_owned(), "two".to_owned()],
            },
            EventKind::Undecided { task: "evaluation".to_owned() },
            EventKind::Unaudited,
            EventKind::Starving { idle: 1, unfinished: 2 },
            EventKind::Rewind { generation: 3, why: "why".to_owned() },
            controlled(ControlAction::Pause, Some("seed-1")),
            controlled(ControlAction::Resume { worker: None }, None),
            controlled(ControlAction::Resume { worker: Some("host".to_owned()) }, None),
            controlled(ControlAction::Stop, None),
            controlled(ControlAction::Priority { priority: 3 }, Some("seed-1")),
            controlled(ControlAction::Drain { worker: "host".to_owned() }, None),
            controlled(ControlAction::Deny { worker: "host".to_owned() }, None),
        ];
        let log = log();
        for kind in kinds {
            let event = log.append(SystemTime::UNIX_EPOCH + Duration::from_secs(9), kind);
            let text = serde_json::to_string(&*event).unwrap();
            assert_eq!(serde_json::from_str::<Event>(&text).unwrap(), *event, "{text}");
        }
        for text in ["{}", r#"{"sequence":0,"at_ms":0,"event":"departed","worker":"77","label":"x"}"#] {
            assert!(serde_json::from_str::<Event>(text).is_err(), "{text}");
        }
    }
}
