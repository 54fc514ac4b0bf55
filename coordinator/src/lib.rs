//! A coordinator: reads an experiment, searches for descriptors, hands tasks to workers, writes the results.

pub mod certs;
pub mod cli;
pub mod dataset;
pub mod exhaust;
pub mod experiment;
#[doc(hidden)]
pub mod hostile;
pub mod run;
pub mod scheduler;

mod artefact;
mod assembly;
mod blobs;
mod book;
mod chronicle;
mod cluster;
mod compare;
mod door;
mod evaluate;
mod evaluation;
mod journal;
mod ledger;
mod local;
mod making;
mod memory;
mod pieces;
mod prepared;
mod reopen;
mod server;
mod service;
mod shard;
mod storage;
mod sweep;
mod task;
mod verify;
mod wire;
