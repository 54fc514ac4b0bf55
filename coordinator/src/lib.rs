//! A coordinator: reads an experiment, evolves descriptors, hands evaluations to workers, writes the results.

pub mod cli;
pub mod dataset;
pub mod evolution;
pub mod experiment;
pub mod run;
pub mod scheduler;

mod blobs;
mod cluster;
mod evaluate;
mod evaluation;
mod local;
mod server;
mod service;
mod verify;
mod wire;
