//! Where prepared clouds come from: memory, this machine's disk, the shared folder, the coordinator, or their source.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use cache::{Claim, Store};
use descriptor::{PreparedCloud, pcd};
use proto::Digest;
use rayon::iter::Either;
use rayon::prelude::*;

use crate::blobs::Blobs;
use crate::prepared_cloud::PREPARED_CLOUD;
use crate::workshop::manifest::{Listed, Manifest};
use crate::workshop::shelf::Shelf;
use crate::workshop::work::Work;
use crate::workshop::{Computing, EvaluationError};

type Brought = Vec<(Digest, Arc<PreparedCloud>)>;

/// Supplies clouds to evaluations, batch by batch.
pub struct Supply {
    /// Blobs of the coordinator.
    pub blobs: Blobs,
    store: Arc<Store>,
    computing: Computing,
    work: Mutex<Work>,
}

impl Supply {
    /// Clouds from `store` and `blobs`, prepared by `computing`.
    pub fn new(blobs: Blobs, store: Arc<Store>, computing: Computing) -> Self {
        Self { blobs, store, computing, work: Mutex::default() }
    }

    /// What was done so far.
    pub fn work(&self) -> MutexGuard<'_, Work> {
        self.work.lock().unwrap_or_else(PoisonError::into_inner) // counts are never half-changed
    }

    /// Calls `each` with all clouds of a split, in order, as many at a time as memory allows.
    pub async fn stream<T: Send + 'static>(
        &self,
        shelf: &Arc<Shelf>,
        manifest: &Manifest,
        each: impl Fn(&[Arc<PreparedCloud>]) -> T + Clone + Send + 'static,
    ) -> Result<Vec<T>, EvaluationError> {
        let mut done = Vec::new();
        let mut rest = &manifest.clouds[..];
        while !rest.is_empty() {
            let count = shelf.clouds().batch(rest);
            let (batch, later) = rest.split_at(count);
            let clouds = self.take(shelf, batch).await?;
            let each = each.clone();
            done.push(self.computing.run(move || each(&clouds)).await);
            rest = later;
        }
        Ok(done)
    }

    /// The prepared clouds of a list, in its order.
    async fn take(
        &self,
        shelf: &Arc<Shelf>,
        listed: &[Listed],
    ) -> Result<Vec<Arc<PreparedCloud>>, EvaluationError> {
        let mut found: HashMap<Digest, Arc<PreparedCloud>> = {
            let clouds = shelf.clouds();
            listed.iter().filter_map(|cloud| Some((cloud.digest, clouds.get(cloud.digest)?))).collect()
        };
        let absent = listed.iter().filter(|cloud| !found.contains_key(&cloud.digest));
        let mut missing: BTreeMap<Digest, &Listed> = absent.map(|cloud| (cloud.digest, cloud)).collect();
        while let Some(&first) = missing.keys().next() {
            let claim = |cloud: &&Listed| {
                let claim = self.store.claim(shelf.entry_key(cloud.digest))?;
                Some(((*cloud).clone(), claim))
            };
            let (ours, claims): (Vec<Listed>, Vec<Claim<'_>>) = missing.values().filter_map(claim).unzip();
            if ours.is_empty() {
                // Other workers of this process are making all of them; what they could not keep is made here.
                self.store.wait(shelf.entry_key(first)).await;
                continue;
            }
            found.extend(self.bring(shelf, ours).await?);
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
    async fn bring(&self, shelf: &Arc<Shelf>, wanted: Vec<Listed>) -> Result<Brought, EvaluationError> {
        let fetched_before = self.blobs.fetched();
        let (loaded, wanted) = self.load(shelf, wanted).await;
        let (fetched, wanted) = self.fetch(shelf, wanted).await;
        let prepared = self.prepare(shelf, wanted).await?;
        let counts = [loaded.len(), fetched.len(), prepared.len()].map(|count| count as u64);
        {
            let mut work = self.work();
            work.loaded += counts[0];
            work.fetched += counts[1];
            work.prepared += counts[2];
        }
        let brought: Brought = loaded.into_iter().chain(fetched).chain(prepared).collect();
        let mut clouds = shelf.clouds();
        let unseen = brought.iter().filter(|(digest, cloud)| clouds.admit(*digest, cloud)).count();
        if unseen > 0 {
            let fetched = self.blobs.fetched() - fetched_before;
            let [loaded, _, prepared] = counts;
            tracing::info!(
                "prepared {prepared} and loaded {loaded} of {} clouds, {fetched} of them fetched",
                brought.len()
            );
        }
        Ok(brought)
    }

    /// From this machine's disk or the shared folder; the second list is what neither has.
    async fn load(&self, shelf: &Arc<Shelf>, wanted: Vec<Listed>) -> (Brought, Vec<Listed>) {
        if !self.store.is_kept() {
            return (Brought::new(), wanted);
        }
        let (store, shelf) = (Arc::clone(&self.store), Arc::clone(shelf));
        let load = move |cloud: Listed| {
            let payload = store.get(PREPARED_CLOUD, shelf.entry_key(cloud.digest));
            sort(&shelf, cloud, payload)
        };
        self.computing.run(move || wanted.into_par_iter().partition_map(load)).await
    }

    /// From the coordinator's own store; the second list is what it does not have.
    async fn fetch(&self, shelf: &Arc<Shelf>, wanted: Vec<Listed>) -> (Brought, Vec<Listed>) {
        let ask = async |cloud: Listed| {
            let entry = self.blobs.derived(PREPARED_CLOUD, shelf.entry_key(cloud.digest)).await;
            (cloud, entry)
        };
        let answers = futures_util::future::join_all(wanted.into_iter().map(ask)).await;
        let (store, shelf) = (Arc::clone(&self.store), Arc::clone(shelf));
        let adopt = move |(cloud, entry): (Listed, Option<Vec<u8>>)| {
            let key = shelf.entry_key(cloud.digest);
            let payload = entry.and_then(|bytes| match store.adopt(PREPARED_CLOUD, key, &bytes) {
                Ok(payload) => Some(payload),
                Err(damage) => {
                    tracing::warn!("{}: the coordinator's entry {damage}, preparing it here", cloud.path);
                    None
                }
            });
            sort(&shelf, cloud, payload)
        };
        self.computing.run(move || answers.into_par_iter().partition_map(adopt)).await
    }

    /// From the source files.
    async fn prepare(&self, shelf: &Arc<Shelf>, wanted: Vec<Listed>) -> Result<Brought, EvaluationError> {
        let bytes = wanted.iter().map(|cloud| self.blobs.get(cloud.digest));
        let bytes = futures_util::future::try_join_all(bytes).await?;
        let (store, shelf) = (Arc::clone(&self.store), Arc::clone(shelf));
        let prepare = move |(cloud, bytes): (Listed, Vec<u8>)| {
            let prepared = prepared(&shelf, &cloud, &bytes)?;
            if store.is_kept() {
                store.put(PREPARED_CLOUD, shelf.entry_key(cloud.digest), &prepared.encode());
            }
            Ok((cloud.digest, Arc::new(prepared)))
        };
        self.computing.run(move || wanted.into_par_iter().zip(bytes).map(prepare).collect()).await
    }
}

/// A cloud with the payload of its entry, or the cloud as it was if there is none of use.
fn sort(
    shelf: &Shelf,
    cloud: Listed,
    payload: Option<Vec<u8>>,
) -> Either<(Digest, Arc<PreparedCloud>), Listed> {
    match payload.map(|payload| PreparedCloud::decode(&payload, &shelf.quantiser)) {
        Some(Ok(prepared)) => Either::Left((cloud.digest, Arc::new(prepared))),
        Some(Err(error)) => {
            let error = error.to_string(); // whose second line, what to do, is what is done here
            let what = error.lines().next().unwrap_or_default();
            tracing::warn!("{}: kept entry is of no use, got {what}; preparing it again", cloud.path);
            Either::Right(cloud)
        }
        None => Either::Right(cloud),
    }
}

fn prepared(shelf: &Shelf, cloud: &Listed, bytes: &[u8]) -> Result<PreparedCloud, EvaluationError> {
    let failed = |what: String| EvaluationError::Cloud { path: cloud.path.clone(), what };
    let source = pcd::read(bytes).map_err(|error| failed(error.to_string()))?;
    let prepared = PreparedCloud::new(&source, &shelf.preparation().preprocess, &shelf.quantiser);
    prepared.map_err(|error| failed(error.to_string()))
}
