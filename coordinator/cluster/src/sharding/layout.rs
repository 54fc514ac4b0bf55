//! Lays evaluations out as they are sharded; sides that several of them share are made once.

use std::collections::BTreeMap;
use std::sync::Arc;

use proto::Digest;
use proto::task::Evaluation;

use super::batch::Planned;
use super::plan::{ShardPlan, SidePlan};
use super::side::Side;
use crate::blobs::BlobStore;

/// Sides that were laid out, by splits and number of shards.
#[derive(Default)]
pub struct Layouts(BTreeMap<(Vec<Digest>, u32), Arc<Side>>);

impl Layouts {
    /// Lays out an evaluation, and publishes the manifests of its shards. It stays whole without a plan, or if its splits
    /// are not published.
    pub fn lay_out(&mut self, evaluation: Evaluation, plan: Option<ShardPlan>, blobs: &BlobStore) -> Planned {
        let laid_out = plan.and_then(|plan| {
            let query = self.side(&evaluation.query, evaluation.queries, plan.query, blobs)?;
            let database =
                self.side(&evaluation.database, evaluation.database_clouds, plan.database, blobs)?;
            Some((plan, [query, database]))
        });
        (evaluation, laid_out)
    }

    fn side(
        &mut self,
        splits: &[Digest],
        clouds: u32,
        plan: SidePlan,
        blobs: &BlobStore,
    ) -> Option<Arc<Side>> {
        let key = (splits.to_vec(), plan.shards);
        if let Some(side) = self.0.get(&key) {
            return Some(Arc::clone(side));
        }
        let side = Arc::new(Side::publish(splits, clouds, plan.shards, blobs)?);
        self.0.insert(key, Arc::clone(&side));
        Some(side)
    }
}
