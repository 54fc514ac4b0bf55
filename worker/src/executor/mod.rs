//! The executor: computes tasks, one at a time, on a pool of threads. What does not depend on the genes that changed is
//! not computed again.

mod cloud_loader;
mod computing;
mod error;
pub(crate) mod manifest;
mod matching;
mod preparation_cache;
mod reuse;
mod task;
mod work;

use std::sync::{Arc, Mutex, PoisonError};

use cache::{ByteSize, Lru, Store};
use descriptor::grid::Cell;
use descriptor::recognise::recognise_from;
use descriptor::{ChannelError, Correct, Family};
use proto::Digest;

pub use error::EvaluationError;
pub use task::{Description, Evaluation, GridCell, Outcome, Preparation, Recognition, Splits, Task, Tile};
pub use work::Work;

use crate::blobs::Blobs;
use cloud_loader::CloudLoader;
use computing::Computing;
use manifest::{Manifest, labels};
use matching::{Matcher, Source};
use preparation_cache::PreparationCache;

/// Memory for split manifests, which are small and wanted by every job, bytes.
const MANIFESTS: usize = 8 << 20;

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
    pub fn name_run(&self, run: String) {
        self.store.name_run(run);
    }

    /// Fetches what is missing and computes.
    pub async fn carry_out(self: Arc<Self>, task: Task) -> Result<Outcome, EvaluationError> {
        let outcome = match task {
            Task::Evaluation(evaluation) => self.evaluate(&evaluation).await.map(Outcome::Evaluation),
            Task::GridCell(cell) => self.count_cell(&cell).await.map(Outcome::GridCell),
            Task::Description(Description { preparation, descriptor, manifest }) => {
                let cache = self.preparation_cache(&preparation)?;
                let manifest = self.manifest(manifest).await?;
                self.matcher.describe(&cache, &descriptor, &manifest).await.map(Outcome::Description)
            }
            Task::Tile(tile) => {
                let Tile { evaluation, descriptions } = &tile;
                self.match_tile(evaluation, descriptions).await.map(Outcome::Evaluation)
            }
        };
        tracing::debug!("work so far: {:?}", self.work());
        outcome
    }

    async fn evaluate(&self, evaluation: &Evaluation) -> Result<Recognition, EvaluationError> {
        let query = self.manifests(&evaluation.splits.query).await?.into_iter().map(Source::split).collect();
        let database = self.manifests(&evaluation.splits.database).await?;
        self.recognise(evaluation, query, database.into_iter().map(Source::split).collect()).await
    }

    async fn match_tile(
        &self,
        evaluation: &Evaluation,
        descriptions: &Splits,
    ) -> Result<Recognition, EvaluationError> {
        let query = self.manifests(&evaluation.splits.query).await?;
        let database = self.manifests(&evaluation.splits.database).await?;
        let query = query.into_iter().zip(&descriptions.query).map(Source::shard).collect();
        let database = database.into_iter().zip(&descriptions.database).map(Source::shard).collect();
        self.recognise(evaluation, query, database).await
    }

    async fn recognise(
        &self,
        evaluation: &Evaluation,
        query: Vec<Source>,
        database: Vec<Source>,
    ) -> Result<Recognition, EvaluationError> {
        let cache = self.preparation_cache(&evaluation.preparation)?;
        let distances = self.matcher.distances(&cache, &evaluation.descriptor, &query, &database).await?;
        let [queries, database] = [query, database]
            .map(|sources| labels(&sources.into_iter().map(|source| source.manifest).collect::<Vec<_>>()));
        let want_matches = evaluation.want_matches;
        let recognise = move || {
            let matches = recognise_from(queries.len(), &distances, &database)?;
            let correct = Correct::count(&matches, &queries, &database);
            Ok(Recognition { correct, matches: if want_matches { matches } else { Vec::new() } })
        };
        self.matcher.loader.computing.run(recognise).await
    }

    async fn count_cell(&self, task: &GridCell) -> Result<Vec<u32>, EvaluationError> {
        let cache = self.preparation_cache(&task.preparation)?;
        let (channel, prepared) = (Family::DiskRing, cache.preparer.family());
        let quantiser = cache.preparer.quantiser().ok_or(ChannelError::Family { channel, prepared })?;
        let cell = Cell::new(quantiser, task.disk_um, task.ring_um).map_err(ChannelError::from)?;
        let cell = Arc::new(cell);
        let query = self.manifests(&task.splits.query).await?;
        let database = self.manifests(&task.splits.database).await?;
        let queries = self.matcher.cell_signatures(&cache, &cell, &query).await?;
        let entries = self.matcher.cell_signatures(&cache, &cell, &database).await?;
        self.matcher.loader.work().cells += 1;
        let labels = [labels(&query), labels(&database)];
        let count = move || cell.object_correct(&queries, &labels[0], &entries, &labels[1]);
        Ok(self.matcher.loader.computing.run(count).await?)
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

#[cfg(test)]
mod tests;
