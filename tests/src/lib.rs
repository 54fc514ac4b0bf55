//! What tests, benchmarks and programs that are started by hand share.
//!
//! - `process`: the harness: programs, their logs, waiting for states
//! - `browser`: a browser without a window
//! - `experiments`: small experiments on synthetic clouds
//! - `readers`: every reader of bytes from outside, for the fuzz drivers

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

pub mod browser;
pub mod experiments;
pub mod process;
pub mod readers;
