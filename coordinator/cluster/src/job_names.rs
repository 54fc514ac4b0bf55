//! The names of the jobs that one client has asked for.

use std::path::Path;

use proto::JobId;
use proto::task::Task;

use crate::job_set::JobSet;
use crate::spill::SpillError;
#[cfg(test)]
use crate::spill::SpillMap;

/// The names of all jobs that one client has asked for.
#[derive(Debug)]
pub struct JobNames(JobSet);

#[cfg(test)]
impl Default for JobNames {
    fn default() -> Self {
        Self::new(None)
    }
}

impl JobNames {
    /// None yet. What outgrows memory goes to a file in this directory, if there is one.
    pub fn new(spill: Option<&Path>) -> Self {
        Self(JobSet::new(spill))
    }

    #[cfg(test)]
    pub(crate) fn of(map: SpillMap) -> Self {
        Self(JobSet::of(map))
    }

    /// Why some of them cannot be looked up any more, if so. From then on, a name that cannot be looked up counts as not
    /// there: ask this before anything is written that rests on it.
    pub fn failure(&self) -> Option<&SpillError> {
        self.0.failure()
    }

    /// Names the next job that asks for this task: equal for all who ask for the same as often, and in every start of
    /// a run.
    pub fn next(&mut self, task: &Task) -> JobId {
        let mut occurrence = 0;
        loop {
            let job = task.job(occurrence);
            if !self.contains(job) {
                self.0.insert(job);
                return job;
            }
            occurrence += 1;
        }
    }

    /// Whether this job was asked for.
    pub fn contains(&self, job: JobId) -> bool {
        self.0.contains(job).unwrap_or_default()
    }

    /// Adds those of another that are not among `except`.
    ///
    /// # Errors
    /// If the others cannot be read any more.
    pub fn add(&mut self, others: &Self, except: &Self) -> Result<(), SpillError> {
        others.0.for_each(|job| {
            if !except.contains(job) {
                self.0.insert(job);
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering;

    use proto::task::Evaluation;

    use super::*;
    use crate::spill::tests::on_failing_disk;

    fn task(number: u32) -> Task {
        Task::Evaluation(Evaluation::sample(number, 9, 9))
    }

    #[test]
    fn a_task_that_is_asked_for_again_has_another_name_though_the_first_has_left_memory() {
        let (disk, fails) = on_failing_disk();
        let mut names = JobNames::of(disk);
        for occurrence in 0..3 {
            for number in 0..200 {
                assert_eq!(names.next(&task(number)), task(number).job(occurrence));
            }
        }
        assert_eq!(names.failure(), None);
        fails.store(true, Ordering::Relaxed);
        assert!((0..200).any(|number| !names.contains(task(number).job(0))), "some are on the disk only");
        assert!(names.failure().is_some());
    }

    #[test]
    fn names_of_another_are_added_unless_they_are_known() {
        let [mut names, mut known, mut others] = <[JobNames; 3]>::default();
        for number in 0..3 {
            others.next(&task(number));
        }
        for number in 1..9 {
            known.next(&task(number));
        }
        names.add(&others, &known).unwrap();
        assert_eq!(
            [0, 1, 2, 3].map(|number| names.contains(task(number).job(0))),
            [true, false, false, false]
        );
    }
}
