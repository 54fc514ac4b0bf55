//! The executor: computes tasks, one at a time, on a pool of threads. What does not depend on the genes that changed is
//! not computed again.

mod cloud_check;
mod cloud_loader;
mod computing;
pub(crate) mod decoded;
mod error;
mod grid_cells;
mod kept_disks;
pub(crate) mod manifest;
mod matching;
mod preparation_cache;
mod reuse;
mod rule;
mod signature_files;
mod source;
mod work;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use cache::{ByteSize, Lru, Store};
use descriptor::fitness::nearest_of_class;
use descriptor::recognise::recognise_from;
use descriptor::structure::scale;
use descriptor::{ChannelError, Correct, Descriptor, Match, Preparation};
use proto::Digest;
use proto::task::{Described, DescribedSplit, Evaluation, EvaluationResult, Scale, Task, TaskResult, Tile};

use tracing::{Instrument as _, debug_span};

pub use error::EvaluationError;
pub use work::Work;

use crate::blobs::Blobs;
use cloud_loader::CloudLoader;
use computing::Computing;
use decoded::{Decoded, InvalidTask, Subject};
use manifest::{Manifest, labels};
use matching::Matcher;
use preparation_cache::PreparationCache;
use source::Source;

/// Memory for split manifests, which are small and wanted by every job, bytes.
const MANIFESTS: usize = 8 << 20;
/// At its end, a worker waits so long for what is on its way to the disk.
const SETTLING: Duration = Duration::from_secs(10);

/// Carries out tasks, one at a time, each on all threads of its pool.
pub struct Executor {
    matcher: Matcher,
    store: Arc<Store>,
    memory: ByteSize,
    manifests: Mutex<Lru<Digest, Arc<Manifest>>>,
    preparation: Mutex<Option<Arc<PreparationCache>>>,
}

impl Executor {
    /// An executor with `threads` threads that gets its data from `store` and `blobs`, and keeps up to `memory` of it.
    ///
    /// # Errors
    /// If the threads cannot be started.
    pub fn new(
        threads: usize,
        memory: ByteSize,
        blobs: Blobs,
        store: Arc<Store>,
    ) -> Result<Self, rayon::ThreadPoolBuildError> {
        let computing = Computing::new(threads)?;
        Ok(Self {
            matcher: Matcher::new(CloudLoader::new(blobs, Arc::clone(&store), computing), memory),
            store,
            memory,
            manifests: Mutex::new(Lru::new(MANIFESTS)),
            preparation: Mutex::new(None),
        })
    }

    /// What was done so far.
    pub fn work(&self) -> Work {
        *self.matcher.loader.work()
    }

    /// From here on, what is kept on disk is noted as made for this run.
    pub async fn name_run(&self, run: String) {
        self.matcher.files.settle().await;
        self.store.name_run(run);
    }

    /// Waits until everything that is to be kept on disk and in the bucket is there, and not for ever: a disk may hang, and
    /// nothing of it has to be kept.
    pub async fn settle(&self) {
        let _ = tokio::time::timeout(SETTLING, self.matcher.files.settle()).await;
        self.matcher.loader.blobs.bucket.settle().await;
    }

    /// From here on, the bucket that machines share is used or not.
    pub fn offer_bucket(&self, has_bucket: bool) {
        self.matcher.loader.blobs.bucket.offer(has_bucket);
    }

    /// From here on, this share of the clouds that others have prepared is prepared again.
    pub fn set_audit(&self, share: f64) {
        self.matcher.loader.set_audit(share);
    }

    /// Refuses to go on once a cloud that others have prepared was found to be wrong.
    fn check_trust(&self) -> Result<(), EvaluationError> {
        self.store.distrusted().map_or(Ok(()), |what| Err(EvaluationError::Distrusted(what.to_owned())))
    }

    /// Fetches what is missing and computes.
    pub async fn carry_out(self: Arc<Self>, task: Task) -> Result<TaskResult, EvaluationError> {
        self.check_trust()?;
        let Decoded { preparation, subject } = Decoded::new(&task)?;
        let cache = self.preparation_cache(&preparation)?;
        let result = match (&task, &subject) {
            (Task::Evaluation(evaluation), Subject::Descriptor(descriptor)) => {
                self.evaluate(&cache, descriptor, evaluation).await.map(TaskResult::Evaluation)
            }
            (Task::Tile(tile), Subject::Descriptor(descriptor)) => {
                self.match_tile(&cache, descriptor, tile).await.map(TaskResult::Evaluation)
            }
            (Task::GridCell(cell), Subject::Cell(radii_um)) => {
                self.count_cell(&cache, *radii_um, cell).await.map(TaskResult::GridCell)
            }
            (Task::Description(shard), Subject::Descriptor(descriptor)) => {
                let manifest = self.manifest(shard.manifest).await?;
                let bytes = self.matcher.describe(&cache, descriptor, &manifest).await?;
                let described = Described::made(bytes);
                self.matcher.loader.blobs.share(&described);
                Ok(TaskResult::Description(described))
            }
            (Task::Scale(scale), Subject::Descriptor(descriptor)) => {
                self.scale(&cache, descriptor, scale).await.map(TaskResult::Scale)
            }
            _ => return Err(InvalidTask::Subject.into()),
        };
        tracing::debug!("work so far: {:?}", self.work());
        self.check_trust()?; // another worker of this process may have found it meanwhile
        result
    }

    async fn evaluate(
        &self,
        cache: &Arc<PreparationCache>,
        descriptor: &Descriptor,
        evaluation: &Evaluation,
    ) -> Result<EvaluationResult, EvaluationError> {
        let channels = descriptor.channels().len();
        let query = self.sources(&evaluation.query, &evaluation.described, channels).await?;
        let database = self.sources(&evaluation.database, &evaluation.described, channels).await?;
        self.recognise(cache, descriptor, [query, database], evaluation).await
    }

    async fn match_tile(
        &self,
        cache: &Arc<PreparationCache>,
        descriptor: &Descriptor,
        Tile { evaluation, query_descriptions, database_descriptions }: &Tile,
    ) -> Result<EvaluationResult, EvaluationError> {
        let query = self.manifests(&evaluation.query).await?;
        let database = self.manifests(&evaluation.database).await?;
        let query = query.into_iter().zip(query_descriptions).map(Source::shard).collect();
        let database = database.into_iter().zip(database_descriptions).map(Source::shard).collect();
        self.recognise(cache, descriptor, [query, database], evaluation).await
    }

    async fn recognise(
        &self,
        cache: &Arc<PreparationCache>,
        descriptor: &Descriptor,
        [query, database]: [Vec<Source>; 2],
        &Evaluation { want_matches, rule, ref scales, .. }: &Evaluation,
    ) -> Result<EvaluationResult, EvaluationError> {
        let manifests = |sources: &[Source]| -> Vec<Arc<Manifest>> {
            sources.iter().map(|source| Arc::clone(&source.manifest)).collect()
        };
        let sides = [manifests(&query), manifests(&database)];
        let members =
            (!rule.is_default()).then(|| rule::members(&rule, [&sides[0], &sides[1]])).transpose()?;
        let clouds = sides.each_ref().map(|manifests| manifests.iter().map(|one| one.clouds.len()).sum());
        if members.is_none() && !self.matcher.has_room(descriptor, clouds) {
            let [queries, known] = sides.map(|manifests| labels(&manifests));
            let wanted = (known.clone(), want_matches);
            let matches =
                self.matcher.recognise(cache, descriptor, [&query, &database], scales, wanted).await?;
            let correct = Correct::count(&matches, &queries, &known);
            return Ok(result(&correct, if want_matches { &matches } else { &[] }));
        }
        let mut distances = self.matcher.distances(cache, descriptor, &query, &database).await?;
        for ((_, weight), scale) in distances.iter_mut().zip(scales) {
            *weight /= scale;
        }
        let recognise = move || {
            if let Some([queries, database]) = members {
                let found = nearest_of_class(&queries, &distances, &database)?;
                return Ok(rule::result(&rule, [&sides[0], &sides[1]], &found, want_matches));
            }
            let [queries, database] = sides.map(|manifests| labels(&manifests));
            let matches = recognise_from(queries.len(), &distances, &database)?;
            let correct = Correct::count(&matches, &queries, &database);
            Ok(result(&correct, if want_matches { &matches } else { &[] }))
        };
        self.matcher.loader.computing.run(recognise).instrument(debug_span!("match")).await
    }

    /// The distances stay where an evaluation of all these clouds against each other looks for them.
    async fn scale(
        &self,
        cache: &Arc<PreparationCache>,
        descriptor: &Descriptor,
        task: &Scale,
    ) -> Result<f64, EvaluationError> {
        let clouds = self.sources(&task.splits, &task.described, 1).await?;
        let mut channels = self.matcher.distances(cache, descriptor, &clouds, &clouds).await?;
        let Some((distances, _)) = channels.pop().filter(|_| channels.is_empty()) else {
            return Err(InvalidTask::Channels { channels: descriptor.channels().len() }.into());
        };
        Ok(self.matcher.loader.computing.run(move || scale(&distances)).await)
    }

    /// The cache for a preparation. Of those that keep clouds only the last one stays: a run has one, and memory is for
    /// its clouds.
    fn preparation_cache(&self, preparation: &Preparation) -> Result<Arc<PreparationCache>, ChannelError> {
        let mut current = self.preparation.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(cache) = current.as_ref().filter(|cache| cache.preparation() == preparation) {
            return Ok(Arc::clone(cache));
        }
        let cache = Arc::new(PreparationCache::new(preparation, self.memory)?);
        if cache.preparer.is_kept() {
            *current = Some(Arc::clone(&cache));
        }
        Ok(cache)
    }

    /// Splits, of which some are described already in some of so many channels.
    async fn sources(
        &self,
        splits: &[Digest],
        described: &[DescribedSplit],
        channels: usize,
    ) -> Result<Vec<Source>, EvaluationError> {
        let mut sources = Vec::new();
        for manifest in self.manifests(splits).await? {
            let split = manifest.digest;
            let mut source = Source::split(manifest, channels);
            for described in described.iter().filter(|described| described.split == split) {
                let shards: Vec<Digest> = described.shards.iter().map(|shard| shard.manifest).collect();
                source.join(described, self.manifests(&shards).await?)?;
            }
            sources.push(source);
        }
        Ok(sources)
    }

    async fn manifests(&self, digests: &[Digest]) -> Result<Vec<Arc<Manifest>>, EvaluationError> {
        let mut manifests = Vec::new();
        for &digest in digests {
            manifests.push(self.manifest(digest).await?);
        }
        Ok(manifests)
    }

    async fn manifest(&self, digest: Digest) -> Result<Arc<Manifest>, EvaluationError> {
        let known = || self.manifests.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = known().get(&digest);
        if let Some(manifest) = kept {
            return Ok(manifest);
        }
        let bytes = self.matcher.loader.blobs.get(digest).await?;
        let manifest = Arc::new(Manifest::decode(digest, &bytes)?);
        known().insert(digest, Arc::clone(&manifest), manifest.bytes());
        Ok(manifest)
    }
}

fn result(correct: &Correct, matches: &[Match]) -> EvaluationResult {
    let found = |found: &Match| proto::task::Match {
        nearest: found.nearest.index,
        distance: found.nearest.distance,
        runner_up: found.runner_up.map(|hit| (hit.index, hit.distance)),
    };
    EvaluationResult {
        queries: correct.queries as u32,
        object_correct: correct.object as u32,
        category_correct: correct.category as u32,
        matches: matches.iter().map(found).collect(),
        ..EvaluationResult::default()
    }
}

#[cfg(test)]
mod tests;
