//! A register of finished runs and grids in the store: which of them rest on whose word. It names those that are to be
//! checked; no result depends on it.

use std::collections::BTreeSet;
use std::fmt;
use std::path::{Path, PathBuf};

use cache::Store;
use proto::{Digest, Principal, SessionId};
use serde::{Deserialize, Serialize};

use super::source::{Source, Wrong};

/// Kind of the entries in the store.
const KIND: &str = "finished run";

/// A finished run or grid.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Finished {
    /// Its folder, absolute.
    pub folder: PathBuf,
    /// Whether it is a grid.
    pub is_grid: bool,
}

/// How to check it.
impl fmt::Display for Finished {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let folder = self.folder.display();
        match self.is_grid {
            true => write!(f, "coordinator exhaust EXPERIMENT --out {folder} --sample 1000"),
            false => write!(f, "coordinator verify {folder} --sample 1000"),
        }
    }
}

/// One of them as it is kept.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    folder: PathBuf,
    is_grid: bool,
    /// The session that has finished it, hexadecimal; empty if that is not known.
    run: String,
    /// On whose word it rests: those who have answered, and those from whom earlier runs had what it has used.
    principals: BTreeSet<String>,
    /// The sessions that have left something that it has used.
    used: BTreeSet<String>,
}

impl Entry {
    fn concerns(&self, wrong: &Wrong) -> bool {
        let principal =
            |text: &String| text.parse().is_ok_and(|one: Principal| wrong.principals.contains(&one));
        let run = |text: &String| SessionId::from_hex(text).is_some_and(|run| wrong.runs.contains(&run));
        self.principals.iter().any(principal) || self.used.iter().any(run)
    }

    fn add(&mut self, principals: BTreeSet<Principal>, used: impl Iterator<Item = Source>) {
        self.principals.extend(principals.iter().map(ToString::to_string));
        for Source { run, provenance } in used {
            self.used.insert(run.to_string());
            self.principals.extend(provenance.principals.iter().map(ToString::to_string));
        }
    }

    fn read(store: &Store, key: Digest) -> Option<Self> {
        serde_json::from_slice(&store.get_local(KIND, key)?).ok()
    }

    fn write(&self, store: &Store, key: Digest) {
        if let Ok(payload) = serde_json::to_vec(self) {
            store.put_local(KIND, key, &payload);
        }
    }
}

/// A folder as it is noted, and the key of its entry.
fn place(folder: &Path) -> (PathBuf, Digest) {
    let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    let key = Digest::of(folder.as_os_str().as_encoded_bytes());
    (folder, key)
}

/// Notes that the run or grid in `folder` was finished by a session, that it rests on the word of these principals, and
/// what it has used of earlier runs.
pub fn note(
    store: &Store,
    (folder, is_grid): (&Path, bool),
    run: SessionId,
    principals: BTreeSet<Principal>,
    used: impl Iterator<Item = Source>,
) {
    let (folder, key) = place(folder);
    let mut entry = Entry { folder, is_grid, run: run.to_string(), ..Entry::default() };
    entry.add(principals, used);
    entry.write(store, key);
}

/// Notes that a comparison in the folder of a finished run rests on the word of these principals, too.
pub fn note_comparison(
    store: &Store,
    folder: &Path,
    principals: BTreeSet<Principal>,
    used: impl Iterator<Item = Source>,
) {
    let (folder, key) = place(folder);
    let mut entry = Entry::read(store, key).unwrap_or_else(|| Entry { folder, ..Entry::default() });
    entry.add(principals, used);
    entry.write(store, key);
}

/// What is finished and rests on what is in doubt, as far as it is still there.
pub fn resting_on(store: &Store, wrong: &Wrong) -> Vec<Finished> {
    let entries = store.local_keys(KIND).into_iter().filter_map(|key| Entry::read(store, key));
    let doubtful = entries.filter(|entry| entry.concerns(wrong) && entry.folder.is_dir());
    let mut finished: Vec<Finished> =
        doubtful.map(|Entry { folder, is_grid, .. }| Finished { folder, is_grid }).collect();
    finished.sort();
    finished
}

/// The session that has finished the run in a folder, if it is in the register.
pub fn session_of(store: &Store, folder: &Path) -> Option<SessionId> {
    SessionId::from_hex(&Entry::read(store, place(folder).1)?.run)
}

#[cfg(test)]
mod tests {
    use cluster::scheduler::Basis;

    use super::super::source::tests::{principal, source};
    use super::*;
    use crate::storage::store_in;

    #[test]
    fn runs_are_named_that_rest_on_a_principal_or_on_what_a_run_has_left() {
        let folder = tempfile::tempdir().unwrap();
        let store = store_in(folder.path());
        let run = |name: &str| {
            let path = folder.path().join(name);
            std::fs::create_dir(&path).unwrap();
            path
        };
        let session = |byte: u8| SessionId([byte; 16]);
        let [first, second, gone] = ["first", "second", "gone"].map(run);
        note(&store, (&first, false), session(1), [principal(1)].into(), std::iter::empty());
        let used = [source(1, &[principal(1)], Basis::Earned), source(3, &[principal(3)], Basis::Earned)];
        note(&store, (&second, true), session(2), [principal(2)].into(), used.into_iter());
        note(&store, (&gone, false), session(4), [principal(1)].into(), std::iter::empty());
        std::fs::remove_dir(gone).unwrap();

        let named = |principals: &[Principal], runs: &[u8]| {
            let principals = principals.iter().copied().collect();
            resting_on(&store, &Wrong { principals, runs: runs.iter().map(|&run| session(run)).collect() })
        };
        let [first, second] =
            [(first, false), (second, true)].map(|(folder, is_grid)| Finished { folder, is_grid });
        assert_eq!(named(&[principal(1)], &[]), [first.clone(), second.clone()]);
        assert_eq!(named(&[principal(2)], &[]), std::slice::from_ref(&second));
        assert_eq!(named(&[principal(3)], &[]), std::slice::from_ref(&second));
        assert_eq!(named(&[], &[1]), std::slice::from_ref(&second));
        assert!(named(&[principal(4)], &[2]).is_empty());
        assert_eq!(session_of(&store, &second.folder), Some(session(2)));
        assert_eq!(session_of(&store, folder.path()), None);

        // A comparison adds to what is noted of its run, if anything is.
        let used = [source(5, &[principal(5)], Basis::Audited)];
        note_comparison(&store, &first.folder, [principal(4)].into(), used.into_iter());
        note_comparison(&store, folder.path(), [principal(4)].into(), std::iter::empty());
        let unknown = Finished { folder: folder.path().to_owned(), is_grid: false };
        assert_eq!(named(&[principal(4)], &[]), [unknown, first.clone()]);
        assert_eq!(named(&[principal(1)], &[]), [first.clone(), second]);
        assert_eq!(named(&[], &[5]), std::slice::from_ref(&first));
        assert_eq!(session_of(&store, &first.folder), Some(session(1)));
    }
}
