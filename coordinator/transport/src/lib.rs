//! Where workers connect: the gRPC service, TLS, access control and the limits of connections.

pub mod certs;
pub mod door;
mod pieces;
mod server;
mod service;
pub mod wire;

pub use server::{DerivedEntries, Release, Servers};

/// This machine's name.
pub fn host_name() -> String {
    hostname::get().map_or_else(|_| "unknown".to_owned(), |name| name.to_string_lossy().into_owned())
}
