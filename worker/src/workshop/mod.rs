//! Evaluations: from a job's description to its result, on a pool of threads. What does not depend on the genes that
//! changed is not computed again.

mod computing;
mod fixed;
pub(crate) mod manifest;
mod matching;
mod reuse;
mod shelf;
mod supply;
mod work;

use std::sync::{Arc, Mutex, PoisonError};

use cache::{ByteSize, Lru, Store};
use descriptor::grid::Cell;
use descriptor::recognise::{RecogniseError, recognise_from};
use descriptor::{Correct, Descriptor, GeneTable, Match, Parameters, Preprocess, QuantiseError, description};
use proto::{Digest, MAX_DESCRIPTION_BYTES};

pub use computing::Computing;
pub use work::Work;

use crate::blobs::{BlobError, Blobs};
use manifest::{Manifest, labels};
use matching::Source;
use shelf::Shelf;
use supply::Supply;

/// Memory for split manifests, which are small and wanted by every job, bytes.
const MANIFESTS: usize = 8 << 20;

/// What is computed once for all parameters of a run.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Preparation {
    /// Keypoints and normals.
    pub preprocess: Preprocess,
    /// The search space: how finely neighbours are recorded.
    pub genes: GeneTable,
}

/// What a job asks for.
#[derive(Clone, Debug)]
pub enum Task {
    /// One descriptor.
    Evaluation(Evaluation),
    /// All descriptors with one R1 and one R2.
    GridCell(GridCell),
    /// The clouds of one shard under one descriptor.
    Description(Description),
    /// One descriptor, on shards that were described before.
    Tile(Tile),
}

/// Splits to match with each other.
#[derive(Clone, Debug)]
pub struct Splits {
    /// Split manifests of the queries, in order.
    pub query: Vec<Digest>,
    /// Split manifests of the database, in order.
    pub database: Vec<Digest>,
}

/// One descriptor to be evaluated.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// How clouds are prepared.
    pub preparation: Preparation,
    /// The descriptor, one of the preparation's search space.
    pub parameters: Parameters,
    /// What is matched with what.
    pub splits: Splits,
    /// Whether each query's match is wanted, or only the counts.
    pub want_matches: bool,
}

/// One cell of the exhaustive search.
#[derive(Clone, Debug)]
pub struct GridCell {
    /// How clouds are prepared.
    pub preparation: Preparation,
    /// R1, micrometres.
    pub disk_um: u32,
    /// R2, micrometres.
    pub ring_um: u32,
    /// What is matched with what.
    pub splits: Splits,
}

/// One shard to be described.
#[derive(Clone, Debug)]
pub struct Description {
    /// How clouds are prepared.
    pub preparation: Preparation,
    /// The descriptor, of the paper's kind one of the preparation's search space.
    pub descriptor: Descriptor,
    /// The shard: a split manifest.
    pub manifest: Digest,
}

/// One tile of the matrix of distances.
#[derive(Clone, Debug)]
pub struct Tile {
    /// Of some shards.
    pub evaluation: Evaluation,
    /// For each of them the digest of its description.
    pub descriptions: Splits,
}

/// What comes of a task.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// Of an evaluation.
    Evaluation(Recognition),
    /// Of a grid cell: recognised queries (object), in the order of [`Cell::object_correct`].
    GridCell(Vec<u32>),
    /// Of a shard: the parts of its clouds, see [`description::encode`] and [`descriptor::fixed::description::encode`].
    Description(Vec<u8>),
}

/// What an evaluation gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Recognition {
    /// How many queries were recognised.
    pub correct: Correct,
    /// One a query if they were wanted.
    pub matches: Vec<Match>,
}

/// Why an evaluation has no result.
#[derive(Debug, thiserror::Error)]
pub enum EvaluationError {
    /// A blob is not to be had.
    #[error(transparent)]
    Blob(#[from] BlobError),
    /// A split manifest is no manifest.
    #[error("split manifest {digest}: {what}")]
    Manifest {
        /// Which blob.
        digest: Digest,
        /// What is wrong with it.
        what: String,
    },
    /// The search space cannot be quantised, or the parameters are not of it.
    #[error(transparent)]
    Quantise(#[from] QuantiseError),
    /// There is nothing to match with.
    #[error(transparent)]
    Recognise(#[from] RecogniseError),
    /// A shard has more clouds than one message can describe.
    #[error(
        "split manifest {digest}: its description must have at most {MAX_DESCRIPTION_BYTES} bytes, got {got}"
    )]
    TooLarge {
        /// Of the shard.
        digest: Digest,
        /// How many it would be.
        got: u64,
    },
    /// Whoever described the shard for this job was wrong, or this worker is.
    #[error("split manifest {digest}: its description must be {expected}, got {got}")]
    Description {
        /// Of the shard.
        digest: Digest,
        /// What the job names.
        expected: Digest,
        /// What the shard's clouds have here.
        got: Digest,
    },
    /// What the job names is no description of its shard.
    #[error(transparent)]
    Undecodable(#[from] description::DescriptionError),
    /// A cloud that the coordinator listed cannot be described.
    #[error("{path}: {what}")]
    Cloud {
        /// Its path in the data set.
        path: String,
        /// What is wrong with it.
        what: String,
    },
}

/// Carries out tasks, one at a time, each on all threads of its pool.
pub struct Workshop {
    computing: Computing,
    store: Arc<Store>,
    supply: Supply,
    memory: ByteSize,
    manifests: Mutex<Lru<Digest, Arc<Manifest>>>,
    shelf: Mutex<Option<Arc<Shelf>>>,
}

impl Workshop {
    /// A workshop with `threads` threads that gets its data from `store` and `blobs`, and keeps up to `memory` of it.
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
            supply: Supply::new(blobs, Arc::clone(&store), computing.clone()),
            computing,
            store,
            memory,
            manifests: Mutex::new(Lru::new(MANIFESTS)),
            shelf: Mutex::new(None),
        })
    }

    /// What was done so far.
    pub fn work(&self) -> Work {
        *self.supply.work()
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
                let described = match &descriptor {
                    Descriptor::DiskRing(parameters) => {
                        self.describe(&preparation, parameters, manifest).await
                    }
                    Descriptor::Fixed(fixed) => {
                        self.describe_fixed(&preparation.preprocess, *fixed, manifest).await
                    }
                };
                described.map(Outcome::Description)
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
        let shelf = self.shelf(&evaluation.preparation)?;
        let [shape, colour] = self.distances(&shelf, &evaluation.parameters, &query, &database).await?;
        let [queries, database] = [query, database]
            .map(|sources| labels(&sources.into_iter().map(|source| source.manifest).collect::<Vec<_>>()));
        let weight = evaluation.parameters.shape_weight();
        let want_matches = evaluation.want_matches;
        let recognise = move || {
            let matches = recognise_from(queries.len(), &shape, &colour, &database, weight)?;
            let correct = Correct::count(&matches, &queries, &database);
            Ok(Recognition { correct, matches: if want_matches { matches } else { Vec::new() } })
        };
        self.computing.run(recognise).await
    }

    async fn count_cell(&self, task: &GridCell) -> Result<Vec<u32>, EvaluationError> {
        let shelf = self.shelf(&task.preparation)?;
        let cell = Arc::new(Cell::new(&shelf.quantiser, task.disk_um, task.ring_um)?);
        let query = self.manifests(&task.splits.query).await?;
        let database = self.manifests(&task.splits.database).await?;
        let queries = self.cell_parts(&shelf, &cell, &query).await?;
        let entries = self.cell_parts(&shelf, &cell, &database).await?;
        self.supply.work().cells += 1;
        let labels = [labels(&query), labels(&database)];
        let count = move || cell.object_correct(&queries, &labels[0], &entries, &labels[1]);
        Ok(self.computing.run(count).await?)
    }

    /// The shelf for a preparation. Only the last one is kept: a run has one, and memory is for its clouds.
    fn shelf(&self, preparation: &Preparation) -> Result<Arc<Shelf>, QuantiseError> {
        let mut current = self.shelf.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(shelf) = current.as_ref().filter(|shelf| shelf.preparation() == preparation) {
            return Ok(Arc::clone(shelf));
        }
        let shelf = Arc::new(Shelf::new(preparation, self.memory)?);
        *current = Some(Arc::clone(&shelf));
        Ok(shelf)
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
        let bytes = self.supply.blobs.get(digest).await?;
        let manifest = Arc::new(Manifest::decode(digest, &bytes)?);
        known().insert(digest, Arc::clone(&manifest), manifest.bytes());
        Ok(manifest)
    }
}

#[cfg(test)]
mod tests;
