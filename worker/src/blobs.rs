//! Blobs by digest: from memory's side of the network, or from the local cache folder.

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use proto::v1::coordinator_client::CoordinatorClient;
use proto::{Digest, MAX_BLOB_BYTES, v1};
use tokio::sync::Semaphore;
use tonic::transport::Channel;

/// Why a blob is not to be had.
#[derive(Debug, thiserror::Error)]
pub enum BlobError {
    /// The coordinator does not give it.
    #[error("blob {digest}: cannot be fetched, got {status}", status = .status.message())]
    Fetch {
        /// Which blob.
        digest: Digest,
        /// The answer.
        status: tonic::Status,
    },
    /// What came is not what was asked for.
    #[error("blob {digest}: bytes must match the digest, got {got}")]
    Mismatch {
        /// Which blob.
        digest: Digest,
        /// The digest of the bytes that came.
        got: Digest,
    },
    /// More bytes than any blob may have.
    #[error("blob {digest}: at most {MAX_BLOB_BYTES} bytes, got more")]
    TooLarge {
        /// Which blob.
        digest: Digest,
    },
}

/// Streams open at once: enough to hide the network's delay, few enough to leave room for polls.
const STREAMS: usize = 16;

/// The coordinator's blobs, with a cache folder before them if there is one.
#[derive(Debug)]
pub struct Blobs {
    client: CoordinatorClient<Channel>,
    folder: Option<PathBuf>,
    streams: Semaphore,
}

impl Blobs {
    /// Blobs from `client`, kept in `folder`.
    pub fn new(client: CoordinatorClient<Channel>, folder: Option<PathBuf>) -> Self {
        Self { client, folder, streams: Semaphore::new(STREAMS) }
    }

    /// The bytes with this digest. A damaged cache entry is dropped and fetched again; a cache folder that cannot
    /// be written costs a warning, not the job.
    pub async fn get(&self, digest: Digest) -> Result<Vec<u8>, BlobError> {
        if let Some(bytes) = self.read_cached(digest) {
            return Ok(bytes);
        }
        let bytes = self.fetch(digest).await?;
        if let Some(folder) = &self.folder
            && let Err(error) = store(folder, digest, &bytes)
        {
            tracing::warn!(
                "cache {}: cannot keep a blob, got {error}\nfree some space or choose another --cache",
                folder.display()
            );
        }
        Ok(bytes)
    }

    fn read_cached(&self, digest: Digest) -> Option<Vec<u8>> {
        let path = entry(self.folder.as_deref()?, digest);
        let bytes = fs::read(&path).ok()?;
        if Digest::of(&bytes) == digest {
            return Some(bytes);
        }
        tracing::warn!("cache {}: entry is damaged, fetching it again", path.display());
        let _ = fs::remove_file(&path); // if it stays, it is found damaged again
        None
    }

    async fn fetch(&self, digest: Digest) -> Result<Vec<u8>, BlobError> {
        let _permit = self.streams.acquire().await;
        let failed = |status| BlobError::Fetch { digest, status };
        let request = v1::FetchBlobRequest { digest: digest.to_vec() };
        let mut stream = self.client.clone().fetch_blob(request).await.map_err(failed)?.into_inner();
        let mut bytes = Vec::new();
        while let Some(chunk) = stream.message().await.map_err(failed)? {
            if (bytes.len() + chunk.data.len()) as u64 > MAX_BLOB_BYTES {
                return Err(BlobError::TooLarge { digest });
            }
            bytes.extend_from_slice(&chunk.data);
        }
        let got = Digest::of(&bytes);
        if got == digest { Ok(bytes) } else { Err(BlobError::Mismatch { digest, got }) }
    }
}

/// Spread over folders of two hex digits, as a folder of a quarter million entries is slow to list.
fn entry(folder: &Path, digest: Digest) -> PathBuf {
    let name = digest.to_string();
    folder.join(&name[..2]).join(name)
}

/// Whole or not at all: another worker may share the folder, and this one may be killed while it writes.
fn store(folder: &Path, digest: Digest, bytes: &[u8]) -> io::Result<()> {
    let path = entry(folder, digest);
    let parent = path.parent().unwrap_or(folder);
    fs::create_dir_all(parent)?;
    let mut file = tempfile::NamedTempFile::new_in(parent)?;
    file.write_all(bytes)?;
    file.persist(&path)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use tonic::transport::Endpoint;

    use super::*;

    fn blobs(folder: &Path) -> Blobs {
        // Nobody listens there: what the test reads must come from the folder.
        let channel = Endpoint::from_static("http://127.0.0.1:1").connect_lazy();
        Blobs::new(CoordinatorClient::new(channel), Some(folder.to_owned()))
    }

    #[tokio::test]
    async fn a_cached_blob_is_read_and_a_damaged_one_is_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let digest = Digest::of(b"cloud");
        store(folder.path(), digest, b"cloud").unwrap();
        let blobs = blobs(folder.path());
        assert_eq!(blobs.get(digest).await.unwrap(), b"cloud");

        let path = entry(folder.path(), digest);
        for damage in [&b"clo"[..], b"clouD", b""] {
            fs::write(&path, damage).unwrap();
            assert!(matches!(blobs.get(digest).await, Err(BlobError::Fetch { .. })));
            assert!(!path.exists());
        }
    }
}
