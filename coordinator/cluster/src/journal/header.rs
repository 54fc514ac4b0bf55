//! What a journal is the journal of, as bytes and back.

use std::path::Path;
use std::time::{Duration, SystemTime};

use proto::SessionId;
use serde::{Deserialize, Serialize};

use super::JournalError;

/// First word of every header.
const MAGIC: &str = "descry journal";
/// Grows with every change of what is kept and how.
pub(super) const VERSION: u64 = 3;
/// Longest header that is read, bytes: both texts of an experiment fit in several times.
const MAX_BYTES: usize = 8 << 20;

/// What a run is. Written once, before anybody is served.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// What determines the search, as canonical TOML.
    pub search: String,
    /// The whole experiment, as canonical TOML.
    pub experiment: String,
    /// Digest of the clouds.
    pub data_digest: String,
    /// Version of the numbers an evaluation gives.
    pub evaluation_version: u32,
    /// Names the run to workers: those that had work from an earlier start keep it.
    pub session: SessionId,
    /// First start of the run; kept to the millisecond.
    pub started_at: SystemTime,
}

/// A header as it is kept.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Form {
    magic: String,
    version: u64,
    search: String,
    experiment: String,
    data_digest: String,
    evaluation_version: u32,
    session: [u8; 16],
    started_milliseconds: u64,
}

/// What headers of all versions have.
#[derive(Deserialize)]
struct Stem {
    magic: String,
    version: u64,
}

impl Header {
    pub(super) fn encode(&self) -> Result<Vec<u8>, serde_json::Error> {
        let started = self.started_at.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        serde_json::to_vec(&Form {
            magic: MAGIC.to_owned(),
            version: VERSION,
            search: self.search.clone(),
            experiment: self.experiment.clone(),
            data_digest: self.data_digest.clone(),
            evaluation_version: self.evaluation_version,
            session: self.session.0,
            started_milliseconds: started.as_millis() as u64,
        })
    }

    /// The inverse of [`Header::encode`]; `path` names the journal in messages.
    pub fn decode(bytes: &[u8], path: &Path) -> Result<Self, JournalError> {
        let damaged = |what: String| JournalError::damaged(path, what);
        if bytes.len() > MAX_BYTES {
            return Err(damaged(format!("a header of {} bytes", bytes.len())));
        }
        let unread = |error: serde_json::Error| damaged(format!("a header that cannot be read: {error}"));
        let stem: Stem = serde_json::from_slice(bytes).map_err(unread)?;
        if stem.magic != MAGIC {
            return Err(damaged("the header of something else".to_owned()));
        }
        if stem.version != VERSION {
            return Err(JournalError::Version { path: path.to_owned(), got: stem.version });
        }
        let form: Form = serde_json::from_slice(bytes).map_err(unread)?;
        let started_at = SystemTime::UNIX_EPOCH
            .checked_add(Duration::from_millis(form.started_milliseconds))
            .ok_or_else(|| damaged("a start that no clock can show".to_owned()))?;
        Ok(Self {
            search: form.search,
            experiment: form.experiment,
            data_digest: form.data_digest,
            evaluation_version: form.evaluation_version,
            session: SessionId(form.session),
            started_at,
        })
    }
}
