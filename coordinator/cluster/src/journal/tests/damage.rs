//! Damaged journals: what is sound is there, nothing else is, and what was taken back never returns.

use proptest::prelude::*;

use super::super::frame::PAGE;
use super::*;

const WRONG: &str = "answered-wrongly";

fn answer_of(job: u64, worker: &str) -> Entry {
    Entry::Accepted(JobId(job), Box::new(AcceptedResult { worker: worker.to_owned(), ..accepted(3) }))
}

/// A journal of several pages, in whose history a worker was quarantined and some of its answers were replaced; and what
/// has to be read from it.
fn history() -> (TempDir, PathBuf, Recorded) {
    let (folder, path) = journal(&[]);
    let (file, ..) = JournalFile::open(&path).unwrap();
    let [good, wrong] = [WorkerId([1; 16]), WorkerId([2; 16])];
    file.commit(&[Entry::Joined(good, member("good")), Entry::Joined(wrong, member(WRONG))]).unwrap();
    for job in 0..60 {
        let entries = [
            leased(job, 1, if job % 3 == 0 { wrong } else { good }),
            answer_of(job, if job % 3 == 0 { WRONG } else { "good" }),
            happened(job, 4),
        ];
        file.commit(&entries).unwrap();
    }
    let retracted = (0..60).filter(|job| job % 3 == 0).map(|job| Entry::Retracted(JobId(job)));
    let doubts: Vec<Entry> = [Entry::Quarantined(principal(2))].into_iter().chain(retracted).collect();
    file.commit(&doubts).unwrap();
    for job in 0..60 {
        file.commit(&[answer_of(100 + job, "good"), happened(100 + job, 5)]).unwrap();
    }
    // Asked again, and retracted as the last thing.
    file.commit(&[answer_of(0, "good"), answer_of(3, WRONG)]).unwrap();
    file.commit(&[Entry::Retracted(JobId(3))]).unwrap();
    drop(file);
    let mut recorded = JournalFile::open(&path).unwrap().2;
    recorded.accepted = recorded.accepted.all().into_iter().collect(); // of no file, which will be damaged
    assert_eq!((recorded.accepted.len(), recorded.repairs), (40 + 60 + 1, 0));
    (folder, path, recorded)
}

/// Everything that is read is part of what was written, who was quarantined is known, and the next start finds the same.
fn check_salvaged(path: &Path, written: &Recorded, what: &str) -> Recorded {
    let before = fs::read(path).unwrap();
    let (_, read, recorded) = JournalFile::open(path).unwrap();
    assert_eq!(read, header(), "{what}");
    let (before_damage, left) = (written.accepted.all(), recorded.accepted.all());
    for (job, answer) in &left {
        assert_eq!(before_damage.get(job), Some(answer), "{what}: job {job}");
    }
    assert!(recorded.events.iter().all(|event| written.events.contains(event)), "{what}");
    assert_eq!(recorded.quarantined, written.quarantined, "{what}");
    assert!(recorded.starts > 1, "{what}");
    let damaged = path.with_extension("damaged-1");
    assert_eq!(recorded.repairs, u64::from(damaged.exists()), "{what}");
    if damaged.exists() {
        assert_eq!(fs::read(&damaged).unwrap(), before, "{what}: kept as it was");
        fs::remove_file(&damaged).unwrap();
        assert!(!recorded.is_trusted(), "{what}");
    }
    let again = JournalFile::open(path).unwrap().2;
    assert!(!damaged.exists(), "{what}: repaired once");
    assert_eq!((again.accepted.all(), &again.events), (left, &recorded.events), "{what}");
    assert_eq!((again.starts, again.repairs), (recorded.starts + 1, recorded.repairs), "{what}");
    recorded
}

#[test]
fn any_page_may_be_zeroed() {
    let (_folder, path, written) = history();
    let whole = fs::read(&path).unwrap();
    let pages = whole.len().div_ceil(PAGE);
    assert!(pages > 6, "{pages}");
    let mut least = usize::MAX;
    for page in 0..pages {
        let mut bytes = whole.clone();
        let end = bytes.len().min((page + 1) * PAGE);
        bytes[page * PAGE..end].fill(0);
        fs::write(&path, &bytes).unwrap();
        let recorded = check_salvaged(&path, &written, &format!("page {page}"));
        assert_eq!(recorded.repairs, 1, "page {page}");
        least = least.min(recorded.accepted.len());
    }
    // Bounded by what one page has.
    assert!(least > written.accepted.len() - 40, "{least} of {}", written.accepted.len());
}

#[test]
fn any_tail_may_be_cut_off() {
    let (_folder, path, written) = history();
    let whole = fs::read(&path).unwrap();
    let mut last = usize::MAX;
    for length in (1..whole.len().div_ceil(PAGE)).map(|pages| pages * PAGE).rev() {
        fs::write(&path, &whole[..length]).unwrap();
        if length < 3 * PAGE {
            // Where the records begin with who was quarantined, they are the first to be written and the last to go.
            let recorded = JournalFile::open(&path).unwrap().2;
            assert!(recorded.accepted.is_empty() && recorded.repairs == 1, "{length}");
            fs::remove_file(path.with_extension("damaged-1")).unwrap();
            continue;
        }
        let recorded = check_salvaged(&path, &written, &format!("{length} bytes"));
        assert!(recorded.accepted.len() <= last, "{length}");
        last = recorded.accepted.len();
    }
}

#[test]
fn what_is_taken_back_is_not_in_the_file_any_more() {
    let (_folder, path, _) = history();
    let bytes = fs::read(&path).unwrap();
    let named = |text: &str| bytes.windows(text.len()).filter(|window| *window == text.as_bytes()).count();
    // As a member, for it has not left; in no answer.
    assert_eq!(named(WRONG), 1);
    let file = JournalFile::open(&path).unwrap().0;
    // Corrected without being retracted, in one commit or two.
    file.commit(&[answer_of(200, "its first answer"), answer_of(200, "its second answer")]).unwrap();
    file.commit(&[
        answer_of(200, "its third answer"),
        answer_of(201, "its fourth answer"),
        Entry::Retracted(JobId(201)),
    ])
    .unwrap();
    drop(file);
    let bytes = fs::read(&path).unwrap();
    let named = |text: &str| bytes.windows(text.len()).filter(|window| *window == text.as_bytes()).count();
    assert_eq!(
        ["its first answer", "its second answer", "its third answer", "its fourth answer"].map(named),
        [0, 0, 1, 0]
    );
    let accepted = JournalFile::open(&path).unwrap().2.accepted;
    assert_eq!(accepted.get(JobId(200)).unwrap().unwrap().worker, "its third answer");
}

#[test]
fn a_journal_that_is_written_anew_stays_in_use() {
    let (_folder, path, _) = history();
    let file = JournalFile::open(&path).unwrap().0;
    file.commit(&[Entry::Quarantined(principal(9))]).unwrap();
    assert!(matches!(JournalFile::open(&path), Err(JournalError::InUse { .. })));
    file.commit(&[answer(300, 1)]).unwrap();
    drop(file);
    let recorded = JournalFile::open(&path).unwrap().2;
    assert!(recorded.accepted.contains(JobId(300)) && recorded.quarantined.len() == 2);
}

#[test]
fn a_journal_without_a_head_is_replaced_by_an_empty_one_and_kept() {
    let (_folder, path, _) = history();
    let mut bytes = fs::read(&path).unwrap();
    bytes[..2 * PAGE].fill(0);
    fs::write(&path, &bytes).unwrap();
    assert!(matches!(JournalFile::open(&path), Err(JournalError::Damaged { .. })));
    let other = Header { session: SessionId([8; 16]), ..header() };
    JournalFile::replace(&path, &other).unwrap();
    let (_file, read, recorded) = JournalFile::open(&path).unwrap();
    assert_eq!((read, recorded.starts, recorded.accepted.len()), (other, 1, 0));
    assert!(!recorded.is_trusted());
    assert_eq!(fs::read(path.with_extension("damaged-1")).unwrap(), bytes);
}

#[test]
fn damage_that_comes_while_the_journal_is_open_is_found_when_it_is_written_anew() {
    let (_folder, path, written) = history();
    let file = JournalFile::open(&path).unwrap().0;
    let mut bytes = fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    io::Write::write_all(&mut File::options().write(true).open(&path).unwrap(), &bytes).unwrap();
    file.commit(&[answer(300, 1), answer(300, 2)]).unwrap();
    drop(file);
    assert!(path.with_extension("damaged-1").exists());
    let recorded = JournalFile::open(&path).unwrap().2;
    assert_eq!((recorded.accepted.get(JobId(300)).unwrap(), recorded.repairs), (Some(accepted(2)), 1));
    assert!(recorded.accepted.len() >= written.accepted.len());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn any_bits_may_be_flipped(
        flips in prop::collection::vec((any::<prop::sample::Index>(), 0u32..8), 1..12),
        in_one_page in any::<bool>(),
    ) {
        thread_local! {
            static HISTORY: (TempDir, PathBuf, Recorded) = history();
        }
        HISTORY.with(|(_, path, written)| {
            let folder = tempfile::tempdir().unwrap();
            let place = folder.path().join(JOURNAL_FILE);
            let mut bytes = fs::read(path).unwrap();
            let first = flips[0].0.index(bytes.len()) / PAGE * PAGE;
            let reach = if in_one_page { first..bytes.len().min(first + PAGE) } else { 0..bytes.len() };
            for (index, bit) in &flips {
                bytes[reach.start + index.index(reach.len())] ^= 1 << bit;
            }
            fs::write(&place, &bytes).unwrap();
            if in_one_page {
                check_salvaged(&place, written, "flips in a page");
            } else if let Ok((_, _, recorded)) = JournalFile::open(&place) {
                let left = recorded.accepted.all();
                assert!(left.into_iter().all(|(job, answer)| written.accepted.get(job).unwrap() == Some(*answer)));
            }
        });
    }
}
