//! When a worker leaves of its own accord: at the end of its lifetime, or after too long without a job.

use std::fmt;
use std::time::{Duration, Instant};

/// What a worker may use of the time for which it has its allocation.
#[derive(Clone, Copy, Debug, Default)]
pub struct LifetimeLimits {
    /// From its start to the moment at which it has left; `None`: no end.
    pub lifetime: Option<Duration>,
    /// How long before that it may begin to take no more jobs.
    pub stagger: Duration,
    /// How long it may be without a job; `None`: for ever.
    pub idle: Option<Duration>,
}

/// Why a worker left that did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leaving {
    /// It was told to stop.
    Stopped,
    /// The run has ended.
    RunEnded,
    /// It had no job for too long.
    Idle,
    /// Its lifetime was over.
    Lifetime,
}

impl fmt::Display for Leaving {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Stopped => "told to stop",
            Self::RunEnded => "the run has ended",
            Self::Idle => "no job for --idle-timeout",
            Self::Lifetime => "the end of --lifetime",
        })
    }
}

/// What a worker may do at a moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Take jobs.
    Working,
    /// End the job in hand, and take no more.
    Ending,
    /// Leave, with a job in hand or not.
    Over(Leaving),
}

/// The lifetime of one worker, as a function of the clock that it is given.
#[derive(Debug)]
pub struct Lifetime {
    ending: Option<Instant>,
    over: Option<Instant>,
    idle: Option<Duration>,
    /// When it last had a job.
    last_job: Instant,
}

impl Lifetime {
    /// Begins now. `share`, from 0 to 1, says how much of the stagger is used: workers that were started together must not
    /// all leave at once.
    pub fn new(limits: LifetimeLimits, share: f64, now: Instant) -> Self {
        let over = limits.lifetime.and_then(|lifetime| now.checked_add(lifetime));
        let early = limits.stagger.mul_f64(share.clamp(0.0, 1.0));
        let ending = over.map(|over| over.checked_sub(early).map_or(now, |ending| ending.max(now)));
        Self { ending, over, idle: limits.idle, last_job: now }
    }

    /// The worker has ended a job: short ones come and go between two looks at the stage.
    pub fn note_job(&mut self, now: Instant) {
        self.last_job = now;
    }

    /// What the worker may do now, with a job in hand or without.
    pub fn stage(&mut self, is_busy: bool, now: Instant) -> Stage {
        if is_busy {
            self.last_job = now;
        }
        let is_past = |moment: Option<Instant>| moment.is_some_and(|moment| now >= moment);
        match () {
            () if is_past(self.over) => Stage::Over(Leaving::Lifetime),
            () if is_past(self.ending) && !is_busy => Stage::Over(Leaving::Lifetime),
            () if is_past(self.ending) => Stage::Ending,
            () if !is_busy && is_past(self.too_idle()) => Stage::Over(Leaving::Idle),
            () => Stage::Working,
        }
    }

    /// When the stage changes next if nothing happens; `None`: never.
    pub fn next_change(&self, is_busy: bool, now: Instant) -> Option<Instant> {
        let idle = if is_busy { None } else { self.too_idle() };
        [self.ending, self.over, idle].into_iter().flatten().filter(|moment| *moment > now).min()
    }

    fn too_idle(&self) -> Option<Instant> {
        self.idle.and_then(|idle| self.last_job.checked_add(idle))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn seconds(seconds: u64) -> Duration {
        Duration::from_secs(seconds)
    }

    #[test]
    fn a_worker_without_limits_works_for_ever() {
        let now = Instant::now();
        let mut lifetime = Lifetime::new(LifetimeLimits::default(), 0.5, now);
        assert_eq!(lifetime.stage(false, now + seconds(1 << 30)), Stage::Working);
        assert_eq!(lifetime.next_change(false, now), None);
        // What no clock reaches is no limit, and no panic.
        let most = LifetimeLimits {
            lifetime: Some(Duration::MAX),
            stagger: seconds(u64::MAX / 4),
            idle: Some(Duration::MAX),
        };
        let mut lifetime = Lifetime::new(most, 1.0, now);
        assert_eq!(lifetime.stage(false, now + seconds(1 << 30)), Stage::Working);
    }

    #[test]
    fn a_job_in_hand_may_end_within_the_stagger_and_no_later() {
        let start = Instant::now();
        let limits = LifetimeLimits { lifetime: Some(seconds(100)), stagger: seconds(20), idle: None };
        let mut lifetime = Lifetime::new(limits, 0.5, start);
        assert_eq!(lifetime.next_change(true, start), Some(start + seconds(90)));
        assert_eq!(lifetime.stage(true, start + seconds(89)), Stage::Working);
        assert_eq!(lifetime.stage(true, start + seconds(90)), Stage::Ending);
        assert_eq!(lifetime.next_change(true, start + seconds(90)), Some(start + seconds(100)));
        assert_eq!(lifetime.stage(false, start + seconds(91)), Stage::Over(Leaving::Lifetime));
        assert_eq!(lifetime.stage(true, start + seconds(100)), Stage::Over(Leaving::Lifetime));
    }

    #[test]
    fn workers_started_together_leave_one_after_the_other() {
        let start = Instant::now();
        let limits = LifetimeLimits { lifetime: Some(seconds(100)), stagger: seconds(40), idle: None };
        for (share, seconds_left) in [(0.0, 100), (0.25, 90), (1.0, 60)] {
            let lifetime = Lifetime::new(limits, share, start);
            assert_eq!(lifetime.next_change(true, start), Some(start + seconds(seconds_left)), "{share}");
        }
        // A stagger longer than the lifetime cannot begin before the start.
        let long = LifetimeLimits { stagger: seconds(400), ..limits };
        assert_eq!(Lifetime::new(long, 1.0, start).stage(true, start), Stage::Ending);
    }

    #[test]
    fn without_a_job_for_too_long_it_leaves_and_a_job_begins_the_wait_anew() {
        let start = Instant::now();
        let limits = LifetimeLimits { idle: Some(seconds(10)), ..LifetimeLimits::default() };
        let mut lifetime = Lifetime::new(limits, 0.0, start);
        assert_eq!(lifetime.next_change(false, start), Some(start + seconds(10)));
        assert_eq!(lifetime.stage(false, start + seconds(9)), Stage::Working);
        assert_eq!(lifetime.stage(true, start + seconds(50)), Stage::Working);
        assert_eq!(lifetime.next_change(true, start + seconds(50)), None);
        assert_eq!(lifetime.stage(false, start + seconds(59)), Stage::Working);
        lifetime.note_job(start + seconds(59));
        assert_eq!(lifetime.stage(false, start + seconds(68)), Stage::Working);
        assert_eq!(lifetime.stage(false, start + seconds(69)), Stage::Over(Leaving::Idle));
    }
}
