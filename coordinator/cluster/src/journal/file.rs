//! The journal's file: made whole, checked when it is opened, written in transactions.

use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use proto::journal::{AcceptedResult, Member};
use proto::{JobId, WorkerId};
use redb::{
    Database, Durability, Error, ReadTransaction, ReadableDatabase as _, ReadableTable as _, TableDefinition,
    backends::FileBackend,
};

use super::{Entry, Header, JournalError, Recorded};
use crate::events::Event;
use crate::sharding::plan::{ShardPlan, SidePlan};

/// One row: [`Header`].
const HEADER: TableDefinition<&str, &[u8]> = TableDefinition::new("header");
/// Starts, and milliseconds at work.
const TALLY: TableDefinition<&str, u64> = TableDefinition::new("tally");
/// Results by job.
const ACCEPTED: TableDefinition<u64, &[u8]> = TableDefinition::new("accepted");
/// Shards and ranges of queries and database by job of the whole evaluation.
const PLANS: TableDefinition<u64, (u32, u32, u32, u32)> = TableDefinition::new("plans");
/// Workers by id.
const MEMBERS: TableDefinition<&[u8; 16], &[u8]> = TableDefinition::new("members");
/// Workers by job and attempt.
const LEASES: TableDefinition<(u64, u32), &[u8; 16]> = TableDefinition::new("leases");
/// Principals that were wrong.
const QUARANTINED: TableDefinition<&str, ()> = TableDefinition::new("quarantined");
/// Events as JSON, by sequence number.
const EVENTS: TableDefinition<u64, &[u8]> = TableDefinition::new("events");

/// Memory for pages: a journal is written at its end and read once.
const CACHE_BYTES: usize = 8 << 20;
/// Highest attempt that is believed: more failures and losses end a run long before.
pub(super) const MAX_ATTEMPT: u32 = 100_000;
/// Highest sequence number that is believed.
const MAX_SEQUENCE: u64 = 1 << 53;

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
        atomic::write_with(path, |file| write_header(file.try_clone()?, header))
            .map_err(|error| classified(path, error))
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
            let mut plans = transaction.open_table(PLANS)?;
            let mut events = transaction.open_table(EVENTS)?;
            for entry in entries {
                match entry {
                    Entry::Accepted(JobId(job), answer) => {
                        let (job, Some(bytes)) = (*job, answer.encode()) else { continue };
                        accepted.insert(job, bytes.as_slice())?;
                        leases.retain_in((job, 0)..=(job, u32::MAX), |_, _| false)?;
                    }
                    Entry::Joined(id, member) => {
                        members.insert(&id.0, member.encode().as_slice())?;
                    }
                    Entry::Left(id) => {
                        members.remove(&id.0)?;
                    }
                    Entry::Leased(job, attempt, id) => {
                        leases.insert((job.0, *attempt), &id.0)?;
                    }
                    Entry::Retracted(job) => {
                        accepted.remove(job.0)?;
                    }
                    Entry::Sharded(job, ShardPlan { query, database }) => {
                        let numbers = (query.shards, query.ranges, database.shards, database.ranges);
                        plans.insert(job.0, numbers)?;
                    }
                    Entry::Quarantined(principal) => {
                        transaction.open_table(QUARANTINED)?.insert(principal.to_string().as_str(), ())?;
                    }
                    Entry::Readmitted(principal) => {
                        transaction.open_table(QUARANTINED)?.remove(principal.to_string().as_str())?;
                    }
                    Entry::Event(event) => {
                        let bytes = serde_json::to_vec(&**event).map_err(std::io::Error::from)?;
                        events.insert(event.sequence, bytes.as_slice())?;
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

fn write_header(file: File, header: &Header) -> Result<(), Error> {
    let database = builder().create_with_backend(FileBackend::new(file)?)?;
    let mut transaction = database.begin_write()?;
    transaction.set_durability(Durability::Immediate)?;
    let bytes = header.encode().map_err(std::io::Error::from)?;
    transaction.open_table(HEADER)?.insert("header", bytes.as_slice())?;
    // The other tables are made here, so that one that is missing later is damage.
    transaction.open_table(TALLY)?.insert("milliseconds", 0)?;
    transaction.open_table(ACCEPTED)?;
    transaction.open_table(MEMBERS)?;
    transaction.open_table(LEASES)?;
    transaction.open_table(PLANS)?;
    transaction.open_table(QUARANTINED)?;
    transaction.open_table(EVENTS)?;
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
    let mut recorded = Recorded::default();
    let tally = transaction.open_table(TALLY).map_err(|error| error.to_string())?;
    let number = |name: &str| -> Result<u64, String> {
        Ok(tally.get(name).map_err(|error| error.to_string())?.map_or(0, |value| value.value()))
    };
    recorded.starts = number("starts")?.min(u64::MAX / 2);
    recorded.at_work = Duration::from_millis(number("milliseconds")?);

    for_each(transaction, ACCEPTED, |job, bytes| {
        let accepted = AcceptedResult::decode(bytes);
        recorded.accepted.insert(JobId(job), accepted.ok_or_else(|| format!("no answer to job {job}"))?);
        Ok(())
    })?;
    for_each(transaction, PLANS, |job, (of_query, query_ranges, of_database, database_ranges)| {
        let query = SidePlan { shards: of_query, ranges: query_ranges };
        let database = SidePlan { shards: of_database, ranges: database_ranges };
        recorded.plans.insert(JobId(job), ShardPlan { query, database });
        Ok(())
    })?;
    for_each(transaction, MEMBERS, |id, bytes| {
        let (id, member) = (WorkerId(*id), Member::decode(bytes));
        recorded.members.insert(id, member.ok_or_else(|| format!("no worker under {id}"))?);
        Ok(())
    })?;
    for_each(transaction, LEASES, |(job, attempt), id| {
        if attempt == 0 || attempt > MAX_ATTEMPT {
            return Err(format!("attempt {attempt} of job {job}"));
        }
        recorded.leases.push((JobId(job), attempt, WorkerId(*id)));
        Ok(())
    })?;
    for_each(transaction, QUARANTINED, |principal, ()| {
        recorded.quarantined.insert(principal.parse().map_err(|error| format!("{error}"))?);
        Ok(())
    })?;
    for_each(transaction, EVENTS, |sequence, bytes| {
        let event: Event = serde_json::from_slice(bytes).map_err(|error| format!("no event: {error}"))?;
        if event.sequence != sequence || sequence > MAX_SEQUENCE {
            return Err(format!("event {} where {sequence} should be", event.sequence));
        }
        recorded.events.push(event);
        Ok(())
    })?;
    Ok(recorded)
}

/// Hands each row of a table to `take`, in the order of keys.
fn for_each<K: redb::Key, V: redb::Value>(
    transaction: &ReadTransaction,
    table: TableDefinition<'_, K, V>,
    mut take: impl FnMut(K::SelfType<'_>, V::SelfType<'_>) -> Result<(), String>,
) -> Result<(), String> {
    let table = transaction.open_table(table).map_err(|error| error.to_string())?;
    for row in table.iter().map_err(|error| error.to_string())? {
        let (key, value) = row.map_err(|error| error.to_string())?;
        take(key.value(), value.value())?;
    }
    Ok(())
}

/// Damage needs other advice than a disk that fails or another process. It may show late: a file that was sharded is missed
/// where it was sharded.
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
