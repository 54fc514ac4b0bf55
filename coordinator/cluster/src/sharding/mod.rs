//! Sharded evaluations: clouds are described in shards and matched in tiles, so that few descriptors keep many workers
//! busy. The merged result is that of the whole evaluation, bit for bit, however it was sharded.

mod batch;
mod costs;
mod layout;
mod merge;
pub mod plan;
mod planner;
mod sharded;
mod side;

pub use batch::Batch;
pub use layout::Layouts;
pub use plan::{Load, MAX_SHARDS, ShardCount, ShardPlan, SidePlan};
pub use planner::Planner;
pub use side::Side;

#[cfg(test)]
mod tests;
