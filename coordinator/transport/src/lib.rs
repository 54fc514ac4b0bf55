//! Where workers connect: the gRPC service, TLS, access control and the limits of connections.

mod access;
mod auth_layer;
mod blob_stream;
mod budget;
pub mod certs;
mod connection;
mod deny_list;
mod limiter;
mod listen_error;
mod listener;
mod port;
mod presigner;
mod principal_share;
mod refusals;
mod server;
mod service;
mod tls;
mod web;
mod wire;

pub use deny_list::{DenyError, deny};
pub use limiter::ConnectionPermit;
pub use listen_error::ListenError;
pub use listener::Listener;
pub use port::{Port, Protection};
pub use presigner::{
    Direction, ObjectRequest, Presign, Presigned, Presigner, SignedUrl, SigningOutcome, UrlCounts,
};
pub use refusals::RefusalLog;
pub use server::Servers;
pub use service::{DerivedEntries, Release, SharedEntries};
pub use web::{WebConnection, WebError, WebListener, WebTokens};
#[doc(hidden)]
pub use wire::{reads_fetch, reads_poll};

/// This machine's name.
pub fn host_name() -> String {
    hostname::get().map_or_else(|_| "unknown".to_owned(), |name| name.to_string_lossy().into_owned())
}
