//! URLs to the bucket that the machines of a run share: for what they may have, and for what may be believed.

mod entry_trust;

use std::collections::HashSet;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use cache::{MAX_ENTRY_BYTES, Store};
use cluster::Cluster;
use cluster::blobs::BlobStore;
use futures_util::future::BoxFuture;
use futures_util::{FutureExt as _, StreamExt as _, TryStreamExt as _};
use proto::{BLOB_KIND, Digest, MIN_SHARED_DESCRIPTION_BYTES, Principal};
use ring::digest;
use transport::{ObjectRequest, Presign, Presigner};
use worker::PREPARED_CLOUD;

#[cfg(not(feature = "s3"))]
pub use crate::no_bucket::{Bucket, BucketError};
use crate::prepared::PreparedClouds;
#[cfg(feature = "s3")]
pub use bucket::{Bucket, BucketError};
use entry_trust::{Check, Conviction, EntryTrust, Finding, Sha256};

/// For all entries that are checked before a call is answered: workers wait longer.
const PATIENCE: Duration = Duration::from_secs(2);
/// Most of them.
const MOST_CHECKS: usize = 64;
/// Checked at once.
const CHECKS_AT_ONCE: usize = 8;
/// After a check that could not be made, so long none is tried.
const PAUSE: Duration = Duration::from_secs(10);

/// What the bucket holds, with the names by which URLs to it are counted.
const COUNTED_KINDS: [(&str, &str); 2] = [(PREPARED_CLOUD, "prepared_cloud"), (BLOB_KIND, "blob")];

/// The bucket of a store, if it has one. Nothing is asked of it yet.
///
/// # Errors
/// If it cannot be opened.
pub fn open(store: &Store) -> Result<Option<Arc<Bucket>>, BucketError> {
    Ok(store.bucket().map(Bucket::open).transpose()?.map(Arc::new))
}

/// Signs URLs of what workers may have, blobs that are released and prepared clouds of these, and counts them.
pub fn presigner(
    bucket: &Arc<Bucket>,
    prepared: &Arc<PreparedClouds>,
    cluster: &Arc<Cluster>,
    store: &Store,
) -> Presigner {
    let is_read_only = store.is_shared_read_only();
    let source = Arc::clone(bucket);
    let read = move |key| {
        let source = Arc::clone(&source);
        let read = async move {
            let read = source.read(PREPARED_CLOUD, key, MAX_ENTRY_BYTES).await;
            read.map_err(|error| proto::Message::of(&error).what)
        };
        read.boxed()
    };
    let entries = Arc::new(Entries::new(Arc::clone(prepared), Arc::clone(cluster), Box::new(read)));
    let (bucket, prepared, cluster) = (Arc::clone(bucket), Arc::clone(prepared), Arc::clone(cluster));
    let sign: Presign = Arc::new(move |principal, kind, objects| {
        let (bucket, prepared, cluster) = (Arc::clone(&bucket), Arc::clone(&prepared), Arc::clone(&cluster));
        let entries = Arc::clone(&entries);
        Box::pin(async move {
            let is_given = |object: &ObjectRequest| {
                let is_write = object.sha256.is_some();
                !(is_write && is_read_only)
                    && is_given(&kind, object.key, is_write, (&prepared, &cluster.blobs))
            };
            let mut given: Vec<bool> = objects.iter().map(is_given).collect();
            if kind == PREPARED_CLOUD {
                entries.admit(principal, &objects, &mut given).await?;
            }
            let mut urls = Vec::with_capacity(objects.len());
            for (ObjectRequest { key, sha256 }, is_given) in objects.into_iter().zip(given) {
                let url = match sha256 {
                    _ if !is_given => Ok(None),
                    None => bucket.url_to_read(&kind, key).await,
                    Some(sha256) => bucket.url_to_write(&kind, key, &sha256).await,
                };
                urls.push(url.map_err(|error| proto::Message::of(&error).what)?);
            }
            Ok(urls)
        })
    });
    Presigner::new(sign, &COUNTED_KINDS)
}

/// Whether workers may have an object now, to read or to write it.
fn is_given(
    kind: &str,
    key: Digest,
    is_write: bool,
    (prepared, blobs): (&PreparedClouds, &BlobStore),
) -> bool {
    match kind {
        PREPARED_CLOUD => prepared.are_given(kind, key, blobs),
        // A blob is checked by whoever reads it.
        BLOB_KIND if is_write => true,
        BLOB_KIND => match blobs.description_bytes(key) {
            Some(bytes) => bytes >= MIN_SHARED_DESCRIPTION_BYTES,
            // What is no cloud of this run may be a description that is forgotten here.
            None => blobs.is_released(key) || !prepared.is_source(key),
        },
        _ => false,
    }
}

/// Gives an entry of the bucket, if there is one, or why that cannot be known.
type Read = Box<dyn Fn(Digest) -> BoxFuture<'static, Result<Option<Vec<u8>>, String>> + Send + Sync>;

/// The prepared clouds in the bucket, which workers cannot check as fast as they read them: who stores wrong ones is found
/// here, before others take them or soon after.
struct Entries {
    prepared: Arc<PreparedClouds>,
    cluster: Arc<Cluster>,
    read: Read,
    patience: Duration,
    trust: Mutex<EntryTrust>,
    /// Held by the call that checks entries: what one has found, the next need not look at. Why that failed, and when.
    checking: tokio::sync::Mutex<Option<(Instant, String)>>,
}

impl Entries {
    fn new(prepared: Arc<PreparedClouds>, cluster: Arc<Cluster>, read: Read) -> Self {
        let trust = Mutex::new(EntryTrust::new(cluster.audit()));
        Self { prepared, cluster, read, patience: PATIENCE, trust, checking: tokio::sync::Mutex::new(None) }
    }

    /// Takes back what is `given` to a principal of entries that are not to be trusted, after as many checks as it takes to
    /// know; notes what it is to store.
    ///
    /// # Errors
    /// If the bucket does not give what is to be checked.
    async fn admit(
        &self,
        principal: Principal,
        objects: &[ObjectRequest],
        given: &mut [bool],
    ) -> Result<(), String> {
        let mut wanted = Vec::new();
        for (object, given) in objects.iter().zip(&mut *given).filter(|(_, given)| **given) {
            match object.sha256 {
                Some(sha256) => *given = self.trust().sign(object.key, sha256, principal),
                None => wanted.push(object.key),
            }
        }
        if wanted.is_empty() {
            return Ok(());
        }
        self.check(&wanted).await?;
        let mut trusted = self.trust().give(&wanted, principal).into_iter();
        let reads = objects.iter().zip(given).filter(|(object, given)| **given && object.sha256.is_none());
        for (_, given) in reads {
            *given = trusted.next().unwrap_or(false);
        }
        Ok(())
    }

    /// Checks as many of these entries as it takes to know whom to trust.
    async fn check(&self, keys: &[Digest]) -> Result<(), String> {
        let share = self.cluster.audit().share;
        // Which ones nobody can foresee; no result depends on it.
        let drawn = keys.iter().copied().filter(|_| rand::random_bool(share)).collect();
        let mut keys = keys.to_vec();
        if self.trust().choose(&keys, &drawn, 1).is_empty() {
            return Ok(());
        }
        let mut failed = self.checking.lock().await;
        if let Some((_, why)) = failed.as_ref().filter(|(since, _)| since.elapsed() < PAUSE) {
            return Err(why.clone());
        }
        let checked = tokio::time::timeout(self.patience, async {
            let mut left = MOST_CHECKS;
            loop {
                let checks = self.trust().choose(&keys, &drawn, left);
                if checks.is_empty() {
                    return Ok(());
                }
                left -= checks.len();
                let chosen: HashSet<Digest> = checks.iter().map(|check| check.key).collect();
                keys.retain(|key| !chosen.contains(key));
                let looks = futures_util::stream::iter(checks).map(|check| self.look_at(check));
                let looks = looks.buffer_unordered(CHECKS_AT_ONCE);
                looks.try_collect::<()>().await?;
            }
        });
        let checked = checked.await.unwrap_or_else(|_| {
            Err(format!("the coordinator has waited {:?} for entries to check", self.patience))
        });
        *failed = checked.as_ref().err().map(|why: &String| (Instant::now(), why.clone()));
        checked
    }

    /// Checks one.
    async fn look_at(&self, check: Check) -> Result<(), String> {
        let finding = match (self.read)(check.key).await? {
            None => Finding::Absent,
            Some(bytes) => {
                let (prepared, cluster) = (Arc::clone(&self.prepared), Arc::clone(&self.cluster));
                let compare = move || compared(&prepared, &cluster.blobs, check.key, &bytes);
                tokio::task::spawn_blocking(compare).await.map_err(|error| error.to_string())??
            }
        };
        let conviction = self.trust().note(check, finding);
        self.draw_consequences(check.key, conviction);
        Ok(())
    }

    /// Quarantines whoever is wrong, and audits whoever may have gone on with it.
    fn draw_consequences(&self, key: Digest, Conviction { wrong, is_earlier, readers }: Conviction) {
        if is_earlier {
            tracing::warn!(
                "bucket: prepared cloud {key} is not what its source gives, and no worker of this run has stored it: only entries that the coordinator has checked are used from now on\nempty the bucket (coordinator prune), and verify the runs that have used it"
            );
        }
        for principal in wrong {
            tracing::warn!(
                "bucket: prepared cloud {key} is not what its source gives: {principal}, which has stored it, is quarantined"
            );
            self.cluster.quarantine(principal);
        }
        for principal in readers {
            tracing::warn!(
                "bucket: {principal} may have computed with wrong clouds: its next answers are audited\nstart its workers again, with an empty cache"
            );
            self.cluster.suspect(principal);
        }
    }

    fn trust(&self) -> MutexGuard<'_, EntryTrust> {
        self.trust.lock().unwrap_or_else(PoisonError::into_inner) // its methods do not panic half-way
    }
}

/// Compares an entry with what its source gives.
fn compared(
    prepared: &PreparedClouds,
    blobs: &BlobStore,
    key: Digest,
    bytes: &[u8],
) -> Result<Finding, String> {
    let mut sha256: Sha256 = [0; 32];
    sha256.copy_from_slice(digest::digest(&digest::SHA256, bytes).as_ref());
    let Ok(payload) = prepared.payload(key, bytes) else { return Ok(Finding::Damaged(sha256)) };
    let expected = prepared.prepare(key, blobs)?;
    Ok(if payload == expected { Finding::Right(sha256) } else { Finding::Wrong(sha256) })
}

#[cfg(test)]
mod tests;
