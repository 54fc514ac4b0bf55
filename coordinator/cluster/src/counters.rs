//! What a cluster counts and times for those who watch it: plain numbers, kept under locks that are held anyway.

use std::collections::BTreeMap;

use proto::task::TaskKind;

use crate::events::{Departure, EventKind};

/// Every way in which an attempt ends, as [`AttemptEnd::as_str`](crate::events::AttemptEnd::as_str) has it.
pub const OUTCOMES: [&str; 14] = [
    "answered",
    "agreed",
    "disagreed",
    "late",
    "failed",
    "overdue",
    "undelivered",
    "revoked",
    "left",
    "lost",
    "quarantined",
    "denied",
    "displaced",
    "dropped",
];

/// Every way in which a worker goes.
pub const DEPARTURES: [Departure; 5] =
    [Departure::Left, Departure::Lost, Departure::Quarantined, Departure::Denied, Departure::Displaced];

/// Upper bounds of the buckets of a histogram, seconds; one more has no bound.
const BOUNDS: [f64; 14] =
    [0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0];

/// How long something took, each time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Histogram {
    counts: [u64; BOUNDS.len() + 1],
    sum: f64,
}

impl Histogram {
    /// Counts a time in seconds. A worker may report anything: what cannot be a time counts as none.
    pub fn observe(&mut self, seconds: f64) {
        let seconds = if seconds.is_finite() { seconds.max(0.0) } else { 0.0 };
        self.counts[BOUNDS.partition_point(|bound| *bound < seconds)] += 1;
        self.sum += seconds;
    }

    /// The upper bound of each bucket, seconds, with how many times fell into it and not into one before. The last bound
    /// is infinite.
    pub fn buckets(&self) -> impl Iterator<Item = (f64, u64)> {
        BOUNDS.into_iter().chain([f64::INFINITY]).zip(self.counts)
    }

    /// How many times.
    pub fn count(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Their sum, seconds.
    pub fn sum(&self) -> f64 {
        self.sum
    }
}

/// What has happened since this start of the coordinator.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Counters {
    /// Leases that were granted, and those that workers kept while the coordinator was started again.
    pub leases: BTreeMap<TaskKind, u64>,
    /// Attempts that ended, by how.
    pub attempts: BTreeMap<(TaskKind, &'static str), u64>,
    /// Seconds on the workers' clocks, of attempts that were reported.
    pub run_times: BTreeMap<TaskKind, Histogram>,
    /// Seconds from the submission of a job to its first lease.
    pub queue_times: Histogram,
    /// Jobs that a second principal has to answer as well.
    pub audits: u64,
    /// Jobs of which two principals gave the same result.
    pub agreements: u64,
    /// Jobs of which results differed.
    pub disagreements: u64,
    /// Workers that joined.
    pub joined: u64,
    /// Workers that went, by [`Departure::as_str`].
    pub departed: BTreeMap<&'static str, u64>,
    /// How often a worker was excluded for a while because it failed.
    pub exclusions: u64,
    /// Workers that were not registered, by [`RegisterRefusal::as_str`](crate::scheduler::RegisterRefusal::as_str).
    pub refused: BTreeMap<&'static str, u64>,
}

impl Counters {
    /// Counts an attempt that has ended, with its seconds on the worker's clock, if it was reported.
    pub fn attempt_ended(&mut self, kind: TaskKind, end: &'static str, run_seconds: Option<f64>) {
        *self.attempts.entry((kind, end)).or_default() += 1;
        if let Some(seconds) = run_seconds {
            self.run_times.entry(kind).or_default().observe(seconds);
        }
    }

    /// Counts what else has happened.
    pub fn note(&mut self, event: &EventKind) {
        match event {
            EventKind::Joined { .. } => self.joined += 1,
            EventKind::Departed { departure, .. } => {
                *self.departed.entry(departure.as_str()).or_default() += 1;
            }
            EventKind::Disagreement { .. } => self.disagreements += 1,
            EventKind::Excluded { .. } => self.exclusions += 1,
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::events::AttemptEnd;

    #[test]
    fn a_time_falls_into_the_first_bucket_that_is_not_below_it() {
        let mut histogram = Histogram::default();
        for seconds in [0.0, 0.001, 0.0011, 3000.0, 3000.1, f64::NAN, f64::INFINITY, -1.0] {
            histogram.observe(seconds);
        }
        let buckets: Vec<(f64, u64)> = histogram.buckets().filter(|(_, count)| *count > 0).collect();
        assert_eq!(buckets, [(0.001, 5), (0.003, 1), (3000.0, 1), (f64::INFINITY, 1)]);
        assert_eq!((histogram.count(), histogram.sum()), (8, 0.001 + 0.0011 + 3000.0 + 3000.1));
    }

    #[test]
    fn every_end_of_an_attempt_is_listed_once() {
        let next = |end: Option<AttemptEnd>| match end {
            None => Some(AttemptEnd::Answered),
            Some(AttemptEnd::Answered) => Some(AttemptEnd::Agreed),
            Some(AttemptEnd::Agreed) => Some(AttemptEnd::Disagreed),
            Some(AttemptEnd::Disagreed) => Some(AttemptEnd::Late),
            Some(AttemptEnd::Late) => Some(AttemptEnd::Failed(String::new())),
            Some(AttemptEnd::Failed(_)) => Some(AttemptEnd::Overdue),
            Some(AttemptEnd::Overdue) => Some(AttemptEnd::Undelivered),
            Some(AttemptEnd::Undelivered) => Some(AttemptEnd::Revoked),
            Some(AttemptEnd::Revoked) => Some(AttemptEnd::Gone(Departure::Left)),
            Some(AttemptEnd::Gone(departure)) => Some(match departure {
                Departure::Left => AttemptEnd::Gone(Departure::Lost),
                Departure::Lost => AttemptEnd::Gone(Departure::Quarantined),
                Departure::Quarantined => AttemptEnd::Gone(Departure::Denied),
                Departure::Denied => AttemptEnd::Gone(Departure::Displaced),
                Departure::Displaced => AttemptEnd::Dropped,
            }),
            Some(AttemptEnd::Dropped) => None,
        };
        let (mut words, mut end) = (Vec::new(), next(None));
        while let Some(one) = end {
            words.push(one.as_str());
            end = next(Some(one));
        }
        assert_eq!(words, OUTCOMES);
        assert_eq!(DEPARTURES.map(Departure::as_str), OUTCOMES[8..13]);
    }
}
