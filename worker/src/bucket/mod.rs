//! The bucket that the machines of a run share, as workers use it: by URLs that the coordinator signs, and only as long as
//! it answers soon enough.

mod breaker;
mod budget;
mod http;

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use futures_util::StreamExt as _;
use hyper::body::Bytes;
use proto::{BLOB_KIND, Digest, MAX_PRESIGNED_URLS};
use ring::digest;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tonic::Code;

use crate::wire::{Client, ObjectRequest, SignedUrl};
use breaker::{Admission, Breaker};
use budget::Budget;
use http::{Fault, Http};
pub use http::{HttpClient, http_client};

/// Objects that are read at once: enough to hide the network's delay.
const DOWNLOADS: usize = 64;
/// Objects that are asked for together at first, and how many times as many after each lot that has come in time: a slow server
/// is given up soon.
const FIRST_LOT: usize = 16;
const GROWTH: usize = 4;
const LARGEST_LOT: usize = 1024;
/// Objects that are stored at once, beside the work.
const UPLOADS: usize = 4;
/// For a signature the coordinator may take so long.
const SIGNATURE: Duration = Duration::from_secs(5);
/// Memory for what is on its way to the bucket, KiB. What finds no room is not kept there.
const UPLOAD_KIB: u32 = 64 << 10;
/// The largest object: what is larger is stored and read by nobody.
pub const MAX_OBJECT_BYTES: u64 = (UPLOAD_KIB as u64) << 10;

/// What a worker does with a bucket.
#[derive(Clone, Copy, Debug)]
pub struct Access {
    /// Whether it takes what others have stored.
    pub reads: bool,
    /// Whether it stores what it has made.
    pub writes: bool,
}

/// What is asked for together.
pub struct Wanted<'a> {
    /// Of which kind the objects are.
    pub kind: &'a str,
    /// Their names.
    pub keys: &'a [Digest],
    /// Bytes that the largest can have.
    pub most: u64,
    /// Says what is wrong with an object. It is called between requests, so that it has to be fast.
    pub damage: &'a (dyn Fn(Digest, &[u8]) -> Option<String> + Sync),
}

/// How long a worker waits for objects.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// For the one that shows whether the bucket is well, and for the next of some that are asked for together. What was
    /// waited for in vain may also be so much at once.
    pub trial: Duration,
    /// For some that are asked for together, and so much more for each.
    pub objects: (Duration, Duration),
    /// Some that come may take so long, and so much more for each as above, and nothing is lost: it takes as long or longer
    /// to get or make them elsewhere.
    pub gain: Duration,
    /// At its end, for what is on its way to the bucket.
    pub uploads: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        let second = Duration::from_secs(1);
        Self {
            trial: second,
            objects: (second / 2, Duration::from_millis(20)),
            gain: second / 10,
            uploads: 5 * second,
        }
    }
}

/// A bucket. Every fault is a miss, and a warning when it makes the worker do without for a while. Three damaged objects in a
/// row do so as well: whoever downloads them loses more than whoever does without.
#[derive(Debug)]
pub struct Bucket {
    client: Client,
    http: OnceLock<Http>,
    /// Whether the coordinator has one.
    is_offered: AtomicBool,
    access: Access,
    patience: Patience,
    reads: Mutex<Breaker>,
    writes: Mutex<Breaker>,
    /// Held while one upload is a trial: others wait for how it ends.
    upload_trial: tokio::sync::Mutex<()>,
    /// Time that reading may still cost.
    budget: Mutex<Budget>,
    /// Objects that are asked for together next.
    lot: AtomicUsize,
    /// For what is on its way to it, KiB.
    room: Arc<Semaphore>,
    /// Damaged objects so far.
    damaged: AtomicU64,
    /// Objects that were taken from it and stored in it so far, and how long tasks have waited for it, ms.
    taken: AtomicU64,
    stored: AtomicU64,
    waited_ms: AtomicU64,
}

impl Bucket {
    /// The bucket to which `client` gives URLs, once it is known that there is one.
    pub fn new(client: Client, access: Access, patience: Patience) -> Arc<Self> {
        let now = Instant::now();
        let breaker = || Mutex::new(Breaker::new(now));
        Arc::new(Self {
            client,
            http: OnceLock::new(),
            is_offered: AtomicBool::new(false),
            access,
            patience,
            reads: breaker(),
            writes: breaker(),
            upload_trial: tokio::sync::Mutex::default(),
            budget: Mutex::new(Budget::new(patience.trial, now)),
            lot: AtomicUsize::new(FIRST_LOT),
            room: Arc::new(Semaphore::new(UPLOAD_KIB as usize)),
            damaged: AtomicU64::new(0),
            taken: AtomicU64::new(0),
            stored: AtomicU64::new(0),
            waited_ms: AtomicU64::new(0),
        })
    }

    /// From here on, the coordinator has one or not.
    pub fn offer(&self, has_bucket: bool) {
        self.is_offered.store(has_bucket, Ordering::Relaxed);
    }

    /// Whether the coordinator has one.
    pub fn is_offered(&self) -> bool {
        self.is_offered.load(Ordering::Relaxed)
    }

    /// Objects as they should be; `None` for those that the bucket has not, or does not give soon enough.
    pub async fn get(&self, wanted: Wanted<'_>) -> Vec<Option<Vec<u8>>> {
        let mut found = vec![None; wanted.keys.len()];
        let begun = Instant::now();
        let mut rest = &mut found[..];
        for keys in wanted.keys.chunks(MAX_PRESIGNED_URLS) {
            let (some, later) = rest.split_at_mut(keys.len());
            if !self.access.reads || !self.is_offered() || lock(&self.reads).refuses(Instant::now()) {
                break;
            }
            let objects = keys.iter().map(|&key| ObjectRequest { key, sha256: None }).collect();
            let urls = self.presigned(&self.reads, wanted.kind, objects).await;
            self.download(urls, &Wanted { keys, ..wanted }, some).await;
            rest = later;
        }
        self.account(begun, found.iter().flatten().count());
        found
    }

    /// Notes what came since then, and does without the bucket for a while if it costs more time than it may.
    fn account(&self, begun: Instant, taken: usize) {
        let now = Instant::now();
        let waited = now - begun;
        self.taken.fetch_add(taken as u64, Ordering::Relaxed);
        self.waited_ms.fetch_add(waited.as_millis() as u64, Ordering::Relaxed);
        let gained = if taken == 0 {
            Duration::ZERO
        } else {
            self.patience.gain + self.patience.objects.1 * taken as u32
        };
        if !lock(&self.budget).pays(waited.saturating_sub(gained), now)
            && let Some(pause) = lock(&self.reads).open(now)
        {
            self.warn(&self.reads, &Fault::Costly, pause);
        }
    }

    /// The objects at `urls`, as far as they come soon enough; the first alone where nothing is known of the bucket.
    async fn download(
        &self,
        mut urls: Vec<(usize, SignedUrl)>,
        wanted: &Wanted<'_>,
        found: &mut [Option<Vec<u8>>],
    ) {
        if urls.is_empty() {
            return; // nothing that could be a trial
        }
        let now = Instant::now();
        let admission = lock(&self.reads).admit(now);
        let is_well = match admission {
            Admission::Refused => false,
            Admission::Granted => true,
            Admission::Trial => {
                let first = urls.drain(..1).collect();
                self.take(first, wanted, now + self.patience.trial, found).await
            }
        };
        let (base, each) = self.patience.objects;
        while is_well && !urls.is_empty() {
            let lot = self.lot.load(Ordering::Relaxed);
            let some: Vec<_> = urls.drain(..urls.len().min(lot)).collect();
            let is_whole = some.len() == lot;
            let deadline = Instant::now() + base + each * some.len() as u32;
            if !self.take(some, wanted, deadline, found).await {
                self.lot.store(FIRST_LOT, Ordering::Relaxed);
                return;
            }
            if is_whole {
                self.lot.store((lot * GROWTH).min(LARGEST_LOT), Ordering::Relaxed);
            }
        }
    }

    /// The objects at `urls`, as far as they come until the deadline, one soon after the other; whether the bucket is well.
    async fn take(
        &self,
        urls: Vec<(usize, SignedUrl)>,
        wanted: &Wanted<'_>,
        deadline: Instant,
        found: &mut [Option<Vec<u8>>],
    ) -> bool {
        let http = self.http();
        let ask = |(index, url): (usize, SignedUrl)| async move {
            let object = http.get(&url.url, wanted.most.min(MAX_OBJECT_BYTES)).await;
            (index, object.and_then(|object| as_wanted(object, url.sha256.as_deref(), wanted, index)))
        };
        let mut answers = futures_util::stream::iter(urls).map(ask).buffer_unordered(DOWNLOADS);
        loop {
            let next = deadline.min(Instant::now() + self.patience.trial);
            match tokio::time::timeout_at(next.into(), answers.next()).await {
                Ok(None) => return true,
                Ok(Some((index, Ok(object)))) => {
                    lock(&self.reads).succeeded();
                    found[index] = object;
                }
                Ok(Some((_, Err(fault)))) if self.gives_up(&self.reads, &fault) => return false,
                Ok(Some((_, Err(_)))) => {}
                Err(_) => {
                    if let Some(pause) = lock(&self.reads).open(Instant::now()) {
                        self.warn(&self.reads, &Fault::Late, pause);
                    }
                    return false;
                }
            }
        }
    }

    /// Keeps objects of one kind there, soon, as far as there is room for them on the way. To be called where tokio's tasks
    /// run, not on the threads that compute.
    pub fn put(self: &Arc<Self>, kind: &'static str, objects: Vec<(Digest, Vec<u8>)>) {
        if !self.access.writes || !self.is_offered() || lock(&self.writes).is_open(Instant::now()) {
            return;
        }
        let with_room = |(key, bytes): (Digest, Vec<u8>)| {
            let kib = u32::try_from(bytes.len() / 1024 + 1).ok()?;
            let room = Arc::clone(&self.room).try_acquire_many_owned(kib).ok()?;
            Some((key, Bytes::from(bytes), room))
        };
        let objects: Vec<_> = objects.into_iter().filter_map(with_room).collect();
        if !objects.is_empty() {
            let bucket = Arc::clone(self);
            tokio::spawn(async move { bucket.upload(kind, objects).await });
        }
    }

    async fn upload(&self, kind: &str, objects: Vec<(Digest, Bytes, OwnedSemaphorePermit)>) {
        let mut objects: Vec<_> = objects
            .into_iter()
            .map(|(key, bytes, room)| (key, digest::digest(&digest::SHA256, &bytes), bytes, room))
            .collect();
        let http = self.http();
        while !objects.is_empty() {
            let some: Vec<_> = objects.drain(..objects.len().min(MAX_PRESIGNED_URLS)).collect();
            let wanted = some
                .iter()
                .map(|(key, sum, ..)| ObjectRequest { key: *key, sha256: Some(sum.as_ref().to_vec()) });
            let urls = self.presigned(&self.writes, kind, wanted.collect()).await;
            let send = async |(index, SignedUrl { url, .. }): (usize, SignedUrl)| {
                let (_, sum, bytes, _) = &some[index];
                let mut trial = Some(self.upload_trial.lock().await);
                match lock(&self.writes).admit(Instant::now()) {
                    Admission::Refused => return,
                    Admission::Granted => trial = None, // others may go on beside it
                    Admission::Trial => {}
                }
                match http.put(&url, &BASE64_STANDARD.encode(sum), bytes.clone()).await {
                    Ok(()) => {
                        lock(&self.writes).succeeded();
                        self.stored.fetch_add(1, Ordering::Relaxed);
                    }
                    Err(fault) => {
                        self.gives_up(&self.writes, &fault);
                    }
                }
                drop(trial);
            };
            futures_util::stream::iter(urls).for_each_concurrent(UPLOADS, send).await;
        }
    }

    /// Waits for what is on its way, but not for ever, and says what the bucket was good for.
    pub async fn settle(&self) {
        let _ = tokio::time::timeout(self.patience.uploads, self.room.acquire_many(UPLOAD_KIB)).await;
        let counts = [&self.taken, &self.stored, &self.waited_ms];
        let [taken, stored, waited] = counts.map(|count| count.load(Ordering::Relaxed));
        if taken + stored + waited > 0 {
            let seconds = waited as f64 / 1000.0;
            tracing::info!("bucket: took {taken} objects, stored {stored}, and waited {seconds:.1} s for it");
        }
    }

    /// URLs of the objects that the coordinator gives any for, with their place in the list.
    async fn presigned(
        &self,
        breaker: &Mutex<Breaker>,
        kind: &str,
        objects: Vec<ObjectRequest>,
    ) -> Vec<(usize, SignedUrl)> {
        match self.client.presign_urls(kind, objects, SIGNATURE).await {
            Ok(urls) => urls.into_iter().enumerate().filter_map(|(index, url)| Some((index, url?))).collect(),
            Err(status) if status.code() == Code::Unimplemented => {
                self.offer(false);
                Vec::new()
            }
            Err(status) => {
                let what = proto::printable(status.message()).into_owned();
                self.gives_up(breaker, &Fault::Unsigned(what));
                Vec::new()
            }
        }
    }

    /// Notes a fault, and whether the bucket is done without now.
    fn gives_up(&self, breaker: &Mutex<Breaker>, fault: &Fault) -> bool {
        let (now, is_damaged) = (Instant::now(), matches!(fault, Fault::Damaged(_)));
        let (pause, gives_up) = {
            let mut breaker = lock(breaker);
            let pause = if is_damaged { breaker.answered_in_vain(now) } else { breaker.failed(now) };
            (pause, breaker.refuses(now))
        };
        if is_damaged {
            self.count_damaged(fault);
        }
        if let Some(pause) = pause {
            self.warn(breaker, fault, pause);
        }
        gives_up
    }

    /// Of many damaged objects, says of those at 1, 2, 4, … what is wrong.
    fn count_damaged(&self, fault: &Fault) {
        let damaged = self.damaged.fetch_add(1, Ordering::Relaxed) + 1;
        if damaged.is_power_of_two() {
            tracing::warn!("bucket: {fault}, doing without it; {damaged} objects so far");
        }
    }

    fn warn(&self, breaker: &Mutex<Breaker>, fault: &Fault, pause: Duration) {
        let done = if std::ptr::eq(breaker, &self.reads) { "read" } else { "written" };
        tracing::warn!("bucket: cannot be {done}, got {fault}; doing without it for {} s", pause.as_secs());
    }

    fn http(&self) -> &Http {
        self.http.get_or_init(Http::new)
    }
}

/// An object, if it is sound and has the content for which the coordinator vouches: another may be older than what somebody
/// was to store, or have taken its place since.
fn as_wanted(
    object: Option<Vec<u8>>,
    sha256: Option<&[u8]>,
    wanted: &Wanted<'_>,
    index: usize,
) -> Result<Option<Vec<u8>>, Fault> {
    let Some(bytes) = object else { return Ok(None) };
    let key = wanted.keys[index];
    let is_other = sha256.is_some_and(|sum| digest::digest(&digest::SHA256, &bytes).as_ref() != sum);
    let damage = if is_other {
        Some("has another content than the coordinator knows it to have".to_owned())
    } else {
        (wanted.damage)(key, &bytes)
    };
    match damage {
        Some(damage) => {
            let kind = if wanted.kind == BLOB_KIND { "blob" } else { wanted.kind };
            Err(Fault::Damaged(format!("{kind} {key} {damage}")))
        }
        None => Ok(Some(bytes)),
    }
}

fn lock<T>(state: &Mutex<T>) -> MutexGuard<'_, T> {
    state.lock().unwrap_or_else(PoisonError::into_inner) // its methods do not panic half-way
}
