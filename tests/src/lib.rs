//! What tests, benchmarks and programs that are started by hand share.
//!
//! - `process`: the harness: programs, their logs, waiting for states
//! - `browser`: a browser without a window
//! - `experiments`: small experiments on synthetic clouds
//! - `benches`: what benchmarks share: their clouds, samples and tables
//! - `manual`: man pages and completions, for packages
//! - `ply_files`: clouds as PLY files
//! - `readers`: every reader of bytes from outside, for the fuzz drivers

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

pub mod benches;
pub mod browser;
pub mod experiments;
pub mod http;
pub mod manual;
pub mod ply_files;
pub mod process;
pub mod readers;
