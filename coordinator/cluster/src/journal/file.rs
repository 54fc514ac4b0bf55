//! The journal's file: made whole, read when it is opened, appended to, and written anew where something is taken back.

use std::collections::BTreeSet;
use std::fs::{File, Metadata, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Seek as _, SeekFrom, Write as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Instant;

use proto::JobId;

use super::contents::Contents;
use super::frame::Key;
use super::layout::Head;
use super::records::{Tally, encode};
use super::repair::{Salvaged, keep_damaged, salvage};
use super::{Entry, Header, JournalError, Recorded};
use crate::job_set::JobSet;
use crate::lock::lock;

/// A journal that this process has open; no other can open it meanwhile.
pub struct JournalFile {
    path: PathBuf,
    opened: Instant,
    /// At the beginning of this start.
    earlier: Tally,
    end: Mutex<End>,
}

/// Where the file ends.
struct End {
    /// Locked.
    file: File,
    key: Key,
    bytes: u64,
    next_number: u64,
    /// Jobs whose results are in the file.
    answered: JobSet,
    /// Where those go that outgrow memory, until a file there fails.
    spill: Option<PathBuf>,
}

impl JournalFile {
    /// Makes a journal that has nothing but its header; it becomes visible whole.
    pub fn create(path: &Path, header: &Header) -> Result<(), JournalError> {
        let made = || {
            let head = Head { key: Key(rand::random()), header: header.encode()? };
            atomic::write_with(path, |file| head.write(&Contents::default(), file).map(drop))
        };
        made().map_err(|error| unusable(path, &error))
    }

    /// Opens a journal, checks all of it, counts one start more, and returns what is in it. One that is damaged is
    /// written anew with what is sound in it, and kept beside.
    ///
    /// # Errors
    /// [`JournalError::Damaged`] if nothing says what it was the journal of.
    pub fn open(path: &Path) -> Result<(Self, Header, Recorded), JournalError> {
        let file = open_locked(path)?;
        let Salvaged { head, mut contents, next_number, end, loss, begun_bytes } =
            read(&file, reopen(&file, path), path)?;
        let header = Header::decode(&head.header, path)?;
        contents.tally.starts += 1;
        let end = if let Some(loss) = loss {
            contents.tally.repairs += 1;
            replace((path, spill_beside(path)), &head, &contents, loss.to_string())?
        } else {
            let spill = spill_beside(path);
            let answered = answered_in(&contents, spill.as_deref());
            let mut end = End { file, key: head.key, bytes: end, next_number, answered, spill };
            end.append([contents.tally.encode()]).map_err(|error| unusable(path, &error))?;
            if begun_bytes > 0 {
                tracing::warn!(
                    "{}: the last record, {begun_bytes} bytes, is not complete and is left out",
                    path.display()
                );
            }
            end
        };
        let (path, earlier) = (path.to_owned(), contents.tally);
        Ok((
            Self { path, opened: Instant::now(), earlier, end: Mutex::new(end) },
            header,
            contents.recorded(),
        ))
    }

    /// The header of a journal that nobody has open. Nothing else is read or checked.
    pub fn header(path: &Path) -> Result<Header, JournalError> {
        let mut bytes = Vec::new();
        Head::most_of(&open_locked(path)?, &mut bytes).map_err(|error| unusable(path, &error))?;
        let (head, ..) = Head::read(&bytes).ok_or_else(|| JournalError::headless(path))?;
        Header::decode(&head.header, path)
    }

    /// Whether a process has a journal open; `None` where the file system knows no locks. Whoever opens it at this very
    /// moment waits for the look to end.
    ///
    /// # Errors
    /// Those of the file system; that there is none is one of them.
    pub fn is_open(path: &Path) -> io::Result<Option<bool>> {
        if !std::fs::metadata(path)?.is_file() {
            return Err(io::Error::new(ErrorKind::InvalidInput, "something that is no file")); // a pipe would be waited for
        }
        atomic::is_locked(&File::open(path)?)
    }

    /// Puts a new journal in the place of one that does not say what it was the journal of, and keeps that beside.
    pub fn replace(path: &Path, header: &Header) -> Result<(), JournalError> {
        let _locked = open_locked(path)?;
        let head = Head {
            key: Key(rand::random()),
            header: header.encode().map_err(|error| unusable(path, &error))?,
        };
        let mut contents = Contents::default();
        contents.tally.repairs = 1;
        replace((path, None), &head, &contents, "no record can be read".to_owned()).map(drop)
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes entries; they are on the disk when this returns.
    ///
    /// What is taken back must never come back, whatever becomes of the file: then the file is written anew, without it
    /// and under another key.
    pub fn commit(&self, entries: &[Entry]) -> Result<(), JournalError> {
        let mut end = lock(&self.end);
        let tally = Tally {
            milliseconds: self.earlier.milliseconds + self.opened.elapsed().as_millis() as u64,
            ..self.earlier
        };
        if end.takes_back(entries) {
            let spill = end.spill.clone().filter(|_| end.answered.failure().is_none());
            let Salvaged { head, mut contents, loss, .. } =
                read(&end.file, end.file.try_clone(), &self.path)?;
            contents.count(tally);
            entries.iter().for_each(|entry| contents.append(entry));
            *end = match loss {
                Some(loss) => {
                    contents.tally.repairs += 1;
                    replace((&self.path, spill), &head, &contents, loss.to_string())?
                }
                None => rewrite((&self.path, spill), &head, &contents)?,
            };
            return Ok(());
        }
        let payloads = entries.iter().filter_map(encode).chain([tally.encode()]);
        end.append(payloads).map_err(|error| unusable(&self.path, &error))?;
        entries.iter().filter_map(answered).for_each(|job| end.answered.insert(job));
        Ok(())
    }
}

impl End {
    /// Whether one of these entries makes something void that the file has, or them.
    ///
    /// A result that cannot be looked up any more counts as one that the file has: that is then written anew, which is
    /// always right.
    fn takes_back(&self, entries: &[Entry]) -> bool {
        let mut new = BTreeSet::new();
        let is_there = |job: &JobId| self.answered.contains(*job).unwrap_or(true);
        entries.iter().any(|entry| match entry {
            Entry::Accepted(job, _) => is_there(job) || !new.insert(*job),
            Entry::Retracted(job) => is_there(job) || new.contains(job),
            Entry::Quarantined(_) | Entry::Readmitted(_) => true,
            _ => false,
        })
    }

    /// Writes records, and all of them to the disk.
    fn append(&mut self, payloads: impl IntoIterator<Item = Vec<u8>>) -> io::Result<()> {
        let (mut bytes, mut next_number) = (Vec::new(), self.next_number);
        for payload in payloads {
            self.key.append(&mut bytes, self.bytes, next_number, &payload);
            next_number += 1;
        }
        // What an earlier process has begun to write there goes.
        self.file.set_len(self.bytes)?;
        self.file.seek(SeekFrom::Start(self.bytes))?;
        self.file.write_all(&bytes)?;
        self.file.sync_data()?;
        (self.bytes, self.next_number) = (self.bytes + bytes.len() as u64, next_number);
        Ok(())
    }
}

/// Where the jobs go that outgrow memory: beside the journal.
fn spill_beside(path: &Path) -> Option<PathBuf> {
    path.parent().map(Path::to_owned)
}

/// The jobs that have a result. What outgrows memory goes to a file in `spill`, if there is such a directory.
fn answered_in(contents: &Contents, spill: Option<&Path>) -> JobSet {
    let mut answered = JobSet::new(spill);
    answered.extend(contents.accepted.jobs());
    answered
}

fn answered(entry: &Entry) -> Option<JobId> {
    match entry {
        Entry::Accepted(job, _) => Some(*job),
        _ => None,
    }
}

/// Writes a journal anew, keeps the damaged file beside it, and tells both.
fn replace(
    (path, spill): (&Path, Option<PathBuf>),
    head: &Head,
    contents: &Contents,
    what: String,
) -> Result<End, JournalError> {
    let damaged = keep_damaged(path).map_err(|error| unusable(path, &error))?;
    let end = rewrite((path, spill), head, contents).inspect_err(|_| {
        let _ = std::fs::remove_file(&damaged); // it is still where it was
    })?;
    let there = contents.accepted.len();
    tracing::warn!(
        "{}: damaged: {what}; goes on with {there} results, computes again what is lost, and keeps the damaged file as {}",
        path.display(),
        damaged.file_name().unwrap_or_default().display()
    );
    Ok(end)
}

/// Writes a journal anew, under a key of its own, and holds it locked before it can be seen.
fn rewrite(
    (path, spill): (&Path, Option<PathBuf>),
    head: &Head,
    contents: &Contents,
) -> Result<End, JournalError> {
    let head = Head { key: Key(rand::random()), ..head.clone() };
    let mut made = None;
    let written = atomic::write_with(path, |file| {
        let (bytes, next_number) = head.write(contents, &*file)?;
        let own = file.try_clone()?;
        lock_file(&own)?;
        made = Some((own, bytes, next_number));
        Ok::<_, io::Error>(())
    });
    let made = written.and_then(|()| made.ok_or_else(|| io::Error::other("no file")));
    let (file, bytes, next_number) = made.map_err(|error| unusable(path, &error))?;
    let answered = answered_in(contents, spill.as_deref());
    Ok(End { file, key: head.key, bytes, next_number, answered, spill })
}

/// Opens the file that has this name, for nobody else.
fn open_locked(path: &Path) -> Result<File, JournalError> {
    let failed = |error: io::Error| unusable(path, &error);
    loop {
        let file = OpenOptions::new().read(true).write(true).open(path).map_err(failed)?;
        let opened = file.metadata().map_err(failed)?;
        if !opened.is_file() {
            return Err(JournalError::unusable(path, "something that is no file"));
        }
        match lock_file(&file) {
            Ok(()) => {}
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                return Err(JournalError::InUse { path: path.to_owned() });
            }
            Err(error) => return Err(failed(error)),
        }
        // It may have been replaced before it was locked.
        if is_same(&opened, &std::fs::metadata(path).map_err(failed)?) {
            return Ok(file);
        }
    }
}

/// The same file once more, without its lock: that of a copy would last as long as the copy.
fn reopen(file: &File, path: &Path) -> io::Result<File> {
    let again = File::open(path)?;
    match is_same(&file.metadata()?, &again.metadata()?) {
        true => Ok(again),
        false => Err(io::Error::other("another file in its place")),
    }
}

fn is_same(one: &Metadata, other: &Metadata) -> bool {
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

/// Locks a file as long as it is open; where the file system knows no locks, nobody else is kept out.
fn lock_file(file: &File) -> io::Result<()> {
    match atomic::try_lock(file) {
        Err(TryLockError::WouldBlock) => Err(ErrorKind::WouldBlock.into()),
        Err(TryLockError::Error(error)) if error.kind() != ErrorKind::Unsupported => Err(error),
        _ => Ok(()),
    }
}

/// What a file has, whose results are read from `results` when they are asked for.
fn read(file: &File, results: io::Result<File>, path: &Path) -> Result<Salvaged, JournalError> {
    let salvaged = results.and_then(|results| salvage(file, results));
    salvaged.map_err(|error| unusable(path, &error))?.ok_or_else(|| JournalError::headless(path))
}

fn unusable(path: &Path, error: &dyn std::fmt::Display) -> JournalError {
    JournalError::unusable(path, format!("I/O error: {error}"))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering;

    use tempfile::TempDir;

    use super::super::tests::{accepted, header};
    use super::*;
    use crate::spill::SpillMap;
    use crate::spill::tests::on_failing_disk;

    fn accept(job: u64) -> Entry {
        Entry::Accepted(JobId(job), Box::new(accepted(1)))
    }

    fn retract(job: u64) -> Entry {
        Entry::Retracted(JobId(job))
    }

    /// A journal with the results of jobs 0 to 199, whose names are in this map.
    fn journal(folder: &TempDir, names: SpillMap) -> JournalFile {
        let path = folder.path().join("journal");
        JournalFile::create(&path, &header()).unwrap();
        let (file, ..) = JournalFile::open(&path).unwrap();
        lock(&file.end).answered = JobSet::of(names);
        file.commit(&(0..200).map(accept).collect::<Vec<_>>()).unwrap();
        file
    }

    /// The jobs that a journal has results of, for the next start.
    fn jobs(file: JournalFile) -> Vec<JobId> {
        let path = file.path().to_owned();
        drop(file);
        JournalFile::open(&path).unwrap().2.accepted.jobs().collect()
    }

    #[test]
    fn a_result_is_taken_back_although_the_name_of_its_job_has_left_memory() {
        let folder = TempDir::new().unwrap();
        let file = journal(&folder, SpillMap::with(Some(folder.path().to_owned()), 0));
        let key = || lock(&file.end).key;
        let before = key();
        file.commit(&[accept(200)]).unwrap();
        assert!(key() == before, "nothing is taken back");
        file.commit(&[retract(0)]).unwrap();
        assert!(key() != before, "written anew, so that it cannot come back");
        assert_eq!(jobs(file), (1..201).map(JobId).collect::<Vec<_>>());
    }

    #[test]
    fn a_result_is_taken_back_although_the_name_of_its_job_cannot_be_looked_up() {
        let folder = TempDir::new().unwrap();
        let (disk, fails) = on_failing_disk();
        let file = journal(&folder, disk);
        let key = || lock(&file.end).key;
        let first = key();
        fails.store(true, Ordering::Relaxed);
        file.commit(&[accept(200), retract(7)]).unwrap();
        let second = key();
        assert!(second != first, "written anew");
        file.commit(&[accept(201)]).unwrap();
        assert!(key() == second, "what is there is known again");
        file.commit(&[retract(8)]).unwrap();
        assert!(key() != second && lock(&file.end).spill.is_none(), "no file is tried again");
        assert_eq!(jobs(file), (0..202).filter(|job| ![7, 8].contains(job)).map(JobId).collect::<Vec<_>>());
    }
}
