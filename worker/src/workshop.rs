//! Evaluations: from a job's description to its result, on a pool of threads, with prepared clouds kept in memory.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, PoisonError};

use descriptor::{
    Correct, GeneTable, Label, Match, Parameters, PreparedCloud, Preprocess, QuantiseError, Quantiser, pcd,
    recognise, recognise::RecogniseError, summarise,
};
use prost::Message as _;
use proto::{Digest, v1};
use rayon::prelude::*;

use crate::blobs::{BlobError, Blobs};

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
pub struct Evaluation {
    /// How clouds are prepared.
    pub preparation: Preparation,
    /// The descriptor, one of the preparation's search space.
    pub parameters: Parameters,
    /// Split manifests of the queries, in order.
    pub query: Vec<Digest>,
    /// Split manifests of the database, in order.
    pub database: Vec<Digest>,
    /// Whether each query's match is wanted, or only the counts.
    pub want_matches: bool,
}

/// What an evaluation gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
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
    /// A cloud that the coordinator listed cannot be described.
    #[error("{path}: {what}")]
    Cloud {
        /// Its path in the data set.
        path: String,
        /// What is wrong with it.
        what: String,
    },
}

/// Source files of this many clouds are in memory at once while clouds are prepared.
const BATCH: usize = 64;

/// One cloud of a split, as the manifest lists it.
struct Listed {
    digest: Digest,
    label: Label,
    path: String,
}

/// The prepared clouds of one preparation.
struct Shelf {
    preparation: Preparation,
    quantiser: Quantiser,
    clouds: Mutex<HashMap<Digest, Arc<PreparedCloud>>>,
}

impl Shelf {
    fn clouds(&self) -> std::sync::MutexGuard<'_, HashMap<Digest, Arc<PreparedCloud>>> {
        // Entries are inserted whole: a panic elsewhere cannot leave a half-made one behind.
        self.clouds.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The prepared clouds of a list, in its order.
    fn take(&self, listed: &[Listed]) -> Result<Vec<Arc<PreparedCloud>>, EvaluationError> {
        let clouds = self.clouds();
        let missing = |cloud: &Listed| EvaluationError::Cloud {
            path: cloud.path.clone(),
            what: "was not prepared".to_owned(),
        };
        listed.iter().map(|cloud| clouds.get(&cloud.digest).cloned().ok_or_else(|| missing(cloud))).collect()
    }
}

/// Evaluates jobs, one at a time, each on all threads of its pool.
pub struct Workshop {
    pool: Arc<rayon::ThreadPool>,
    blobs: Blobs,
    shelf: Mutex<Option<Arc<Shelf>>>,
}

impl Workshop {
    /// A workshop with `threads` threads that gets its data from `blobs`.
    pub fn new(threads: usize, blobs: Blobs) -> Result<Self, rayon::ThreadPoolBuildError> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|index| format!("evaluate-{index}"))
            .build()?;
        Ok(Self { pool: Arc::new(pool), blobs, shelf: Mutex::new(None) })
    }

    /// Fetches what is missing and evaluates.
    pub async fn evaluate(self: Arc<Self>, evaluation: Evaluation) -> Result<Outcome, EvaluationError> {
        let shelf = self.shelf(&evaluation.preparation)?;
        let query = self.listed(&evaluation.query).await?;
        let database = self.listed(&evaluation.database).await?;
        self.prepare(&shelf, query.iter().chain(&database)).await?;

        let pool = Arc::clone(&self.pool);
        compute(move || pool.install(|| match_clouds(&shelf, &evaluation, &query, &database))).await
    }

    /// The shelf for a preparation. Only the last one is kept: a run has one, and memory is for its clouds.
    fn shelf(&self, preparation: &Preparation) -> Result<Arc<Shelf>, QuantiseError> {
        let mut current = self.shelf.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(shelf) = current.as_ref().filter(|shelf| shelf.preparation == *preparation) {
            return Ok(Arc::clone(shelf));
        }
        let shelf = Arc::new(Shelf {
            preparation: preparation.clone(),
            quantiser: Quantiser::new(&preparation.genes)?,
            clouds: Mutex::new(HashMap::new()),
        });
        *current = Some(Arc::clone(&shelf));
        Ok(shelf)
    }

    async fn listed(&self, manifests: &[Digest]) -> Result<Vec<Listed>, EvaluationError> {
        let mut listed = Vec::new();
        for &digest in manifests {
            let bytes = self.blobs.get(digest).await?;
            let broken = |what: String| EvaluationError::Manifest { digest, what };
            let manifest =
                v1::SplitManifest::decode(&bytes[..]).map_err(|error| broken(error.to_string()))?;
            for cloud in manifest.clouds {
                listed.push(Listed {
                    digest: Digest::try_from(&cloud.digest[..]).map_err(|error| broken(error.to_string()))?,
                    label: Label { category: cloud.category, instance: cloud.instance },
                    path: cloud.path,
                });
            }
        }
        Ok(listed)
    }

    /// Prepares the clouds that are not on the shelf yet, a batch at a time.
    async fn prepare(
        &self,
        shelf: &Arc<Shelf>,
        wanted: impl Iterator<Item = &Listed>,
    ) -> Result<(), EvaluationError> {
        let mut missing: BTreeMap<Digest, &Listed> = BTreeMap::new();
        {
            let clouds = shelf.clouds();
            missing.extend(wanted.filter(|c| !clouds.contains_key(&c.digest)).map(|c| (c.digest, c)));
        }
        let missing: Vec<&Listed> = missing.into_values().collect();
        let fetched_before = self.blobs.fetched();
        for batch in missing.chunks(BATCH) {
            let bytes =
                futures_util::future::try_join_all(batch.iter().map(|c| self.blobs.get(c.digest))).await?;
            let sources: Vec<(Digest, String, Vec<u8>)> =
                batch.iter().zip(bytes).map(|(c, bytes)| (c.digest, c.path.clone(), bytes)).collect();
            let (pool, shelf) = (Arc::clone(&self.pool), Arc::clone(shelf));
            compute(move || pool.install(|| prepare_batch(&shelf, sources))).await?;
        }
        if !missing.is_empty() {
            let fetched = self.blobs.fetched() - fetched_before;
            tracing::info!("prepared {} clouds, {fetched} of them fetched", missing.len());
        }
        Ok(())
    }
}

/// Runs `work` off the async threads; a panic in it goes on in the caller, which reports it.
async fn compute<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> T {
    match tokio::task::spawn_blocking(work).await {
        Ok(done) => done,
        Err(error) => match error.try_into_panic() {
            Ok(panic) => std::panic::resume_unwind(panic),
            // The runtime is going down, and with it whoever waits for this.
            Err(_) => std::future::pending().await,
        },
    }
}

fn prepare_batch(shelf: &Shelf, sources: Vec<(Digest, String, Vec<u8>)>) -> Result<(), EvaluationError> {
    let Shelf { preparation: Preparation { preprocess, .. }, quantiser, .. } = shelf;
    let prepared: Vec<(Digest, PreparedCloud)> = sources
        .into_par_iter()
        .map(|(digest, path, bytes)| {
            let failed = |what: String| EvaluationError::Cloud { path: path.clone(), what };
            let cloud = pcd::read(&bytes).map_err(|error| failed(error.to_string()))?;
            let prepared = PreparedCloud::new(&cloud, preprocess, quantiser);
            let prepared = prepared.map_err(|error| failed(error.to_string()))?;
            Ok((digest, prepared))
        })
        .collect::<Result<_, EvaluationError>>()?;
    shelf.clouds().extend(prepared.into_iter().map(|(digest, cloud)| (digest, Arc::new(cloud))));
    Ok(())
}

fn match_clouds(
    shelf: &Shelf,
    evaluation: &Evaluation,
    query: &[Listed],
    database: &[Listed],
) -> Result<Outcome, EvaluationError> {
    let binning = shelf.quantiser.binning(&evaluation.parameters)?;
    let query_summaries = summarise(&shelf.take(query)?, &binning);
    let database_summaries = summarise(&shelf.take(database)?, &binning);
    let labels = |listed: &[Listed]| listed.iter().map(|cloud| cloud.label).collect::<Vec<Label>>();
    let (query, database) = (labels(query), labels(database));
    let weight = evaluation.parameters.shape_weight();
    let matches = recognise(&query_summaries, &database_summaries, &database, weight)?;
    let correct = Correct::count(&matches, &query, &database);
    Ok(Outcome { correct, matches: if evaluation.want_matches { matches } else { Vec::new() } })
}
