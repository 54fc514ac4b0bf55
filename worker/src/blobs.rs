//! What the coordinator gives: blobs by digest, kept in the cache folder, and entries of its own store. Both may be in the
//! bucket that machines share.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use cache::{MAX_ENTRY_BYTES, Store};
use proto::task::Described;
use proto::{BLOB_KIND, Digest, MAX_BLOB_BYTES, MIN_SHARED_DESCRIPTION_BYTES};
use tokio::sync::Semaphore;
use tokio::task::spawn_blocking;
use tonic::{Code, Status};

use crate::backoff::Backoff;
use crate::bucket::{Bucket, Wanted};
use crate::wire::Client;

/// Why a blob is not to be had.
#[derive(Debug, thiserror::Error)]
pub enum BlobError {
    /// The coordinator does not give it.
    #[error("blob {digest}: cannot be fetched, got {status}", status = .status.message())]
    Fetch {
        /// Which blob.
        digest: Digest,
        /// The answer.
        status: Status,
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

/// The coordinator's blobs and entries.
#[derive(Debug)]
pub struct Blobs {
    client: Client,
    /// Where copies of blobs are kept; `None` for a worker inside the coordinator's process, which has them all, and
    /// whose store is the coordinator's.
    copies: Option<Arc<Store>>,
    /// The bucket that machines share, if there is one.
    pub bucket: Arc<Bucket>,
    streams: Semaphore,
    retries: u32,
    /// Blobs that came over the network.
    fetched: AtomicU64,
}

impl Blobs {
    /// Blobs from `client` and `bucket`, with copies kept in `copies`.
    pub fn new(client: Client, copies: Option<Arc<Store>>, bucket: Arc<Bucket>) -> Self {
        Self {
            client,
            copies,
            bucket,
            streams: Semaphore::new(STREAMS),
            retries: RETRIES,
            fetched: AtomicU64::new(0),
        }
    }

    /// Blobs that came over the network so far, and not from the disk.
    pub fn fetched(&self) -> u64 {
        self.fetched.load(Ordering::Relaxed)
    }

    /// The bytes with this digest, as from [`Blobs::get_all`].
    pub async fn get(&self, digest: Digest) -> Result<Vec<u8>, BlobError> {
        let mut bytes = self.get_all(&[digest]).await?;
        bytes.pop().ok_or(BlobError::Stopping { digest })
    }

    /// The bytes with each of these digests. A damaged copy is dropped and fetched again; a disk that cannot be written
    /// costs a warning, not the job.
    pub async fn get_all(&self, digests: &[Digest]) -> Result<Vec<Vec<u8>>, BlobError> {
        let mut found = self.kept(digests).await;
        let absent = digests.iter().zip(&found).filter(|(_, bytes)| bytes.is_none());
        let absent: Vec<Digest> = absent.map(|(digest, _)| *digest).collect();
        let fetched = self.fetch_all(&absent).await?;
        let mut fetched = self.keep(&absent, fetched).await?.into_iter();
        found.iter_mut().filter(|bytes| bytes.is_none()).for_each(|bytes| *bytes = fetched.next());
        let there =
            |(bytes, &digest): (Option<Vec<u8>>, &Digest)| bytes.ok_or(BlobError::Stopping { digest });
        found.into_iter().zip(digests).map(there).collect()
    }

    /// What the disk has of these blobs.
    async fn kept(&self, digests: &[Digest]) -> Vec<Option<Vec<u8>>> {
        let Some(store) = &self.copies else { return vec![None; digests.len()] };
        // A slow disk must not hold up the polls that tell the coordinator this worker is alive.
        let read = |&digest: &Digest| {
            let store = Arc::clone(store);
            spawn_blocking(move || store.blob(digest))
        };
        let read = futures_util::future::join_all(digests.iter().map(read)).await;
        read.into_iter().map(|bytes| bytes.ok().flatten()).collect()
    }

    /// Keeps blobs on the disk.
    async fn keep(&self, digests: &[Digest], blobs: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, BlobError> {
        let Some(store) = &self.copies else { return Ok(blobs) };
        let keep = async |(&digest, bytes): (&Digest, Vec<u8>)| {
            let store = Arc::clone(store);
            let kept = spawn_blocking(move || {
                store.put_blob(digest, &bytes);
                bytes
            });
            kept.await.map_err(|_| BlobError::Stopping { digest })
        };
        futures_util::future::try_join_all(digests.iter().zip(blobs).map(keep)).await
    }

    /// Blobs from the bucket or the coordinator. What the bucket has not is kept there for others, except by a worker inside
    /// the coordinator's process, which has them all.
    async fn fetch_all(&self, digests: &[Digest]) -> Result<Vec<Vec<u8>>, BlobError> {
        let shared = self.shared(digests).await;
        let is_new: Vec<bool> = shared.iter().map(Option::is_none).collect();
        let fetch = async |(shared, &digest): (Option<Vec<u8>>, &Digest)| match shared {
            Some(bytes) => Ok(bytes),
            None => self.fetch(digest).await,
        };
        let fetch = shared.into_iter().zip(digests).map(fetch);
        let blobs = futures_util::future::try_join_all(fetch).await?;
        if self.copies.is_some() && self.bucket.is_offered() {
            let new = digests.iter().zip(&blobs).zip(is_new).filter(|(_, is_new)| *is_new);
            let new = new.map(|((digest, bytes), _)| (*digest, bytes.clone()));
            self.bucket.put(BLOB_KIND, new.collect());
        }
        Ok(blobs)
    }

    /// The bytes with this digest, if the bucket or the coordinator gives them; nothing of them is kept on the disk. `None`
    /// for whatever goes wrong: what is asked for can be made here just as well.
    pub async fn given(&self, digest: Digest) -> Option<Vec<u8>> {
        match self.shared(&[digest]).await.pop().flatten() {
            Some(bytes) => Some(bytes),
            None => self.fetch(digest).await.ok(),
        }
    }

    /// Gives the description of a shard to others by the bucket, if it is large.
    pub fn share(&self, described: &Described) {
        let is_large = |bytes: &&Arc<[u8]>| bytes.len() >= MIN_SHARED_DESCRIPTION_BYTES;
        if let Some(bytes) = described.bytes.as_ref().filter(is_large) {
            self.bucket.put(BLOB_KIND, vec![(described.digest, bytes.to_vec())]);
        }
    }

    /// What the bucket has of these blobs.
    async fn shared(&self, digests: &[Digest]) -> Vec<Option<Vec<u8>>> {
        let damage = |digest: Digest, bytes: &[u8]| {
            let got = Digest::of(bytes);
            (got != digest).then(|| format!("must have that digest, got {got}"))
        };
        self.bucket
            .get(Wanted { kind: BLOB_KIND, keys: digests, most: MAX_BLOB_BYTES, damage: &damage })
            .await
    }

    /// An entry of the coordinator's store, unchecked; `None` if it has none or is this process, if nothing is kept
    /// here, or for whatever else goes wrong: a cloud can be prepared here just as well.
    pub async fn derived(&self, kind: &str, key: Digest) -> Option<Vec<u8>> {
        self.copies.as_ref().filter(|store| store.is_kept())?;
        let _permit = self.streams.acquire().await;
        self.client.fetch_derived(kind, key, MAX_ENTRY_BYTES).await.ok()?
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
        let bytes = self.client.fetch_blob(digest, MAX_BLOB_BYTES).await.map_err(failed)?;
        let bytes = bytes.ok_or(BlobError::TooLarge { digest })?;
        let got = Digest::of(&bytes);
        if got == digest { Ok(bytes) } else { Err(BlobError::Mismatch { digest, got }) }
    }
}
