//! A map whose memory is bounded: what is more lies in a temporary file, which goes with the process.
//!
//! A long run meets millions of jobs and descriptors, any of which may be asked for again, while hardly any are. What a
//! restart needs is in the journal; nothing here has to outlive a crash, so that nothing is ever synced.
//!
//! The environment variable `DESCRY_SPILL_ABOVE` has maps keep fewer bytes in memory, so that a run of seconds can test what
//! otherwise takes a run of hours.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::io;
use std::ops::Bound;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use redb::backends::FileBackend;
use redb::{
    Database, ReadableDatabase, ReadableTable, StorageBackend, TableDefinition, TableError, WriteTransaction,
};

/// Most bytes of entries in memory, of one map, unless `DESCRY_SPILL_ABOVE` says how many.
const RESIDENT_BYTES: usize = 4 << 20;

/// What an entry takes beside the bytes of its key and value, about: two vectors and their allocations.
const ENTRY_BYTES: usize = 96;

/// Entries that move to the file at once, and bytes of them: as few as keep a poll from waiting for longer than a few
/// milliseconds.
const ENTRIES_AT_ONCE: usize = 512;
const BYTES_AT_ONCE: usize = 256 << 10;

/// Memory that the file is read and written through.
const CACHE_BYTES: usize = 4 << 20;

const TABLE: TableDefinition<'_, &[u8], &[u8]> = TableDefinition::new("spilled");

/// `DESCRY_SPILL_ABOVE` asks for something unknown.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("DESCRY_SPILL_ABOVE: a number of bytes expected, got {0}\nleave it out for {RESIDENT_BYTES}")]
pub struct SpillSettingError(String);

/// Checks what `DESCRY_SPILL_ABOVE` asks for. A program calls it when it starts: maps take a mistake in it for nothing.
///
/// # Errors
/// If it is no number of bytes.
pub fn check_environment() -> Result<(), SpillSettingError> {
    bytes_of_environment().map(drop)
}

fn bytes_of_environment() -> Result<usize, SpillSettingError> {
    let asked = std::env::var_os("DESCRY_SPILL_ABOVE").unwrap_or_default();
    if asked.is_empty() {
        return Ok(RESIDENT_BYTES);
    }
    let bytes = asked.to_str().and_then(|asked| asked.parse().ok());
    bytes.ok_or_else(|| SpillSettingError(asked.to_string_lossy().into_owned()))
}

/// Most bytes of entries in memory, of one map of this process.
fn resident_bytes() -> usize {
    static BYTES: OnceLock<usize> = OnceLock::new();
    *BYTES.get_or_init(|| bytes_of_environment().unwrap_or(RESIDENT_BYTES))
}

/// A map from bytes to bytes of which memory holds a part.
#[derive(Debug)]
pub struct SpillMap {
    /// The part in memory. It holds of an entry that is in the file, too.
    resident: BTreeMap<Vec<u8>, Vec<u8>>,
    /// Bytes of the resident part.
    bytes: usize,
    /// Most of them.
    most: usize,
    /// Where the file is made.
    directory: Option<PathBuf>,
    file: Option<Database>,
    /// From which key on entries move to the file next: neighbours lie together there.
    next: Vec<u8>,
    failure: OnceLock<SpillError>,
}

/// The file of a map can no longer be used: some of what a run has met cannot be looked up.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{directory}: what the run has met cannot be looked up in a file there, got {what}\ncheck the disk and its free space, then run the same command again"
)]
pub struct SpillError {
    directory: PathBuf,
    what: String,
}

impl SpillMap {
    /// An empty map, whose file is made in this directory when it is needed; without a directory it stays in memory.
    pub fn new(directory: Option<&Path>) -> Self {
        let most = if directory.is_some() { resident_bytes() } else { usize::MAX };
        Self::with(directory.map(Path::to_owned), most)
    }

    /// An empty map with so many bytes of entries in memory at most.
    pub(crate) fn with(directory: Option<PathBuf>, most: usize) -> Self {
        let (resident, next) = (BTreeMap::new(), Vec::new());
        Self { resident, bytes: 0, most, directory, file: None, next, failure: OnceLock::new() }
    }

    /// Why the file cannot be used any more, if so.
    pub fn failure(&self) -> Option<&SpillError> {
        self.failure.get()
    }

    /// What there is under a key.
    ///
    /// # Errors
    /// If the file cannot be used any more.
    pub fn get(&self, key: &[u8]) -> Result<Option<Vec<u8>>, SpillError> {
        if let Some(value) = self.resident.get(key) {
            return Ok(Some(value.clone()));
        }
        self.read(|table| Ok(table.get(key)?.map(|value| value.value().to_vec())))
    }

    /// Whether there is something under a key.
    ///
    /// # Errors
    /// If the file cannot be used any more.
    pub fn contains(&self, key: &[u8]) -> Result<bool, SpillError> {
        Ok(self.resident.contains_key(key) || self.read(|table| Ok(table.get(key)?.map(drop)))?.is_some())
    }

    /// All keys from one to another, both included.
    ///
    /// # Errors
    /// If the file cannot be used any more.
    pub fn keys(&self, from: &[u8], to: &[u8]) -> Result<Vec<Vec<u8>>, SpillError> {
        let in_file = self.read(|table| {
            table
                .range(from..=to)?
                .map(|entry| Ok(entry?.0.value().to_vec()))
                .collect::<Result<Vec<_>, _>>()
                .map(Some)
        });
        let bounds = (Bound::Included(from), Bound::Included(to));
        let resident = self.resident.range::<[u8], _>(bounds).map(|(key, _)| key.clone());
        let mut keys: Vec<Vec<u8>> = resident.chain(in_file?.unwrap_or_default()).collect();
        keys.sort_unstable();
        keys.dedup();
        Ok(keys)
    }

    /// Shows all entries to `see`, in no order of meaning.
    ///
    /// # Errors
    /// If the file cannot be used any more: then not all were shown.
    pub fn for_each(&self, mut see: impl FnMut(&[u8], &[u8])) -> Result<(), SpillError> {
        self.resident.iter().for_each(|(key, value)| see(key, value));
        self.read(|table| {
            for entry in table.iter()? {
                let (key, value) = entry?;
                if !self.resident.contains_key(key.value()) {
                    see(key.value(), value.value());
                }
            }
            Ok(Some(()))
        })?;
        Ok(())
    }

    /// Puts a value under a key, instead of one that is there. If the file cannot be written, it stays in memory, and whoever
    /// looks for something in the file is told.
    pub fn insert(&mut self, key: &[u8], value: Vec<u8>) {
        self.keep(key, value);
        if self.is_full() && self.open() {
            self.spill(ENTRIES_AT_ONCE, BYTES_AT_ONCE);
        }
    }

    /// The same for many entries, while nobody waits: all that memory holds moves at once. In the order of their keys they
    /// touch the fewest pages.
    pub fn extend<K: AsRef<[u8]>>(&mut self, entries: impl IntoIterator<Item = (K, Vec<u8>)>) {
        for (key, value) in entries {
            self.keep(key.as_ref(), value);
            if self.is_full() && self.open() {
                self.spill(usize::MAX, usize::MAX);
            }
        }
    }

    fn keep(&mut self, key: &[u8], value: Vec<u8>) {
        self.bytes += ENTRY_BYTES + key.len() + value.len();
        if let Some(before) = self.resident.insert(key.to_vec(), value) {
            self.bytes -= ENTRY_BYTES + key.len() + before.len();
        }
    }

    /// Whether entries have to leave memory.
    fn is_full(&self) -> bool {
        self.bytes > self.most && self.failure().is_none()
    }

    /// Makes the file, unless there is one; `false` if none can be made: then all stays in memory, until there is twice as
    /// much.
    fn open(&mut self) -> bool {
        if self.file.is_none()
            && let Some(directory) = &self.directory
        {
            match create(directory) {
                Ok(file) => {
                    tracing::info!(
                        "{}: more than {} bytes of what the run meets go to a temporary file there",
                        directory.display(),
                        self.most
                    );
                    self.file = Some(file);
                }
                Err(error) => {
                    tracing::warn!(
                        "{}: no file can be made for what the run meets, got {error}: it stays in memory",
                        directory.display()
                    );
                    self.most = self.most.saturating_mul(2).max(RESIDENT_BYTES);
                }
            }
        }
        self.file.is_some()
    }

    /// Moves entries to the file, as many and of as many bytes as this.
    fn spill(&mut self, most_entries: usize, most_bytes: usize) {
        let [on, before] = [
            (Bound::Included(&self.next[..]), Bound::Unbounded),
            (Bound::Unbounded, Bound::Excluded(&self.next[..])),
        ]
        .map(|bounds| self.resident.range::<[u8], _>(bounds).map(|(key, _)| key.clone()));
        let mut bytes = 0;
        let fit = |key: &Vec<u8>| {
            let before = bytes;
            bytes += self.resident[key].len();
            before < most_bytes
        };
        let keys: Vec<Vec<u8>> = on.chain(before).take(most_entries).take_while(fit).collect();
        let Self { file: Some(file), resident, .. } = self else { return };
        let write = || -> Result<(), redb::Error> {
            let transaction: WriteTransaction = file.begin_write()?;
            {
                let mut table = transaction.open_table(TABLE)?;
                for key in &keys {
                    table.insert(&key[..], &resident[key][..])?;
                }
            }
            Ok(transaction.commit()?)
        };
        if let Err(error) = write() {
            self.fail(&error);
            return;
        }
        for key in keys {
            if let Some(value) = self.resident.remove(&key) {
                self.bytes -= ENTRY_BYTES + key.len() + value.len();
            }
            self.next = key;
        }
        self.next.push(0); // the first key after the last that has moved
    }

    /// What there is in the file, if there is one that can be used.
    fn read<T>(
        &self,
        read: impl FnOnce(&Table) -> Result<Option<T>, redb::StorageError>,
    ) -> Result<Option<T>, SpillError> {
        if let Some(failure) = self.failure() {
            return Err(failure.clone());
        }
        let read = |file: &Database| -> Result<Option<T>, redb::Error> {
            match file.begin_read()?.open_table(TABLE) {
                Ok(table) => Ok(read(&table)?),
                Err(TableError::TableDoesNotExist(_)) => Ok(None),
                Err(error) => Err(error.into()),
            }
        };
        self.file.as_ref().map_or(Ok(None), |file| read(file).map_err(|error| self.fail(&error)))
    }

    fn fail(&self, error: &dyn Display) -> SpillError {
        let directory = self.directory.clone().unwrap_or_default();
        self.failure.get_or_init(|| SpillError { directory, what: error.to_string() }).clone()
    }
}

type Table = redb::ReadOnlyTable<&'static [u8], &'static [u8]>;

fn create(directory: &Path) -> Result<Database, redb::Error> {
    let file = FileBackend::new(tempfile::tempfile_in(directory)?)?;
    Ok(Database::builder().set_cache_size(CACHE_BYTES).create_with_backend(Unsynced(file))?)
}

/// A file that nobody will read after a crash.
#[derive(Debug)]
struct Unsynced(FileBackend);

impl StorageBackend for Unsynced {
    fn len(&self) -> io::Result<u64> {
        self.0.len()
    }

    fn read(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        self.0.read(offset, out)
    }

    fn set_len(&self, len: u64) -> io::Result<()> {
        self.0.set_len(len)
    }

    fn sync_data(&self) -> io::Result<()> {
        Ok(())
    }

    fn write(&self, offset: u64, data: &[u8]) -> io::Result<()> {
        self.0.write(offset, data)
    }

    fn close(&self) -> io::Result<()> {
        self.0.close()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};

    use proptest::prelude::*;
    use redb::backends::InMemoryBackend;

    use super::*;

    fn spilled(map: &SpillMap) -> usize {
        map.read(|table| Ok(Some(table.iter()?.count()))).unwrap().unwrap_or(0)
    }

    fn all(map: &SpillMap) -> BTreeMap<Vec<u8>, Vec<u8>> {
        let mut all = BTreeMap::new();
        map.for_each(|key, value| {
            assert!(all.insert(key.to_vec(), value.to_vec()).is_none(), "{key:?} twice")
        })
        .unwrap();
        all
    }

    fn entries() -> impl Strategy<Value = Vec<(Vec<u8>, Vec<u8>)>> {
        let entry = (prop::collection::vec(0u8..4, 0..5), prop::collection::vec(any::<u8>(), 0..40));
        prop::collection::vec(entry, 0..300)
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 32, ..ProptestConfig::default() })]

        #[test]
        fn it_is_a_map_whatever_memory_holds(
            inserted in entries(),
            together in entries(),
            most in 0usize..20_000,
        ) {
            let directory = tempfile::tempdir().unwrap();
            let mut map = SpillMap::with(Some(directory.path().to_owned()), most);
            let mut expected = BTreeMap::new();
            for (key, value) in inserted {
                prop_assert_eq!(map.contains(&key), Ok(expected.contains_key(&key)));
                map.insert(&key, value.clone());
                expected.insert(key, value);
                prop_assert!(map.bytes <= most, "an entry that was new made room for itself");
            }
            map.extend(together.iter().map(|(key, value)| (key, value.clone())));
            prop_assert!(map.bytes <= most);
            expected.extend(together);
            for key in (0..=5).map(|length| vec![1; length]).chain(expected.keys().cloned()) {
                prop_assert_eq!(map.get(&key), Ok(expected.get(&key).cloned()));
                prop_assert_eq!(map.contains(&key), Ok(expected.contains_key(&key)));
            }
            for (from, to) in [(vec![], vec![4]), (vec![1], vec![2, 2]), (vec![1, 3], vec![1, 3])] {
                let within: Vec<_> = expected.range(from.clone()..=to.clone()).map(|(key, _)| key.clone()).collect();
                prop_assert_eq!(map.keys(&from, &to), Ok(within));
            }
            prop_assert_eq!(all(&map), expected);
            prop_assert_eq!(map.failure(), None);
        }
    }

    #[test]
    fn memory_is_bounded_and_the_file_cannot_be_left_behind() {
        let directory = tempfile::tempdir().unwrap();
        let mut map = SpillMap::with(Some(directory.path().to_owned()), 100_000);
        for number in 0..20_000u64 {
            map.insert(&number.wrapping_mul(0x9e37_79b9_7f4a_7c15).to_be_bytes(), vec![1; 8]);
            assert!(map.bytes <= 100_000 && map.resident.len() <= 1000);
        }
        assert_eq!(all(&map).len(), 20_000);
        assert!(spilled(&map) >= 19_000);
        assert_eq!(directory.path().read_dir().unwrap().count(), 0);
    }

    #[test]
    fn where_no_file_can_be_made_all_stays_in_memory() {
        let mut map = SpillMap::with(Some("/nowhere/at/all".into()), 1000);
        for key in 0..100u8 {
            map.insert(&[key], vec![key]);
        }
        assert_eq!(map.resident.len(), 100);
        assert_eq!(map.failure(), None);
    }

    /// A disk that fails once it is told to.
    #[derive(Debug)]
    struct Failing(InMemoryBackend, Arc<AtomicBool>);

    impl Failing {
        fn check(&self) -> io::Result<()> {
            let has_failed = self.1.load(Ordering::Relaxed);
            if has_failed { Err(io::ErrorKind::StorageFull.into()) } else { Ok(()) }
        }
    }

    impl StorageBackend for Failing {
        fn len(&self) -> io::Result<u64> {
            self.0.len()
        }

        fn read(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
            self.check().and_then(|()| self.0.read(offset, out))
        }

        fn set_len(&self, len: u64) -> io::Result<()> {
            self.check().and_then(|()| self.0.set_len(len))
        }

        fn sync_data(&self) -> io::Result<()> {
            Ok(())
        }

        fn write(&self, offset: u64, data: &[u8]) -> io::Result<()> {
            self.check().and_then(|()| self.0.write(offset, data))
        }
    }

    /// A map whose file is on a disk that fails once it is told to.
    pub(crate) fn on_failing_disk() -> (SpillMap, Arc<AtomicBool>) {
        let fails = Arc::new(AtomicBool::new(false));
        let disk = Failing(InMemoryBackend::new(), Arc::clone(&fails));
        let mut map = SpillMap::with(Some("disk".into()), 1000);
        map.file = Some(Database::builder().set_cache_size(0).create_with_backend(disk).unwrap());
        (map, fails)
    }

    /// Such a map with a thousand entries.
    fn filled() -> (SpillMap, Arc<AtomicBool>) {
        let (mut map, fails) = on_failing_disk();
        (0..1000u32).for_each(|number| map.insert(&number.to_be_bytes(), vec![1]));
        assert!(spilled(&map) > 900 && map.failure().is_none());
        (map, fails)
    }

    #[test]
    fn a_disk_that_cannot_be_written_is_told_and_what_is_in_memory_stays_there() {
        let (mut map, fails) = filled();
        let resident: Vec<_> = map.resident.keys().cloned().collect();
        fails.store(true, Ordering::Relaxed);
        for number in 1000..1100u32 {
            map.insert(&number.to_be_bytes(), vec![2]);
            assert_eq!(map.get(&number.to_be_bytes()), Ok(Some(vec![2])));
        }
        assert!(resident.iter().all(|key| map.contains(key) == Ok(true)));
        let failure = map.failure().unwrap().to_string();
        assert!(failure.starts_with("disk: what the run has met cannot be looked up"), "{failure}");
    }

    #[test]
    fn what_cannot_be_read_is_an_error_and_stays_one() {
        let (map, fails) = filled();
        let is_spilled = |key: &[u8; 4]| !map.resident.contains_key(&key[..]);
        let spilled = (0..1000u32).map(u32::to_be_bytes).find(is_spilled).unwrap();
        assert_eq!(map.get(&spilled), Ok(Some(vec![1])));
        fails.store(true, Ordering::Relaxed);
        let failure = map.get(&spilled).unwrap_err();
        fails.store(false, Ordering::Relaxed);
        assert_eq!(map.get(&spilled), Err(failure.clone()));
        assert_eq!(map.contains(&spilled), Err(failure.clone()));
        assert_eq!(map.keys(&spilled, &spilled), Err(failure.clone()));
        assert_eq!(map.for_each(|_, _| {}), Err(failure.clone()));
        assert_eq!(map.failure(), Some(&failure));
    }
}
