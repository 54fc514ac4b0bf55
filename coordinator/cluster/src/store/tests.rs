//! Accepted results and their checks, reports that are not on the disk, what earlier starts have left.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use proto::journal::Assurance;
use proto::task::{Described, Description, Evaluation, EvaluationResult, Scale, Subject};
use proto::{Fingerprint, LeaseNonce};

use super::*;
use crate::journal::tests::header;
use crate::journal::{Journal, JournalFile};
use crate::scheduler::fair_queue::QueuePosition;
use crate::scheduler::{Channel, JobChannels};
use crate::spill;

const GOOD: Principal = Principal::Certificate(Fingerprint([1; 32]));
const BAD: Principal = Principal::Certificate(Fingerprint([2; 32]));

fn task(number: u32) -> Arc<Task> {
    Arc::new(Task::Evaluation(Evaluation::sample(number, 10, 10)))
}

fn finished(job: JobId, principal: Principal, correct: u32) -> Finished {
    let result = EvaluationResult {
        queries: 10,
        object_correct: correct,
        category_correct: correct,
        ..EvaluationResult::default()
    };
    Finished {
        job,
        result: TaskResult::Evaluation(result),
        worker_id: WorkerId([1; 16]),
        worker: "host".to_owned(), // two workers may have had one label
        attempt: 3,
        queued: Duration::ZERO,
        run_seconds: 1.0,
        principal,
        seconded: None,
        assurance: Assurance::Unaudited,
    }
}

/// A store that goes on after an earlier start, which has accepted these results.
fn restored(accepted: &[Finished]) -> JobStore {
    let mut store = JobStore::default();
    let accepted =
        accepted.iter().map(|finished| (finished.job, Box::new(finished.kept().unwrap()))).collect();
    store.restore(Recorded { accepted, ..Recorded::default() });
    store
}

/// A store with results of a thousand tasks, and what has its disks fail: that of places, and that of blocks.
pub(crate) fn on_failing_disks() -> (JobStore, [Arc<AtomicBool>; 2]) {
    let mut store = JobStore::default();
    let [(places, without_places), (full, without_blocks)] =
        [(); 2].map(|()| spill::tests::on_failing_disk());
    store.archive = Archive::new([places, full, SpillMap::new(None)]);
    for number in 0..1000 {
        store.accept(&task(number), &finished(task(number).job(0), GOOD, 5));
    }
    (store, [without_places, without_blocks])
}

#[test]
fn a_result_that_cannot_be_read_is_not_there_and_the_store_says_so() {
    let recalled = |store: &mut JobStore| {
        (0..1000).filter(|&number| store.recall(task(number).job(0), &task(number)).is_some()).count()
    };
    for disk in [0, 1] {
        let (mut store, fails) = on_failing_disks();
        assert_eq!((recalled(&mut store), store.failure()), (1000, None));
        fails[disk].store(true, Ordering::Relaxed);
        assert!(recalled(&mut store) < 500);
        assert!(store.failure().is_some());
    }
}

#[test]
fn what_a_wrong_worker_answered_is_asked_again_and_a_changed_result_replaces_it() {
    let mut store = JobStore::default();
    for (number, worker) in [(8, GOOD), (9, BAD), (10, BAD)] {
        store.accept(&task(number), &finished(task(number).job(0), worker, 5));
    }
    assert!(store.recall(task(11).job(0), &task(11)).is_none(), "nobody has asked that");
    let asked = store.recheck(BAD);
    assert_eq!(asked.len(), 2, "although all have one label");
    assert!(store.is_checking());
    for Recheck { job, of, task: asked } in &asked {
        assert!(store.is_check(*job) && !store.is_check(*of));
        let correct = if *asked == task(9) { 5 } else { 6 };
        let checked = store.check(&finished(*job, GOOD, correct)).unwrap();
        assert_eq!(checked.finished.job, *of);
        assert_eq!(checked.corrected, (correct == 6).then(|| task(10)));
    }
    assert!(!store.is_checking());
    assert!(store.check(&finished(asked[0].job, GOOD, 5)).is_none(), "a result checks once");
    assert!(store.recheck(BAD).is_empty(), "each result is another's by now");
    let job = task(10).job(0);
    assert_eq!(store.recall(job, &task(10)), Some(finished(job, GOOD, 6)));
}

/// The channels of a descriptor of the tests below: one for each of its bytes.
fn channels(descriptor: &DescriptorBytes) -> Vec<Channel> {
    descriptor.bytes().iter().map(|&number| Channel { number: u64::from(number), cost: 1 }).collect()
}

/// A description for a descriptor with these channels, a scale and an evaluation of it, with results.
fn of_channels(channels: &[u8], digest: u8) -> [(Task, TaskResult); 3] {
    let (subject, splits) =
        (Subject { descriptor: channels.to_vec().into(), ..Subject::sample(1) }, Vec::new());
    let manifest = Digest([digest; 32]);
    let evaluation =
        Evaluation { subject: subject.clone(), ..Evaluation::sample(1, 10, 10 + u32::from(digest)) };
    let evaluated = finished(JobId(0), GOOD, 5).result;
    [
        (
            Task::Description(Description { subject: subject.clone(), manifest, clouds: 1 }),
            TaskResult::Description(Described::named(manifest)),
        ),
        (
            Task::Scale(Scale { subject, splits, clouds: u32::from(digest), described: Vec::new() }),
            TaskResult::Scale(0.5),
        ),
        (Task::Evaluation(evaluation), evaluated),
    ]
}

#[test]
fn of_the_channels_of_a_descriptor_scales_and_descriptions_are_about_it() {
    let [mut store, mut of_none] = [JobStore::new(channels, None), JobStore::default()];
    let mut jobs = Vec::new();
    for (digest, channels) in (1..).zip([&[1][..], &[2], &[3], &[1, 2], &[1, 2, 3], &[]]) {
        jobs.push(of_channels(channels, digest).map(|(task, result)| {
            let job = task.job(0);
            let finished = Finished { result, ..finished(job, GOOD, 5) };
            for store in [&mut store, &mut of_none] {
                store.accept(&Arc::new(task.clone()), &finished);
            }
            job
        }));
    }
    let found = |store: &JobStore| -> BTreeSet<JobId> {
        store.about(&vec![1, 2].into()).iter().map(|(_, finished)| finished.job).collect()
    };
    let [alone, other, whole] = [0, 1, 3].map(|place| &jobs[place]);
    assert_eq!(found(&store), alone[..2].iter().chain(&other[..2]).chain(whole).copied().collect());
    assert_eq!(found(&of_none), whole.iter().copied().collect(), "nothing is known of channels");

    let named = [1, 3, 99].map(|number| Digest([number; 32])).into();
    let describing: BTreeSet<JobId> = store.describing(&named).into_iter().collect();
    assert_eq!(describing, [jobs[0][0], jobs[2][0]].into());
}

#[test]
fn what_is_found_about_a_descriptor_is_what_a_look_at_all_results_finds() {
    let mut store = JobStore::new(channels, None);
    // What an earlier start has left is about nothing until it is asked for.
    let mut digest = 0;
    let descriptors: Vec<Vec<u8>> =
        (0..16).map(|set| (0..4).filter(|bit| set >> bit & 1 == 1).collect()).collect();
    for descriptor in descriptors.iter().cycle().take(48) {
        digest += 1;
        for (task, result) in of_channels(descriptor, digest) {
            let finished = Finished { result, ..finished(task.job(0), GOOD, 5) };
            if digest % 3 == 0 {
                store.recorded.extend([(finished.job, Box::new(finished.kept().unwrap()))]);
            } else {
                store.accept(&Arc::new(task.clone()), &finished);
            }
            if digest % 6 == 0 {
                assert!(store.recall(task.job(0), &Arc::new(task)).is_some());
            }
        }
    }
    let mut all = 0;
    for descriptor in &descriptors {
        let is_about = |task: &Task| {
            let of_task = task.subject().descriptor.bytes();
            let is_evaluation = matches!(task, Task::Evaluation(_));
            let is_of_channels =
                !of_task.is_empty() && of_task.iter().all(|channel| descriptor.contains(channel));
            of_task == descriptor || !is_evaluation && is_of_channels
        };
        let mut expected = Vec::new();
        for part in store.archive.parts() {
            let about = part.records().filter(|record| is_about(&record.task()));
            expected.extend(about.map(|record| record.job));
        }
        expected.sort();
        let found = store.about(&descriptor.clone().into());
        assert_eq!(found.iter().map(|(_, finished)| finished.job).collect::<Vec<_>>(), expected);
        assert!(found.iter().all(|(task, finished)| task.job(0) == finished.job));
        all += found.len();
    }
    assert!(all > 16 * 3, "{all}");
}

#[test]
fn what_is_accepted_about_a_descriptor_is_found_and_its_assurance_kept() {
    let mut store = JobStore::default();
    for number in [8, 9] {
        store.accept(&task(number), &finished(task(number).job(0), GOOD, 5));
    }
    let (task_8, job) = (task(8), task(8).job(0));
    let about = &task_8.subject().descriptor;
    let found = |store: &JobStore| {
        let found = store.about(about);
        found.iter().map(|(_, finished)| (finished.job, finished.assurance)).collect::<Vec<_>>()
    };
    assert_eq!(found(&store), [(job, Assurance::Unaudited)]);
    let audited = |correct| {
        let fingerprint = finished(job, GOOD, correct).result.fingerprint();
        Confirmed {
            job,
            fingerprint,
            seconded: Some(BAD),
            assurance: Assurance::Audited,
            was_disputed: false,
        }
    };
    assert_eq!(store.assure(&audited(6)), None);
    assert_eq!(found(&store), [(job, Assurance::Unaudited)]);
    let kept = store.assure(&audited(5)).unwrap();
    assert_eq!((kept.assurance, kept.seconded), (Assurance::Audited, Some(BAD)));
    assert_eq!(found(&store), [(job, Assurance::Audited)]);
    // Who has seconded a result was part of why it was believed.
    assert_eq!(store.recheck(BAD).iter().map(|recheck| recheck.of).collect::<Vec<_>>(), [job]);
}

#[test]
fn a_report_is_withheld_until_it_is_on_the_disk_and_nothing_else_is() {
    let (journal, held) = Journal::held();
    let (task, job) = (task(8), task(8).job(0));
    let mut store = restored(&[finished(job, GOOD, 5)]);
    assert_eq!(store.recall(job, &task), Some(finished(job, GOOD, 5)));

    let [lease, other] = [3, 2].map(|attempt| Lease { job, attempt, nonce: LeaseNonce::default() });
    store.set_pending(job, 3, journal.record(crate::journal::Entry::Retracted(job)));
    let mut acknowledged = vec![lease, other];
    let is_durable = |sequence| journal.is_durable(sequence);
    assert_eq!(store.withhold(&mut acknowledged, is_durable), [lease]);
    assert_eq!(acknowledged, [other]);
    assert!(store.last_pending(&[lease]).is_some());
    assert_eq!(held.commit(), 1);
    let mut acknowledged = vec![lease, other];
    assert_eq!(store.withhold(&mut acknowledged, is_durable), []);
    assert_eq!(acknowledged, [lease, other]);
    assert!(store.last_pending(&[lease]).is_none());
}

#[test]
fn a_recorded_result_that_cannot_be_one_is_not_recalled() {
    let small = Arc::new(Task::Evaluation(Evaluation::sample(1, 9, 3)));
    let job = small.job(0);
    let mut store = restored(&[finished(job, GOOD, 5)]);
    assert!(store.has_result(job));
    assert!(store.recall(job, &small).is_none());
    assert!(!store.has_result(job));
}

#[test]
fn a_recorded_result_that_cannot_be_read_any_more_is_not_recalled_and_can_be_accepted_anew() {
    let folder = tempfile::tempdir().unwrap();
    let (path, job) = (folder.path().join("journal"), task(8).job(0));
    JournalFile::create(&path, &header()).unwrap();
    let accepted = Box::new(finished(job, GOOD, 5).kept().unwrap());
    JournalFile::open(&path).unwrap().0.commit(&[crate::journal::Entry::Accepted(job, accepted)]).unwrap();
    let mut store = JobStore::default();
    store.restore(JournalFile::open(&path).unwrap().2);
    assert!(store.has_result(job) && !store.was_asked(job));
    std::fs::File::options().write(true).open(&path).unwrap().set_len(0).unwrap();
    assert_eq!(store.recall(job, &task(8)), None);
    assert!(!store.has_result(job));
    store.ask(job);
    store.accept(&task(8), &finished(job, GOOD, 6));
    assert_eq!(store.recall(job, &task(8)), Some(finished(job, GOOD, 6)));
}

#[test]
fn a_recorded_result_that_is_looked_at_does_not_count_as_asked_for() {
    let job = task(8).job(0);
    let mut store = restored(&[finished(job, GOOD, 5)]);
    assert!(store.recall(job, &task(8)).is_some());
    assert!(store.is_known(job) && !store.was_asked(job));
    store.ask(job);
    assert!(store.was_asked(job));
}

#[test]
fn recorded_results_of_a_wrong_worker_are_dropped_until_they_are_asked_for() {
    let jobs = [8, 9, 10].map(|number| task(number).job(0));
    let mut store =
        restored(&[finished(jobs[0], GOOD, 5), finished(jobs[1], BAD, 5), finished(jobs[2], BAD, 5)]);
    assert!(store.recall(jobs[2], &task(10)).is_some());
    assert_eq!(store.drop_recorded(BAD), [jobs[1]]);
    assert_eq!(jobs.map(|job| store.has_result(job)), [true, false, true]);
    // That of which the task is known is checked.
    let rechecks: Vec<JobId> = store.recheck(BAD).iter().map(|recheck| recheck.of).collect();
    assert_eq!(rechecks, [jobs[2]]);
}

#[test]
fn a_job_with_a_lease_of_an_earlier_start_is_known_until_it_is_asked_for() {
    let mut store = JobStore::default();
    let job = task(8).job(0);
    let [one, other] = [WorkerId([1; 16]), WorkerId([2; 16])];
    let leases = vec![(job, 1, other), (job, 2, one)];
    store.restore(Recorded { leases, ..Recorded::default() });
    assert!(store.is_known(job) && !store.was_asked(job));
    assert_eq!(store.take_earlier_leases(job), [(other, 1), (one, 2)]);
    assert!(!store.is_known(job));
}

#[test]
fn of_a_job_that_is_done_there_is_no_entry_and_its_result_and_who_asked_are_known() {
    let mut store = JobStore::default();
    let (task, job) = (task(8), task(8).job(0));
    let open = || {
        Job::new(
            task.clone(),
            JobChannels::default(),
            (ClientId::new(1), QueuePosition::default()),
            Instant::now(),
        )
    };
    store.ask(job);
    store.set_plan(job, None);
    assert!(store.wait_for(job, &task, ClientId::new(1)));
    store.open(job, open());
    assert!(store.take_waiting(job).is_some());
    store.accept(&task, &finished(job, GOOD, 5));
    assert_eq!(store.entries.len(), 1, "an audit may be going on");
    assert!(store.close(job).is_some());
    assert_eq!(store.entries.len(), 0);
    assert!(store.was_asked(job) && store.is_known(job) && store.has_result(job));
    assert_eq!(store.recall(job, &task), Some(finished(job, GOOD, 5)));

    // It is asked for again, and audited.
    store.ask(job);
    store.set_plan(job, None);
    assert_eq!(store.entries.len(), 0);
    store.open(job, open());
    assert!(store.was_asked(job) && store.close(job).is_some());
    assert_eq!(store.entries.len(), 0);

    // Nobody has asked for what an earlier start has left, although its result was looked at.
    let mut store = restored(&[finished(job, GOOD, 5)]);
    assert!(store.recall(job, &task).is_some());
    assert!(!store.was_asked(job) && store.entries.len() == 1);
    store.ask(job);
    assert!(store.was_asked(job) && store.entries.is_empty());
}

#[test]
fn equal_questions_share_one_entry() {
    let mut store = JobStore::default();
    let job = task(8).job(0);
    store.ask(job);
    assert!(store.was_asked(job));
    assert!(store.wait_for(job, &task(8), ClientId::new(1)));
    assert!(!store.wait_for(job, &task(8), ClientId::new(2)));
    assert_eq!(store.take_waiting(job), Some((task(8), vec![ClientId::new(1), ClientId::new(2)])));
    assert_eq!(store.take_waiting(job), None);
}
