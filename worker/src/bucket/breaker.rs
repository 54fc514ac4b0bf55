//! Whether a server that fails is asked at all: after faults not for a while, and then by one request alone.

use std::time::{Duration, Instant};

/// Faults in a row that are taken for chance.
const TOLERATED: u32 = 2;
/// Until a server that has failed is tried again, at first and at most.
const PAUSES: [Duration; 2] = [Duration::from_secs(30), Duration::from_secs(600)];

/// What may be asked now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Admission {
    /// Everything.
    Granted,
    /// One request, whose outcome is to be told.
    Trial,
    /// Nothing.
    Refused,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Closed,
    /// Until then nothing is asked.
    Open(Instant),
    /// One request is under way; if nothing is heard of it until then, the next may be.
    Trial(Instant),
}

/// A circuit breaker. It begins with a trial: a server that does not answer costs one request, not as many as are sent at
/// once.
#[derive(Debug)]
pub struct Breaker {
    state: State,
    faults: u32,
    pause: Duration,
}

impl Breaker {
    /// Of a server of which nothing is known.
    pub fn new(now: Instant) -> Self {
        Self { state: State::Open(now), faults: 0, pause: PAUSES[0] }
    }

    /// Whether nothing is asked now.
    pub fn refuses(&self, now: Instant) -> bool {
        matches!(self.state, State::Open(until) | State::Trial(until) if now < until)
    }

    /// Whether nothing is asked now, and no trial is under way after which that may be otherwise.
    pub fn is_open(&self, now: Instant) -> bool {
        matches!(self.state, State::Open(until) if now < until)
    }

    /// What may be asked. Whoever gets a trial has the pause that follows a fault to tell how it ended; then the next may
    /// try.
    pub fn admit(&mut self, now: Instant) -> Admission {
        match self.state {
            State::Closed => Admission::Granted,
            State::Open(until) | State::Trial(until) if until <= now => {
                self.state = State::Trial(now + self.pause);
                Admission::Trial
            }
            State::Open(_) | State::Trial(_) => Admission::Refused,
        }
    }

    /// The server has answered. Each answer halves the pause after the next fault: a server that comes and goes is tried
    /// less and less often.
    pub fn succeeded(&mut self) {
        self.state = State::Closed;
        self.faults = 0;
        self.pause = (self.pause / 2).max(PAUSES[0]);
    }

    /// A request has failed. Returns for how long nothing is asked, if that begins now.
    pub fn failed(&mut self, now: Instant) -> Option<Duration> {
        self.faults += 1;
        match self.state {
            State::Closed if self.faults <= TOLERATED => None,
            _ => self.open(now),
        }
    }

    /// The server has answered, but with what is of no use; otherwise as [`Breaker::failed`]. One such answer is no reason to
    /// stop, not even to a trial: others may be right.
    pub fn answered_in_vain(&mut self, now: Instant) -> Option<Duration> {
        if matches!(self.state, State::Trial(_)) {
            self.state = State::Closed;
        }
        self.failed(now)
    }

    /// Waiting for answers has taken too long: nothing is asked from now on. Returns for how long; `None` if that has begun
    /// before, by another of the requests that were under way together.
    pub fn open(&mut self, now: Instant) -> Option<Duration> {
        if matches!(self.state, State::Open(_)) {
            return None;
        }
        let pause = self.pause;
        self.state = State::Open(now + pause);
        self.faults = 0;
        self.pause = (2 * pause).min(PAUSES[1]);
        Some(pause)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn a_trial_comes_first_and_only_one_at_a_time() {
        let now = Instant::now();
        let mut breaker = Breaker::new(now);
        assert_eq!(breaker.admit(now), Admission::Trial);
        assert_eq!(breaker.admit(now), Admission::Refused);
        assert!(breaker.refuses(now) && !breaker.is_open(now));
        breaker.succeeded();
        assert_eq!(breaker.admit(now), Admission::Granted);
        breaker.open(now);
        assert!(breaker.refuses(now) && breaker.is_open(now));
        // One whose outcome was never told does not block for ever.
        let mut breaker = Breaker::new(now);
        breaker.admit(now);
        assert_eq!(breaker.admit(now + PAUSES[0]), Admission::Trial);
    }

    #[test]
    fn single_faults_are_chance_and_three_in_a_row_are_not() {
        let now = Instant::now();
        let mut breaker = Breaker::new(now);
        breaker.succeeded();
        for _ in 0..3 {
            assert_eq!(breaker.failed(now), None);
            assert_eq!(breaker.failed(now), None);
            breaker.succeeded();
        }
        assert_eq!([breaker.failed(now), breaker.failed(now)], [None, None]);
        assert_eq!(breaker.failed(now), Some(PAUSES[0]));
        assert_eq!(breaker.admit(now + PAUSES[0] - SECOND), Admission::Refused);
        assert_eq!(breaker.admit(now + PAUSES[0]), Admission::Trial);
    }

    #[test]
    fn a_server_that_answers_in_vain_is_stopped_asking_after_three_answers_and_longer_each_time() {
        let mut now = Instant::now();
        let mut breaker = Breaker::new(now);
        for pause in [PAUSES[0], 2 * PAUSES[0], 4 * PAUSES[0]] {
            assert_eq!(breaker.admit(now), Admission::Trial);
            assert_eq!(breaker.answered_in_vain(now), None);
            assert_eq!(breaker.admit(now), Admission::Granted);
            let answers = [breaker.answered_in_vain(now), breaker.answered_in_vain(now)];
            assert_eq!(answers, [None, Some(pause)]);
            now += pause;
        }
    }

    #[test]
    fn pauses_grow_to_the_longest_and_shrink_again() {
        let mut now = Instant::now();
        let mut breaker = Breaker::new(now);
        let mut pauses = Vec::new();
        for _ in 0..7 {
            assert_eq!(breaker.admit(now), Admission::Trial);
            let pause = breaker.failed(now).unwrap();
            pauses.push(pause.as_secs());
            now += pause;
        }
        assert_eq!(pauses, [30, 60, 120, 240, 480, 600, 600]);
        breaker.succeeded();
        assert_eq!(breaker.open(now), Some(Duration::from_secs(300)));
        (0..20).for_each(|_| breaker.succeeded());
        assert_eq!(breaker.open(now), Some(PAUSES[0]));
    }

    #[test]
    fn requests_that_fail_together_are_one_reason_to_stop() {
        let now = Instant::now();
        let mut breaker = Breaker::new(now);
        breaker.admit(now);
        breaker.succeeded();
        let stops: Vec<_> = (0..16).filter_map(|_| breaker.failed(now)).collect();
        assert_eq!((stops, breaker.open(now)), (vec![PAUSES[0]], None));
        assert_eq!(breaker.admit(now + PAUSES[0]), Admission::Trial, "the pause has not grown meanwhile");
    }
}
