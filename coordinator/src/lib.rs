//! A coordinator: reads an experiment, searches for descriptors, hands tasks to workers, writes the results.

pub mod cli;
pub mod dataset;
pub mod evolution;
pub mod exhaust;
pub mod experiment;
#[doc(hidden)]
pub mod hostile;
pub mod run;

mod artefact;
mod compare;
mod evaluate;
mod local;
mod making;
mod memory;
mod prepared;
mod reopen;
mod storage;
mod sweep;
mod tasks;
mod verify;
