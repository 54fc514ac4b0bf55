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

    /// Those that are not among others, in memory; `None` if there are none. Like others, those that cannot be looked up
    /// count as not there.
    pub fn without(&self, others: &Self) -> Option<Self> {
        let mut left = None;
        let mut keep = |job| left.get_or_insert_with(|| JobSet::new(None)).insert(job);
        let shown = self.0.for_each(|job| {
            if !others.contains(job) {
                keep(job);
            }
        });
        shown.ok().and(left.map(Self))
    }

    /// Whether this job was asked for.
    pub fn contains(&self, job: JobId) -> bool {
        self.0.contains(job).unwrap_or_default()
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
    fn what_another_has_not_asked_for_is_left_of_names() {
        let (mut names, mut others) = (JobNames::default(), JobNames::default());
        (0..3).for_each(|number| drop(names.next(&task(number))));
        (1..9).for_each(|number| drop(others.next(&task(number))));
        let left = names.without(&others).unwrap();
        assert_eq!(
            [0, 1, 2, 3].map(|number| left.contains(task(number).job(0))),
            [true, false, false, false]
        );
        others.next(&task(0));
        assert!(names.without(&others).is_none());
    }
}
