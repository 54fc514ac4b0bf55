//! Evaluations: from a job's description to its result, on a pool of threads. What does not depend on the genes that
//! changed is not computed again.

mod computing;
pub(crate) mod decoded;
mod fixed;
mod lru;
pub(crate) mod manifest;
mod matching;
mod reuse;
mod shelf;
mod supply;
mod work;

use std::sync::{Arc, Mutex, PoisonError};

use descriptor::grid::Cell;
use descriptor::recognise::{RecogniseError, recognise_from};
use descriptor::{Correct, Match, Parameters, QuantiseError, description};
use proto::task::{
    Described, Description, Evaluation, EvaluationResult, Failure, FailureReason, GridCell, Task, TaskResult,
    Tile,
};
use proto::{Digest, MAX_DESCRIPTION_BYTES};

pub use computing::Computing;
pub use lru::Lru;
pub use work::Work;

use crate::blobs::{BlobError, Blobs};
use crate::size::Size;
use crate::store::Store;
pub(crate) use decoded::Preparation;
use decoded::{Decoded, InvalidTask, Subject};
use manifest::{Manifest, labels};
use matching::Source;
use shelf::Shelf;
use supply::Supply;

/// Memory for split manifests, which are small and wanted by every job, bytes.
const MANIFESTS: usize = 8 << 20;

/// Why an evaluation has no result.
#[derive(Debug, thiserror::Error)]
pub enum EvaluationError {
    /// The task cannot be read.
    #[error(transparent)]
    Invalid(#[from] InvalidTask),
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

impl EvaluationError {
    fn reason(&self) -> FailureReason {
        match self {
            Self::Invalid(_)
            | Self::Manifest { .. }
            | Self::Quantise(_)
            | Self::Recognise(_)
            | Self::TooLarge { .. } => FailureReason::InvalidJob,
            Self::Blob(_) => FailureReason::Data,
            Self::Cloud { .. } => FailureReason::Cloud,
            Self::Description { .. } | Self::Undecodable(_) => FailureReason::Description,
        }
    }
}

impl From<EvaluationError> for Failure {
    fn from(error: EvaluationError) -> Self {
        Self::new(error.reason(), error)
    }
}

/// Carries out tasks, one at a time, each on all threads of its pool.
pub struct Workshop {
    computing: Computing,
    store: Arc<Store>,
    supply: Supply,
    memory: Size,
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
        memory: Size,
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
    pub async fn carry_out(self: Arc<Self>, task: Task) -> Result<TaskResult, EvaluationError> {
        let Decoded { preparation, subject } = Decoded::new(&task)?;
        let result = match (&task, subject) {
            (Task::Evaluation(evaluation), Subject::DiskRing(parameters)) => {
                self.evaluate(&preparation, &parameters, evaluation).await.map(TaskResult::Evaluation)
            }
            (Task::Tile(tile), Subject::DiskRing(parameters)) => {
                self.match_tile(&preparation, &parameters, tile).await.map(TaskResult::Evaluation)
            }
            (Task::GridCell(cell), Subject::Cell(radii_um)) => {
                self.count_cell(&preparation, radii_um, cell).await.map(TaskResult::GridCell)
            }
            (Task::Description(Description { manifest, .. }), subject) => {
                let bytes = match &subject {
                    Subject::DiskRing(parameters) => self.describe(&preparation, parameters, *manifest).await,
                    Subject::Fixed(fixed) => {
                        self.describe_fixed(&preparation.preprocess, *fixed, *manifest).await
                    }
                    Subject::Cell(_) => return Err(InvalidTask::Subject.into()),
                };
                bytes.map(|bytes| TaskResult::Description(Described::new(bytes)))
            }
            _ => return Err(InvalidTask::Subject.into()),
        };
        tracing::debug!("work so far: {:?}", self.work());
        result
    }

    async fn evaluate(
        &self,
        preparation: &Preparation,
        parameters: &Parameters,
        evaluation: &Evaluation,
    ) -> Result<EvaluationResult, EvaluationError> {
        let query = self.manifests(&evaluation.query).await?.into_iter().map(Source::split).collect();
        let database = self.manifests(&evaluation.database).await?.into_iter().map(Source::split).collect();
        self.recognise(preparation, parameters, [query, database], evaluation.want_matches).await
    }

    async fn match_tile(
        &self,
        preparation: &Preparation,
        parameters: &Parameters,
        Tile { evaluation, query_descriptions, database_descriptions }: &Tile,
    ) -> Result<EvaluationResult, EvaluationError> {
        let query = self.manifests(&evaluation.query).await?;
        let database = self.manifests(&evaluation.database).await?;
        let query = query.into_iter().zip(query_descriptions).map(Source::shard).collect();
        let database = database.into_iter().zip(database_descriptions).map(Source::shard).collect();
        self.recognise(preparation, parameters, [query, database], evaluation.want_matches).await
    }

    async fn recognise(
        &self,
        preparation: &Preparation,
        parameters: &Parameters,
        [query, database]: [Vec<Source>; 2],
        want_matches: bool,
    ) -> Result<EvaluationResult, EvaluationError> {
        let shelf = self.shelf(preparation)?;
        let [shape, colour] = self.distances(&shelf, parameters, &query, &database).await?;
        let [queries, database] = [query, database]
            .map(|sources| labels(&sources.into_iter().map(|source| source.manifest).collect::<Vec<_>>()));
        let weight = parameters.shape_weight();
        let recognise = move || {
            let matches = recognise_from(queries.len(), &shape, &colour, &database, weight)?;
            let correct = Correct::count(&matches, &queries, &database);
            Ok(result(&correct, if want_matches { &matches } else { &[] }))
        };
        self.computing.run(recognise).await
    }

    async fn count_cell(
        &self,
        preparation: &Preparation,
        [disk_um, ring_um]: [u32; 2],
        task: &GridCell,
    ) -> Result<Vec<u32>, EvaluationError> {
        let shelf = self.shelf(preparation)?;
        let cell = Arc::new(Cell::new(&shelf.quantiser, disk_um, ring_um)?);
        let query = self.manifests(&task.query).await?;
        let database = self.manifests(&task.database).await?;
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
    }
}

#[cfg(test)]
mod tests;
