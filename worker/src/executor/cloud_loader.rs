//! Where prepared clouds come from: memory, this machine's disk, the shared folder, the bucket, the coordinator, or their
//! source.

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use cache::{Claim, MAX_ENTRY_BYTES, Store};
use descriptor::PreparedCloud;
use proto::{Digest, Message};
use rayon::iter::Either;
use rayon::prelude::*;
use tracing::{Instrument as _, debug_span};

use crate::blobs::Blobs;
use crate::bucket::Wanted;
use crate::executor::cloud_check;
use crate::executor::computing::Computing;
use crate::executor::error::EvaluationError;
use crate::executor::manifest::{Listed, Manifest};
use crate::executor::preparation_cache::PreparationCache;
use crate::executor::work::Work;
use crate::prepared_cloud::PREPARED_CLOUD;

type Prepared = (Digest, Arc<PreparedCloud>);
type Loaded = Vec<Prepared>;
/// A cloud, and the key of its entry.
type Keyed = (Listed, Digest);

/// Loads prepared clouds for tasks, batch by batch.
pub struct CloudLoader {
    /// Blobs of the coordinator.
    pub blobs: Blobs,
    /// The threads that prepare, and compute whatever else is to be computed.
    pub computing: Computing,
    pub(super) store: Arc<Store>,
    /// The share of the clouds prepared by others that is prepared again ([`cloud_check::check`]): the bits of a float.
    audit: AtomicU64,
    work: Mutex<Work>,
}

impl CloudLoader {
    /// Clouds from `store` and `blobs`, prepared by `computing`.
    pub fn new(blobs: Blobs, store: Arc<Store>, computing: Computing) -> Self {
        Self { blobs, store, computing, audit: AtomicU64::new(0), work: Mutex::default() }
    }

    /// From here on, this share of the clouds that others have prepared is prepared again, from 0 to 1.
    pub fn set_audit(&self, share: f64) {
        self.audit.store(share.to_bits(), Ordering::Relaxed);
    }

    /// What was done so far.
    pub fn work(&self) -> MutexGuard<'_, Work> {
        self.work.lock().unwrap_or_else(PoisonError::into_inner) // counts are never half-changed
    }

    /// Calls `each` with all clouds of a split, in order, as many at a time as memory allows.
    pub async fn stream<T: Send + 'static>(
        &self,
        cache: &Arc<PreparationCache>,
        manifest: &Manifest,
        each: impl Fn(&[Arc<PreparedCloud>]) -> T + Clone + Send + 'static,
    ) -> Result<Vec<T>, EvaluationError> {
        let mut done = Vec::new();
        let mut rest = &manifest.clouds[..];
        while !rest.is_empty() {
            let count = cache.clouds().batch(rest);
            let (batch, later) = rest.split_at(count);
            let clouds = self.take(cache, batch).await?;
            let each = each.clone();
            let described = self.computing.run(move || each(&clouds));
            done.push(described.instrument(debug_span!("describe", descry.clouds = count as i64)).await);
            rest = later;
        }
        Ok(done)
    }

    /// The prepared clouds of a list, in its order.
    async fn take(
        &self,
        cache: &Arc<PreparationCache>,
        listed: &[Listed],
    ) -> Result<Vec<Arc<PreparedCloud>>, EvaluationError> {
        let mut found: HashMap<Digest, Arc<PreparedCloud>> = {
            let clouds = cache.clouds();
            listed.iter().filter_map(|cloud| Some((cloud.digest, clouds.get(cloud.digest)?))).collect()
        };
        if !cache.preparer.is_kept() {
            found.extend(self.prepare(cache, listed.to_vec()).await?);
        }
        let absent = listed.iter().filter(|cloud| !found.contains_key(&cloud.digest));
        let mut missing: BTreeMap<Digest, &Listed> = absent.map(|cloud| (cloud.digest, cloud)).collect();
        while let Some(&first) = missing.keys().next() {
            let claim = |cloud: &&Listed| {
                let claim = self.store.claim(cache.entry_key(cloud.digest)?)?;
                Some(((*cloud).clone(), claim))
            };
            let (ours, claims): (Vec<Listed>, Vec<Claim<'_>>) = missing.values().filter_map(claim).unzip();
            if ours.is_empty()
                && let Some(key) = cache.entry_key(first)
            {
                // Other workers of this process are making all of them; what they could not keep is made here.
                self.store.wait(key).await;
                continue;
            }
            found.extend(self.load_or_prepare(cache, ours).await?);
            drop(claims);
            missing.retain(|digest, _| !found.contains_key(digest));
        }
        let in_order = |cloud: &Listed| {
            found.get(&cloud.digest).cloned().ok_or_else(|| EvaluationError::Cloud {
                path: cloud.path.clone(),
                what: "was not prepared".to_owned(),
            })
        };
        listed.iter().map(in_order).collect()
    }

    /// Clouds that are not in memory, from the nearest place that has them.
    async fn load_or_prepare(
        &self,
        cache: &Arc<PreparationCache>,
        wanted: Vec<Listed>,
    ) -> Result<Loaded, EvaluationError> {
        let fetched_before = self.blobs.fetched();
        let listed = wanted.clone();
        let (loaded, wanted) = self.load_from_disk(cache, wanted).await;
        let (fetched, wanted) = self.fetch(cache, wanted).await;
        let shared = loaded.iter().filter(|(_, is_local)| !is_local).map(|(one, _)| one);
        // Which ones nobody can foresee; no result depends on it.
        let share = f64::from_bits(self.audit.load(Ordering::Relaxed));
        let chosen = shared.chain(&fetched).filter(|_| rand::random_bool(share));
        let with_source = |(digest, cloud): &Prepared| {
            let listed = listed.iter().find(|listed| listed.digest == *digest)?;
            Some((listed.clone(), Arc::clone(cloud)))
        };
        let chosen = chosen.filter_map(with_source).collect();
        cloud_check::check(chosen, cache, (&self.blobs, &self.computing, &self.store)).await?;
        let loaded: Loaded = loaded.into_iter().map(|(one, _)| one).collect();
        let prepared = self.prepare(cache, wanted).await?;
        let counts = [loaded.len(), fetched.len(), prepared.len()].map(|count| count as u64);
        {
            let mut work = self.work();
            work.loaded += counts[0];
            work.fetched += counts[1];
            work.prepared += counts[2];
        }
        let all: Loaded = loaded.into_iter().chain(fetched).chain(prepared).collect();
        let mut clouds = cache.clouds();
        let unseen = all.iter().filter(|(digest, cloud)| clouds.admit(*digest, cloud)).count();
        if unseen > 0 {
            let fetched = self.blobs.fetched() - fetched_before;
            let [loaded, _, prepared] = counts;
            tracing::info!(
                "prepared {prepared} and loaded {loaded} of {} clouds, {fetched} of them fetched",
                all.len()
            );
        }
        Ok(all)
    }

    /// From this machine's disk, which is noted of each, or the shared folder; the second list is what neither has.
    async fn load_from_disk(
        &self,
        cache: &Arc<PreparationCache>,
        wanted: Vec<Listed>,
    ) -> (Vec<(Prepared, bool)>, Vec<Listed>) {
        if !self.store.is_kept() {
            return (Vec::new(), wanted);
        }
        let (store, cache) = (Arc::clone(&self.store), Arc::clone(cache));
        let load = move |cloud: Listed| {
            let key = cache.entry_key(cloud.digest);
            let found = key.and_then(|key| store.get_with_place(PREPARED_CLOUD, key));
            let (payload, is_local) = found.unzip();
            decoded(&cache, cloud, payload).map_left(|one| (one, is_local == Some(true)))
        };
        self.computing.run(move || wanted.into_par_iter().partition_map(load)).await
    }

    /// From the bucket or the coordinator's own store; the second list is what neither has. What the coordinator gives, the
    /// bucket has from then on.
    async fn fetch(&self, cache: &Arc<PreparationCache>, wanted: Vec<Listed>) -> (Loaded, Vec<Listed>) {
        let (mut keyed, mut without) = (Vec::new(), Vec::new());
        for cloud in wanted {
            match cache.entry_key(cloud.digest).filter(|_| self.store.is_kept()) {
                Some(key) => keyed.push((cloud, key)),
                None => without.push(cloud),
            }
        }
        if keyed.is_empty() {
            return (Vec::new(), without);
        }
        let span = debug_span!("fetch", descry.clouds = keyed.len() as i64);
        let bucket = &self.blobs.bucket;
        let keys: Vec<Digest> = keyed.iter().map(|(_, key)| *key).collect();
        let damage = |key: Digest, bytes: &[u8]| {
            self.store.payload(PREPARED_CLOUD, key, bytes).err().map(|damage| damage.to_string())
        };
        let wanted = Wanted { kind: PREPARED_CLOUD, keys: &keys, most: MAX_ENTRY_BYTES, damage: &damage };
        let entries = bucket.get(wanted).instrument(span.clone()).await;
        let (shared, absent) = self.adopt(cache, keyed, entries).await;

        let ask = absent.iter().map(|(_, key)| self.blobs.derived(PREPARED_CLOUD, *key));
        let entries = futures_util::future::join_all(ask).instrument(span).await;
        let (given, absent) = self.adopt(cache, absent, entries).await;
        without.extend(absent.into_iter().map(|(cloud, _)| cloud));

        let (given, entries): (Loaded, Vec<(Digest, Vec<u8>)>) = given.into_iter().unzip();
        bucket.put(PREPARED_CLOUD, entries);
        (shared.into_iter().map(|(one, _)| one).chain(given).collect(), without)
    }

    /// Keeps the entries that are sound, which are returned with their clouds; the second list are clouds without.
    async fn adopt(
        &self,
        cache: &Arc<PreparationCache>,
        wanted: Vec<Keyed>,
        entries: Vec<Option<Vec<u8>>>,
    ) -> (Vec<(Prepared, (Digest, Vec<u8>))>, Vec<Keyed>) {
        let (store, cache) = (Arc::clone(&self.store), Arc::clone(cache));
        let adopt = move |((cloud, key), entry): (Keyed, Option<Vec<u8>>)| {
            let Some(bytes) = entry else { return Either::Right((cloud, key)) };
            match store.adopt(PREPARED_CLOUD, key, &bytes) {
                Ok(payload) => decoded(&cache, cloud, Some(payload))
                    .map_left(|one| (one, (key, bytes)))
                    .map_right(|cloud| (cloud, key)),
                Err(damage) => {
                    tracing::warn!("{}: the coordinator's entry {damage}, preparing it here", cloud.path);
                    Either::Right((cloud, key))
                }
            }
        };
        self.computing.run(move || wanted.into_par_iter().zip(entries).partition_map(adopt)).await
    }

    /// From the source files.
    async fn prepare(
        &self,
        cache: &Arc<PreparationCache>,
        wanted: Vec<Listed>,
    ) -> Result<Loaded, EvaluationError> {
        if wanted.is_empty() {
            return Ok(Vec::new());
        }
        let clouds = wanted.len();
        let digests: Vec<Digest> = wanted.iter().map(|cloud| cloud.digest).collect();
        let bytes = self.blobs.get_all(&digests);
        let bytes = bytes.instrument(debug_span!("fetch", descry.clouds = clouds as i64)).await?;
        let (store, cache, has_bucket) =
            (Arc::clone(&self.store), Arc::clone(cache), self.blobs.bucket.is_offered());
        let prepare = move |(cloud, bytes): (Listed, Vec<u8>)| {
            let prepared = cache.prepare(&cloud, &bytes)?;
            let mut entry = None;
            if let Some(key) = cache.entry_key(cloud.digest).filter(|_| store.is_kept())
                && let Some(payload) = cache.preparer.encode(&prepared)
            {
                store.put(PREPARED_CLOUD, key, &payload);
                entry = has_bucket.then(|| (key, store.as_entry(PREPARED_CLOUD, key, &payload)));
            }
            Ok(((cloud.digest, Arc::new(prepared)), entry))
        };
        let prepared = self.computing.run(move || wanted.into_par_iter().zip(bytes).map(prepare).collect());
        let prepared: Result<Vec<_>, EvaluationError> =
            prepared.instrument(debug_span!("prepare", descry.clouds = clouds as i64)).await;
        let (prepared, entries): (Loaded, Vec<_>) = prepared?.into_iter().unzip();
        self.blobs.bucket.put(PREPARED_CLOUD, entries.into_iter().flatten().collect());
        Ok(prepared)
    }
}

/// A cloud with the payload of its entry, or the cloud as it was if there is none of use.
fn decoded(
    cache: &PreparationCache,
    cloud: Listed,
    payload: Option<Vec<u8>>,
) -> Either<(Digest, Arc<PreparedCloud>), Listed> {
    match payload.map(|payload| cache.preparer.decode(&payload)) {
        Some(Ok(prepared)) => Either::Left((cloud.digest, Arc::new(prepared))),
        Some(Err(error)) => {
            let what = Message::of(&error).what; // its advice is what is done here
            tracing::warn!("{}: kept entry is of no use, got {what}; preparing it again", cloud.path);
            Either::Right(cloud)
        }
        None => Either::Right(cloud),
    }
}
