//! A coordinator: reads an experiment, searches for descriptors, hands tasks to workers, writes the results.

pub mod cli;
pub mod control;
pub mod dataset;
pub mod exhaust;
pub mod experiment;
#[doc(hidden)]
pub mod fuzz_entry;
pub mod run;

mod compare;
mod console;
mod dashboard;
mod evaluate;
mod examine;
mod export;
mod fitness;
mod front;
mod in_process;
mod lines;
mod lock;
mod looks;
pub mod metrics;
mod names;
#[cfg(not(feature = "s3"))]
mod no_bucket;
mod objectives;
mod observers;
mod prepared;
mod reference_clouds;
mod reopen;
mod report;
mod result_cache;
pub mod session;
mod shared_bucket;
mod signing;
mod slurm;
mod storage;
mod sweep;
mod tasks;
pub mod trace;
mod verify;
mod web;
mod weighing;
