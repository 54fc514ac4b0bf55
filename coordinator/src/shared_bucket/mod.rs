//! URLs to the bucket that the machines of a run share: for what they may have, and for what may be believed.

mod entry_trust;

use std::collections::{HashMap, HashSet};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use cache::Store;
use cluster::Cluster;
use cluster::blobs::BlobStore;
use futures_util::FutureExt as _;
use futures_util::future::{BoxFuture, Shared};
use proto::{BLOB_KIND, Digest, MIN_SHARED_DESCRIPTION_BYTES, Principal};
use rand::seq::SliceRandom as _;
use ring::digest;
use tokio::sync::Semaphore;
use transport::{ObjectRequest, Presign, Presigner, SignedUrl};
use worker::{MAX_OBJECT_BYTES, PREPARED_CLOUD};

use crate::lock::lock;
#[cfg(not(feature = "s3"))]
pub use crate::no_bucket::{Bucket, BucketError};
use crate::prepared::PreparedClouds;
#[cfg(feature = "s3")]
pub use bucket::{Bucket, BucketError};
use entry_trust::{Check, Conviction, EntryTrust, Finding, Given, Sha256};

/// How long the bucket may take to give an entry that is to be checked, and a call waits for its checks: workers wait longer.
const PATIENCE: (Duration, Duration) = (Duration::from_secs(1), Duration::from_secs(2));
/// How long it may take to give an entry that is larger than it should be, as large as workers read any.
const PATIENCE_FOR_LARGE: Duration = Duration::from_secs(60);
/// Most checks of a call.
const MOST_CHECKS: usize = 64;
/// Checked at once.
const CHECKS_AT_ONCE: usize = 8;
/// After the bucket has not given an entry, so long none is asked for.
const PAUSE: Duration = Duration::from_secs(10);
/// An entry has at most so many bytes beside its payload.
const HEADER_BYTES: u64 = 4 << 10;

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
    let objects: Box<dyn Objects> = Box::new(Arc::clone(bucket));
    let entries = Arc::new(Entries::new(Arc::clone(prepared), Arc::clone(cluster), objects));
    let (bucket, prepared, cluster) = (Arc::clone(bucket), Arc::clone(prepared), Arc::clone(cluster));
    let sign: Presign = Arc::new(move |principal, kind, objects| {
        let (bucket, prepared, cluster) = (Arc::clone(&bucket), Arc::clone(&prepared), Arc::clone(&cluster));
        let entries = Arc::clone(&entries);
        Box::pin(async move {
            let give = |object: &ObjectRequest| {
                let is_write = object.sha256.is_some();
                let is_given = !(is_write && is_read_only)
                    && is_given(&kind, object.key, is_write, (&prepared, &cluster.blobs));
                if is_given { Given::Anything } else { Given::Withheld }
            };
            let mut given: Vec<Given> = objects.iter().map(give).collect();
            if kind == PREPARED_CLOUD {
                entries.admit(principal, &objects, &mut given).await?;
            }
            let mut urls = Vec::with_capacity(objects.len());
            for (ObjectRequest { key, sha256 }, given) in objects.into_iter().zip(given) {
                let content = match given {
                    Given::Withheld => {
                        urls.push(None);
                        continue;
                    }
                    Given::Content(sha256) => Some(sha256),
                    Given::Anything => None,
                };
                let url = match sha256 {
                    None => bucket.url_to_read(&kind, key).await,
                    Some(sha256) => bucket.url_to_write(&kind, key, &sha256).await,
                };
                let url = url.map_err(|error| what(&error))?;
                urls.push(url.map(|url| SignedUrl { url, sha256: content }));
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

/// The prepared clouds in a bucket, as they are to be checked. Errors say why something cannot be known.
trait Objects: Send + Sync {
    /// How many bytes an entry has, if there is one.
    fn size(&self, key: Digest) -> BoxFuture<'static, Result<Option<u64>, String>>;
    /// An entry, if there is one of at most so many bytes.
    fn read(&self, key: Digest, most: u64) -> BoxFuture<'static, Result<Option<Vec<u8>>, String>>;
}

impl Objects for Arc<Bucket> {
    fn size(&self, key: Digest) -> BoxFuture<'static, Result<Option<u64>, String>> {
        let bucket = Arc::clone(self);
        async move { Bucket::size(&bucket, PREPARED_CLOUD, key).await.map_err(|error| what(&error)) }.boxed()
    }

    fn read(&self, key: Digest, most: u64) -> BoxFuture<'static, Result<Option<Vec<u8>>, String>> {
        let bucket = Arc::clone(self);
        async move { Bucket::read(&bucket, PREPARED_CLOUD, key, most).await.map_err(|error| what(&error)) }
            .boxed()
    }
}

/// What an error says, without its advice, which is for whoever runs the coordinator.
fn what(error: &BucketError) -> String {
    proto::Message::of(error).what
}

/// A check that is being made.
type Look = Shared<BoxFuture<'static, ()>>;

/// The prepared clouds in the bucket, which workers cannot check as fast as they read them: who stores wrong ones is found
/// here, before others take them or soon after.
struct Entries {
    prepared: Arc<PreparedClouds>,
    cluster: Arc<Cluster>,
    objects: Box<dyn Objects>,
    patience: (Duration, Duration),
    trust: Mutex<EntryTrust>,
    /// Each entry is looked at by one task, whoever waits for it, and as long as it takes.
    looks: Mutex<HashMap<Digest, Look>>,
    at_once: Semaphore,
    /// One entry is read at a time that is larger than it should be.
    large: Semaphore,
    /// Why the bucket has not given an entry, and when.
    failed: Mutex<Option<(Instant, String)>>,
    /// Wrong entries, and entries that could not be compared, so far.
    wrong: AtomicU64,
    unknown: AtomicU64,
}

impl Entries {
    fn new(prepared: Arc<PreparedClouds>, cluster: Arc<Cluster>, objects: Box<dyn Objects>) -> Self {
        let trust = Mutex::new(EntryTrust::new(cluster.audit(), &cluster.quarantined()));
        Self {
            prepared,
            cluster,
            objects,
            patience: PATIENCE,
            trust,
            looks: Mutex::default(),
            at_once: Semaphore::new(CHECKS_AT_ONCE),
            large: Semaphore::new(1),
            failed: Mutex::default(),
            wrong: AtomicU64::new(0),
            unknown: AtomicU64::new(0),
        }
    }

    /// Takes back what is `given` to a principal of entries that are not to be trusted, after as many checks as it takes to
    /// know; notes what it is to store.
    ///
    /// # Errors
    /// If the bucket does not give what is to be checked, and nothing else is there to be given.
    async fn admit(
        self: &Arc<Self>,
        principal: Principal,
        objects: &[ObjectRequest],
        given: &mut [Given],
    ) -> Result<(), String> {
        self.distrust_quarantined();
        let now = Instant::now();
        let mut wanted = Vec::new();
        let open = objects.iter().zip(&mut *given).filter(|(_, given)| **given != Given::Withheld);
        for (object, given) in open {
            match object.sha256 {
                Some(sha256) if self.trust().sign(object.key, sha256, principal, now) => {}
                Some(_) => *given = Given::Withheld,
                None => wanted.push(object.key),
            }
        }
        if wanted.is_empty() {
            return Ok(());
        }
        // Which ones nobody can foresee; no result depends on it.
        let share = self.cluster.audit().share;
        let drawn = wanted.iter().copied().filter(|_| rand::random_bool(share)).collect();
        self.check(&wanted, &drawn).await;
        let trusted = self.trust().give(&wanted, &drawn, principal, Instant::now());
        if let Some(why) = self.failure().filter(|_| trusted.iter().all(|given| *given == Given::Withheld)) {
            return Err(why);
        }
        let mut trusted = trusted.into_iter();
        let reads = objects.iter().zip(given).filter(|(_, given)| **given != Given::Withheld);
        for (_, given) in reads.filter(|(object, _)| object.sha256.is_none()) {
            *given = trusted.next().unwrap_or(Given::Withheld);
        }
        Ok(())
    }

    /// Whoever has given a wrong answer may have stored a wrong entry.
    fn distrust_quarantined(&self) {
        let mut quarantined = self.cluster.quarantined();
        quarantined.retain(|principal| !self.trust().is_distrusted(*principal));
        let readers = self.trust().distrust(&quarantined);
        readers.into_iter().for_each(|reader| self.suspect(reader));
    }

    /// Checks as many of these entries as it takes to know whom to trust, as far as there is time.
    async fn check(self: &Arc<Self>, keys: &[Digest], drawn: &HashSet<Digest>) {
        // Whoever asks must not choose which ones are looked at.
        let mut keys: Vec<Digest> = keys.iter().copied().collect::<HashSet<_>>().into_iter().collect();
        keys.shuffle(&mut rand::rng());
        let deadline = tokio::time::Instant::now() + self.patience.1;
        let mut left = MOST_CHECKS;
        loop {
            let checks = self.trust().choose(&keys, drawn, left, Instant::now());
            if checks.is_empty() || self.failure().is_some() {
                return;
            }
            left -= checks.len();
            let chosen: HashSet<Digest> = checks.iter().map(|check| check.key).collect();
            keys.retain(|key| !chosen.contains(key));
            let looks = futures_util::future::join_all(checks.into_iter().map(|check| self.look(check)));
            if tokio::time::timeout_at(deadline, looks).await.is_err() {
                return;
            }
        }
    }

    /// Looks at an entry, or waits for whoever does.
    fn look(self: &Arc<Self>, check: Check) -> Look {
        let mut looks = lock(&self.looks);
        if let Some(look) = looks.get(&check.key) {
            return look.clone();
        }
        let this = Arc::clone(self);
        let task = tokio::spawn(async move {
            if let Ok(_place) = this.at_once.acquire().await
                && this.failure().is_none()
            {
                this.look_at(check).await;
            }
            lock(&this.looks).remove(&check.key);
        });
        let look = task.map(drop).boxed().shared();
        looks.insert(check.key, look.clone());
        look
    }

    /// Checks one, and notes what was found.
    async fn look_at(&self, check: Check) {
        let finding = match self.find(check.key).await {
            Ok(finding) => finding,
            Err(why) => {
                *lock(&self.failed) = Some((Instant::now(), why));
                return;
            }
        };
        let conviction = self.trust().note(check, finding, Instant::now());
        self.draw_consequences(check.key, conviction);
    }

    /// What is there under the name of an entry.
    ///
    /// # Errors
    /// If the bucket does not say so in time.
    async fn find(&self, key: Digest) -> Result<Finding, String> {
        let Some(size) = self.in_time(self.objects.size(key)).await? else { return Ok(Finding::Nothing) };
        let (prepared, cluster) = (Arc::clone(&self.prepared), Arc::clone(&self.cluster));
        let prepare = move || prepared.prepare(key, &cluster.blobs);
        let expected = tokio::task::spawn_blocking(prepare).await.map_err(|error| error.to_string())?;
        let expected = match expected {
            Ok(expected) => expected,
            Err(why) => {
                if let Some(count) = count(&self.unknown) {
                    tracing::warn!(
                        "bucket: prepared cloud {key} cannot be checked and is not used, got {why}; {count} so far"
                    );
                }
                return Ok(Finding::Nothing);
            }
        };
        let most = expected.len() as u64 + HEADER_BYTES;
        if size > most {
            return Ok(self.of_large(key, size, expected).await);
        }
        let Some(bytes) = self.in_time(self.objects.read(key, most)).await? else {
            return Ok(Finding::Nothing);
        };
        let prepared = Arc::clone(&self.prepared);
        let compare = move || compared(&prepared, key, &bytes, &expected);
        tokio::task::spawn_blocking(compare).await.map_err(|error| error.to_string())
    }

    /// What an entry is that has more bytes than it should: whoever has signed for these bytes is wrong, whatever was added to
    /// them. Another may have taken its place until it is read.
    async fn of_large(&self, key: Digest, size: u64, expected: Vec<u8>) -> Finding {
        let Ok(_alone) = self.large.acquire().await else { return Finding::Nothing }; // it is never closed
        if size > MAX_OBJECT_BYTES {
            return Finding::TooLarge;
        }
        let read = self.objects.read(key, MAX_OBJECT_BYTES);
        let Ok(Ok(Some(bytes))) = tokio::time::timeout(PATIENCE_FOR_LARGE, read).await else {
            return Finding::TooLarge;
        };
        let prepared = Arc::clone(&self.prepared);
        let compare = move || compared(&prepared, key, &bytes, &expected);
        tokio::task::spawn_blocking(compare).await.unwrap_or(Finding::TooLarge)
    }

    async fn in_time<T>(&self, answer: BoxFuture<'_, Result<T, String>>) -> Result<T, String> {
        let (patience, _) = self.patience;
        let late = |_| Err(format!("the coordinator has waited {patience:?} for an entry to check"));
        tokio::time::timeout(patience, answer).await.unwrap_or_else(late)
    }

    /// Quarantines whoever is wrong, and audits whoever may have gone on with it.
    fn draw_consequences(&self, key: Digest, Conviction { wrong, is_earlier, readers }: Conviction) {
        let told = if is_earlier || !wrong.is_empty() { count(&self.wrong) } else { None };
        if let Some(count) = told {
            let who =
                wrong.iter().map(|principal| format!("{principal}, which has stored it, is quarantined"));
            let who = who.reduce(|all, one| format!("{all}; {one}")).unwrap_or_else(|| {
                "no worker has stored it since this start: of what was there before, only entries that the coordinator has checked are used from now on\nempty the bucket (coordinator prune URL --days 0), and verify the runs that have used it".to_owned()
            });
            tracing::warn!(
                "bucket: prepared cloud {key} is not what its source gives, the {count}. so far: {who}"
            );
        }
        for principal in wrong {
            self.cluster.quarantine(principal);
        }
        readers.into_iter().for_each(|reader| self.suspect(reader));
    }

    fn suspect(&self, reader: Principal) {
        tracing::warn!(
            "bucket: {reader} may have computed with wrong clouds: its next answers are audited\nstart its workers again, with an empty cache"
        );
        self.cluster.suspect(reader);
    }

    /// Why nothing is asked of the bucket now, if that is so.
    fn failure(&self) -> Option<String> {
        let failed = lock(&self.failed);
        failed.as_ref().filter(|(since, _)| since.elapsed() < PAUSE).map(|(_, why)| why.clone())
    }

    fn trust(&self) -> MutexGuard<'_, EntryTrust> {
        lock(&self.trust)
    }
}

/// Counts one more, and returns how many there are if that is to be said: of many, 1, 2, 4, …
fn count(counter: &AtomicU64) -> Option<u64> {
    let count = counter.fetch_add(1, Ordering::Relaxed) + 1;
    count.is_power_of_two().then_some(count)
}

/// Compares an entry with the payload that its source gives.
fn compared(prepared: &PreparedClouds, key: Digest, bytes: &[u8], expected: &[u8]) -> Finding {
    let sha256 = sha256_of(bytes);
    match prepared.payload(key, bytes) {
        Err(_) => Finding::Damaged(sha256),
        Ok(payload) if payload == expected => Finding::Right(sha256),
        Ok(_) => Finding::Wrong(sha256),
    }
}

fn sha256_of(bytes: &[u8]) -> Sha256 {
    let mut sha256 = [0; 32];
    sha256.copy_from_slice(digest::digest(&digest::SHA256, bytes).as_ref());
    sha256
}

#[cfg(test)]
mod tests;
