//! Descriptions under descriptors without genes: from the source clouds, of which nothing is kept.

use descriptor::fixed::FixedError;
use descriptor::fixed::description::{self, DescribedClouds};
use descriptor::summary::Part;
use descriptor::{FixedDescriptor, Preprocess, pcd};
use futures_util::future::try_join_all;
use proto::Digest;
use rayon::prelude::*;

use crate::workshop::manifest::Listed;
use crate::workshop::matching::refuse_too_large;
use crate::workshop::{EvaluationError, Workshop};

/// Clouds in memory at once, for each thread.
const CLOUDS_A_THREAD: usize = 2;

impl Workshop {
    /// The description of a shard.
    pub(super) async fn describe_fixed(
        &self,
        preprocess: &Preprocess,
        descriptor: FixedDescriptor,
        manifest: Digest,
    ) -> Result<Vec<u8>, EvaluationError> {
        let manifest = self.manifest(manifest).await?;
        let kind = descriptor.kind;
        refuse_too_large(&manifest, description::length(kind, manifest.clouds.len() as u32))?;
        let mut described = DescribedClouds::default();
        for batch in manifest.clouds.chunks(CLOUDS_A_THREAD * self.computing.threads()) {
            let bytes = try_join_all(batch.iter().map(|cloud| self.supply.blobs.get(cloud.digest))).await?;
            let (batch, preprocess) = (batch.to_vec(), *preprocess);
            let describe = move || -> Result<Vec<_>, EvaluationError> {
                let clouds = batch.par_iter().zip(bytes);
                clouds.map(|(cloud, bytes)| described_cloud(cloud, &bytes, &preprocess, descriptor)).collect()
            };
            for cloud in self.computing.run(describe).await? {
                described.push(kind, cloud);
            }
        }
        self.supply.work().described += manifest.clouds.len() as u64;
        Ok(description::encode(&described))
    }
}

/// How many of its keypoints are described, and their summary; `None` if there are none.
fn described_cloud(
    cloud: &Listed,
    bytes: &[u8],
    preprocess: &Preprocess,
    descriptor: FixedDescriptor,
) -> Result<Option<(u32, Part)>, EvaluationError> {
    let failed = |what: String| EvaluationError::Cloud { path: cloud.path.clone(), what };
    let source = pcd::read(bytes).map_err(|error| failed(error.to_string()))?;
    match descriptor.histograms(&source, preprocess) {
        Ok(histograms) => Ok(Some((histograms.rows().len() as u32, histograms.summary()))),
        Err(FixedError::NothingDescribed { .. }) => Ok(None),
        Err(error) => Err(failed(error.to_string())),
    }
}
