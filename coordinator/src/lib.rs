//! A coordinator: reads an experiment, searches for descriptors, hands tasks to workers, writes the results.

pub mod cli;
pub mod dataset;
pub mod evolution;
pub mod exhaust;
pub mod experiment;
pub mod run;
pub mod scheduler;

mod blobs;
mod cluster;
mod evaluate;
mod evaluation;
mod local;
mod memory;
mod prepared;
mod server;
mod service;
mod storage;
mod task;
mod verify;
mod wire;
