//! Lays evaluations and scales out as they are sharded; sides that several of them share are made once.

use std::collections::BTreeMap;
use std::sync::Arc;

use proto::task::{Evaluation, Scale};
use proto::{Digest, MAX_DESCRIPTION_BYTES};

use super::batch::{Planned, PlannedScale};
use super::plan::{ShardPlan, SidePlan};
use super::sharded_scale::SplitSide;
use super::side::Side;
use crate::blobs::BlobStore;

/// Sides that were laid out.
#[derive(Default)]
pub struct Layouts {
    /// By splits and number of shards.
    sides: BTreeMap<(Vec<Digest>, u32), Arc<Side>>,
    /// Splits that are one shard.
    splits: BTreeMap<Digest, Arc<Side>>,
}

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

    /// Lays out a scale: each of its splits has a share of the shards of its plan, and so many that each description fits
    /// into a message. It stays whole without a plan, or if its splits are not published.
    pub fn lay_out_scale(
        &mut self,
        scale: Scale,
        plan: Option<ShardPlan>,
        blobs: &BlobStore,
    ) -> PlannedScale {
        let laid_out = plan.and_then(|plan| self.splits(&scale, plan.query.shards, blobs));
        (scale, laid_out)
    }

    fn splits(&mut self, scale: &Scale, shards: u32, blobs: &BlobStore) -> Option<Vec<SplitSide>> {
        let fitting = MAX_DESCRIPTION_BYTES.checked_div(scale.subject.facts.description_bytes);
        let fitting = fitting.unwrap_or(u64::MAX);
        if fitting == 0 {
            return None; // no message can describe a cloud
        }
        let mut sides = BTreeMap::new();
        for &split in &scale.splits {
            let whole = self.split(split, blobs)?;
            let clouds = whole.labels.len() as u64;
            if clouds == 0 {
                continue; // nothing to describe
            }
            let share = u64::from(shards) * clouds / u64::from(scale.clouds.max(1));
            let shards = share.max(clouds.div_ceil(fitting)).min(clouds) as u32;
            let side = match shards {
                1 => whole,
                _ => self.side(&[split], clouds as u32, SidePlan { shards, ranges: 1 }, blobs)?,
            };
            sides.insert(split, side);
        }
        (!sides.is_empty()).then(|| sides.into_iter().collect())
    }

    fn split(&mut self, split: Digest, blobs: &BlobStore) -> Option<Arc<Side>> {
        if let Some(side) = self.splits.get(&split) {
            return Some(Arc::clone(side));
        }
        let side = Arc::new(Side::of_split(split, blobs)?);
        self.splits.insert(split, Arc::clone(&side));
        Some(side)
    }

    fn side(
        &mut self,
        splits: &[Digest],
        clouds: u32,
        plan: SidePlan,
        blobs: &BlobStore,
    ) -> Option<Arc<Side>> {
        let key = (splits.to_vec(), plan.shards);
        if let Some(side) = self.sides.get(&key) {
            return Some(Arc::clone(side));
        }
        let side = Arc::new(Side::publish(splits, clouds, plan.shards, blobs)?);
        self.sides.insert(key, Arc::clone(&side));
        Some(side)
    }
}
