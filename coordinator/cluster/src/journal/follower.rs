//! Reads a journal while its coordinator writes it: who only looks on, opens nothing and locks nothing.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{ErrorKind, Read as _, Seek as _, SeekFrom};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use proto::{JobId, WorkerId};

use super::frame::{Key, framed};
use super::layout::Head;
use super::records::{Record, decode};
use super::{Entry, Header, JournalError};
use crate::events::Event;

/// Most bytes of one read.
const CHUNK: u64 = 32 << 20;

/// Bytes in which the key of a file is looked for, if it is the same file; longer headers are taken for the same.
const BEGINNING: u64 = 64 << 10;

/// Follows the journal of a run, of whichever process.
pub struct JournalFollower {
    path: PathBuf,
    /// `None` before the first read, and after the file was replaced.
    place: Option<Place>,
    leases: BTreeMap<(JobId, u32), WorkerId>,
}

/// How far a file was read.
struct Place {
    /// Device and inode.
    file: (u64, u64),
    key: Key,
    header: Header,
    /// Where the next record begins.
    next: u64,
    /// Starts of coordinators so far.
    starts: u64,
}

/// What a read has found.
#[derive(Debug, Default)]
pub struct Followed {
    /// Whether the file is another than at the last read: what was read before is void.
    pub is_anew: bool,
    /// What has happened since, in order.
    pub events: Vec<Event>,
    /// How many of these happened before each start of a coordinator.
    pub starts: Vec<usize>,
}

impl JournalFollower {
    /// Of the journal at `path`, which need not be there yet.
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), place: None, leases: BTreeMap::new() }
    }

    /// What was written since the last read; at first, everything. Records that are being written come with a later read.
    /// `None`: there is no journal.
    ///
    /// # Errors
    /// If it cannot be read, or nothing in it says what it is of.
    pub fn read(&mut self) -> Result<Option<Followed>, JournalError> {
        let unusable =
            |error: std::io::Error| JournalError::unusable(&self.path, format!("I/O error: {error}"));
        let mut file = match File::open(&self.path) {
            Ok(file) => file,
            Err(error) if error.kind() == ErrorKind::NotFound => {
                self.place = None;
                return Ok(None);
            }
            Err(error) => return Err(unusable(error)),
        };
        let metadata = file.metadata().map_err(unusable)?;
        if !metadata.is_file() {
            return Err(JournalError::unusable(&self.path, "something that is no file"));
        }
        let id = (metadata.dev(), metadata.ino());
        // A file may have the inode of one that was replaced before.
        let mut beginning = Vec::new();
        (&file).take(BEGINNING).read_to_end(&mut beginning).map_err(unusable)?;
        let key = Head::read(&beginning).map(|(head, ..)| head.key);
        if self.place.as_ref().is_some_and(|place| key.is_some_and(|key| key != place.key)) {
            self.place = None;
        }
        let mut followed = Followed::default();
        if self.place.as_ref().is_none_or(|place| place.file != id || place.next > metadata.len()) {
            self.leases.clear();
            followed.is_anew = true;
            let mut bytes = Vec::new();
            Head::most_of(&file, &mut bytes).map_err(unusable)?;
            let (head, records, _) = Head::read(&bytes).ok_or_else(|| JournalError::headless(&self.path))?;
            let header = Header::decode(&head.header, &self.path)?;
            self.place = Some(Place { file: id, key: head.key, header, next: records as u64, starts: 0 });
        }
        let Some(place) = &mut self.place else { return Ok(None) };
        loop {
            let mut bytes = Vec::new();
            file.seek(SeekFrom::Start(place.next)).map_err(unusable)?;
            (&file).take(CHUNK).read_to_end(&mut bytes).map_err(unusable)?;
            let mut rest = &bytes[..];
            while let Some((_, payload)) = place.key.first_record(rest, place.next) {
                match decode(payload) {
                    Some(Record::Entry(entry)) => take(&mut self.leases, &mut followed.events, entry),
                    Some(Record::Tally(tally)) if tally.starts > place.starts => {
                        place.starts = tally.starts;
                        followed.starts.push(followed.events.len());
                    }
                    _ => {}
                }
                let length = framed(payload.len());
                (rest, place.next) = (&rest[length..], place.next + length as u64);
            }
            // The end of the file, a record that is not whole yet, or one that is damaged, behind which nothing is shown.
            if (bytes.len() as u64) < CHUNK || rest.len() == bytes.len() {
                return Ok(Some(followed));
            }
        }
    }

    /// What the run is, as the journal says; `None` before the first read.
    pub fn header(&self) -> Option<&Header> {
        self.place.as_ref().map(|place| &place.header)
    }

    /// Attempts that are under way, with the workers that have them.
    pub fn leases(&self) -> &BTreeMap<(JobId, u32), WorkerId> {
        &self.leases
    }
}

fn take(leases: &mut BTreeMap<(JobId, u32), WorkerId>, events: &mut Vec<Event>, entry: Entry) {
    match entry {
        Entry::Event(event) => {
            if let crate::events::EventKind::Attempt(attempt) = &event.kind {
                leases.remove(&(attempt.job, attempt.number));
            }
            events.push(Event::clone(&event));
        }
        Entry::Leased(job, attempt, worker) => {
            leases.insert((job, attempt), worker);
        }
        Entry::Accepted(job, _) => {
            let of_job: Vec<_> = leases.range((job, 0)..=(job, u32::MAX)).map(|(&lease, _)| lease).collect();
            for lease in of_job {
                leases.remove(&lease);
            }
        }
        Entry::Left(worker) => leases.retain(|_, held_by| *held_by != worker),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, SystemTime};

    use proto::SessionId;
    use tempfile::TempDir;

    use super::*;
    use crate::events::EventKind;
    use crate::journal::JournalFile;
    use crate::scheduler::RunSecret;

    fn header() -> Header {
        Header {
            search: "seed = 1\n".to_owned(),
            experiment: "version = 1\n".to_owned(),
            data_digest: "00".to_owned(),
            evaluation_version: 2,
            session: SessionId([7; 16]),
            secret: RunSecret::new([8; 32]),
            started_at: SystemTime::UNIX_EPOCH + Duration::from_millis(5),
        }
    }

    fn event(sequence: u64) -> Entry {
        let kind = EventKind::Rewind { generation: sequence as u32, why: "why".to_owned() };
        Entry::Event(std::sync::Arc::new(Event {
            sequence,
            at: SystemTime::UNIX_EPOCH,
            kind,
            omitted: false,
        }))
    }

    fn sequences(followed: &Followed) -> Vec<u64> {
        followed.events.iter().map(|event| event.sequence).collect()
    }

    #[test]
    fn what_another_process_writes_is_read_once_and_in_order_and_nobody_is_kept_out() {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("journal.log");
        let mut follower = JournalFollower::new(&path);
        assert!(follower.read().unwrap().is_none());
        JournalFile::create(&path, &header()).unwrap();
        assert!(follower.read().unwrap().unwrap().is_anew);
        assert_eq!(follower.header(), Some(&header()));
        let (journal, ..) = JournalFile::open(&path).unwrap();
        let mut seen = Vec::new();
        for first in 0..20 {
            journal.commit(&[event(2 * first), event(2 * first + 1)]).unwrap();
            if first % 3 == 0 {
                seen.extend(sequences(&follower.read().unwrap().unwrap()));
            }
        }
        let last = follower.read().unwrap().unwrap();
        assert!(!last.is_anew);
        seen.extend(sequences(&last));
        assert_eq!(seen, (0..40).collect::<Vec<_>>());
        assert_eq!(sequences(&follower.read().unwrap().unwrap()), [0u64; 0]);
        drop(journal);
        JournalFile::open(&path).unwrap();
    }

    #[test]
    fn a_record_that_is_half_written_comes_when_it_is_whole() {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("journal.log");
        JournalFile::create(&path, &header()).unwrap();
        let (journal, ..) = JournalFile::open(&path).unwrap();
        journal.commit(&[event(0)]).unwrap();
        let before = std::fs::read(&path).unwrap();
        journal.commit(&[event(1)]).unwrap();
        let whole = std::fs::read(&path).unwrap();
        drop(journal);
        for end in before.len()..whole.len() {
            // The same file, as a slow disk shows it.
            std::fs::write(&path, &whole[..end]).unwrap();
            let mut follower = JournalFollower::new(&path);
            let first = sequences(&follower.read().unwrap().unwrap());
            assert!(first.starts_with(&[0]), "{end}: {first:?}");
            std::fs::write(&path, &whole).unwrap();
            let rest = sequences(&follower.read().unwrap().unwrap());
            assert_eq!([first, rest].concat(), [0, 1], "{end}");
        }
    }

    #[test]
    fn another_journal_with_the_same_inode_is_read_anew() {
        let folder = TempDir::new().unwrap();
        let [path, other] = ["journal.log", "other.log"].map(|name| folder.path().join(name));
        for (path, events) in [(&path, 1..3), (&other, 5..9)] {
            JournalFile::create(path, &header()).unwrap();
            let entries: Vec<Entry> = events.map(event).collect();
            JournalFile::open(path).unwrap().0.commit(&entries).unwrap();
        }
        let mut follower = JournalFollower::new(&path);
        assert_eq!(sequences(&follower.read().unwrap().unwrap()), [1, 2]);
        let inode = || std::fs::metadata(&path).unwrap().ino();
        let before = inode();
        std::fs::write(&path, std::fs::read(&other).unwrap()).unwrap();
        assert_eq!(inode(), before);
        let anew = follower.read().unwrap().unwrap();
        assert_eq!((anew.is_anew, sequences(&anew)), (true, vec![5, 6, 7, 8]));
    }

    #[test]
    fn a_journal_that_is_written_anew_is_read_anew() {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("journal.log");
        JournalFile::create(&path, &header()).unwrap();
        let (journal, ..) = JournalFile::open(&path).unwrap();
        let lease = Entry::Leased(JobId(1), 1, WorkerId([1; 16]));
        journal.commit(&[event(0), lease, Entry::Leased(JobId(2), 1, WorkerId([2; 16]))]).unwrap();
        let mut follower = JournalFollower::new(&path);
        assert_eq!(sequences(&follower.read().unwrap().unwrap()), [0]);
        assert_eq!(follower.leases().len(), 2);
        journal
            .commit(&[Entry::Quarantined(proto::Introduction::sample("rack", 1).principal), event(1)])
            .unwrap();
        let anew = follower.read().unwrap().unwrap();
        assert_eq!((anew.is_anew, sequences(&anew)), (true, vec![0, 1]));
        journal.commit(&[Entry::Left(WorkerId([1; 16]))]).unwrap();
        follower.read().unwrap();
        assert!(!follower.leases().contains_key(&(JobId(1), 1)));
        std::fs::write(&path, "no journal").unwrap();
        assert!(matches!(follower.read(), Err(JournalError::Damaged { .. })));
    }
}
