//! A set of jobs whose memory is bounded: a long run has millions of them.

use std::path::Path;

use proto::JobId;

use crate::spill::{SpillError, SpillMap};

/// A set of jobs of which memory holds a part.
#[derive(Debug)]
pub struct JobSet(SpillMap);

impl JobSet {
    /// An empty set, whose file is made in this directory when it is needed; without a directory it stays in memory.
    pub fn new(directory: Option<&Path>) -> Self {
        Self(SpillMap::new(directory))
    }

    #[cfg(test)]
    pub(crate) fn of(map: SpillMap) -> Self {
        Self(map)
    }

    /// Why some of it cannot be looked up any more, if so.
    pub fn failure(&self) -> Option<&SpillError> {
        self.0.failure()
    }

    /// Whether a job is in it.
    ///
    /// # Errors
    /// If that cannot be looked up any more.
    pub fn contains(&self, job: JobId) -> Result<bool, SpillError> {
        self.0.contains(&key_of(job))
    }

    /// Adds a job.
    pub fn insert(&mut self, job: JobId) {
        self.0.insert(&key_of(job), Vec::new());
    }

    /// Adds many jobs, best sorted, while nobody waits.
    pub fn extend(&mut self, jobs: impl IntoIterator<Item = JobId>) {
        self.0.extend(jobs.into_iter().map(|job| (key_of(job), Vec::new())));
    }

    /// Shows all jobs to `see`, in no order of meaning.
    ///
    /// # Errors
    /// If it cannot be read any more: then not all were shown.
    pub fn for_each(&self, mut see: impl FnMut(JobId)) -> Result<(), SpillError> {
        self.0.for_each(|key, _| match key.first_chunk() {
            Some(key) => see(JobId(u64::from_be_bytes(*key))),
            None => unreachable!("a key that was made here has eight bytes"),
        })
    }
}

/// Jobs in the order of their numbers.
pub(crate) fn key_of(job: JobId) -> [u8; 8] {
    job.0.to_be_bytes()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn a_job_that_has_left_memory_is_still_in_the_set() {
        let directory = tempfile::tempdir().unwrap();
        let mut set = JobSet::of(SpillMap::with(Some(directory.path().to_owned()), 1000));
        let jobs: BTreeSet<JobId> =
            (1..=2000u64).map(|number| JobId(number.wrapping_mul(0x9e37_79b9_7f4a_7c15))).collect();
        for job in jobs.iter().take(1000) {
            assert_eq!(set.contains(*job), Ok(false));
            set.insert(*job);
            set.insert(*job); // adds nothing
        }
        set.extend(jobs.iter().skip(500).copied());
        assert!(jobs.iter().all(|job| set.contains(*job) == Ok(true)));
        let mut shown = Vec::new();
        set.for_each(|job| shown.push(job)).unwrap();
        shown.sort_unstable();
        assert_eq!(shown, Vec::from_iter(jobs));
        assert_eq!(set.failure(), None);
    }
}
