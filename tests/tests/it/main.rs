//! One binary of end-to-end tests, so that the workspace is linked once.
//!
//! - `process`: the harness: programs, their logs, waiting for states
//! - `experiments`: small experiments on synthetic clouds
//! - `programs`: every command as a user runs it
//! - `bad_input`: what users get wrong, and what they are told
//! - `determinism`: one digest, whatever the workers do
//! - `remembering`: caches and what is kept from run to run
//! - `exhaust`: the exhaustive search, and what runs make of it
//! - `grid`: grid cells against the evaluator on real clouds
//! - `protocol`: the coordinator's port as a client sees it
//! - `impostors`: peers that are not what they seem
//! - `parity`: agreement with PCL on its reference values
//! - `repository`: the rules of this repository

#![expect(
    clippy::unwrap_used,
    reason = "a test that cannot go on has failed; helpers of tests are no tests to clippy"
)]

mod bad_input;
mod determinism;
mod exhaust;
mod experiments;
mod grid;
mod impostors;
mod parity;
mod process;
mod programs;
mod protocol;
mod remembering;
mod repository;
