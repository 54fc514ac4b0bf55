//! Whose entries in the bucket are given to workers: trust is earned by checks, as it is with answers.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use cluster::scheduler::Audit;
use proto::{Digest, Principal};

/// SHA-256 of an object's bytes.
pub type Sha256 = [u8; 32];

/// Objects of one name that may be signed for in a run: whoever asks without end must not fill the memory.
const MOST_UPLOADS: usize = 16;

/// Who may have stored an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Author {
    /// Somebody in another run, or whoever else has the key to the bucket.
    Unknown,
    /// Whom this run has given a URL to store it.
    Principal(Principal),
}

/// What is known of an author.
#[derive(Debug, Default)]
struct Record {
    /// Entries that were found right: a name counts once, however often it is stored.
    right: BTreeSet<Digest>,
    /// One was found wrong.
    is_wrong: bool,
    /// Who was given any of its entries.
    readers: BTreeSet<Principal>,
}

/// An entry that was looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Known {
    Right,
    Wrong,
    Absent,
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
    /// Nothing.
    Absent,
    /// What the entry should be.
    Right(Sha256),
    /// Bytes that are no entry: a fault of the server, unless somebody has signed for just these.
    Damaged(Sha256),
    /// A sound entry that is not what its source gives.
    Wrong(Sha256),
}

/// Who was found wrong.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Conviction {
    /// Principals that have stored what is wrong.
    pub wrong: Vec<Principal>,
    /// Whether it was there before this run.
    pub is_earlier: bool,
    /// Principals that were given entries of theirs before, and are not wrong by themselves.
    pub readers: BTreeSet<Principal>,
}

/// What is known of the entries of one run's clouds, and of who stored them.
#[derive(Debug)]
pub struct EntryTrust {
    audit: Audit,
    /// What was signed for, by whom.
    uploads: HashMap<Digest, Vec<(Sha256, Principal)>>,
    known: HashMap<Digest, Known>,
    records: BTreeMap<Author, Record>,
}

impl EntryTrust {
    /// Nothing is known. The first entries of each author are checked, and a share of all others.
    pub fn new(audit: Audit) -> Self {
        Self { audit, uploads: HashMap::new(), known: HashMap::new(), records: BTreeMap::new() }
    }

    /// Notes that a principal gets a URL to store these bytes; `false`: it must not. Of those that have made the same entry the
    /// first one stores it, so that it has one author, and is sent once; another does if that one was found wrong.
    pub fn sign(&mut self, key: Digest, sha256: Sha256, principal: Principal) -> bool {
        let uploads = self.uploads.entry(key).or_default();
        let is_anothers = uploads.iter().any(|(_, author)| *author != principal);
        if is_anothers && self.known.get(&key) != Some(&Known::Wrong) {
            return false;
        }
        if !uploads.contains(&(sha256, principal)) {
            if uploads.len() >= MOST_UPLOADS {
                return false;
            }
            uploads.push((sha256, principal));
        }
        self.known.remove(&key);
        true
    }

    /// Which of these entries to check before any is given, at most `most`: `drawn` are checked even if their authors have
    /// earned trust.
    pub fn choose(&self, keys: &[Digest], drawn: &HashSet<Digest>, most: usize) -> Vec<Check> {
        let mut due: BTreeMap<Author, u32> = BTreeMap::new();
        let mut is_due = |key: &Digest| {
            let mut is_due = drawn.contains(key);
            for author in self.authors(*key) {
                let due = due.entry(author).or_insert_with(|| self.due(author));
                is_due |= *due > 0;
                *due = due.saturating_sub(1);
            }
            is_due
        };
        let unknown = keys.iter().filter(|key| !self.known.contains_key(key));
        let chosen = unknown.filter(|key| is_due(key)).take(most);
        chosen.map(|&key| Check { key, uploads: self.uploads(key).len() }).collect()
    }

    /// Notes what was found, and returns who is wrong because of it.
    pub fn note(&mut self, check: Check, finding: Finding) -> Conviction {
        let uploads = self.uploads(check.key).to_vec();
        let stored = |sha256: Sha256| {
            let theirs = uploads.iter().filter(move |(signed, _)| *signed == sha256);
            theirs.map(|(_, principal)| *principal).collect::<BTreeSet<_>>()
        };
        // What is signed for by others may come at any time, and replace what was looked at.
        let is_current = |sha256: Sha256| {
            uploads.len() == check.uploads && uploads.iter().all(|(signed, _)| *signed == sha256)
        };
        let (known, conviction) = match finding {
            Finding::Absent => (uploads.is_empty().then_some(Known::Absent), Conviction::default()),
            Finding::Right(sha256) => {
                let authors = stored(sha256);
                let unknown = authors.is_empty().then_some(Author::Unknown);
                for author in authors.into_iter().map(Author::Principal).chain(unknown) {
                    self.records.entry(author).or_default().right.insert(check.key);
                }
                (is_current(sha256).then_some(Known::Right), Conviction::default())
            }
            Finding::Damaged(sha256) if stored(sha256).is_empty() => {
                (Some(Known::Wrong), Conviction::default())
            }
            Finding::Damaged(sha256) | Finding::Wrong(sha256) => {
                (Some(Known::Wrong), self.convict(stored(sha256)))
            }
        };
        if let Some(known) = known.filter(|_| uploads.len() == check.uploads) {
            self.known.insert(check.key, known);
        }
        conviction
    }

    /// Which of these entries a principal is given.
    pub fn give(&mut self, keys: &[Digest], reader: Principal) -> Vec<bool> {
        let give = |&key: &Digest| {
            let authors = self.authors(key);
            let is_given = match self.known.get(&key) {
                Some(Known::Right) => true,
                Some(Known::Wrong | Known::Absent) => false,
                None => !self.is_closed() && authors.iter().all(|author| self.due(*author) == 0),
            };
            if is_given {
                for author in authors {
                    self.records.entry(author).or_default().readers.insert(reader);
                }
            }
            is_given
        };
        keys.iter().map(give).collect()
    }

    /// Notes that these principals were wrong; if there are none, whoever has stored what nobody has signed for.
    fn convict(&mut self, wrong: BTreeSet<Principal>) -> Conviction {
        let authors = match wrong.is_empty() {
            true => vec![Author::Unknown],
            false => wrong.iter().copied().map(Author::Principal).collect(),
        };
        let mut readers = BTreeSet::new();
        for author in authors {
            let record = self.records.entry(author).or_default();
            record.is_wrong = true;
            readers.append(&mut record.readers);
        }
        let is_innocent = |reader: &Principal| *reader != Principal::Coordinator && !wrong.contains(reader);
        readers.retain(is_innocent);
        Conviction { is_earlier: wrong.is_empty(), wrong: wrong.into_iter().collect(), readers }
    }

    fn uploads(&self, key: Digest) -> &[(Sha256, Principal)] {
        self.uploads.get(&key).map_or(&[], Vec::as_slice)
    }

    fn authors(&self, key: Digest) -> BTreeSet<Author> {
        match self.uploads(key) {
            [] => BTreeSet::from([Author::Unknown]),
            uploads => uploads.iter().map(|(_, principal)| Author::Principal(*principal)).collect(),
        }
    }

    /// How many entries of an author are still to be checked before the others are given.
    fn due(&self, author: Author) -> u32 {
        match (author, self.records.get(&author)) {
            (Author::Principal(Principal::Coordinator), _) => 0,
            (_, None) => self.audit.first,
            (_, Some(record)) if record.is_wrong => u32::MAX,
            (_, Some(record)) => self.audit.first.saturating_sub(record.right.len() as u32),
        }
    }

    /// Whether an entry that nobody has signed for was wrong: whoever stored it may replace any other.
    fn is_closed(&self) -> bool {
        self.records.get(&Author::Unknown).is_some_and(|record| record.is_wrong)
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

    /// The first entry to check of some that are all drawn.
    fn any(trust: &EntryTrust, keys: &[Digest]) -> Check {
        trust.choose(keys, &keys.iter().copied().collect(), 100)[0]
    }

    /// Entries that a principal has stored.
    fn stored(trust: &mut EntryTrust, keys: &[Digest], principal: Principal) {
        assert!(keys.iter().all(|&key| trust.sign(key, WELL, principal)));
    }

    fn chosen(trust: &EntryTrust, keys: &[Digest]) -> Vec<Digest> {
        trust.choose(keys, &HashSet::new(), 100).iter().map(|check| check.key).collect()
    }

    /// Looks once at what is to be looked at, until there is nothing more, and finds each time the same.
    fn check_all(trust: &mut EntryTrust, keys: &[Digest], finding: Finding) {
        let mut left = keys.to_vec();
        loop {
            let checks = trust.choose(&left, &HashSet::new(), 100);
            if checks.is_empty() {
                return;
            }
            for check in checks {
                left.retain(|key| *key != check.key);
                assert_eq!(trust.note(check, finding), Conviction::default());
            }
        }
    }

    #[test]
    fn the_first_entries_of_each_author_are_checked_before_others_are_given() {
        let mut trust = EntryTrust::new(AUDIT);
        let (keys, reader) = (keys(10), principal(9));
        let (first, second) = keys.split_at(5);
        stored(&mut trust, first, principal(1));
        stored(&mut trust, second, principal(2));
        assert_eq!(chosen(&trust, &keys), [&first[..3], &second[..3]].concat());
        assert_eq!(trust.give(&keys, reader), [false; 10]);
        check_all(&mut trust, first, Finding::Right(WELL));
        assert_eq!(trust.give(&keys, reader), [[true; 5], [false; 5]].concat());
        check_all(&mut trust, &keys, Finding::Right(WELL));
        assert_eq!(trust.give(&keys, reader), [true; 10]);
        let drawn = HashSet::from_iter(keys.iter().copied());
        assert_eq!(trust.choose(&keys, &drawn, 2).len(), 2, "of those that are trusted, at most so many");
    }

    #[test]
    fn few_entries_are_given_once_each_was_checked() {
        let mut trust = EntryTrust::new(AUDIT);
        let keys = keys(2);
        stored(&mut trust, &keys, principal(1));
        check_all(&mut trust, &keys, Finding::Right(WELL));
        assert_eq!(trust.give(&keys, principal(9)), [true; 2]);
    }

    #[test]
    fn what_was_there_before_has_an_author_too_and_what_is_not_there_says_nothing() {
        let mut trust = EntryTrust::new(AUDIT);
        let keys = keys(10);
        let (absent, there) = keys.split_at(4);
        check_all(&mut trust, absent, Finding::Absent);
        assert_eq!(trust.give(&keys, principal(9)), [false; 10]);
        assert_eq!(chosen(&trust, &keys), there[..3]);
        check_all(&mut trust, &keys, Finding::Right(WELL));
        assert_eq!(trust.give(&keys, principal(9)), [[false; 4].as_slice(), &[true; 6]].concat());
    }

    #[test]
    fn whoever_has_signed_for_what_is_wrong_is_found_with_all_it_has_stored_and_all_who_took_it() {
        let mut trust = EntryTrust::new(AUDIT);
        let keys = keys(8);
        stored(&mut trust, &keys, principal(1));
        check_all(&mut trust, &keys, Finding::Right(WELL));
        trust.give(&keys, principal(8));
        trust.give(&keys[4..5], principal(9));
        assert!(trust.sign(keys[7], ILL, principal(1)));
        let check = any(&trust, &keys[7..]);
        let conviction = trust.note(check, Finding::Wrong(ILL));
        let readers = BTreeSet::from([principal(8), principal(9)]);
        assert_eq!(conviction, Conviction { wrong: vec![principal(1)], is_earlier: false, readers });
        let given = trust.give(&keys, principal(9));
        assert_eq!(given, [[true; 3].as_slice(), &[false; 5]].concat(), "those that were looked at");
        // Somebody else makes one again.
        assert!(trust.sign(keys[7], WELL, Principal::Coordinator));
        check_all(&mut trust, &keys[7..], Finding::Right(WELL));
        assert_eq!(
            trust.give(&keys[7..], principal(9)),
            [false],
            "it can still be replaced for some minutes"
        );
    }

    #[test]
    fn a_wrong_entry_that_nobody_has_signed_for_closes_all_that_was_not_looked_at() {
        let mut trust = EntryTrust::new(AUDIT);
        let keys = keys(10);
        stored(&mut trust, &keys[..4], principal(1));
        check_all(&mut trust, &keys[..4], Finding::Right(WELL));
        let check = any(&trust, &keys[4..]);
        let conviction = trust.note(check, Finding::Wrong(ILL));
        assert_eq!(conviction, Conviction { is_earlier: true, ..Conviction::default() });
        assert_eq!(trust.give(&keys, principal(9)), [[true; 3].as_slice(), &[false; 7]].concat());
        // It stays so: what is found right from now on is given, and nothing else.
        check_all(&mut trust, &keys, Finding::Right(WELL));
        assert_eq!(trust.give(&keys[4..5], principal(9)), [false]);
        assert_eq!(trust.give(&keys[5..], principal(9)), [true; 5]);
    }

    #[test]
    fn a_damaged_entry_is_the_fault_of_whoever_has_signed_for_it_or_else_of_nobody() {
        let mut trust = EntryTrust::new(AUDIT);
        let keys = keys(1);
        stored(&mut trust, &keys, principal(1));
        let check = any(&trust, &keys);
        assert_eq!(trust.note(check, Finding::Damaged(ILL)), Conviction::default());
        assert_eq!(trust.give(&keys, principal(9)), [false]);
        stored(&mut trust, &keys, principal(1));
        let check = any(&trust, &keys);
        assert_eq!(trust.note(check, Finding::Damaged(WELL)).wrong, [principal(1)]);
    }

    #[test]
    fn what_can_still_be_replaced_is_not_taken_for_right() {
        let mut trust = EntryTrust::new(AUDIT);
        let keys = keys(1);
        stored(&mut trust, &keys, principal(1));
        assert!(trust.sign(keys[0], ILL, principal(1)), "to be sent later");
        for _ in 0..5 {
            let check = any(&trust, &keys);
            trust.note(check, Finding::Right(WELL));
        }
        assert_eq!(trust.give(&keys, principal(9)), [false], "nor does one name earn trust for others");
        // Signed for while it was looked at.
        let mut trust = EntryTrust::new(AUDIT);
        stored(&mut trust, &keys, principal(1));
        let check = any(&trust, &keys);
        assert!(trust.sign(keys[0], ILL, principal(1)));
        trust.note(check, Finding::Right(WELL));
        assert_eq!(trust.give(&keys, principal(9)), [false]);
    }

    #[test]
    fn of_those_who_have_made_an_entry_one_stores_it() {
        let mut trust = EntryTrust::new(AUDIT);
        let keys = keys(1);
        stored(&mut trust, &keys, principal(1));
        assert!(
            !trust.sign(keys[0], WELL, principal(2)) && !trust.sign(keys[0], ILL, Principal::Coordinator)
        );
        let check = any(&trust, &keys);
        trust.note(check, Finding::Wrong(WELL));
        assert!(trust.sign(keys[0], ILL, principal(2)), "until it was found wrong");
    }

    #[test]
    fn the_coordinator_needs_no_checks_and_audits_can_be_off() {
        let mut trust = EntryTrust::new(AUDIT);
        let keys = keys(2);
        stored(&mut trust, &keys, Principal::Coordinator);
        assert_eq!((chosen(&trust, &keys), trust.give(&keys, principal(9))), (vec![], vec![true; 2]));
        let mut trust = EntryTrust::new(Audit::NONE);
        assert_eq!((chosen(&trust, &keys), trust.give(&keys, principal(9))), (vec![], vec![true; 2]));
    }

    #[test]
    fn nobody_fills_the_memory_with_uploads() {
        let mut trust = EntryTrust::new(AUDIT);
        let signs: Vec<bool> =
            (0..100).map(|byte| trust.sign(Digest::of(b"one"), [byte; 32], principal(1))).collect();
        assert_eq!(signs.iter().filter(|signed| **signed).count(), MOST_UPLOADS);
        assert!(trust.sign(Digest::of(b"one"), [0; 32], principal(1)), "the same again");
    }
}
