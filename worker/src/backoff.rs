//! Pauses between attempts to reach a coordinator: longer each time, and never in step with other workers.

use std::time::Duration;

use chacha20::ChaCha8Rng;
use rand::RngExt as _;

/// The first pause, before jitter.
const FIRST: Duration = Duration::from_millis(100);
/// No pause is longer than this, so that a coordinator that is back is found soon.
const LONGEST: Duration = Duration::from_secs(5);

/// Exponential back-off with jitter: a thousand workers that lost the same coordinator spread their return.
#[derive(Debug)]
pub struct Backoff {
    rng: ChaCha8Rng,
    failures: u32,
}

impl Backoff {
    /// No failure yet; `rng` must differ from worker to worker.
    pub fn new(rng: ChaCha8Rng) -> Self {
        Self { rng, failures: 0 }
    }

    /// The pause after one more failure: between half of and the whole of 0.1 s · 2ⁿ, at most 5 s.
    pub fn next_pause(&mut self) -> Duration {
        let whole = FIRST.saturating_mul(1 << self.failures.min(16)).min(LONGEST);
        self.failures = self.failures.saturating_add(1);
        let half = whole.as_millis() as u64 / 2;
        Duration::from_millis(half + self.rng.random_range(0..=half))
    }

    /// Failures since the last success.
    pub fn failures(&self) -> u32 {
        self.failures
    }

    /// Whether the last pause was the first since the last success.
    pub fn is_first(&self) -> bool {
        self.failures == 1
    }

    /// The coordinator answered.
    pub fn reset(&mut self) {
        self.failures = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_double_up_to_a_bound_and_are_spread() {
        let mut backoff = Backoff::new(descriptor::random::stream(1, "test", &[]));
        for failure in 0..40u32 {
            let whole = (100u128 << failure.min(20)).min(5_000);
            let pause = backoff.next_pause().as_millis();
            assert!((whole / 2..=whole).contains(&pause), "{failure}: {pause}");
            assert_eq!(backoff.is_first(), failure == 0);
        }
        let spread: std::collections::BTreeSet<_> = (0..50).map(|_| backoff.next_pause()).collect();
        assert!(spread.len() > 25);
        backoff.reset();
        assert!(backoff.next_pause() <= FIRST);
    }
}
