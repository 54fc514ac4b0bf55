//! What the benchmarks share.
//!
//! - `household`: the benchmark data and the experiment on it
//! - `machine`: what they run on
//! - `prepared`: clouds in memory, evaluated as a worker does it
//! - `table`: samples, rows and how they are printed

pub mod household;
pub mod machine;
pub mod prepared;
pub mod table;
