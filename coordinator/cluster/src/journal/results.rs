//! The accepted results that a journal has: memory holds who gave each and where in the file it stands, as there may be
//! millions, most of which are asked for once.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;
use std::sync::Arc;

use proto::journal::{AcceptedResult, Assurance};
use proto::{JobId, Principal, WorkerId};

use super::Entry;
use super::frame::{Key, framed};
use super::records::{Record, decode};
use crate::store::Grounds;

/// Who gave a result, and why it is believed.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Attribution {
    /// The worker that gave it.
    pub worker_id: WorkerId,
    /// Its label.
    pub worker: String,
    /// On whose word the result rests.
    pub grounds: Grounds,
}

/// Accepted results, by job.
#[derive(Default)]
pub struct RecordedResults {
    source: Source,
    kept: BTreeMap<JobId, Kept>,
    /// By the numbers that stand beside results.
    attributions: Vec<Arc<Attribution>>,
    numbers: BTreeMap<Arc<Attribution>, u32>,
}

/// Where the record of a result begins, how long its payload is, and the number of its attribution.
struct Kept {
    place: u64,
    payload: u32,
    attribution: u32,
}

/// A journal's file, which only grows, and records that are to follow on what it had.
struct Source {
    key: Key,
    /// None: nothing but the records that are to follow.
    file: Option<File>,
    length: u64,
    following: Vec<u8>,
}

impl Default for Source {
    fn default() -> Self {
        Self { key: Key([0; 32]), file: None, length: 0, following: Vec::new() }
    }
}

impl Source {
    /// The payload of the record at a place.
    fn read(&self, place: u64, payload: u32) -> io::Result<Vec<u8>> {
        let length = framed(payload as usize);
        let damaged = || io::Error::other(format!("no sound record at byte {place}"));
        let mut record = vec![0; length];
        match (&self.file, place.checked_sub(self.length)) {
            (Some(file), None) => file.read_exact_at(&mut record, place)?,
            (_, start) => {
                let following = start.and_then(|start| self.following.get(start as usize..)?.get(..length));
                record.copy_from_slice(following.ok_or_else(damaged)?);
            }
        }
        let (_, payload) = self.key.first_record(&record, place).ok_or_else(damaged)?;
        Ok(payload.to_vec())
    }

    /// Puts a record behind all others; returns where it is.
    fn append(&mut self, payload: &[u8]) -> u64 {
        let place = self.length + self.following.len() as u64;
        self.key.append(&mut self.following, self.length, 0, payload);
        place
    }
}

impl RecordedResults {
    /// None yet, of a file whose records have this key.
    pub(super) fn of(key: Key, file: File) -> io::Result<Self> {
        let length = file.metadata()?.len();
        Ok(Self {
            source: Source { key, file: Some(file), length, following: Vec::new() },
            ..Self::default()
        })
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.kept.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }

    /// Whether there is one of this job.
    pub fn contains(&self, job: JobId) -> bool {
        self.kept.contains_key(&job)
    }

    /// The jobs that have one, sorted.
    pub fn jobs(&self) -> impl Iterator<Item = JobId> {
        self.kept.keys().copied()
    }

    /// Those who gave them, each with how many of them.
    pub fn attributions(&self) -> impl Iterator<Item = (&Attribution, usize)> {
        let mut results = vec![0; self.attributions.len()];
        self.kept.values().for_each(|kept| results[kept.attribution as usize] += 1);
        self.attributions
            .iter()
            .map(|attribution| &**attribution)
            .zip(results)
            .filter(|(_, results)| *results > 0)
    }

    /// Adds the result of a job, or puts it in the place of the one that is there. Its record stands in the file, with a
    /// payload of so many bytes.
    pub(super) fn insert(&mut self, job: JobId, accepted: &AcceptedResult, (place, payload): (u64, usize)) {
        let attribution = self.number(Attribution {
            worker_id: accepted.worker_id,
            worker: accepted.worker.clone(),
            grounds: Grounds::of_accepted(accepted),
        });
        self.kept.insert(job, Kept { place, payload: payload as u32, attribution });
    }

    /// Keeps the payload of a record that is not in the file yet; returns where it stands then.
    pub(super) fn append(&mut self, payload: &[u8]) -> (u64, usize) {
        (self.source.append(payload), payload.len())
    }

    fn number(&mut self, attribution: Attribution) -> u32 {
        if let Some(number) = self.numbers.get(&attribution) {
            return *number;
        }
        let (attribution, number) = (Arc::new(attribution), self.attributions.len() as u32);
        self.attributions.push(Arc::clone(&attribution));
        self.numbers.insert(attribution, number);
        number
    }

    /// Notes why the result of a job is believed by now, and another principal that gave it.
    pub(super) fn assure(&mut self, job: JobId, assurance: Assurance, seconded: Option<Principal>) {
        let Some(number) = self.kept.get(&job).map(|kept| kept.attribution) else { return };
        let attribution = Attribution::clone(&self.attributions[number as usize]);
        let grounds = Grounds { assurance, seconded, ..attribution.grounds };
        let number = self.number(Attribution { grounds, ..attribution });
        if let Some(kept) = self.kept.get_mut(&job) {
            kept.attribution = number;
        }
    }

    /// Drops the result of a job; whether there was one.
    pub fn remove(&mut self, job: JobId) -> bool {
        self.kept.remove(&job).is_some()
    }

    /// Drops the results that rest on a principal's word; returns their jobs, sorted.
    pub fn remove_resting_on(&mut self, principal: Principal) -> Vec<JobId> {
        let attributions = &self.attributions;
        let rests_on =
            |_: &JobId, kept: &mut Kept| attributions[kept.attribution as usize].grounds.rest_on(principal);
        self.kept.extract_if(.., rests_on).map(|(job, _)| job).collect()
    }

    /// The result of a job, if there is one.
    ///
    /// # Errors
    /// If it cannot be read any more.
    pub fn get(&self, job: JobId) -> io::Result<Option<AcceptedResult>> {
        self.kept.get(&job).map(|kept| self.read(kept)).transpose()
    }

    fn read(&self, &Kept { place, payload, attribution }: &Kept) -> io::Result<AcceptedResult> {
        match decode(&self.source.read(place, payload)?) {
            Some(Record::Entry(Entry::Accepted(_, accepted))) => {
                let Grounds { seconded, assurance, .. } = self.attributions[attribution as usize].grounds;
                Ok(AcceptedResult { seconded, assurance, ..*accepted })
            }
            _ => Err(io::Error::other(format!("no result at byte {place}"))),
        }
    }

    /// Shows all of them to `see`, as they follow in the file.
    ///
    /// # Errors
    /// Those of `see`, and if one cannot be read any more.
    pub(super) fn for_each(
        &self,
        mut see: impl FnMut(JobId, AcceptedResult) -> io::Result<()>,
    ) -> io::Result<()> {
        let mut in_file: Vec<_> = self.kept.iter().collect();
        in_file.sort_unstable_by_key(|(_, kept)| kept.place);
        in_file.into_iter().try_for_each(|(job, kept)| see(*job, self.read(kept)?))
    }
}

impl std::fmt::Debug for RecordedResults {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_set().entries(self.kept.keys()).finish()
    }
}

#[cfg(test)]
impl RecordedResults {
    /// All of them.
    pub fn all(&self) -> BTreeMap<JobId, Box<AcceptedResult>> {
        self.jobs().map(|job| (job, Box::new(self.get(job).unwrap().unwrap()))).collect()
    }
}

#[cfg(test)]
impl PartialEq for RecordedResults {
    fn eq(&self, other: &Self) -> bool {
        self.all() == other.all()
    }
}

#[cfg(test)]
impl FromIterator<(JobId, Box<AcceptedResult>)> for RecordedResults {
    fn from_iter<I: IntoIterator<Item = (JobId, Box<AcceptedResult>)>>(results: I) -> Self {
        let mut recorded = Self::default();
        recorded.extend(results);
        recorded
    }
}

#[cfg(test)]
impl Extend<(JobId, Box<AcceptedResult>)> for RecordedResults {
    fn extend<I: IntoIterator<Item = (JobId, Box<AcceptedResult>)>>(&mut self, results: I) {
        for (job, accepted) in results {
            let record = super::records::encode(&Entry::Accepted(job, accepted.clone())).unwrap();
            let place = self.append(&record);
            self.insert(job, &accepted, place);
        }
    }
}
