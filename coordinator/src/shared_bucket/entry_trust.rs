//! Whose entries in the bucket are given to workers: trust is earned by checks, as it is with answers.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::time::{Duration, Instant};

use cluster::scheduler::Audit;
use proto::{Digest, Principal};

/// SHA-256 of an object's bytes.
pub type Sha256 = [u8; 32];

/// Contents of one name that may be signed for in a run: whoever asks without end must not fill the memory.
const MOST_UPLOADS: usize = 16;
/// So long after a URL to store something was signed nobody else gets one of that name: the URL is good for 15 min, and what
/// was begun in time may end later.
const UPLOAD_TIME: Duration = Duration::from_secs(20 * 60);
/// What could not be looked at is looked at again after this.
const LOOK_AGAIN: Duration = Duration::from_secs(10);

/// Who may have stored an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Author {
    /// Somebody in another run or before a restart, or whoever else has the key to the bucket.
    Unknown,
    /// Whom this run has given a URL to store it.
    Principal(Principal),
}

/// What is known of an author.
#[derive(Debug, Default)]
struct Record {
    /// Entries that were found right: a name counts once, however often it is stored.
    right: BTreeSet<Digest>,
    /// One was found wrong, or an answer was.
    is_wrong: bool,
    /// Who was given any of its entries before they were looked at.
    readers: BTreeSet<Principal>,
}

/// A content that was signed for.
#[derive(Clone, Copy, Debug)]
struct Upload {
    sha256: Sha256,
    principal: Principal,
    /// Until then it may be stored.
    until: Instant,
}

/// What was found under a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Known {
    /// This content, which is right, whatever takes its place.
    Right(Sha256),
    Wrong,
    /// Nothing that could be compared; until then nobody looks again.
    Nothing(Instant),
}

/// What is known of a name.
#[derive(Debug, Default)]
struct Entry {
    /// What was signed for, the last of which is to be there now.
    uploads: Vec<Upload>,
    known: Option<Known>,
}

/// An entry to be looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Check {
    /// Its name.
    pub key: Digest,
    /// Uploads that were signed for when it was chosen.
    uploads: usize,
}

/// What is there under the name of an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finding {
    /// Nothing, or nothing that it could be compared with.
    Nothing,
    /// What the entry should be.
    Right(Sha256),
    /// More bytes than workers read, or than could be read in time: nobody knows whose they are.
    TooLarge,
    /// Bytes that are no entry: a fault of the server, unless somebody has signed for just these.
    Damaged(Sha256),
    /// A sound entry that is not what its source gives.
    Wrong(Sha256),
}

/// What a worker is given of an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Given {
    /// Nothing.
    Withheld,
    /// Bytes with this SHA-256; what else is there is not to be used.
    Content(Sha256),
    /// Whatever is there, as far as this file knows: an earlier run has stored it, or it is to be stored.
    Anything,
}

/// Who was found wrong.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Conviction {
    /// Principals that have stored what is wrong.
    pub wrong: Vec<Principal>,
    /// Whether nobody has signed for it since this start.
    pub is_earlier: bool,
    /// Principals that were given entries of theirs before, and are not wrong by themselves.
    pub readers: BTreeSet<Principal>,
}

/// What is known of the entries of one run's clouds, and of who stored them.
#[derive(Debug)]
pub struct EntryTrust {
    audit: Audit,
    entries: HashMap<Digest, Entry>,
    records: BTreeMap<Author, Record>,
}

impl EntryTrust {
    /// The first entries of each author are checked, and a share of all others. If somebody was quarantined before this start,
    /// everything that was there before is: it may be theirs.
    pub fn new(audit: Audit, quarantined: &BTreeSet<Principal>) -> Self {
        let mut trust = Self { audit, entries: HashMap::new(), records: BTreeMap::new() };
        trust.distrust(quarantined);
        if !quarantined.is_empty() {
            trust.records.entry(Author::Unknown).or_default().is_wrong = true;
        }
        trust
    }

    /// Notes that a principal gets a URL to store these bytes; `false`: it must not. An entry has one author at a time, and is
    /// sent once: another content is signed for when the one before is out of time or was found wrong.
    pub fn sign(&mut self, key: Digest, sha256: Sha256, principal: Principal, now: Instant) -> bool {
        let entry = self.entries.entry(key).or_default();
        if matches!(entry.known, Some(Known::Right(_))) {
            return false; // it is there
        }
        let is_wrong = entry.known == Some(Known::Wrong);
        if let Some(last) = entry.uploads.last_mut() {
            let is_same = last.sha256 == sha256 && last.principal == principal;
            let author = self.records.get(&Author::Principal(last.principal));
            let is_free = now >= last.until || is_wrong || author.is_some_and(|record| record.is_wrong);
            if is_same {
                last.until = now + UPLOAD_TIME;
                entry.known = entry.known.filter(|_| !is_wrong);
                return true;
            }
            if !is_free {
                return false;
            }
        }
        if entry.uploads.len() >= MOST_UPLOADS {
            return false;
        }
        entry.uploads.push(Upload { sha256, principal, until: now + UPLOAD_TIME });
        entry.known = None;
        true
    }

    /// Which of these entries to check before any is given, at most `most`: `drawn` are checked even if their authors have
    /// earned trust.
    pub fn choose(&self, keys: &[Digest], drawn: &HashSet<Digest>, most: usize, now: Instant) -> Vec<Check> {
        let mut due: BTreeMap<Author, u32> = BTreeMap::new();
        let mut is_due = |key: &Digest| {
            let author = self.author(*key);
            let due = due.entry(author).or_insert_with(|| self.due(author));
            let is_due = *due > 0 || drawn.contains(key);
            *due = due.saturating_sub(1);
            is_due
        };
        let unknown = keys.iter().filter(|key| self.known(**key, now).is_none());
        let chosen = unknown.filter(|key| is_due(key)).take(most);
        chosen.map(|&key| Check { key, uploads: self.uploads(key).len() }).collect()
    }

    /// Notes what was found, and returns who is wrong because of it.
    pub fn note(&mut self, check: Check, finding: Finding, now: Instant) -> Conviction {
        let uploads = self.uploads(check.key).to_vec();
        let stored = |sha256: Sha256| {
            let theirs = uploads.iter().filter(move |upload| upload.sha256 == sha256);
            theirs.map(|upload| upload.principal).collect::<BTreeSet<_>>()
        };
        let is_current = uploads.len() == check.uploads;
        let (known, conviction) = match finding {
            Finding::Nothing => (Known::Nothing(now + LOOK_AGAIN), Conviction::default()),
            Finding::Right(sha256) => {
                let authors = stored(sha256);
                let unknown = authors.is_empty().then_some(Author::Unknown);
                for author in authors.into_iter().map(Author::Principal).chain(unknown) {
                    self.records.entry(author).or_default().right.insert(check.key);
                }
                (Known::Right(sha256), Conviction::default())
            }
            Finding::TooLarge => (Known::Wrong, Conviction::default()),
            Finding::Damaged(sha256) if stored(sha256).is_empty() => (Known::Wrong, Conviction::default()),
            Finding::Damaged(sha256) | Finding::Wrong(sha256) => {
                let authors = stored(sha256);
                (Known::Wrong, self.convict(authors))
            }
        };
        // What is right stays so; anything else may be what another content has replaced in the meantime.
        if is_current || matches!(known, Known::Right(_)) {
            self.entries.entry(check.key).or_default().known = Some(known);
        }
        conviction
    }

    /// What a principal is given of these entries. Those that are `drawn` must have been looked at.
    pub fn give(
        &mut self,
        keys: &[Digest],
        drawn: &HashSet<Digest>,
        reader: Principal,
        now: Instant,
    ) -> Vec<Given> {
        let give = |&key: &Digest| {
            let author = self.author(key);
            match self.known(key, now) {
                Some(Known::Right(sha256)) => return Given::Content(sha256),
                Some(Known::Wrong | Known::Nothing(_)) => return Given::Withheld,
                None if drawn.contains(&key) || self.due(author) > 0 => return Given::Withheld,
                None => {}
            }
            self.records.entry(author).or_default().readers.insert(reader);
            self.uploads(key).last().map_or(Given::Anything, |upload| Given::Content(upload.sha256))
        };
        keys.iter().map(give).collect()
    }

    /// Whether nothing that a principal stores is given unchecked any more.
    pub fn is_distrusted(&self, principal: Principal) -> bool {
        self.records.get(&Author::Principal(principal)).is_some_and(|record| record.is_wrong)
    }

    /// Notes that these principals were wrong, in whatever they have done; returns who was given what they have stored.
    pub fn distrust(&mut self, wrong: &BTreeSet<Principal>) -> BTreeSet<Principal> {
        let mut readers = BTreeSet::new();
        for principal in wrong {
            let record = self.records.entry(Author::Principal(*principal)).or_default();
            record.is_wrong = true;
            readers.append(&mut record.readers);
        }
        readers.retain(|reader| *reader != Principal::Coordinator && !wrong.contains(reader));
        readers
    }

    /// Notes that these principals were wrong; if there are none, whoever has stored what nobody has signed for.
    fn convict(&mut self, wrong: BTreeSet<Principal>) -> Conviction {
        let mut readers = self.distrust(&wrong);
        if wrong.is_empty() {
            let record = self.records.entry(Author::Unknown).or_default();
            record.is_wrong = true;
            readers.append(&mut record.readers);
            readers.remove(&Principal::Coordinator);
        }
        Conviction { is_earlier: wrong.is_empty(), wrong: wrong.into_iter().collect(), readers }
    }

    fn uploads(&self, key: Digest) -> &[Upload] {
        self.entries.get(&key).map_or(&[], |entry| &entry.uploads)
    }

    fn known(&self, key: Digest, now: Instant) -> Option<Known> {
        let known = self.entries.get(&key)?.known;
        known.filter(|known| !matches!(known, Known::Nothing(until) if now >= *until))
    }

    /// Who is to have stored what is there now.
    fn author(&self, key: Digest) -> Author {
        self.uploads(key).last().map_or(Author::Unknown, |upload| Author::Principal(upload.principal))
    }

    /// How many entries of an author are still to be checked before the others are given.
    fn due(&self, author: Author) -> u32 {
        match self.records.get(&author) {
            Some(record) if record.is_wrong => u32::MAX,
            _ if author == Author::Principal(Principal::Coordinator) => 0,
            None => self.audit.first,
            Some(record) => self.audit.first.saturating_sub(record.right.len() as u32),
        }
    }
}

#[cfg(test)]
mod tests {
    use proto::Origin;

    use super::*;

    const AUDIT: Audit = Audit { share: 0.0, first: 3 };
    const WELL: Sha256 = [1; 32];
    const ILL: Sha256 = [2; 32];

    fn principal(byte: u8) -> Principal {
        Principal::Anonymous(Origin::of([192, 0, 2, byte].into()))
    }

    fn keys(count: u8) -> Vec<Digest> {
        (0..count).map(|byte| Digest::of(&[byte])).collect()
    }

    /// What is known of a bucket, at a time that the test moves on.
    struct Bench {
        trust: EntryTrust,
        now: Instant,
    }

    impl Bench {
        fn new(audit: Audit) -> Self {
            Self { trust: EntryTrust::new(audit, &BTreeSet::new()), now: Instant::now() }
        }

        fn sign(&mut self, key: Digest, sha256: Sha256, author: u8) -> bool {
            self.trust.sign(key, sha256, principal(author), self.now)
        }

        /// Entries that a principal has stored.
        fn stored(&mut self, keys: &[Digest], author: u8) {
            assert!(keys.iter().all(|&key| self.sign(key, WELL, author)));
        }

        fn chosen(&self, keys: &[Digest]) -> Vec<Digest> {
            let checks = self.trust.choose(keys, &HashSet::new(), 100, self.now);
            checks.iter().map(|check| check.key).collect()
        }

        /// The check of one entry that is drawn.
        fn check(&self, key: Digest) -> Check {
            self.trust.choose(&[key], &HashSet::from([key]), 1, self.now)[0]
        }

        fn note(&mut self, check: Check, finding: Finding) -> Conviction {
            self.trust.note(check, finding, self.now)
        }

        /// Looks once at what is to be looked at, until there is nothing more, and finds each time the same.
        fn check_all(&mut self, keys: &[Digest], finding: Finding) {
            let mut left = keys.to_vec();
            loop {
                let checks = self.trust.choose(&left, &HashSet::new(), 100, self.now);
                if checks.is_empty() {
                    return;
                }
                for check in checks {
                    left.retain(|key| *key != check.key);
                    assert_eq!(self.note(check, finding), Conviction::default());
                }
            }
        }

        fn give(&mut self, keys: &[Digest], reader: u8) -> Vec<Given> {
            self.trust.give(keys, &HashSet::new(), principal(reader), self.now)
        }

        /// Which of these entries a worker gets.
        fn is_given(&mut self, keys: &[Digest]) -> Vec<bool> {
            self.give(keys, 9).into_iter().map(|given| given != Given::Withheld).collect()
        }
    }

    #[test]
    fn the_first_entries_of_each_author_are_checked_before_others_are_given() {
        let (mut bench, keys) = (Bench::new(AUDIT), keys(10));
        let (first, second) = keys.split_at(5);
        bench.stored(first, 1);
        bench.stored(second, 2);
        assert_eq!(bench.chosen(&keys), [&first[..3], &second[..3]].concat());
        assert_eq!(bench.is_given(&keys), [false; 10]);
        bench.check_all(first, Finding::Right(WELL));
        assert_eq!(bench.is_given(&keys), [[true; 5], [false; 5]].concat());
        bench.check_all(&keys, Finding::Right(WELL));
        assert_eq!(bench.is_given(&keys), [true; 10]);
    }

    #[test]
    fn what_is_drawn_is_given_once_it_was_looked_at() {
        let (mut bench, keys) = (Bench::new(AUDIT), keys(10));
        bench.stored(&keys, 1);
        bench.check_all(&keys, Finding::Right(WELL));
        let drawn = HashSet::from_iter(keys[5..].iter().copied());
        let checks = bench.trust.choose(&keys, &drawn, 2, bench.now);
        assert_eq!(checks.len(), 2, "of those that are trusted, at most so many");
        bench.note(checks[0], Finding::Right(WELL));
        let given = bench.trust.give(&keys, &drawn, principal(9), bench.now);
        let is_given: Vec<bool> = given.iter().map(|given| *given != Given::Withheld).collect();
        assert_eq!(is_given, [[true; 6].as_slice(), &[false; 4]].concat());
    }

    #[test]
    fn few_entries_are_given_once_each_was_checked() {
        let (mut bench, keys) = (Bench::new(AUDIT), keys(2));
        bench.stored(&keys, 1);
        bench.check_all(&keys, Finding::Right(WELL));
        assert_eq!(bench.give(&keys, 9), [Given::Content(WELL); 2]);
    }

    #[test]
    fn what_was_there_before_has_an_author_too_and_what_is_not_there_says_nothing() {
        let (mut bench, keys) = (Bench::new(AUDIT), keys(10));
        let (absent, there) = keys.split_at(4);
        bench.check_all(absent, Finding::Nothing);
        assert_eq!(bench.is_given(&keys), [false; 10]);
        assert_eq!(bench.chosen(&keys), there[..3]);
        bench.check_all(&keys, Finding::Right(WELL));
        let expected = [[Given::Withheld; 4].as_slice(), &[Given::Content(WELL); 3], &[Given::Anything; 3]];
        assert_eq!(bench.give(&keys, 9), expected.concat());
        // Somebody else may have stored the others by now.
        bench.now += LOOK_AGAIN;
        assert_eq!(bench.give(absent, 9), [Given::Anything; 4]);
    }

    #[test]
    fn who_only_asks_to_store_vouches_for_nothing_that_was_there_before() {
        let (mut bench, keys) = (Bench::new(AUDIT), keys(5));
        assert!(bench.trust.sign(keys[0], WELL, Principal::Coordinator, bench.now));
        assert_eq!(bench.give(&keys[..1], 9), [Given::Content(WELL)], "an older content is not to be used");
        // What is found there is right or wrong by itself, and says nothing of who has asked.
        bench.stored(&keys[1..], 1);
        for key in &keys[1..4] {
            let check = bench.check(*key);
            bench.note(check, Finding::Right(ILL));
        }
        assert_eq!(
            bench.give(&keys[1..], 9),
            [[Given::Content(ILL); 3].as_slice(), &[Given::Withheld]].concat()
        );
        let check = bench.check(keys[4]);
        let conviction = bench.note(check, Finding::Wrong(ILL));
        assert_eq!(conviction, Conviction { is_earlier: true, ..Conviction::default() });
    }

    #[test]
    fn whoever_has_signed_for_what_is_wrong_is_found_with_all_it_has_stored_and_all_who_took_it() {
        let (mut bench, keys) = (Bench::new(AUDIT), keys(8));
        bench.stored(&keys[..7], 1);
        assert!(bench.sign(keys[7], ILL, 1));
        bench.check_all(&keys[..7], Finding::Right(WELL));
        bench.give(&keys, 8);
        bench.give(&keys[4..5], 9);
        let check = bench.check(keys[7]);
        let conviction = bench.note(check, Finding::Wrong(ILL));
        let readers = BTreeSet::from([principal(8), principal(9)]);
        assert_eq!(conviction, Conviction { wrong: vec![principal(1)], is_earlier: false, readers });
        assert_eq!(bench.is_given(&keys), [[true; 3].as_slice(), &[false; 5]].concat(), "what was looked at");
        // Somebody else makes them again.
        for key in &keys[4..] {
            assert!(bench.trust.sign(*key, WELL, Principal::Coordinator, bench.now));
        }
        assert_eq!(bench.give(&keys[7..], 9), [Given::Content(WELL)], "and nothing that takes its place");
    }

    #[test]
    fn whoever_is_quarantined_for_an_answer_is_not_believed_in_the_bucket_either() {
        let (mut bench, keys) = (Bench::new(AUDIT), keys(8));
        bench.stored(&keys, 1);
        bench.check_all(&keys, Finding::Right(WELL));
        bench.give(&keys, 8);
        let readers = bench.trust.distrust(&BTreeSet::from([principal(1)]));
        assert_eq!(readers, BTreeSet::from([principal(8)]));
        assert_eq!(bench.is_given(&keys), [[true; 3].as_slice(), &[false; 5]].concat());
        assert!(bench.sign(keys[7], ILL, 2), "its names are free");
        // The coordinator itself included.
        bench.trust.distrust(&BTreeSet::from([Principal::Coordinator]));
        assert!(bench.trust.sign(keys[6], WELL, Principal::Coordinator, bench.now));
        assert_eq!(bench.is_given(&keys[6..7]), [false]);
    }

    #[test]
    fn after_a_quarantine_before_this_start_all_that_was_there_is_looked_at() {
        let (mut bench, keys) = (Bench::new(AUDIT), keys(10));
        bench.trust = EntryTrust::new(AUDIT, &BTreeSet::from([principal(1)]));
        assert_eq!(bench.chosen(&keys), keys);
        bench.check_all(&keys[..8], Finding::Right(WELL));
        assert_eq!(bench.is_given(&keys), [[true; 8].as_slice(), &[false; 2]].concat());
        assert!(bench.trust.is_distrusted(principal(1)) && !bench.trust.is_distrusted(principal(2)));
    }

    #[test]
    fn a_wrong_entry_that_nobody_has_signed_for_closes_all_others_of_the_kind() {
        let (mut bench, keys) = (Bench::new(AUDIT), keys(10));
        bench.stored(&keys[..4], 1);
        bench.check_all(&keys[..4], Finding::Right(WELL));
        let check = bench.check(keys[4]);
        let conviction = bench.note(check, Finding::Wrong(ILL));
        assert_eq!(conviction, Conviction { is_earlier: true, ..Conviction::default() });
        assert_eq!(bench.is_given(&keys), [[true; 4].as_slice(), &[false; 6]].concat());
        // It stays so: what is found right from now on is given, and nothing else.
        bench.check_all(&keys, Finding::Right(WELL));
        assert_eq!(bench.is_given(&keys[4..5]), [false]);
        assert_eq!(bench.is_given(&keys[5..]), [true; 5]);
    }

    #[test]
    fn a_damaged_entry_is_the_fault_of_whoever_has_signed_for_it_or_else_of_nobody() {
        let (mut bench, keys) = (Bench::new(AUDIT), keys(2));
        bench.stored(&keys, 1);
        for (key, finding) in keys.iter().zip([Finding::Damaged(ILL), Finding::TooLarge]) {
            let check = bench.check(*key);
            assert_eq!(bench.note(check, finding), Conviction::default());
            assert_eq!(bench.is_given(&[*key]), [false]);
        }
        bench.stored(&keys[..1], 1);
        let check = bench.check(keys[0]);
        assert_eq!(bench.note(check, Finding::Damaged(WELL)).wrong, [principal(1)]);
    }

    #[test]
    fn what_is_signed_for_while_another_content_is_looked_at_is_looked_at_too() {
        let (mut bench, keys) = (Bench::new(AUDIT), keys(1));
        let check = bench.check(keys[0]);
        assert!(bench.sign(keys[0], WELL, 1));
        bench.note(check, Finding::Nothing);
        assert_eq!(bench.chosen(&keys), keys);
    }

    #[test]
    fn of_those_who_have_made_an_entry_one_stores_it() {
        let (mut bench, keys) = (Bench::new(AUDIT), keys(2));
        bench.stored(&keys, 1);
        let is_another_signed = |bench: &mut Bench| {
            [(WELL, 2), (ILL, 2), (ILL, 1)].map(|(sum, author)| bench.sign(keys[0], sum, author))
        };
        assert_eq!(is_another_signed(&mut bench), [false; 3]);
        assert!(bench.sign(keys[0], WELL, 1), "the same again");
        let check = bench.check(keys[0]);
        bench.note(check, Finding::Right(WELL));
        bench.now += UPLOAD_TIME;
        assert_eq!(is_another_signed(&mut bench), [false; 3], "it is there");
        // Until it was found wrong, or is out of time.
        assert!(bench.sign(keys[1], ILL, 2));
        let check = bench.check(keys[1]);
        bench.note(check, Finding::Wrong(ILL));
        assert!(bench.sign(keys[1], WELL, 3));
    }

    #[test]
    fn the_coordinator_needs_no_checks_and_audits_can_be_off() {
        let (mut bench, keys) = (Bench::new(AUDIT), keys(2));
        for key in &keys {
            bench.trust.sign(*key, WELL, Principal::Coordinator, bench.now);
        }
        assert_eq!((bench.chosen(&keys), bench.is_given(&keys)), (vec![], vec![true; 2]));
        let mut bench = Bench::new(Audit::NONE);
        assert_eq!((bench.chosen(&keys), bench.is_given(&keys)), (vec![], vec![true; 2]));
    }

    #[test]
    fn nobody_fills_the_memory_with_uploads() {
        let mut bench = Bench::new(AUDIT);
        let key = Digest::of(b"one");
        let mut sign = |byte| {
            bench.now += UPLOAD_TIME;
            bench.sign(key, [byte; 32], 1)
        };
        assert_eq!((0..100).filter(|byte| sign(*byte)).count(), MOST_UPLOADS);
    }
}
