//! Whose job is next: clients take turns, so that one that asks for a thousand jobs at once does not hold up one that
//! asks for ten.
//!
//! Start-time fair queueing (Goyal, Vin and Cheng, 1996) with jobs of equal length and clients of equal weight.

use std::collections::BTreeMap;

/// One of those who submit jobs: a run has one, a sweep one for each of its members.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ClientId(pub u32);

impl ClientId {
    /// Whoever checks answers, for all others.
    pub const AUDITOR: Self = Self(0);
}

/// Where a job stands among those that wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Place {
    turn: u64,
    /// Grows with each job: within one turn, who asked first comes first.
    number: u64,
}

/// Gives places.
#[derive(Debug, Default)]
pub(super) struct Turns {
    /// Turn of the job that was handed out last.
    current: u64,
    /// Next turn of each client. One that did not ask for a while has saved up nothing.
    next: BTreeMap<ClientId, u64>,
    places: u64,
}

impl Turns {
    /// The place of a client's next job: after its other jobs, and not before what was handed out already.
    pub(super) fn place(&mut self, client: ClientId) -> Place {
        let next = self.next.entry(client).or_default();
        let turn = self.current.max(*next);
        *next = turn + 1;
        self.places += 1;
        Place { turn, number: self.places }
    }

    /// Notes that the job at this place is handed out.
    pub(super) fn serve(&mut self, place: Place) {
        self.current = self.current.max(place.turn);
    }

    pub(super) fn forget(&mut self, client: ClientId) {
        self.next.remove(&client);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lets clients ask and be served one by one; returns which client each job that was handed out was for.
    #[derive(Default)]
    struct Line {
        turns: Turns,
        waiting: BTreeMap<Place, u32>,
    }

    impl Line {
        fn ask(&mut self, client: u32, jobs: u32) {
            for _ in 0..jobs {
                self.waiting.insert(self.turns.place(ClientId(client)), client);
            }
        }

        fn serve(&mut self, jobs: usize) -> Vec<u32> {
            let mut served = Vec::new();
            while served.len() < jobs
                && let Some((place, client)) = self.waiting.pop_first()
            {
                self.turns.serve(place);
                served.push(client);
            }
            served
        }
    }

    #[test]
    fn one_client_is_served_in_the_order_in_which_it_asks() {
        let mut turns = Turns::default();
        let places: Vec<Place> = (0..100)
            .map(|asked| {
                let place = turns.place(ClientId(1));
                if asked % 3 == 0 {
                    turns.serve(place);
                }
                place
            })
            .collect();
        assert!(places.is_sorted());
    }

    #[test]
    fn a_client_that_asks_for_a_thousand_jobs_does_not_hold_up_one_that_asks_for_few() {
        let mut line = Line::default();
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
    fn a_client_that_was_away_has_saved_up_no_turns() {
        let mut line = Line::default();
        line.ask(1, 500);
        line.ask(2, 1);
        line.serve(400);
        line.ask(2, 100);
        let served = line.serve(20);
        assert!((9..=11).contains(&served.iter().filter(|&&client| client == 2).count()), "{served:?}");
    }
}
