//! The blobs a run gives to its workers: split manifests, the clouds they list and descriptions of shards, by digest
//! and nothing else.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError, RwLock};

use cache::Lru;
use proto::task::Described;
use proto::{Compressed, Digest};

use crate::lock::lock;

/// Memory for descriptions, bytes, compressed; what was used least recently goes first, and is made again where it is needed.
pub const DESCRIPTIONS: usize = 256 << 20;

/// Why a blob is not given.
#[derive(Debug, thiserror::Error)]
pub enum BlobError {
    /// No such blob, or not yet.
    #[error("blob {0}: this run has none of this name")]
    Unknown(Digest),
    /// The cloud cannot be read any more.
    #[error("{path}: cannot read it any more, got {reason}")]
    Read {
        /// Which file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The file is not the one the run started with.
    #[error(
        "{0}: has changed since the run started\nleave a data set alone while a run uses it, and start the run again"
    )]
    Changed(PathBuf),
}

/// Gives the bytes of the cloud that a file stands for, or in a line why there are none.
pub type ReadCloud = fn(&Path) -> Result<Vec<u8>, String>;

#[derive(Clone, Debug)]
enum Source {
    Bytes(Vec<u8>),
    Cloud(PathBuf, ReadCloud),
}

/// The bytes of a blob as they are sent.
#[derive(Clone, Debug)]
pub enum Blob {
    /// As they are.
    Bytes(Vec<u8>),
    /// Compressed.
    Compressed(Compressed),
}

/// What workers may fetch. Paths come from the coordinator's own lists, never from a request.
#[derive(Debug)]
pub struct BlobStore {
    sources: RwLock<HashMap<Digest, Source>>,
    descriptions: Mutex<Lru<Digest, Compressed>>,
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

    /// Releases a cloud whose bytes had this digest when the run started.
    pub fn publish_cloud(&self, digest: Digest, path: PathBuf, read: ReadCloud) {
        self.insert(digest, Source::Cloud(path, read));
    }

    /// Releases the description of a shard, as long as there is room for it. One of which only the name is left is not to
    /// be had.
    pub fn publish_description(&self, described: &Described) {
        let compress = || Compressed::new(described.bytes.as_ref()?);
        if let Some(compressed) = described.compressed.clone().or_else(compress) {
            let bytes = compressed.block().len();
            lock(&self.descriptions).insert(described.digest, compressed, bytes);
        }
    }

    /// Whether workers may have this blob.
    pub fn is_released(&self, digest: Digest) -> bool {
        self.sources.read().unwrap_or_else(PoisonError::into_inner).contains_key(&digest)
    }

    /// How long a description is, as long as it is kept; `None` of everything else.
    pub fn description_bytes(&self, digest: Digest) -> Option<usize> {
        lock(&self.descriptions).get(&digest).map(|described| described.length() as usize)
    }

    /// The bytes of a released blob; a cloud is compared with its digest again.
    pub fn read(&self, digest: Digest) -> Result<Vec<u8>, BlobError> {
        match self.read_as_kept(digest)? {
            Blob::Bytes(bytes) => Ok(bytes),
            // What came compressed was decompressed before it was kept.
            Blob::Compressed(described) => described.decompress().map_err(|_| BlobError::Unknown(digest)),
        }
    }

    /// As [`BlobStore::read`], but descriptions compressed.
    pub fn read_as_kept(&self, digest: Digest) -> Result<Blob, BlobError> {
        let source = self.sources.read().unwrap_or_else(PoisonError::into_inner).get(&digest).cloned();
        match source {
            None => match lock(&self.descriptions).get(&digest) {
                Some(described) => Ok(Blob::Compressed(described)),
                None => Err(BlobError::Unknown(digest)),
            },
            Some(Source::Bytes(bytes)) => Ok(Blob::Bytes(bytes)),
            Some(Source::Cloud(path, read)) => read_cloud(path, read, digest).map(Blob::Bytes),
        }
    }

    fn insert(&self, digest: Digest, source: Source) {
        self.sources.write().unwrap_or_else(PoisonError::into_inner).insert(digest, source);
    }
}

fn read_cloud(path: PathBuf, read: ReadCloud, digest: Digest) -> Result<Vec<u8>, BlobError> {
    match read(&path) {
        Ok(bytes) if Digest::of(&bytes) == digest => Ok(bytes),
        Ok(_) => Err(BlobError::Changed(path)),
        Err(reason) => Err(BlobError::Read { path, reason }),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn only_released_blobs_are_read_and_changed_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.pcd");
        fs::write(&path, "cloud").unwrap();
        let store = BlobStore::default();
        let digest = Digest::of(b"cloud");
        assert!(matches!(store.read(digest), Err(BlobError::Unknown(_))));
        store.publish_cloud(digest, path.clone(), |path| fs::read(path).map_err(|error| error.to_string()));
        assert_eq!(store.read(digest).unwrap(), b"cloud");
        fs::write(&path, "another").unwrap();
        assert!(matches!(store.read(digest), Err(BlobError::Changed(_))));
        fs::remove_file(&path).unwrap();
        assert!(matches!(store.read(digest), Err(BlobError::Read { .. })));
        let manifest = store.publish_bytes(b"list".to_vec());
        assert_eq!(store.read(manifest).unwrap(), b"list");

        assert!(matches!(store.read_as_kept(manifest), Ok(Blob::Bytes(_))));
    }

    #[test]
    fn descriptions_are_kept_compressed_however_they_came_and_read_either_way() {
        let store = BlobStore::default();
        let bytes = b"parts".repeat(1000);
        for described in [Described::new(bytes.clone()), Described::made(bytes.clone())] {
            let name = described.digest;
            store.publish_description(&described);
            assert_eq!(store.read(name).unwrap(), bytes);
            let Ok(Blob::Compressed(compressed)) = store.read_as_kept(name) else { panic!("not compressed") };
            assert!(compressed.block().len() < bytes.len() / 10);
            assert_eq!(store.description_bytes(name), Some(bytes.len()));
            assert!(!store.is_released(name));
        }
        let manifest = store.publish_bytes(b"list".to_vec());
        assert_eq!(store.description_bytes(manifest), None);
        let named = Described::named(Digest::of(b"another"));
        store.publish_description(&named);
        assert!(matches!(store.read(named.digest), Err(BlobError::Unknown(_))));
    }
}
