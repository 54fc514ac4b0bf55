//! Forgets what is in doubt, wherever in the store it is kept, and names the finished runs that rest on it.

use std::fmt;

use cache::Store;

use super::finished_runs::Finished;
use super::source::Wrong;
use super::sourced::Sourced;
use super::{KIND, finished_runs, records};

/// Runs and grids that a message names.
const MAX_SHOWN: usize = 10;

/// What was dropped, and what rests on it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Forgotten {
    /// Remembered counts.
    pub counts: usize,
    /// Entries with descriptions, or the best descriptor of a grid.
    pub entries: usize,
    /// Finished runs and grids that rest on what is in doubt.
    pub finished: Vec<Finished>,
}

/// Drops everything that is in doubt from this machine's disk.
pub fn forget(store: &Store, wrong: &Wrong) -> Forgotten {
    if wrong.is_empty() {
        return Forgotten::default();
    }
    let mut forgotten =
        Forgotten { finished: finished_runs::resting_on(store, wrong), ..Forgotten::default() };
    for key in store.local_keys(KIND) {
        let Some(payload) = store.get_local(KIND, key) else { continue };
        match records::without(&payload, wrong) {
            (_, 0) => {}
            (left, dropped) => {
                match left {
                    Some(left) => store.put_local(KIND, key, &left),
                    None => store.remove_local(KIND, key),
                }
                forgotten.counts += dropped;
            }
        }
    }
    forgotten.entries = Sourced::ALL.iter().map(|kind| kind.forget(store, wrong)).sum();
    forgotten
}

impl Forgotten {
    /// Whether there was nothing, and no run rests on anything.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

impl fmt::Display for Forgotten {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { counts, entries, finished } = self;
        match (counts, entries) {
            (0, 0) => f.write_str("the cache has nothing of it")?,
            (_, 0) => write!(f, "dropped from the cache: {counts} counts")?,
            _ => write!(f, "dropped from the cache: {counts} counts and {entries} other entries")?,
        }
        for one in finished.iter().take(MAX_SHOWN) {
            write!(f, "\n{} rests on such answers, too; check it: {one}", one.folder.display())?;
        }
        let more = finished.len().saturating_sub(MAX_SHOWN);
        if more > 0 { write!(f, "\nso do {more} more") } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use cluster::scheduler::Basis;
    use descriptor::{Descriptor, Parameters, Preprocess};
    use proto::{Digest, SessionId};
    use results::Counts;

    use super::super::source::tests::{principal, source};
    use super::super::{CachedCounts, CountCache, CountsByDescriptor};
    use super::*;
    use crate::storage::store_in;

    #[test]
    fn what_a_principal_has_left_goes_from_every_entry_and_the_rest_stays() {
        let folder = tempfile::tempdir().unwrap();
        let store = store_in(folder.path());
        let counts = Counts { object_correct: 3, category_correct: 4, queries: 10 };
        let one = |shape_bins: u32, byte: u8| {
            let source = Arc::new(source(1, &[principal(byte)], Basis::Earned));
            let parameters = Parameters { shape_bins, ..Parameters::PAPER_BEST };
            (Descriptor::DiskRing(parameters), CachedCounts { counts, source })
        };
        let cache = |clouds: u8| {
            let manifest = [Digest([clouds; 32])];
            CountCache::new(&store, &Preprocess::default(), [&manifest, &manifest], 10)
        };
        cache(1).keep(&CountsByDescriptor::from([one(8, 1), one(9, 2)]));
        cache(2).keep(&CountsByDescriptor::from([one(8, 1)]));
        cache(3).keep(&CountsByDescriptor::from([one(8, 2)]));
        let [liar, honest] = [1, 2].map(|byte| source(1, &[principal(byte)], Basis::Audited));
        for kind in Sourced::ALL {
            kind.put(&store, Digest([1; 32]), &liar, b"wrong");
            kind.put(&store, Digest([2; 32]), &honest, b"right");
        }
        let run = folder.path().join("run");
        std::fs::create_dir(&run).unwrap();
        finished_runs::note(
            &store,
            (&run, false),
            SessionId([1; 16]),
            [principal(1)].into(),
            std::iter::empty(),
        );

        let wrong = Wrong { principals: [principal(1)].into(), ..Wrong::default() };
        let forgotten = forget(&store, &wrong);
        let finished = vec![Finished { folder: run, is_grid: false }];
        assert_eq!(forgotten, Forgotten { counts: 2, entries: 2, finished });
        assert_eq!(cache(1).read(), CountsByDescriptor::from([one(9, 2)]));
        assert_eq!(cache(2).read(), CountsByDescriptor::new());
        assert_eq!(cache(3).read(), CountsByDescriptor::from([one(8, 2)]));
        for kind in Sourced::ALL {
            assert_eq!(kind.get(&store, Digest([1; 32])), None);
            assert_eq!(kind.get(&store, Digest([2; 32])), Some((honest.clone(), b"right".to_vec())));
        }
        let again = forget(&store, &wrong);
        assert_eq!((again.counts, again.entries), (0, 0));
        assert!(forget(&store, &Wrong::default()).is_empty());
    }
}
