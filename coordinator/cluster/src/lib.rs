//! Who computes what: workers, jobs and leases, sharding, the journal of accepted results, and the event log.
//!
//! No gRPC, no tables: the service feeds polls in, the run driver submits evaluations and waits for them.

pub mod blobs;
mod cluster;
mod cost;
pub mod counters;
pub mod events;
mod job_names;
mod job_set;
pub mod journal;
mod lock;
pub mod scheduler;
mod secret;
pub mod sharding;
pub mod spill;
pub mod store;

pub use cluster::{
    CellAnswer, Client, Cluster, ClusterError, ClusterNews, ControlRefusal, DescriptionAnswer,
};
pub use sharding::{AwaitingScales, FoundScale};
