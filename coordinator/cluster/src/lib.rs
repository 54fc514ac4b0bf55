//! Who computes what: workers, jobs and leases, the journal of accepted answers, and the events that tell of them.
//!
//! No gRPC, no tables: the service feeds polls in, the run driver submits evaluations and waits for them.

pub mod assembly;
pub mod blobs;
mod book;
pub mod chronicle;
mod cluster;
mod job_names;
pub mod journal;
mod ledger;
pub mod scheduler;

pub use cluster::{CellAnswer, Client, Cluster, ClusterError, ClusterNews};
