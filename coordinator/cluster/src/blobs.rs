//! The blobs a run gives to its workers: split manifests, the clouds they list and descriptions of shards, by digest
//! and nothing else.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};
use std::{fs, io};

use proto::Digest;
use worker::Lru;

/// Memory for descriptions, bytes; what was used least recently goes first, and is made again where it is needed.
const DESCRIPTIONS: usize = 256 << 20;

/// Why a blob is not given.
#[derive(Debug, thiserror::Error)]
pub enum BlobError {
    /// No such blob, or not yet.
    #[error("blob {0}: this run has none of this name")]
    Unknown(Digest),
    /// The file cannot be read any more.
    #[error("{path}: cannot read it any more, got {source}")]
    Read {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is not the one the run started with.
    #[error(
        "{0}: has changed since the run started\nleave a data set alone while a run uses it, and start the run again"
    )]
    Changed(PathBuf),
}

#[derive(Clone, Debug)]
enum Source {
    Bytes(Vec<u8>),
    File(PathBuf),
}

/// What workers may fetch. Paths come from the coordinator's own lists, never from a request.
#[derive(Debug)]
pub struct BlobStore {
    sources: RwLock<HashMap<Digest, Source>>,
    descriptions: Mutex<Lru<Digest, Arc<[u8]>>>,
}

impl Default for BlobStore {
    fn default() -> Self {
        Self { sources: RwLock::default(), descriptions: Mutex::new(Lru::new(DESCRIPTIONS)) }
    }
}

impl BlobStore {
    /// Releases bytes and returns their name.
    pub fn publish_bytes(&self, bytes: Vec<u8>) -> Digest {
        let digest = Digest::of(&bytes);
        self.insert(digest, Source::Bytes(bytes));
        digest
    }

    /// Releases a file whose bytes had this digest when the run started.
    pub fn publish_file(&self, digest: Digest, path: PathBuf) {
        self.insert(digest, Source::File(path));
    }

    /// Releases the description of a shard, as long as there is room for it.
    pub fn publish_description(&self, digest: Digest, parts: &Arc<[u8]>) {
        self.descriptions().insert(digest, Arc::clone(parts), parts.len());
    }

    /// Whether workers may have this blob.
    pub fn is_released(&self, digest: Digest) -> bool {
        self.sources.read().unwrap_or_else(PoisonError::into_inner).contains_key(&digest)
    }

    /// The bytes of a released blob; a file is compared with its digest again.
    pub fn read(&self, digest: Digest) -> Result<Vec<u8>, BlobError> {
        let source = self.sources.read().unwrap_or_else(PoisonError::into_inner).get(&digest).cloned();
        match source {
            None => match self.descriptions().get(&digest) {
                Some(parts) => Ok(parts.to_vec()),
                None => Err(BlobError::Unknown(digest)),
            },
            Some(Source::Bytes(bytes)) => Ok(bytes),
            Some(Source::File(path)) => read_file(&path, digest),
        }
    }

    fn descriptions(&self) -> MutexGuard<'_, Lru<Digest, Arc<[u8]>>> {
        self.descriptions.lock().unwrap_or_else(PoisonError::into_inner) // values are inserted whole
    }

    fn insert(&self, digest: Digest, source: Source) {
        self.sources.write().unwrap_or_else(PoisonError::into_inner).insert(digest, source);
    }
}

fn read_file(path: &Path, digest: Digest) -> Result<Vec<u8>, BlobError> {
    let bytes = fs::read(path).map_err(|source| BlobError::Read { path: path.to_owned(), source })?;
    if Digest::of(&bytes) == digest { Ok(bytes) } else { Err(BlobError::Changed(path.to_owned())) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_released_blobs_are_read_and_changed_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.pcd");
        fs::write(&path, "cloud").unwrap();
        let store = BlobStore::default();
        let digest = Digest::of(b"cloud");
        assert!(matches!(store.read(digest), Err(BlobError::Unknown(_))));
        store.publish_file(digest, path.clone());
        assert_eq!(store.read(digest).unwrap(), b"cloud");
        fs::write(&path, "another").unwrap();
        assert!(matches!(store.read(digest), Err(BlobError::Changed(_))));
        fs::remove_file(&path).unwrap();
        assert!(matches!(store.read(digest), Err(BlobError::Read { .. })));
        let manifest = store.publish_bytes(b"list".to_vec());
        assert_eq!(store.read(manifest).unwrap(), b"list");

        let parts: Arc<[u8]> = b"parts".as_slice().into();
        store.publish_description(Digest::of(&parts), &parts);
        assert_eq!(store.read(Digest::of(&parts)).unwrap(), b"parts");
    }
}
