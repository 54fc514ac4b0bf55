//! How many workers Slurm is asked for, and when it is not asked: a function of what there is to do, of what Slurm says of
//! its jobs, and of the clock.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

/// Failures one after the other after which no worker is asked for for a while.
const FAILURES: u32 = 3;
/// The first such while; each that follows takes twice as long.
const FIRST_PAUSE: Duration = Duration::from_secs(120);
/// The longest one.
const LONGEST_PAUSE: Duration = Duration::from_secs(3600);

/// What Slurm says of one of its jobs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SlurmJob {
    /// Its number, with that in its array: `17_2`.
    pub id: String,
    /// In Slurm's words: `RUNNING`.
    pub state: String,
}

/// What a state means here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Meaning {
    /// It is waiting or at work, or will be again. What Slurm has no word for yet counts as this: rather a worker less than
    /// jobs without end.
    Here,
    /// It has ended as it should, or somebody has ended it.
    Ended,
    /// It has ended, and the next is likely to end as well.
    Failed,
}

impl SlurmJob {
    /// From a line `ID STATE` of `squeue`; `None` if it is no such line.
    pub fn parse(line: &str) -> Option<Self> {
        let (id, state) = line.split_once(' ')?;
        let is_id = id.starts_with(|first: char| first.is_ascii_digit());
        is_id.then(|| Self { id: id.to_owned(), state: state.trim().to_owned() })
    }

    fn meaning(&self) -> Meaning {
        match self.state.as_str() {
            "COMPLETED" | "CANCELLED" | "TIMEOUT" | "PREEMPTED" | "REVOKED" => Meaning::Ended,
            "FAILED" | "BOOT_FAIL" | "NODE_FAIL" | "OUT_OF_MEMORY" | "DEADLINE" | "LAUNCH_FAILED" => {
                Meaning::Failed
            }
            _ => Meaning::Here,
        }
    }
}

/// What is to be done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Decision {
    /// Nothing.
    Wait,
    /// Ask for so many workers.
    Ask(u32),
    /// Nothing for so long, and tell people why.
    Pause(Duration),
}

/// Keeps as many workers as there is work for.
#[derive(Debug)]
pub struct Scaler {
    most: u32,
    threads: u32,
    /// Jobs whose end has been counted.
    ended: BTreeSet<String>,
    /// In a row.
    failures: u32,
    pauses: u32,
    paused_until: Option<Instant>,
}

impl Scaler {
    /// For at most `most` workers of `threads` threads each.
    pub fn new(most: u32, threads: u32) -> Self {
        Self { most, threads, ended: BTreeSet::new(), failures: 0, pauses: 0, paused_until: None }
    }

    /// What to do when the open jobs could keep `wanted` threads busy and Slurm has these jobs, those among them that have
    /// ended a short time ago.
    pub fn decide(&mut self, wanted: u64, jobs: &[SlurmJob], now: Instant) -> Decision {
        for job in jobs {
            let meaning = job.meaning();
            if meaning != Meaning::Here && self.ended.insert(job.id.clone()) {
                match meaning {
                    Meaning::Failed => self.failures += 1,
                    _ => (self.failures, self.pauses) = (0, 0),
                }
            }
        }
        if self.paused_until.is_some_and(|until| now < until) {
            return Decision::Wait;
        }
        if self.failures >= FAILURES {
            return self.pause(now);
        }
        let here = jobs.iter().filter(|job| job.meaning() == Meaning::Here).count() as u64;
        let most = u64::from(self.most);
        let missing = wanted.div_ceil(u64::from(self.threads)).min(most).saturating_sub(here);
        match u32::try_from(missing) {
            Ok(missing) if missing > 0 => Decision::Ask(missing),
            _ => Decision::Wait,
        }
    }

    /// Slurm has refused what it was asked for.
    pub fn refused(&mut self, now: Instant) -> Decision {
        self.failures += 1;
        if self.failures >= FAILURES { self.pause(now) } else { Decision::Wait }
    }

    fn pause(&mut self, now: Instant) -> Decision {
        let pause = FIRST_PAUSE.saturating_mul(1 << self.pauses.min(16)).min(LONGEST_PAUSE);
        self.paused_until = Some(now + pause);
        self.pauses += 1;
        self.failures = FAILURES - 1; // one more after it, and the next pause begins
        Decision::Pause(pause)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn jobs(states: &[(&str, &str)]) -> Vec<SlurmJob> {
        let job = |&(id, state): &(&str, &str)| SlurmJob { id: id.to_owned(), state: state.to_owned() };
        states.iter().map(job).collect()
    }

    #[test]
    fn as_many_are_asked_for_as_there_is_work_for_and_are_not_there() {
        let (mut scaler, now) = (Scaler::new(8, 16), Instant::now());
        assert_eq!(scaler.decide(0, &[], now), Decision::Wait);
        assert_eq!(scaler.decide(1, &[], now), Decision::Ask(1));
        assert_eq!(scaler.decide(33, &jobs(&[("1", "PENDING")]), now), Decision::Ask(2));
        assert_eq!(
            scaler.decide(33, &jobs(&[("1", "RUNNING"), ("2_1", "COMPLETED")]), now),
            Decision::Ask(2)
        );
        assert_eq!(scaler.decide(u64::MAX, &[], now), Decision::Ask(8));
        let full: Vec<_> =
            (0..8).map(|id| SlurmJob { id: id.to_string(), state: "A_NEW_WORD".into() }).collect();
        assert_eq!(scaler.decide(u64::MAX, &full, now), Decision::Wait, "unknown states count as workers");
    }

    #[test]
    fn three_failures_in_a_row_pause_and_each_pause_is_longer_until_one_ends_well() {
        let (mut scaler, now) = (Scaler::new(8, 1), Instant::now());
        let mut failed: Vec<SlurmJob> = Vec::new();
        let mut fail = |scaler: &mut Scaler, now| {
            failed.push(SlurmJob { id: format!("9_{}", failed.len()), state: "FAILED".into() });
            scaler.decide(2, &failed, now)
        };
        assert_eq!(fail(&mut scaler, now), Decision::Ask(2));
        assert_eq!(fail(&mut scaler, now), Decision::Ask(2));
        assert_eq!(fail(&mut scaler, now), Decision::Pause(FIRST_PAUSE));
        assert_eq!(fail(&mut scaler, now), Decision::Wait);
        let later = now + FIRST_PAUSE;
        assert_eq!(
            scaler.decide(2, &[], later),
            Decision::Pause(2 * FIRST_PAUSE),
            "the fourth was not forgotten"
        );
        let later = later + 2 * FIRST_PAUSE;
        assert_eq!(scaler.decide(2, &[], later), Decision::Ask(2), "one more try");
        assert_eq!(scaler.decide(2, &jobs(&[("10", "NODE_FAIL")]), later), Decision::Pause(4 * FIRST_PAUSE));
        let later = later + 4 * FIRST_PAUSE;
        assert_eq!(scaler.decide(2, &jobs(&[("11", "COMPLETED")]), later), Decision::Ask(2));
        assert_eq!(scaler.refused(later), Decision::Wait);
        assert_eq!(scaler.refused(later), Decision::Wait);
        assert_eq!(scaler.refused(later), Decision::Pause(FIRST_PAUSE), "what ended well has ended the row");
    }

    #[test]
    fn only_lines_of_a_job_are_jobs() {
        assert_eq!(SlurmJob::parse("17_2 RUNNING"), Some(jobs(&[("17_2", "RUNNING")]).remove(0)));
        for line in ["", "17", "JOBID STATE", "slurm_load_jobs error: Unable to contact slurm controller"] {
            assert_eq!(SlurmJob::parse(line), None, "{line}");
        }
    }

    proptest! {
        /// Whatever Slurm says, never more workers than were allowed.
        #[test]
        fn never_more_than_allowed(
            most in 1u32..20, threads in 1u32..64, wanted in any::<u64>(),
            states in prop::collection::vec(prop::sample::select(vec!["PENDING", "RUNNING", "COMPLETED", "FAILED", "X"]), 0..30),
        ) {
            let jobs: Vec<_> =
                states.iter().enumerate().map(|(id, state)| SlurmJob { id: id.to_string(), state: (*state).into() }).collect();
            let here = jobs.iter().filter(|job| job.meaning() == Meaning::Here).count() as u32;
            if let Decision::Ask(count) = Scaler::new(most, threads).decide(wanted, &jobs, Instant::now()) {
                prop_assert!(count > 0 && here + count <= most);
            }
        }
    }
}
