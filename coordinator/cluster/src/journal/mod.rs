//! The journal of a run: every result that was accepted, kept through any end of the coordinator.
//!
//! A search is deterministic, so that going on is doing it again with the results that are there. It is an append-only log:
//! `frame` has single records with their checksums, `records` and `header` what they say, `contents` what that comes to,
//! `layout` the whole file, `repair` takes what is sound in it, `results` finds a result in it again, `file` opens and
//! appends; `writer` commits in groups on a thread of its own. `follower` reads what another process writes.

mod contents;
mod file;
mod follower;
mod frame;
mod header;
mod layout;
mod records;
mod repair;
mod results;
mod writer;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use proto::journal::{AcceptedResult, Assurance, Member};
use proto::{JobId, Principal, WorkerId};

use crate::events::Event;
use crate::sharding::plan::ShardPlan;
pub use file::JournalFile;
pub use follower::JournalFollower;
pub use header::Header;
pub use results::{Attribution, RecordedResults};
pub use writer::{Journal, LogSequence};

/// File in a run folder.
pub const JOURNAL_FILE: &str = "journal.log";
/// Journals of version 2 and earlier have this name and another form, which is not read.
pub const EARLIER_JOURNAL_FILE: &str = "journal.redb";

/// Why a journal cannot be read or written.
#[derive(Clone, Debug, thiserror::Error)]
pub enum JournalError {
    /// Nothing in it says what it is the journal of.
    #[error(
        "{path}: damaged, got {what}\ngo on by the command that has begun this run: it computes again what is lost; or start another with --fresh"
    )]
    Damaged {
        /// The journal.
        path: PathBuf,
        /// What was found.
        what: String,
    },
    /// Another release wrote it.
    #[error(
        "{path}: version must be {version}, got {got}, written by {writer}\nfinish this run with that build, or start another with --fresh",
        version = header::VERSION,
        writer = if *got < header::VERSION { "an earlier build of Descry 0.1" } else { "a later release of Descry" }
    )]
    Version {
        /// The journal.
        path: PathBuf,
        /// Its version.
        got: u64,
    },
    /// The run is under way.
    #[error("{path}: in use by another process\nwait until it has ended, or stop it")]
    InUse {
        /// The journal.
        path: PathBuf,
    },
    /// The disk, most likely.
    #[error(
        "{path}: cannot be used, got {what}\ncheck permissions and free space, then run the same command again"
    )]
    Unusable {
        /// The journal.
        path: PathBuf,
        /// Why.
        what: String,
    },
}

impl JournalError {
    /// A journal of a version before there was [`JOURNAL_FILE`].
    pub fn earlier(path: &Path) -> Self {
        Self::Version { path: path.to_owned(), got: 2 }
    }

    fn damaged(path: &Path, what: impl ToString) -> Self {
        Self::Damaged { path: path.to_owned(), what: what.to_string() }
    }

    fn headless(path: &Path) -> Self {
        Self::damaged(path, "nothing that says what it is the journal of")
    }

    fn unusable(path: &Path, what: impl ToString) -> Self {
        Self::Unusable { path: path.to_owned(), what: what.to_string() }
    }
}

/// What is to be kept.
#[derive(Clone, Debug)]
pub enum Entry {
    /// A result of a job was accepted. It ends what is kept of the job's leases.
    Accepted(JobId, Box<AcceptedResult>),
    /// Why the accepted result of a job is believed by now, and another principal that gave it.
    Assured(JobId, Assurance, Option<Principal>),
    /// A worker joined.
    Joined(WorkerId, Member),
    /// A worker went.
    Left(WorkerId),
    /// An attempt at a job was handed out.
    Leased(JobId, u32, WorkerId),
    /// A result is in doubt, and none to go on with.
    Retracted(JobId),
    /// A principal was wrong, and is quarantined.
    Quarantined(Principal),
    /// A principal is no longer quarantined.
    Readmitted(Principal),
    /// Something happened.
    Event(Arc<Event>),
    /// The evaluation of this job is sharded.
    Sharded(JobId, ShardPlan),
}

/// What earlier starts of a run have left.
#[derive(Debug, Default)]
#[cfg_attr(test, derive(PartialEq))]
pub struct Recorded {
    /// Starts of the coordinator so far.
    pub starts: u64,
    /// Time they were at work.
    pub at_work: Duration,
    /// Every result.
    pub accepted: RecordedResults,
    /// Workers that had not gone.
    pub members: BTreeMap<WorkerId, Member>,
    /// How evaluations were sharded, by job.
    pub plans: BTreeMap<JobId, ShardPlan>,
    /// Attempts at jobs that have no result, with the workers they were given to, in order of jobs and attempts.
    pub leases: Vec<(JobId, u32, WorkerId)>,
    /// Principals that were wrong.
    pub quarantined: BTreeSet<Principal>,
    /// What happened, in order.
    pub events: Vec<Event>,
    /// How often the journal was damaged, so that not all of this is here.
    pub repairs: u64,
}

impl Recorded {
    /// Whether nobody was found to be wrong, as far as anybody can know.
    pub fn is_trusted(&self) -> bool {
        self.quarantined.is_empty() && self.repairs == 0
    }

    /// Labels under which results are recorded.
    pub fn labels(&self) -> BTreeSet<String> {
        self.accepted.attributions().map(|(attribution, _)| attribution.worker.clone()).collect()
    }
}

#[cfg(test)]
pub(crate) mod tests;
