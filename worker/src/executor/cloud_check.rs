//! Clouds that others have prepared, in the shared folder, the bucket or the coordinator's store: a share of them is
//! prepared here again, and must be the same bits.

use std::sync::Arc;

use cache::Store;
use descriptor::PreparedCloud;
use rayon::prelude::*;

use crate::blobs::Blobs;
use crate::executor::computing::Computing;
use crate::executor::error::EvaluationError;
use crate::executor::manifest::Listed;
use crate::executor::preparation_cache::PreparationCache;
use crate::executor::signature_files::SIGNATURES;
use crate::prepared_cloud::PREPARED_CLOUD;

/// Prepares some clouds again, which others have prepared for `cache`.
///
/// # Errors
/// If one of them is not what its source gives: nothing more is computed by this process, as what it has used may be
/// wrong, too.
pub(super) async fn check(
    chosen: Vec<(Listed, Arc<PreparedCloud>)>,
    cache: &Arc<PreparationCache>,
    (blobs, computing, store): (&Blobs, &Computing, &Store),
) -> Result<(), EvaluationError> {
    if chosen.is_empty() {
        return Ok(());
    }
    let digests: Vec<_> = chosen.iter().map(|(cloud, _)| cloud.digest).collect();
    let bytes = blobs.get_all(&digests).await?;
    let preparing = Arc::clone(cache);
    let differs = move |((listed, given), bytes): ((Listed, Arc<PreparedCloud>), Vec<u8>)| {
        let [given, expected] =
            [&*given, &preparing.prepare(&listed, &bytes)?].map(|cloud| preparing.preparer.encode(cloud));
        Ok((given != expected).then_some(listed))
    };
    let compare = move || chosen.into_par_iter().zip(bytes).map(differs).collect();
    let differing: Result<Vec<Option<Listed>>, EvaluationError> = computing.run(compare).await;
    let Some(wrong) = differing?.into_iter().flatten().next() else { return Ok(()) };
    let path = &wrong.path;
    tracing::error!(
        "{path}: prepared cloud of the shared folder, the bucket or the coordinator is not what its source gives\nempty derived/prepared-cloud-2 there, start the workers again, and verify the runs that have used it"
    );
    let what = format!(
        "{path}: prepared cloud of the shared folder, the bucket or the coordinator must be what its source gives, got another"
    );
    if let Some(key) = cache.entry_key(wrong.digest) {
        store.distrust(PREPARED_CLOUD, key, what.clone(), &[PREPARED_CLOUD, SIGNATURES]);
    }
    Err(EvaluationError::Distrusted(what))
}
