//! A worker: takes evaluations from a coordinator, computes them, hands in the results.
//!
//! It needs nothing but the coordinator's address. It never decides anything about a run.

mod backoff;
mod blobs;
mod bucket;
pub mod cli;
pub mod command_line;
mod executor;
#[doc(hidden)]
pub mod fuzz_entry;
mod identity;
mod job_slots;
mod join_file;
mod lifetime;
mod link;
pub mod log;
pub mod names;
mod prepared_cloud;
mod run;
mod session;
mod tls;
pub mod trace;
pub mod version;
mod wire;

pub use bucket::{HttpClient, MAX_OBJECT_BYTES, http_client};
pub use identity::{BUILD, Identity};
pub use join_file::JoinFile;
pub use lifetime::{Leaving, LifetimeLimits};
pub use link::{Credentials, Link, link};
pub use prepared_cloud::{PREPARED_CLOUD, prepared_cloud_key, preprocess_key};
pub use run::{Options, run};
pub use session::WorkerError;
