//! Blobs by digest: from the coordinator, or from the local cache folder.

use std::fs;
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use proto::v1::coordinator_client::CoordinatorClient;
use proto::{Digest, MAX_BLOB_BYTES, v1};
use tokio::sync::Semaphore;
use tokio::task::spawn_blocking;
use tonic::Code;
use tonic::transport::Channel;

use crate::backoff::Backoff;

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
    /// The worker is about to stop.
    #[error("blob {digest}: not read, the worker is stopping")]
    Stopping {
        /// Which blob.
        digest: Digest,
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

/// Times a blob is asked for again before its job fails: about ten seconds in all.
const RETRIES: u32 = 6;

/// The coordinator's blobs, with a cache folder before them if there is one.
#[derive(Debug)]
pub struct Blobs {
    client: CoordinatorClient<Channel>,
    folder: Option<PathBuf>,
    streams: Semaphore,
    retries: u32,
    /// Blobs that came over the network.
    fetched: AtomicU64,
    /// Whether it has been said that the folder cannot be written: once is enough.
    warned: AtomicBool,
}

impl Blobs {
    /// Blobs from `client`, kept in `folder`.
    pub fn new(client: CoordinatorClient<Channel>, folder: Option<PathBuf>) -> Self {
        Self {
            client,
            folder,
            streams: Semaphore::new(STREAMS),
            retries: RETRIES,
            fetched: AtomicU64::new(0),
            warned: AtomicBool::new(false),
        }
    }

    /// Blobs that came over the network so far, and not from the folder.
    pub fn fetched(&self) -> u64 {
        self.fetched.load(Ordering::Relaxed)
    }

    /// The bytes with this digest. A damaged cache entry is dropped and fetched again; a cache folder that cannot
    /// be written costs a warning, not the job.
    pub async fn get(&self, digest: Digest) -> Result<Vec<u8>, BlobError> {
        let Some(folder) = self.folder.clone() else { return self.fetch(digest).await };
        // A slow disk must not hold up the polls that tell the coordinator this worker is alive.
        let path = entry(&folder, digest);
        if let Ok(Some(bytes)) = spawn_blocking(move || read_cached(&path, digest)).await {
            return Ok(bytes);
        }
        let bytes = self.fetch(digest).await?;
        let kept = spawn_blocking(move || {
            let stored = store(&folder, digest, &bytes);
            (bytes, stored.map_err(|error| (folder, error)))
        });
        let (bytes, stored) = kept.await.map_err(|_| BlobError::Stopping { digest })?;
        if let Err((folder, error)) = stored
            && !self.warned.swap(true, Ordering::Relaxed)
        {
            tracing::warn!(
                "cache {}: cannot keep clouds, got {error}\nfree some space or choose another --cache",
                folder.display()
            );
        }
        Ok(bytes)
    }

    /// Tries again after faults of the network, which are no faults of the job.
    async fn fetch(&self, digest: Digest) -> Result<Vec<u8>, BlobError> {
        let _permit = self.streams.acquire().await;
        let mut backoff = Backoff::new(descriptor::random::stream(rand::random(), "blob back-off", &[]));
        loop {
            match self.fetch_once(digest).await {
                Err(BlobError::Fetch { status, .. })
                    if backoff.failures() < self.retries
                        && !matches!(
                            status.code(),
                            Code::NotFound | Code::DataLoss | Code::InvalidArgument
                        ) =>
                {
                    tokio::time::sleep(backoff.next_pause()).await;
                }
                Ok(bytes) => {
                    self.fetched.fetch_add(1, Ordering::Relaxed);
                    return Ok(bytes);
                }
                Err(error) => return Err(error),
            }
        }
    }

    async fn fetch_once(&self, digest: Digest) -> Result<Vec<u8>, BlobError> {
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

fn read_cached(path: &Path, digest: Digest) -> Option<Vec<u8>> {
    let file = fs::File::open(path).ok()?;
    let mut bytes = Vec::new();
    file.take(MAX_BLOB_BYTES + 1).read_to_end(&mut bytes).ok()?;
    if Digest::of(&bytes) == digest {
        return Some(bytes);
    }
    tracing::warn!("cache {}: entry is damaged, fetching it again", path.display());
    let _ = fs::remove_file(path); // if it stays, it is found damaged again
    None
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
        Blobs { retries: 0, ..Blobs::new(CoordinatorClient::new(channel), Some(folder.to_owned())) }
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
