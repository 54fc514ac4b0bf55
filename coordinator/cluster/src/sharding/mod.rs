//! Sharded evaluations and scales: clouds are described in shards and matched in tiles, so that few descriptors keep many
//! workers busy. The result is that of the whole, bit for bit, however it was sharded.

mod batch;
mod combined;
mod costs;
mod layout;
mod merge;
pub mod plan;
mod planner;
mod sharded;
mod sharded_scale;
mod side;

pub use batch::{AwaitingScales, Batch, Waiting};
pub use layout::Layouts;
pub use plan::{Load, MAX_SHARDS, ShardCount, ShardPlan, SidePlan};
pub use planner::Planner;
pub use sharded_scale::FoundScale;
pub use side::Side;

#[cfg(test)]
mod tests;
