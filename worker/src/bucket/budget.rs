//! How much time a bucket may cost: a share of all time, however it fails.

use std::time::{Duration, Instant};

/// A bucket may cost a twentieth of the time, in the long run.
const SHARE: u32 = 20;

/// Time that may still be lost. It grows again while none is, up to what it was at first, so that a long rest is no reason to
/// wait long.
#[derive(Debug)]
pub struct Budget {
    most: Duration,
    left: Duration,
    at: Instant,
}

impl Budget {
    /// `most` may be lost at once.
    pub fn new(most: Duration, now: Instant) -> Self {
        Self { most, left: most, at: now }
    }

    /// Takes off what was lost until now, and says whether more than that was left.
    pub fn pays(&mut self, lost: Duration, now: Instant) -> bool {
        let earned = now.saturating_duration_since(self.at) / SHARE;
        self.at = now;
        let left = (self.left + earned).min(self.most);
        self.left = left.saturating_sub(lost);
        lost <= left
    }
}

#[cfg(test)]
mod tests {
    use descriptor::random::stream;
    use rand::RngExt as _;

    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn what_is_lost_at_once_is_paid_up_to_the_most() {
        let now = Instant::now();
        let mut budget = Budget::new(SECOND, now);
        assert!(budget.pays(SECOND / 2, now));
        assert!(budget.pays(SECOND / 2, now));
        assert!(!budget.pays(SECOND / 100, now));
    }

    #[test]
    fn a_long_rest_earns_no_more_than_the_most() {
        let now = Instant::now();
        let mut budget = Budget::new(SECOND, now);
        assert!(!budget.pays(2 * SECOND, now));
        assert!(!budget.pays(SECOND / 2, now + 9 * SECOND), "nine seconds earn nine twentieths");
        assert!(!budget.pays(SECOND + SECOND / 100, now + 86_400 * SECOND));
        assert!(budget.pays(SECOND, now + 2 * 86_400 * SECOND));
    }

    /// Whoever stops when it does not pay has lost the most, a twentieth of the time, and the last wait.
    #[test]
    fn a_twentieth_of_the_time_is_lost_at_most() {
        let mut unpaid = 0;
        for case in 0..500 {
            let mut rng = stream(1, "budget", &[case]);
            let begin = Instant::now();
            let (mut budget, mut now, mut lost) = (Budget::new(SECOND, begin), begin, Duration::ZERO);
            for _ in 0..100 {
                let [between, wait] =
                    [10_000, 400].map(|most| Duration::from_millis(rng.random_range(0..most)));
                now += between + wait;
                if !budget.pays(wait, now) {
                    unpaid += 1;
                    break;
                }
                lost += wait;
                let bound = SECOND + (now - begin) / SHARE;
                assert!(lost <= bound, "{lost:?} of {bound:?}");
            }
        }
        assert!((100..400).contains(&unpaid), "both ends must be seen, got {unpaid} of 500");
    }
}
