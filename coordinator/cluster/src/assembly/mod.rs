//! Evaluations in pieces: clouds are described in shards and matched in tiles, so that few descriptors keep many workers
//! busy. What comes of the pieces is what the whole evaluation gives, bit for bit, however it was cut.

mod batch;
mod costs;
mod cut;
mod merge;
mod planner;
mod side;
mod under_way;

pub use batch::Batch;
pub use cut::{Cut, Load, MAX_PIECES, Pieces, SideCut};
pub use planner::Planner;
pub use side::Side;

#[cfg(test)]
mod tests;
