//! Which workers fail so often that they get no more jobs for a while.

use std::time::{Duration, Instant};

/// Outcomes that are looked at.
const WINDOW: u32 = 16;
/// Failures before a worker is excluded: one alone may be the job's.
const MIN_FAILURES: u32 = 3;
/// How long a worker is excluded for the first time; each further time twice as long, …
const FIRST_EXCLUSION: Duration = Duration::from_secs(60);
/// … up to this.
const LONGEST_EXCLUSION: Duration = Duration::from_secs(3600);

/// How the last jobs of one worker went.
#[derive(Clone, Debug, Default)]
pub(super) struct Health {
    /// One bit an outcome, the last one lowest: 1 for a failure.
    outcomes: u32,
    count: u32,
    exclusions: u32,
    excluded_until: Option<Instant>,
}

impl Health {
    /// A job went well. After an exclusion nothing of before counts: what was wrong is repaired.
    pub(super) fn succeeded(&mut self) {
        if self.exclusions > 0 && !self.is_excluded() {
            *self = Self::default();
        }
        self.push(0);
    }

    /// A job failed. Returns how long the worker is excluded from now on, if it is: more than half of its last jobs have
    /// failed, and at least three, or one if it comes from an exclusion or if `suspect`, because others of its principal
    /// were excluded.
    pub(super) fn failed(&mut self, suspect: bool, now: Instant) -> Option<Duration> {
        self.push(1);
        let failures = self.outcomes.count_ones();
        let enough = if suspect || self.exclusions > 0 { 1 } else { MIN_FAILURES };
        if failures < enough || 2 * failures <= self.count {
            return None;
        }
        let length = FIRST_EXCLUSION.saturating_mul(1 << self.exclusions.min(16)).min(LONGEST_EXCLUSION);
        self.exclusions += 1;
        self.excluded_until = Some(now + length);
        Some(length)
    }

    /// Whether it gets no jobs.
    pub(super) fn is_excluded(&self) -> bool {
        self.excluded_until.is_some()
    }

    /// Ends an exclusion whose time is over; whether there was one.
    pub(super) fn end_exclusion(&mut self, now: Instant) -> bool {
        self.excluded_until.take_if(|until| *until <= now).is_some()
    }

    fn push(&mut self, outcome: u32) {
        self.outcomes = (self.outcomes << 1 | outcome) & ((1 << WINDOW) - 1);
        self.count = (self.count + 1).min(WINDOW);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_worker_that_fails_more_often_than_not_is_excluded_for_longer_and_longer_until_it_succeeds() {
        let mut now = Instant::now();
        let mut health = Health::default();
        assert_eq!([(); 2].map(|()| health.failed(false, now)), [None, None]);
        assert_eq!(health.failed(false, now), Some(Duration::from_secs(60)));
        assert!(health.is_excluded() && !health.end_exclusion(now));
        for seconds in [120, 240, 480, 960, 1920, 3600, 3600] {
            now += LONGEST_EXCLUSION;
            assert!(health.end_exclusion(now) && !health.is_excluded());
            assert_eq!(health.failed(false, now), Some(Duration::from_secs(seconds)));
        }
        now += LONGEST_EXCLUSION;
        assert!(health.end_exclusion(now));
        health.succeeded();
        assert_eq!([(); 2].map(|()| health.failed(false, now)), [None, None]);
    }

    #[test]
    fn one_that_fails_now_and_then_goes_on() {
        let (mut health, now) = (Health::default(), Instant::now());
        for _ in 0..100 {
            health.succeeded();
            assert_eq!(health.failed(false, now), None);
        }
        let excluded = (0..WINDOW).find(|_| health.failed(false, now).is_some());
        assert_eq!(excluded, Some(0), "it was half of them already");
    }

    #[test]
    fn whose_principal_was_excluded_has_one_try() {
        let now = Instant::now();
        assert!(Health::default().failed(true, now).is_some());
        let mut health = Health::default();
        health.succeeded();
        assert_eq!(health.failed(true, now), None);
    }
}
