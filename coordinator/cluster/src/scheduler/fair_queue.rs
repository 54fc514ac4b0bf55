//! Whose job is next: clients are served in turn, so that one that asks for a thousand jobs at once does not hold up one that
//! asks for ten.
//!
//! Start-time fair queueing (Goyal, Vin and Cheng, 1996) with jobs of equal length, and clients with a weight each.

use std::collections::BTreeMap;

/// One of those who submit jobs: a run has one, a sweep one for each of its members, and each of these some that ask
/// beforehand for what it will ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ClientId {
    number: u32,
    /// Which of those that foresee for it; 0 for itself.
    foresight: u32,
}

impl ClientId {
    /// Checks results, for all others.
    pub const AUDITOR: Self = Self::new(0);

    /// One that waits for what it asks for.
    pub const fn new(number: u32) -> Self {
        Self { number, foresight: 0 }
    }

    /// One that asks for what this one will ask for; each has a number of its own, from 1.
    pub const fn foresight(self, foresight: u32) -> Self {
        Self { foresight, ..self }
    }

    /// The one that will ask for what this one asks for; itself, if it does not foresee.
    pub const fn owner(self) -> Self {
        Self::new(self.number)
    }

    /// Whether it asks only beforehand.
    pub const fn foresees(self) -> bool {
        self.foresight > 0
    }
}

/// Virtual time of one job of a client of weight 1.
const JOB: u64 = 1 << 20;

/// Where a job stands among those that wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(test, derive(Default))]
pub struct QueuePosition {
    /// Jobs that are only foreseen come after all others.
    is_foreseen: bool,
    virtual_start: u64,
    /// Grows with each job: within one virtual start time, who asked first comes first.
    number: u64,
}

impl QueuePosition {
    /// Whether the job is only foreseen.
    pub fn is_foreseen(self) -> bool {
        self.is_foreseen
    }
}

/// Assigns positions in the queue.
#[derive(Debug, Default)]
pub(super) struct FairQueue {
    asked: Line,
    foreseen: Line,
    /// Clients of another weight than 1: of those that compete, each gets workers in proportion to its own.
    weights: BTreeMap<ClientId, u32>,
    positions: u64,
}

/// Jobs that are asked for, or foreseen.
#[derive(Debug, Default)]
struct Line {
    /// Virtual start time of the job that was handed out last.
    current: u64,
    /// Virtual start time of the next job of each client. One that did not ask for a while has saved up nothing.
    next: BTreeMap<ClientId, u64>,
}

impl FairQueue {
    fn line(&mut self, is_foreseen: bool) -> &mut Line {
        if is_foreseen { &mut self.foreseen } else { &mut self.asked }
    }

    /// The position of a client's next job: after its other jobs, and not before what was handed out already.
    pub(super) fn position(&mut self, client: ClientId) -> QueuePosition {
        let (length, is_foreseen) = (JOB / u64::from(self.weight(client)), client.foresees());
        let Line { current, next } = self.line(is_foreseen);
        let next = next.entry(client.owner()).or_default();
        let virtual_start = (*current).max(*next);
        *next = virtual_start + length;
        self.positions += 1;
        QueuePosition { is_foreseen, virtual_start, number: self.positions }
    }

    /// Notes that the job at this position is handed out.
    pub(super) fn serve(&mut self, position: QueuePosition) {
        let current = &mut self.line(position.is_foreseen).current;
        *current = (*current).max(position.virtual_start);
    }

    /// Forgets a client; one that foresees goes on as the same.
    pub(super) fn forget(&mut self, client: ClientId) {
        if !client.foresees() {
            self.restart(client);
            self.weights.remove(&client);
        }
    }

    /// The client's next job is its first, and the next that is foreseen for it.
    pub(super) fn restart(&mut self, client: ClientId) {
        for line in [&mut self.asked, &mut self.foreseen] {
            line.next.remove(&client);
        }
    }

    pub(super) fn weight(&self, client: ClientId) -> u32 {
        self.weights.get(&client.owner()).copied().unwrap_or(1)
    }

    /// Sets the weight of a client, at least 1, for the jobs that it asks for from here on.
    pub(super) fn set_weight(&mut self, client: ClientId, weight: u32) {
        self.weights.insert(client, weight.max(1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lets clients ask and be served one by one; returns which client each job that was handed out was for.
    #[derive(Default)]
    struct Served {
        fair_queue: FairQueue,
        waiting: BTreeMap<QueuePosition, u32>,
    }

    impl Served {
        fn ask(&mut self, client: u32, jobs: u32) {
            for _ in 0..jobs {
                self.waiting.insert(self.fair_queue.position(ClientId::new(client)), client);
            }
        }

        fn serve(&mut self, jobs: usize) -> Vec<u32> {
            let mut served = Vec::new();
            while served.len() < jobs
                && let Some((position, client)) = self.waiting.pop_first()
            {
                self.fair_queue.serve(position);
                served.push(client);
            }
            served
        }
    }

    #[test]
    fn one_client_is_served_in_the_order_in_which_it_asks() {
        let mut fair_queue = FairQueue::default();
        let positions: Vec<QueuePosition> = (0..100)
            .map(|asked| {
                let position = fair_queue.position(ClientId::new(1));
                if asked % 3 == 0 {
                    fair_queue.serve(position);
                }
                position
            })
            .collect();
        assert!(positions.is_sorted());
    }

    #[test]
    fn a_client_that_asks_for_a_thousand_jobs_does_not_hold_up_one_that_asks_for_few() {
        let mut line = Served::default();
        line.ask(1, 1000);
        assert_eq!(line.serve(5), [1; 5]);
        for _ in 0..10 {
            line.ask(2, 3);
            let served = line.serve(6);
            assert_eq!(served.iter().filter(|&&client| client == 2).count(), 3, "{served:?}");
        }
        line.ask(2, 3);
        line.ask(3, 3);
        assert_eq!(line.serve(9).iter().filter(|&&client| client == 1).count(), 3);
    }

    #[test]
    fn what_is_foreseen_comes_after_all_that_is_asked_for_and_is_served_in_turn_as_well() {
        let (mut fair_queue, client) = (FairQueue::default(), ClientId::new);
        let mut ask = |client| fair_queue.position(client);
        let foreseen: Vec<QueuePosition> =
            (0..9).map(|number| ask(client(1).foresight(1 + number % 3))).collect();
        let other = ask(client(2).foresight(1));
        let asked: Vec<QueuePosition> = (0..99).map(|_| ask(client(1))).collect();
        assert!(asked.is_sorted() && foreseen.is_sorted() && asked[98] < foreseen[0]);
        assert!(foreseen[0] < other && other < foreseen[1], "{foreseen:?} {other:?}");
        assert!(other.is_foreseen() && !asked[0].is_foreseen());
    }

    #[test]
    fn a_client_that_was_away_has_saved_up_no_turns() {
        let mut line = Served::default();
        line.ask(1, 500);
        line.ask(2, 1);
        line.serve(400);
        line.ask(2, 100);
        let served = line.serve(20);
        assert!((9..=11).contains(&served.iter().filter(|&&client| client == 2).count()), "{served:?}");
    }
}
