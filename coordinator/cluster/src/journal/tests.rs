//! The journal's promises: what was committed is read back, and nothing else ever passes for it.

use std::fs::{self, File};
use std::io;
use std::time::SystemTime;

use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use proto::task::{Described, EvaluationResult, Match, TaskResult};
use proto::{Digest, Introduction, SessionId};
use tempfile::TempDir;

use super::*;
use crate::events::{Attempt, AttemptEnd, EventKind};
use crate::scheduler::RunSecret;
use crate::sharding::SidePlan;

mod damage;
mod results;

pub(crate) fn header() -> Header {
    Header {
        search: "seed = 1\n".to_owned(),
        experiment: "version = 1\n".to_owned(),
        data_digest: "00".to_owned(),
        evaluation_version: 2,
        session: SessionId([7; 16]),
        secret: RunSecret::new([8; 32]),
        started_at: SystemTime::UNIX_EPOCH + Duration::from_millis(1_700_000_000_123),
    }
}

fn boxed((job, accepted): (JobId, AcceptedResult)) -> (JobId, Box<AcceptedResult>) {
    (job, Box::new(accepted))
}

pub(super) fn accepted(matches: usize) -> AcceptedResult {
    let found = |index: usize| Match {
        nearest: index as u32,
        distance: 0.1 + index as f64,
        runner_up: (index % 2 == 1).then_some((9, 0.3)),
    };
    AcceptedResult {
        result: TaskResult::Evaluation(EvaluationResult {
            queries: 10,
            object_correct: 4,
            category_correct: 6,
            matches: (0..matches).map(found).collect(),
            ..EvaluationResult::default()
        }),
        worker_id: WorkerId([3; 16]),
        worker: "rack-3".to_owned(),
        principal: principal(3),
        seconded: Some(principal(4)),
        assurance: Assurance::Unaudited,
        attempt: 2,
        queued: Duration::from_nanos(1_234_567_891),
        run_seconds: 0.1,
    }
}

fn answer(job: u64, matches: usize) -> Entry {
    Entry::Accepted(JobId(job), Box::new(accepted(matches)))
}

fn member(label: &str) -> Member {
    let introduction = Introduction { threads: 4, ..Introduction::sample("rack", 1) };
    Member { label: label.to_owned(), introduction }
}

fn event(sequence: u64, generation: u32) -> Event {
    let at = SystemTime::UNIX_EPOCH + Duration::from_millis(1_700_000_000_123);
    Event { sequence, at, kind: EventKind::Rewind { generation, why: "why".to_owned() }, omitted: false }
}

fn happened(sequence: u64, generation: u32) -> Entry {
    Entry::Event(Arc::new(event(sequence, generation)))
}

fn principal(number: u8) -> Principal {
    Introduction::sample("rack", number).principal
}

fn leased(job: u64, attempt: u32, worker: WorkerId) -> Entry {
    Entry::Leased(JobId(job), attempt, worker)
}

/// A journal in a folder of its own, with some entries.
fn journal(entries: &[Entry]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(JOURNAL_FILE);
    JournalFile::create(&path, &header()).unwrap();
    JournalFile::open(&path).unwrap().0.commit(entries).unwrap();
    (folder, path)
}

/// Whoever was found to be wrong must not be believed by the next start, even if this one could not retract all it gave.
#[test]
fn a_quarantine_takes_back_what_rests_on_the_quarantined() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(JOURNAL_FILE);
    JournalFile::create(&path, &header()).unwrap();
    let of = |job, principal, seconded, assurance| {
        Entry::Accepted(
            JobId(job),
            Box::new(AcceptedResult { principal, seconded, assurance, ..accepted(0) }),
        )
    };
    let [good, bad] = [3, 4].map(principal);
    let before = [
        of(1, good, None, Assurance::Unaudited),
        of(2, bad, None, Assurance::Unaudited),
        of(3, good, Some(bad), Assurance::Audited),
        of(4, bad, None, Assurance::Own),
        of(5, bad, None, Assurance::Unaudited),
    ];
    let (journal, ..) = JournalFile::open(&path).unwrap();
    journal.commit(&before).unwrap();
    journal.commit(&[Entry::Quarantined(bad), of(5, good, None, Assurance::Unaudited)]).unwrap();
    drop(journal);
    let (.., recorded) = JournalFile::open(&path).unwrap();
    // The fourth was computed by the own process, too.
    assert_eq!(recorded.accepted.jobs().collect::<Vec<_>>(), [1, 4, 5].map(JobId));
}

#[test]
fn what_was_committed_is_there_at_the_next_start() {
    let [one, two] = [WorkerId([1; 16]), WorkerId([2; 16])];
    let (_folder, path) = journal(&[
        Entry::Joined(one, member("rack")),
        Entry::Joined(two, member("rack-2")),
        leased(5, 1, one),
        leased(5, 2, two),
        leased(6, 1, one),
        answer(5, 0),
        answer(u64::MAX, 3),
        Entry::Left(two),
        happened(0, 9),
        happened(1, 8),
        happened(7, 3),
        Entry::Quarantined(principal(2)),
    ]);
    let (_file, read, recorded) = JournalFile::open(&path).unwrap();
    assert_eq!(read, header());
    assert_eq!(recorded.starts, 2);
    assert_eq!(
        recorded.accepted.all(),
        [(JobId(5), accepted(0)), (JobId(u64::MAX), accepted(3))].map(boxed).into()
    );
    assert_eq!(recorded.members, [(one, member("rack"))].into());
    // An answered job is nobody's any more.
    assert_eq!(recorded.leases, [(JobId(6), 1, one)]);
    // In order; numbers between belong to events that were not to be kept.
    assert_eq!(recorded.events, [event(0, 9), event(1, 8), event(7, 3)]);
    assert!(!recorded.is_trusted());
    assert_eq!(recorded.quarantined, [principal(2)].into());
}

#[test]
fn subtasks_of_evaluations_are_there_at_the_next_start() {
    let side = |shards, ranges| SidePlan { shards, ranges };
    let plan = ShardPlan { query: side(4, 2), database: side(8, 8) };
    let entry = |job| Entry::Accepted(JobId(job), Box::new(described()));
    let holder = WorkerId([1; 16]);
    let (_folder, path) = journal(&[
        Entry::Sharded(JobId(9), plan),
        leased(5, 1, holder),
        entry(5),
        entry(6),
        answer(7, 3),
        Entry::Retracted(JobId(6)),
    ]);
    let recorded = JournalFile::open(&path).unwrap().2;
    assert_eq!(recorded.accepted.all(), [(JobId(5), described()), (JobId(7), accepted(3))].map(boxed).into());
    assert_eq!(recorded.plans, [(JobId(9), plan)].into());
    assert_eq!(recorded.leases, []);
}

#[test]
fn a_journal_is_not_there_before_it_is_whole_and_a_killed_attempt_to_make_it_is_no_obstacle() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(JOURNAL_FILE);
    fs::write(folder.path().join(".tmp-host-1-xxxxxxxxxxxx"), b"half").unwrap();
    assert!(!path.exists());
    JournalFile::create(&path, &header()).unwrap();
    assert_eq!(JournalFile::open(&path).unwrap().2, Recorded { starts: 1, ..Recorded::default() });
}

#[test]
fn a_journal_that_is_in_use_is_refused() {
    let (_folder, path) = journal(&[]);
    assert_eq!(JournalFile::is_open(&path).unwrap(), Some(false));
    let file = JournalFile::open(&path).unwrap();
    assert_eq!(JournalFile::is_open(&path).unwrap(), Some(true));
    assert!(matches!(JournalFile::header(&path), Err(JournalError::InUse { .. })));
    drop(file);
    // A look does not keep a coordinator from starting.
    let look = File::open(&path).unwrap();
    look.try_lock_shared().unwrap();
    let opened = std::thread::scope(|scope| {
        let opened = scope.spawn(|| JournalFile::open(&path).map(drop));
        std::thread::yield_now();
        drop(look);
        opened.join().unwrap()
    });
    opened.unwrap();
    fs::remove_file(&path).unwrap();
    assert_eq!(JournalFile::is_open(&path).unwrap_err().kind(), io::ErrorKind::NotFound);
}

#[test]
fn what_is_no_journal_is_said_to_be_damaged_or_of_another_version() {
    let (_folder, path) = journal(&[answer(5, 40)]);
    let whole = fs::read(&path).unwrap();
    for bytes in [b"".as_slice(), b"journal", &[0; 8192], &whole[1..]] {
        fs::write(&path, bytes).unwrap();
        for error in [JournalFile::open(&path).err().unwrap(), JournalFile::header(&path).err().unwrap()] {
            assert!(matches!(error, JournalError::Damaged { .. }), "{error}");
            assert!(error.to_string().contains("--fresh"), "{error}");
        }
        assert_eq!(fs::read(&path).unwrap(), bytes, "left as it is");
    }

    for (from, to) in [("descry journal", "descry_journal"), ("\"search\"", "\"sought\"")] {
        let text = String::from_utf8(header().encode().unwrap()).unwrap();
        assert!(Header::decode(text.replace(from, to).as_bytes(), &path).is_err(), "{from}");
    }
    let text = String::from_utf8(header().encode().unwrap()).unwrap();
    for (got, writer) in [(2, "an earlier build of Descry 0.1"), (4, "a later release of Descry")] {
        let other = text.replace("\"version\":3", &format!("\"version\":{got},\"more\":0"));
        let error = Header::decode(other.as_bytes(), &path).unwrap_err().to_string();
        let said =
            format!("version must be 3, got {got}, written by {writer}\nfinish this run with that build,");
        assert!(error.contains(&said), "{error}");
    }
}

/// Journals of versions 1 and 2 have another name.
#[test]
fn a_journal_of_an_earlier_version_is_refused_with_what_can_finish_it() {
    let error = JournalError::earlier(Path::new(EARLIER_JOURNAL_FILE)).to_string();
    let expected = "journal.redb: version must be 3, got 2, written by an earlier build of Descry 0.1\nfinish this run with that build, or start another with --fresh";
    assert_eq!(error, expected);
}

/// A journal with an entry of every kind, as this version has written it; compressed, for most of it is zeros.
const SAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/testdata/journal-v3.gz");

fn described() -> AcceptedResult {
    let result = TaskResult::Description(Described::named(Digest([7; 32])));
    AcceptedResult { result, ..accepted(0) }
}

/// What was committed to the sample, and what has to be read from it.
fn sample() -> (Vec<Entry>, Recorded) {
    let [one, two] = [WorkerId([1; 16]), WorkerId([2; 16])];
    let at = SystemTime::UNIX_EPOCH + Duration::from_millis(1_700_000_000_123);
    let attempt = EventKind::Attempt(Attempt {
        job: JobId(5),
        number: 2,
        task: "evaluation of descriptor 1".to_owned(),
        kind: None,
        worker: one,
        label: "rack".to_owned(),
        held_seconds: 0.5,
        run_seconds: Some(0.1),
        end: AttemptEnd::Failed("panic: out of memory".to_owned()),
    });
    let attempt = Event { sequence: 1, at, kind: attempt, omitted: false };
    let side = |shards, ranges| SidePlan { shards, ranges };
    let plan = ShardPlan { query: side(4, 2), database: side(8, 8) };
    let member = Member {
        label: "rack".to_owned(),
        introduction: Introduction { threads: 4, ..Introduction::sample("rack", 1) },
    };
    let entries = vec![
        Entry::Joined(one, member.clone()),
        Entry::Joined(two, member.clone()),
        leased(8, 3, one),
        answer(5, 2),
        Entry::Accepted(JobId(6), Box::new(described())),
        answer(7, 0),
        Entry::Retracted(JobId(7)),
        Entry::Left(two),
        Entry::Quarantined(principal(2)),
        happened(0, 9),
        Entry::Event(Arc::new(attempt.clone())),
        Entry::Assured(JobId(6), Assurance::Audited, Some(principal(5))),
        Entry::Quarantined(principal(6)),
        Entry::Readmitted(principal(6)),
        Entry::Sharded(JobId(9), plan),
    ];
    let assured =
        AcceptedResult { assurance: Assurance::Audited, seconded: Some(principal(5)), ..described() };
    let recorded = Recorded {
        starts: 2,
        at_work: Duration::ZERO,
        accepted: [(JobId(5), accepted(2)), (JobId(6), assured)].map(boxed).into_iter().collect(),
        members: [(one, member)].into(),
        plans: [(JobId(9), plan)].into(),
        leases: vec![(JobId(8), 3, one)],
        quarantined: [principal(2)].into(),
        events: vec![event(0, 9), attempt],
        repairs: 0,
    };
    (entries, recorded)
}

/// It must be read for as long as journals of version 3 are. After a change of version:
/// `UPDATE_EXPECT=1 cargo test --release --workspace --lib sample_of_this_version`.
#[test]
fn the_sample_of_this_version_is_read() {
    let (entries, expected) = sample();
    if std::env::var_os("UPDATE_EXPECT").is_some() {
        let (_folder, path) = journal(&entries);
        let mut sample = GzEncoder::new(File::create(SAMPLE).unwrap(), Compression::best());
        io::copy(&mut File::open(path).unwrap(), &mut sample).unwrap();
        sample.finish().unwrap();
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(JOURNAL_FILE);
    let mut sample = GzDecoder::new(File::open(SAMPLE).unwrap());
    io::copy(&mut sample, &mut File::create(&path).unwrap()).unwrap();
    let (_file, read, mut recorded) = JournalFile::open(&path).unwrap();
    assert_eq!(read, header());
    recorded.at_work = Duration::ZERO; // as long as it took
    assert_eq!(recorded, expected);
}

#[tokio::test]
async fn a_mark_is_durable_when_the_file_has_what_was_recorded() {
    let (_folder, path) = journal(&[]);
    let journal = Journal::start(JournalFile::open(&path).unwrap().0).unwrap();
    let sequences: Vec<LogSequence> = (0..100).map(|job| journal.record(answer(job, 0))).collect();
    assert_eq!(sequences.last(), Some(&journal.end()));
    journal.durable(sequences[99]).await.unwrap();
    assert!(sequences.iter().all(|sequence| journal.is_durable(*sequence)) && journal.failure().is_none());
    let later = journal.record(answer(100, 0));
    journal.durable(later).await.unwrap();
    drop(journal);
    // The thread lets go of the file when it has nothing left to do.
    let reopened = loop {
        match JournalFile::open(&path) {
            Err(JournalError::InUse { .. }) => std::thread::yield_now(),
            other => break other.unwrap(),
        }
    };
    assert_eq!(reopened.2.accepted.len(), 101);
}
