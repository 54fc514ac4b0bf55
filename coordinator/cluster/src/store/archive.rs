//! Accepted results in little memory: tasks and results as bytes, many of them compressed together, most of them in a file.
//!
//! Any of them may have to be checked again, so none is dropped before the run ends.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};

use proto::journal::{AcceptedResult, Assurance};
use proto::task::Task;
use proto::{Compressed, JobId, Principal};

use crate::job_set::key_of;
use crate::scheduler::messages::Finished;
use crate::spill::{SpillError, SpillMap};

/// Most bytes of records that are compressed together, unless one has more. More would take a little less memory, but
/// longer to read: whoever wants one record decompresses all of its block.
const BLOCK_BYTES: usize = 32 << 10;

/// Accepted results, one a job.
pub(super) struct Archive {
    /// Where the last record of each job is.
    places: SpillMap,
    /// Full blocks by their numbers, from 0 on.
    full: SpillMap,
    /// How many there are.
    blocks: u32,
    /// Where records are that others have replaced.
    replaced: SpillMap,
    /// The records of the block that is being filled.
    filling: Vec<u8>,
    /// The block that was read last, decompressed: a search that begins again asks for results in about the order in which
    /// they came.
    read_last: Option<(u32, Vec<u8>)>,
    /// Grounds of results, by the numbers that stand in records, and how many results have them.
    grounds: Vec<(Grounds, usize)>,
    numbers: BTreeMap<Grounds, usize>,
}

/// Where a record begins.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Place {
    block: u32,
    start: u32,
}

/// On whose word an accepted result rests.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Grounds {
    /// Who gave it.
    pub principal: Principal,
    /// Another principal that gave the same.
    pub seconded: Option<Principal>,
    /// Why their word is believed.
    pub assurance: Assurance,
}

/// Some of the results, as they were when they were taken out.
pub struct Part {
    bytes: Vec<u8>,
    /// Where the records begin that count, and their grounds.
    records: Vec<(usize, Grounds)>,
}

/// A task and its accepted result, as bytes.
pub struct Record<'a> {
    /// The job.
    pub job: JobId,
    /// On whose word the result rests: who looks at all results for that need not decode them.
    pub grounds: Grounds,
    task: &'a [u8],
    accepted: &'a [u8],
}

impl Grounds {
    /// Those of an accepted result.
    pub fn of<R>(finished: &Finished<R>) -> Self {
        let Finished { principal, seconded, assurance, .. } = *finished;
        Self { principal, seconded, assurance }
    }

    /// Those of what is kept of an accepted result.
    pub fn of_accepted(accepted: &AcceptedResult) -> Self {
        let AcceptedResult { principal, seconded, assurance, .. } = *accepted;
        Self { principal, seconded, assurance }
    }

    /// Whether a result is believed on the word of this principal.
    pub fn rest_on(&self, principal: Principal) -> bool {
        let is_own = self.assurance == Assurance::Own && principal != Principal::Coordinator;
        !is_own && (self.principal == principal || self.seconded == Some(principal))
    }
}

impl Record<'_> {
    /// The task.
    pub fn task(&self) -> Task {
        Task::from_bytes(self.task)
            .unwrap_or_else(|error| unreachable!("a task that was encoded here: {error}"))
    }

    /// What is kept of the result.
    pub fn finished(&self) -> Finished {
        let accepted = AcceptedResult::decode(self.accepted)
            .unwrap_or_else(|| unreachable!("a result that was encoded here"));
        Finished::recorded(self.job, accepted)
    }
}

impl Place {
    /// In the order of places.
    fn to_bytes(self) -> Vec<u8> {
        [self.block.to_be_bytes(), self.start.to_be_bytes()].concat()
    }

    fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (block, start) = bytes.split_first_chunk()?;
        let [block, start] = [*block, *start.first_chunk()?].map(u32::from_be_bytes);
        Some(Self { block, start })
    }
}

impl Archive {
    /// An empty archive of three maps.
    pub(super) fn new([places, full, replaced]: [SpillMap; 3]) -> Self {
        Self {
            places,
            full,
            blocks: 0,
            replaced,
            filling: Vec::new(),
            read_last: None,
            grounds: Vec::new(),
            numbers: BTreeMap::new(),
        }
    }

    /// Why some of it cannot be read any more, if so. From then on, what cannot be read counts as not there: ask this
    /// before anything is written that rests on what was looked up here.
    pub(super) fn failure(&self) -> Option<&SpillError> {
        [&self.places, &self.full, &self.replaced].into_iter().find_map(SpillMap::failure)
    }

    /// Keeps the result of a job instead of the one that is there. Returns whether anything is kept of such a result.
    pub(super) fn replace(&mut self, task: &Task, finished: &Finished) -> bool {
        let before = self.place(finished.job);
        let grounds = before.and_then(|before| self.record(before)).map(|record| record.grounds);
        let is_kept = self.insert(task, finished);
        if let Some(before) = before.filter(|_| is_kept) {
            self.replaced.insert(&before.to_bytes(), Vec::new());
            if let Some(grounds) = grounds {
                let number = self.number(grounds);
                self.grounds[number].1 -= 1;
            }
        }
        is_kept
    }

    /// Keeps the first result of a job. Returns whether anything is kept of such a result.
    pub(super) fn insert(&mut self, task: &Task, finished: &Finished) -> bool {
        let Some(accepted) = finished.kept().and_then(|accepted| accepted.encode()) else { return false };
        let number = self.number(Grounds::of(finished));
        self.grounds[number].1 += 1;
        let grounds = (number as u32).to_le_bytes();
        let task = task.to_bytes();
        let [task_length, accepted_length] = [&task, &accepted].map(|part| (part.len() as u32).to_le_bytes());
        let job = finished.job.0.to_le_bytes();
        let record = [&job[..], &grounds, &task_length, &task, &accepted_length, &accepted].concat();
        if self.filling.len() + record.len() > BLOCK_BYTES {
            self.close_block();
        }
        let place = Place { block: self.blocks, start: self.filling.len() as u32 };
        self.filling.extend_from_slice(&record);
        self.places.insert(&key_of(finished.job), place.to_bytes());
        true
    }

    fn number(&mut self, grounds: Grounds) -> usize {
        *self.numbers.entry(grounds).or_insert_with(|| {
            self.grounds.push((grounds, 0));
            self.grounds.len() - 1
        })
    }

    /// The grounds that some result has.
    pub(super) fn grounds(&self) -> impl Iterator<Item = Grounds> {
        self.grounds.iter().filter(|(_, results)| *results > 0).map(|(grounds, _)| *grounds)
    }

    fn close_block(&mut self) {
        if !self.filling.is_empty()
            && let Some(block) = Compressed::new(&self.filling)
        {
            let bytes = [&block.length().to_le_bytes(), block.block()].concat();
            self.full.insert(&self.blocks.to_be_bytes(), bytes);
            self.blocks += 1;
            self.filling.clear();
            self.filling.shrink_to(BLOCK_BYTES);
        }
    }

    /// Whether there is a result of a job.
    pub(super) fn contains(&self, job: JobId) -> bool {
        self.places.contains(&key_of(job)).unwrap_or_default()
    }

    /// Where the last record of a job is.
    fn place(&self, job: JobId) -> Option<Place> {
        Place::from_bytes(&self.places.get(&key_of(job)).ok()??)
    }

    /// A full block, decompressed; `None` if there is none of this number, or it cannot be read any more.
    fn full_block(&self, number: u32) -> Option<Vec<u8>> {
        let bytes = self.full.get(&number.to_be_bytes()).ok()??;
        let (length, block) = bytes.split_first_chunk()?;
        let block = Compressed::of_block(block.to_vec(), u32::from_le_bytes(*length));
        let decompressed = block.decompress();
        Some(decompressed.unwrap_or_else(|error| unreachable!("a block that was compressed here: {error}")))
    }

    /// The result of a job, if there is one, with its task.
    pub(super) fn get(&mut self, job: JobId) -> Option<(Task, Finished)> {
        let place = self.place(job)?;
        self.record(place).map(|record| (record.task(), record.finished()))
    }

    /// The record at a place.
    fn record(&mut self, Place { block, start }: Place) -> Option<Record<'_>> {
        if block < self.blocks && self.read_last.as_ref().is_none_or(|(last, _)| *last != block) {
            self.read_last = Some((block, self.full_block(block)?));
        }
        let bytes = match &self.read_last {
            Some((last, bytes)) if *last == block => bytes,
            _ => &self.filling,
        };
        self.first_record(&bytes[start as usize..]).map(|(record, _)| record)
    }

    /// The results of those of some jobs whose tasks are wanted, by job.
    pub(super) fn select(
        &self,
        jobs: &BTreeSet<JobId>,
        is_wanted: impl Fn(&Task) -> bool,
    ) -> BTreeMap<JobId, (Task, Finished)> {
        let mut places: Vec<Place> = jobs.iter().filter_map(|job| self.place(*job)).collect();
        places.sort_unstable();
        let mut selected = BTreeMap::new();
        for of_block in places.chunk_by(|one, next| one.block == next.block) {
            let number = of_block[0].block;
            let full = (number < self.blocks).then(|| self.full_block(number).unwrap_or_default());
            let bytes = full.as_ref().unwrap_or(&self.filling);
            for place in of_block {
                let Some((record, _)) =
                    bytes.get(place.start as usize..).and_then(|bytes| self.first_record(bytes))
                else {
                    continue;
                };
                let task = record.task();
                if is_wanted(&task) {
                    selected.insert(record.job, (task, record.finished()));
                }
            }
        }
        selected
    }

    /// The results of one block, those that others have replaced left out; `None` after the last. Whoever takes block after
    /// block sees every job that has a result when the first is taken: one that is replaced meanwhile stands in its old block
    /// or a later one, or in both.
    pub(super) fn part(&self, number: u32) -> Option<Part> {
        let bytes = match number.cmp(&self.blocks) {
            Ordering::Less => self.full_block(number).unwrap_or_default(),
            Ordering::Equal => self.filling.clone(),
            Ordering::Greater => return None,
        };
        let [first, last] = [0, u32::MAX].map(|start| Place { block: number, start }.to_bytes());
        let replaced = self.replaced.keys(&first, &last).ok()?;
        let (mut records, mut rest) = (Vec::new(), &bytes[..]);
        while let Some((record, next)) = self.first_record(rest) {
            let start = bytes.len() - rest.len();
            let place = Place { block: number, start: start as u32 }.to_bytes();
            if replaced.binary_search(&place).is_err() {
                records.push((start, record.grounds));
            }
            rest = next;
        }
        Some(Part { bytes, records })
    }

    /// All results, in no order of meaning.
    pub(super) fn parts(&self) -> impl Iterator<Item = Part> {
        (0..=self.blocks).filter_map(|number| self.part(number))
    }

    /// The record that these bytes begin with, and the bytes after it.
    fn first_record<'a>(&self, bytes: &'a [u8]) -> Option<(Record<'a>, &'a [u8])> {
        let (grounds, _) = self.grounds.get(grounds_number(bytes)?)?;
        record(bytes, *grounds)
    }
}

impl Part {
    /// The results.
    pub fn records(&self) -> impl Iterator<Item = Record<'_>> {
        let record = |&(start, grounds): &(usize, Grounds)| Some(record(&self.bytes[start..], grounds)?.0);
        self.records.iter().filter_map(record)
    }
}

/// The number of the grounds of the record that these bytes begin with.
fn grounds_number(bytes: &[u8]) -> Option<usize> {
    let (_job, rest) = bytes.split_first_chunk::<8>()?;
    Some(u32::from_le_bytes(*rest.first_chunk()?) as usize)
}

/// The record with these grounds that these bytes begin with, and the bytes after it.
fn record(bytes: &[u8], grounds: Grounds) -> Option<(Record<'_>, &[u8])> {
    let (job, rest) = bytes.split_first_chunk()?;
    let (_number, rest) = rest.split_first_chunk::<4>()?;
    let (task, rest) = field(rest)?;
    let (accepted, rest) = field(rest)?;
    Some((Record { job: JobId(u64::from_le_bytes(*job)), grounds, task, accepted }, rest))
}

fn field(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(u32::from_le_bytes(*length) as usize)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use proptest::prelude::*;
    use proto::journal::Assurance;
    use proto::task::{
        Described, DescribedShard, DescribedSplit, Evaluation, EvaluationResult, Exclusion, Match,
        MatchingRule, Nearest, Objective, Scale, Subject, TaskResult, Tile,
    };
    use proto::{Digest, Fingerprint, Principal, WorkerId};

    use super::*;

    fn in_memory() -> Archive {
        Archive::new([(); 3].map(|()| SpillMap::new(None)))
    }

    /// Its bytes do not compress, so that few of them fill a block.
    fn task(number: u32, digests: u32) -> Task {
        let digest = |index: u32| Digest::of(&[number.to_le_bytes(), index.to_le_bytes()].concat());
        let query = (0..digests).map(digest).collect();
        Task::Evaluation(Evaluation { query, ..Evaluation::sample(number, 10, 10) })
    }

    fn finished(job: u64, correct: u32, margin: Option<f64>) -> Finished {
        let counts = EvaluationResult { queries: 10, object_correct: correct, margin, ..Default::default() };
        Finished {
            job: JobId(job),
            result: TaskResult::Evaluation(counts),
            worker_id: WorkerId([1; 16]),
            worker: "host".to_owned(),
            attempt: 3,
            queued: Duration::from_nanos(1_234_567_891),
            run_seconds: 0.1,
            principal: Principal::Certificate(Fingerprint([1; 32])),
            seconded: margin.map(|_| Principal::Coordinator),
            assurance: Assurance::Audited,
        }
    }

    proptest! {
        #[test]
        fn the_last_of_each_job_is_there_and_nothing_else(
            inserted in prop::collection::vec(
                (0u64..40, any::<u32>(), 0u32..400, 0u32..11, prop::option::of(-1.0..1.0)),
                0..60,
            ),
            most in prop::option::of(0usize..100_000),
        ) {
            let directory = tempfile::tempdir().unwrap();
            let map = || match most {
                Some(most) => SpillMap::with(Some(directory.path().to_owned()), most),
                None => SpillMap::new(None),
            };
            let (mut archive, mut expected) = (Archive::new([map(), map(), map()]), BTreeMap::new());
            for (job, number, digests, correct, margin) in inserted {
                let (task, finished) = (task(number, digests), finished(job, correct, margin));
                let is_kept = match expected.contains_key(&JobId(job)) {
                    true => archive.replace(&task, &finished),
                    false => archive.insert(&task, &finished),
                };
                prop_assert!(is_kept);
                expected.insert(JobId(job), (task, finished));
            }
            for job in (0..41).map(JobId) {
                let got = archive.get(job);
                prop_assert_eq!(archive.contains(job), got.is_some());
                prop_assert_eq!(got.as_ref(), expected.get(&job));
            }
            let mut all = BTreeMap::new();
            for record in archive.parts().collect::<Vec<_>>().iter().flat_map(Part::records) {
                let (task, finished) = (record.task(), record.finished());
                prop_assert_eq!(record.grounds, Grounds::of(&finished));
                prop_assert!(all.insert(record.job, (task, finished)).is_none(), "{:?} twice", record.job);
            }
            prop_assert_eq!(&all, &expected);
            let grounds: BTreeSet<_> = expected.values().map(|(_, finished)| Grounds::of(finished)).collect();
            prop_assert_eq!(archive.grounds().collect::<BTreeSet<_>>(), grounds);

            let jobs = (0..41).filter(|job| job % 3 > 0).map(JobId).collect();
            let is_even = |task: &Task| task.subject().descriptor.bytes()[0].is_multiple_of(2);
            expected.retain(|job, (task, _)| job.0 % 3 > 0 && is_even(task));
            prop_assert_eq!(archive.select(&jobs, is_even), expected);
        }
    }

    #[test]
    fn what_can_be_a_result_of_a_task_comes_back_with_it() {
        let rule = MatchingRule { exclude: Exclusion::SameCloud, objective: Objective::Object, margin: true };
        let ruled = Evaluation { rule, want_matches: true, ..Evaluation::sample(1, 1, 3) };
        let nearest = Nearest { same: Some((1, 0.0)), other: Some((2, 0.25)) };
        let by_rule = EvaluationResult {
            queries: 1,
            object_correct: 1,
            category_correct: 1,
            nearest: vec![nearest],
            margin: Some(1.0),
            ..EvaluationResult::default()
        };
        let whole = Evaluation { want_matches: true, scales: vec![0.5], ..Evaluation::sample(2, 2, 3) };
        let [one, other] =
            [None, Some((0, 0.75))].map(|runner_up| Match { nearest: 2, distance: 0.125, runner_up });
        let matched = EvaluationResult {
            queries: 2,
            object_correct: 1,
            category_correct: 2,
            matches: vec![one, other],
            ..EvaluationResult::default()
        };
        let [query, database] = [1, 2].map(|byte| vec![Digest([byte; 32])]);
        let tile = Tile {
            evaluation: Evaluation { query: query.clone(), database: database.clone(), ..whole },
            query_descriptions: query,
            database_descriptions: database,
        };
        let shard = DescribedShard { manifest: Digest([3; 32]), description: Digest([4; 32]) };
        let described = vec![DescribedSplit { channel: 0, split: Digest([5; 32]), shards: vec![shard] }];
        let scale =
            Scale { subject: Subject::sample(3), splits: vec![Digest([5; 32])], clouds: 4, described };

        let mut archive = in_memory();
        let answered = [
            (Task::Evaluation(ruled), TaskResult::Evaluation(by_rule)),
            (Task::Tile(tile), TaskResult::Evaluation(matched)),
            (Task::Scale(scale), TaskResult::Scale(f64::from(f32::MIN_POSITIVE))),
        ];
        for (task, result) in &answered {
            assert_eq!(task.check(result), Ok(()));
            let finished =
                Finished { result: result.clone(), run_seconds: 0.0, ..finished(task.job(0).0, 0, None) };
            assert!(archive.insert(task, &finished));
            assert_eq!(archive.get(finished.job), Some((task.clone(), finished)));
        }
    }

    #[test]
    fn whoever_looks_at_all_results_part_by_part_misses_none_that_is_replaced_meanwhile() {
        for replaced_after in 0..5 {
            let mut archive = in_memory();
            for job in 0..2000 {
                archive.insert(&task(job, 2), &finished(job.into(), 1, None));
            }
            assert!(archive.blocks > 4);
            let mut seen = BTreeMap::<JobId, Vec<u32>>::new();
            let mut number = 0;
            while let Some(part) = archive.part(number) {
                for record in part.records() {
                    let TaskResult::Evaluation(result) = record.finished().result else { unreachable!() };
                    seen.entry(record.job).or_default().push(result.object_correct);
                }
                if number == replaced_after {
                    for job in (0..2000).step_by(3) {
                        archive.replace(&task(job, 2), &finished(job.into(), 7, Some(0.5)));
                    }
                }
                number += 1;
            }
            for job in 0..2000u32 {
                let corrects = &seen[&JobId(job.into())];
                let is_replaced = job.is_multiple_of(3);
                assert!(matches!(corrects[..], [1] | [1, 7] | [7]), "{corrects:?}");
                assert_eq!(corrects.contains(&7), is_replaced, "job {job}");
            }
        }
    }

    #[test]
    fn a_large_record_is_alone_in_its_block() {
        let mut archive = in_memory();
        for (job, digests) in [(1, 0), (2, 2000), (3, 0), (4, 0)] {
            archive.insert(&task(job, digests), &finished(job.into(), 0, None));
        }
        let block = |job| archive.place(JobId(job)).map(|place| place.block);
        assert_eq!([1, 2, 3, 4].map(block), [0, 1, 2, 2].map(Some));
        let length = archive.full_block(1).unwrap().len();
        assert!(length > BLOCK_BYTES && archive.filling.len() < BLOCK_BYTES);
    }

    #[test]
    fn of_a_description_the_digest_is_kept_and_of_a_grid_cell_nothing() {
        let mut archive = in_memory();
        let described = TaskResult::Description(Described::new(vec![7; 100]));
        let of = |result: TaskResult| Finished { result, ..finished(1, 0, None) };
        assert!(archive.insert(&task(1, 0), &of(described.clone())));
        let kept = archive.get(JobId(1)).map(|(_, finished)| finished.result);
        assert_eq!(kept, described.kept());
        assert!(!archive.insert(&task(1, 0), &of(TaskResult::GridCell(vec![1]))));
    }

    #[test]
    fn similar_records_take_a_fraction_of_their_bytes() {
        let mut archive = in_memory();
        let mut bytes = 0;
        for number in 0..10_000 {
            let Task::Evaluation(one) = task(number, 0) else { unreachable!("an evaluation") };
            let query = vec![Digest([7; 32]), Digest::of(&[1])];
            let task = Task::Evaluation(Evaluation { query, ..one });
            bytes += task.to_bytes().len();
            archive.insert(&task, &finished(number.into(), number % 10, None));
        }
        let mut kept = 0;
        archive.full.for_each(|_, block| kept += block.len()).unwrap();
        assert!(archive.blocks > 0 && kept * 2 < bytes, "{kept} of {bytes}");
    }
}
