//! The journal's file: made whole, checked when it is opened, written in transactions.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use proto::{JobId, Lease, WorkerId};
use redb::{
    Database, Durability, Error, ReadTransaction, ReadableDatabase as _, ReadableTable, TableDefinition,
};
use results::Proceedings;
use serde::de::DeserializeOwned;

use super::{Entry, Header, JournalError, Recorded, Told, record};
use crate::assembly::{Cut, SideCut};

/// One row: [`Header`].
const HEADER: TableDefinition<&str, &[u8]> = TableDefinition::new("header");
/// Starts, milliseconds at work, and whether a worker was wrong.
const TALLY: TableDefinition<&str, u64> = TableDefinition::new("tally");
/// Answers by job.
const ACCEPTED: TableDefinition<u64, &[u8]> = TableDefinition::new("accepted");
/// Shards and ranges of queries and database by job of the whole evaluation.
const CUTS: TableDefinition<u64, (u32, u32, u32, u32)> = TableDefinition::new("cuts");
/// Workers by id.
const MEMBERS: TableDefinition<&[u8; 16], &[u8]> = TableDefinition::new("members");
/// Workers by job and attempt.
const LEASES: TableDefinition<(u64, u32), &[u8; 16]> = TableDefinition::new("leases");
/// Workers that were wrong, by id.
const QUARANTINED: TableDefinition<&[u8; 16], ()> = TableDefinition::new("quarantined");
/// What is told, by table ([`WORKERS`], [`ATTEMPTS`] or [`EVENTS`]) and place.
const TOLD: TableDefinition<(u8, u32), &[u8]> = TableDefinition::new("told");
const WORKERS: u8 = 0;
const ATTEMPTS: u8 = 1;
const EVENTS: u8 = 2;

/// Memory for pages: a journal is written at its end and read once.
const CACHE_BYTES: usize = 8 << 20;
/// Highest attempt that is believed: more failures and losses end a run long before.
pub(super) const MAX_ATTEMPT: u32 = 100_000;

/// A journal that this process has open; no other can open it meanwhile.
pub struct JournalFile {
    database: Database,
    path: PathBuf,
    opened: Instant,
    /// Time at work of earlier starts.
    earlier: Duration,
}

impl JournalFile {
    /// Makes a journal that has nothing but its header; it becomes visible whole.
    pub fn create(path: &Path, header: &Header) -> Result<(), JournalError> {
        let failed = |error: Error| classified(path, error);
        let making = path.with_extension("new");
        match fs::remove_file(&making) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(failed(error.into())),
            _ => {}
        }
        write_header(&making, header).map_err(failed)?;
        let sync = || File::open(path.parent().unwrap_or(Path::new(".")))?.sync_all();
        fs::rename(&making, path).and_then(|()| sync()).map_err(|error| failed(error.into()))
    }

    /// Opens a journal, checks all of it, counts one start more, and returns what is in it.
    pub fn open(path: &Path) -> Result<(Self, Header, Recorded), JournalError> {
        let database = builder().open(path).map_err(|error| classified(path, error.into()))?;
        let transaction = database.begin_read().map_err(|error| classified(path, error.into()))?;
        let header = read_header(&transaction, path)?;
        let mut recorded = read_recorded(&transaction).map_err(|what| JournalError::damaged(path, what))?;
        drop(transaction);
        recorded.starts += 1;
        let (path, opened, earlier) = (path.to_owned(), Instant::now(), recorded.at_work);
        let file = Self { database, path, opened, earlier };
        file.count_start(recorded.starts).map_err(|error| classified(&file.path, error))?;
        Ok((file, header, recorded))
    }

    /// The header of a journal that nobody has open.
    pub fn header(path: &Path) -> Result<Header, JournalError> {
        let database = builder().open(path).map_err(|error| classified(path, error.into()))?;
        let transaction = database.begin_read().map_err(|error| classified(path, error.into()))?;
        read_header(&transaction, path)
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes entries, all of them or none; they are on the disk when this returns.
    pub fn commit(&self, entries: &[Entry]) -> Result<(), JournalError> {
        self.write(entries).map_err(|error| classified(&self.path, error))
    }

    fn count_start(&self, starts: u64) -> Result<(), Error> {
        let mut transaction = self.database.begin_write()?;
        transaction.set_durability(Durability::Immediate)?;
        transaction.open_table(TALLY)?.insert("starts", starts)?;
        Ok(transaction.commit()?)
    }

    fn write(&self, entries: &[Entry]) -> Result<(), Error> {
        let mut transaction = self.database.begin_write()?;
        transaction.set_durability(Durability::Immediate)?;
        {
            let mut accepted = transaction.open_table(ACCEPTED)?;
            let mut members = transaction.open_table(MEMBERS)?;
            let mut leases = transaction.open_table(LEASES)?;
            let mut cuts = transaction.open_table(CUTS)?;
            for entry in entries {
                match entry {
                    Entry::Accepted(answer) => {
                        let job = answer.job.0;
                        let Some(bytes) = record::encode_accepted(answer) else { continue };
                        accepted.insert(job, bytes.as_slice())?;
                        leases.retain_in((job, 0)..=(job, u32::MAX), |_, _| false)?;
                    }
                    Entry::Joined(id, member) => {
                        members.insert(&id.0, record::encode_member(member).as_slice())?;
                    }
                    Entry::Left(id) => {
                        members.remove(&id.0)?;
                    }
                    Entry::Leased(lease, id) => {
                        leases.insert((lease.job.0, lease.attempt), &id.0)?;
                    }
                    Entry::Struck(job) => {
                        accepted.remove(job.0)?;
                    }
                    Entry::Cut(job, Cut { query, database }) => {
                        let numbers = (query.shards, query.ranges, database.shards, database.ranges);
                        cuts.insert(job.0, numbers)?;
                    }
                    Entry::Distrusted(id) => {
                        transaction.open_table(TALLY)?.insert("distrusted", 1)?;
                        transaction.open_table(QUARANTINED)?.insert(&id.0, ())?;
                    }
                    Entry::Told(place, told) => {
                        let (table, bytes) = match &**told {
                            Told::Worker(row) => (WORKERS, serde_json::to_vec(row)),
                            Told::Attempt(row) => (ATTEMPTS, serde_json::to_vec(row)),
                            Told::Event(row) => (EVENTS, serde_json::to_vec(row)),
                        };
                        let bytes = bytes.map_err(std::io::Error::from)?;
                        transaction.open_table(TOLD)?.insert((table, *place), bytes.as_slice())?;
                    }
                }
            }
            let at_work = self.earlier + self.opened.elapsed();
            transaction.open_table(TALLY)?.insert("milliseconds", at_work.as_millis() as u64)?;
        }
        Ok(transaction.commit()?)
    }
}

fn builder() -> redb::Builder {
    let mut builder = Database::builder();
    // A page that was altered is found when the file is opened, not in the middle of a run.
    builder.set_cache_size(CACHE_BYTES).set_check_integrity_on_open(true);
    builder
}

fn write_header(path: &Path, header: &Header) -> Result<(), Error> {
    let database = builder().create(path)?;
    let mut transaction = database.begin_write()?;
    transaction.set_durability(Durability::Immediate)?;
    let bytes = header.encode().map_err(std::io::Error::from)?;
    transaction.open_table(HEADER)?.insert("header", bytes.as_slice())?;
    // The other tables are made here, so that one that is missing later is damage.
    transaction.open_table(TALLY)?.insert("milliseconds", 0)?;
    transaction.open_table(ACCEPTED)?;
    transaction.open_table(MEMBERS)?;
    transaction.open_table(LEASES)?;
    transaction.open_table(CUTS)?;
    transaction.open_table(QUARANTINED)?;
    transaction.open_table(TOLD)?;
    Ok(transaction.commit()?)
}

fn read_header(transaction: &ReadTransaction, path: &Path) -> Result<Header, JournalError> {
    let bytes = || -> Result<Option<Vec<u8>>, Error> {
        Ok(transaction.open_table(HEADER)?.get("header")?.map(|bytes| bytes.value().to_vec()))
    };
    match bytes() {
        Ok(Some(bytes)) => Header::decode(&bytes, path),
        Ok(None) => Err(JournalError::damaged(path, "no header")),
        Err(error) => Err(JournalError::damaged(path, error)),
    }
}

fn read_recorded(transaction: &ReadTransaction) -> Result<Recorded, String> {
    let said = |error: Error| error.to_string();
    let mut recorded = Recorded::default();
    let tally = transaction.open_table(TALLY).map_err(|error| said(error.into()))?;
    let number = |name: &str| -> Result<u64, Error> { Ok(tally.get(name)?.map_or(0, |value| value.value())) };
    recorded.starts = number("starts").map_err(said)?.min(u64::MAX / 2);
    recorded.at_work = Duration::from_millis(number("milliseconds").map_err(said)?);
    recorded.trusted = number("distrusted").map_err(said)? == 0;

    let table = transaction.open_table(ACCEPTED).map_err(|error| said(error.into()))?;
    for row in table.iter().map_err(|error| said(error.into()))? {
        let (job, bytes) = row.map_err(|error| said(error.into()))?;
        let job = JobId(job.value());
        let accepted = record::decode_accepted(job, bytes.value());
        recorded.accepted.insert(job, accepted.ok_or_else(|| format!("no answer to job {job}"))?);
    }
    let table = transaction.open_table(CUTS).map_err(|error| said(error.into()))?;
    for row in table.iter().map_err(|error| said(error.into()))? {
        let (job, cut) = row.map_err(|error| said(error.into()))?;
        let (of_query, query_ranges, of_database, database_ranges) = cut.value();
        let query = SideCut { shards: of_query, ranges: query_ranges };
        let database = SideCut { shards: of_database, ranges: database_ranges };
        recorded.cuts.insert(JobId(job.value()), Cut { query, database });
    }
    let table = transaction.open_table(MEMBERS).map_err(|error| said(error.into()))?;
    for row in table.iter().map_err(|error| said(error.into()))? {
        let (id, bytes) = row.map_err(|error| said(error.into()))?;
        let id = WorkerId(*id.value());
        let member = record::decode_member(bytes.value());
        recorded.members.insert(id, member.ok_or_else(|| format!("no worker under {id}"))?);
    }
    let table = transaction.open_table(LEASES).map_err(|error| said(error.into()))?;
    for row in table.iter().map_err(|error| said(error.into()))? {
        let (lease, id) = row.map_err(|error| said(error.into()))?;
        let (job, attempt) = lease.value();
        if attempt == 0 || attempt > MAX_ATTEMPT {
            return Err(format!("attempt {attempt} of job {job}"));
        }
        recorded.leases.push((Lease { job: JobId(job), attempt }, WorkerId(*id.value())));
    }
    let table = transaction.open_table(QUARANTINED).map_err(|error| said(error.into()))?;
    for row in table.iter().map_err(|error| said(error.into()))? {
        let (id, _) = row.map_err(|error| said(error.into()))?;
        recorded.quarantined.insert(WorkerId(*id.value()));
    }
    let table = transaction.open_table(TOLD).map_err(|error| said(error.into()))?;
    recorded.proceedings = Proceedings {
        workers: read_told(&table, WORKERS)?,
        attempts: read_told(&table, ATTEMPTS)?,
        events: read_told(&table, EVENTS)?,
    };
    Ok(recorded)
}

/// The rows of one table of what is told, in order.
fn read_told<R: DeserializeOwned>(
    told: &impl ReadableTable<(u8, u32), &'static [u8]>,
    table: u8,
) -> Result<Vec<R>, String> {
    let said = |error: redb::StorageError| error.to_string();
    let mut rows = Vec::new();
    for row in told.range((table, 0)..=(table, u32::MAX)).map_err(said)? {
        let (key, bytes) = row.map_err(said)?;
        if key.value().1 as usize != rows.len() {
            return Err(format!("row {} of what is told where {} should be", key.value().1, rows.len()));
        }
        rows.push(serde_json::from_slice(bytes.value()).map_err(|error| error.to_string())?);
    }
    Ok(rows)
}

/// Damage needs other advice than a disk that fails or another process. It may show late: a file that was cut is missed
/// where it was cut.
fn classified(path: &Path, error: Error) -> JournalError {
    match error {
        Error::Io(error) if !matches!(error.kind(), ErrorKind::InvalidData | ErrorKind::UnexpectedEof) => {
            JournalError::unusable(path, format!("I/O error: {error}"))
        }
        Error::PreviousIo => JournalError::unusable(path, "an earlier I/O error"),
        Error::DatabaseAlreadyOpen => JournalError::InUse { path: path.to_owned() },
        error => JournalError::damaged(path, error),
    }
}
