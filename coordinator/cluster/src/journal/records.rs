//! What a journal's records say, as bytes and back.

use std::sync::Arc;

use proto::journal::{AcceptedResult, Assurance, Member};
use proto::{JobId, Principal, WorkerId};

use super::Entry;
use crate::events::Event;
use crate::sharding::plan::{ShardPlan, SidePlan};

/// Highest attempt that is believed: more failures and losses end a run long before.
pub(super) const MAX_ATTEMPT: u32 = 100_000;
/// Highest sequence number that is believed.
const MAX_SEQUENCE: u64 = 1 << 53;

/// First byte of a record.
mod kind {
    pub const PADDING: u8 = 0;
    pub const TALLY: u8 = 1;
    pub const ACCEPTED: u8 = 2;
    pub const JOINED: u8 = 3;
    pub const LEFT: u8 = 4;
    pub const LEASED: u8 = 5;
    pub const RETRACTED: u8 = 6;
    pub const QUARANTINED: u8 = 7;
    pub const EVENT: u8 = 8;
    pub const SHARDED: u8 = 9;
    pub const READMITTED: u8 = 10;
    pub const ASSURED: u8 = 11;
}

/// What is counted over all starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Starts of the coordinator.
    pub starts: u64,
    /// How long they were at work.
    pub milliseconds: u64,
    /// How often records were lost.
    pub repairs: u64,
}

/// What a record says.
#[derive(Debug)]
pub enum Record {
    /// Nothing: what follows begins on a page of its own.
    Padding,
    /// Counts.
    Tally(Tally),
    /// What the journal was handed.
    Entry(Entry),
}

/// A record that takes `bytes` and says nothing.
pub fn padding(bytes: usize) -> Vec<u8> {
    vec![kind::PADDING; bytes]
}

impl Tally {
    /// Its record.
    pub fn encode(self) -> Vec<u8> {
        let numbers = [self.starts, self.milliseconds, self.repairs].map(u64::to_le_bytes);
        [&[kind::TALLY][..], &numbers.concat()].concat()
    }
}

/// The bytes of an entry; `None` of a result or an attempt that is not kept.
pub fn encode(entry: &Entry) -> Option<Vec<u8>> {
    let record = |kind: u8, parts: &[&[u8]]| Some([&[kind][..], &parts.concat()].concat());
    match entry {
        Entry::Accepted(JobId(job), answer) => {
            record(kind::ACCEPTED, &[&job.to_le_bytes(), &answer.encode()?])
        }
        Entry::Joined(id, member) => record(kind::JOINED, &[&id.0, &member.encode()]),
        Entry::Left(id) => record(kind::LEFT, &[&id.0]),
        // It would be taken for damage.
        Entry::Leased(_, attempt, _) if *attempt > MAX_ATTEMPT => None,
        Entry::Leased(job, attempt, id) => {
            record(kind::LEASED, &[&job.0.to_le_bytes(), &attempt.to_le_bytes(), &id.0])
        }
        Entry::Retracted(job) => record(kind::RETRACTED, &[&job.0.to_le_bytes()]),
        Entry::Quarantined(principal) => record(kind::QUARANTINED, &[principal.to_string().as_bytes()]),
        Entry::Readmitted(principal) => record(kind::READMITTED, &[principal.to_string().as_bytes()]),
        Entry::Assured(JobId(job), assurance, seconded) => {
            let seconded = seconded.map(|principal| principal.to_string()).unwrap_or_default();
            record(kind::ASSURED, &[&job.to_le_bytes(), &[assurance_code(*assurance)], seconded.as_bytes()])
        }
        Entry::Event(event) => record(kind::EVENT, &[&serde_json::to_vec(&**event).ok()?]),
        Entry::Sharded(job, ShardPlan { query, database }) => {
            let numbers = [query.shards, query.ranges, database.shards, database.ranges];
            record(kind::SHARDED, &[&job.0.to_le_bytes(), &numbers.map(u32::to_le_bytes).concat()])
        }
    }
}

/// What a record says; `None` if no record of this version has these bytes.
pub fn decode(payload: &[u8]) -> Option<Record> {
    let (&kind, bytes) = payload.split_first()?;
    let id = |bytes: &[u8]| Some(WorkerId(bytes.try_into().ok()?));
    let entry = match kind {
        kind::PADDING => return Some(Record::Padding),
        kind::TALLY => {
            let (starts, rest) = number(bytes)?;
            let (milliseconds, rest) = number(rest)?;
            let repairs = u64::from_le_bytes(rest.try_into().ok()?);
            let [starts, milliseconds, repairs] =
                [starts, milliseconds, repairs].map(|count| count.min(u64::MAX / 2));
            return Some(Record::Tally(Tally { starts, milliseconds, repairs }));
        }
        kind::ACCEPTED => {
            let (job, answer) = number(bytes)?;
            Entry::Accepted(JobId(job), Box::new(AcceptedResult::decode(answer)?))
        }
        kind::JOINED => {
            let (id, member) = bytes.split_first_chunk()?;
            Entry::Joined(WorkerId(*id), Member::decode(member)?)
        }
        kind::LEFT => Entry::Left(id(bytes)?),
        kind::LEASED => {
            let (job, rest) = number(bytes)?;
            let (attempt, holder) = rest.split_first_chunk()?;
            let attempt = u32::from_le_bytes(*attempt);
            let is_believed = (1..=MAX_ATTEMPT).contains(&attempt);
            Entry::Leased(JobId(job), attempt, id(holder).filter(|_| is_believed)?)
        }
        kind::RETRACTED => Entry::Retracted(JobId(u64::from_le_bytes(bytes.try_into().ok()?))),
        kind::QUARANTINED => Entry::Quarantined(principal(bytes)?),
        kind::READMITTED => Entry::Readmitted(principal(bytes)?),
        kind::ASSURED => {
            let (job, rest) = number(bytes)?;
            let (&code, seconded) = rest.split_first()?;
            let assurance = ASSURANCES.into_iter().find(|one| assurance_code(*one) == code)?;
            let seconded = if seconded.is_empty() { None } else { Some(principal(seconded)?) };
            Entry::Assured(JobId(job), assurance, seconded)
        }
        kind::EVENT => {
            let event: Event = serde_json::from_slice(bytes).ok()?;
            Entry::Event(Arc::new(Some(event).filter(|event| event.sequence <= MAX_SEQUENCE)?))
        }
        kind::SHARDED => {
            let (job, numbers) = number(bytes)?;
            let numbers: &[u8; 16] = numbers.try_into().ok()?;
            let side = |at: usize| {
                let number = |at: usize| u32::from_le_bytes([0, 1, 2, 3].map(|byte| numbers[at * 4 + byte]));
                SidePlan { shards: number(at), ranges: number(at + 1) }
            };
            Entry::Sharded(JobId(job), ShardPlan { query: side(0), database: side(2) })
        }
        _ => return None,
    };
    Some(Record::Entry(entry))
}

/// All there are.
const ASSURANCES: [Assurance; 4] =
    [Assurance::Owed, Assurance::Unaudited, Assurance::Audited, Assurance::Own];

fn assurance_code(assurance: Assurance) -> u8 {
    match assurance {
        Assurance::Owed => 1,
        Assurance::Unaudited => 2,
        Assurance::Audited => 3,
        Assurance::Own => 4,
    }
}

fn principal(bytes: &[u8]) -> Option<Principal> {
    std::str::from_utf8(bytes).ok()?.parse().ok()
}

/// A number, and what follows.
fn number(bytes: &[u8]) -> Option<(u64, &[u8])> {
    bytes.split_first_chunk().map(|(number, rest)| (u64::from_le_bytes(*number), rest))
}
