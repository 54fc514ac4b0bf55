//! The protocol between coordinator and workers: generated messages, ids, versions and bounds.
//!
//! `descry/v1/coordinator.proto` is the manual.

mod ids;
mod join;
mod message;

pub use ids::{Digest, Fingerprint, InvalidFingerprint, InvalidId, JobId, Lease, SessionId, WorkerId};
pub use join::{DEFAULT_PORT, InvalidJoinAddress, InvalidToken, JoinAddress, Token, Trust};
pub use message::Message;

/// Messages, client and server of `descry.v1`.
pub mod v1 {
    #![allow(missing_docs, clippy::all, clippy::disallowed_methods, clippy::unwrap_used)] // generated code
    tonic::include_proto!("descry.v1");
}

/// The compiled .proto files, for gRPC reflection and the test of compatibility.
pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/descriptor_set.bin"));

/// Must be equal on both sides.
pub const PROTOCOL_MAJOR: u32 = 1;
/// Grows when the protocol grows.
pub const PROTOCOL_MINOR: u32 = 3;
/// The least that a worker must know: descriptors without genes.
pub const LEAST_PROTOCOL_MINOR: u32 = 3;

/// The largest message either side accepts, bytes: some 300 000 matches of one final test.
pub const MAX_MESSAGE_BYTES: usize = 16 << 20;
/// Size of one piece of a blob, bytes.
pub const BLOB_CHUNK_BYTES: usize = 64 << 10;
/// The largest blob a worker accepts, bytes: a cloud of 16 million points.
pub const MAX_BLOB_BYTES: u64 = 256 << 20;
/// The largest radius of a descriptor without genes, micrometres.
pub const MAX_RADIUS_UM: u32 = 1_000_000;
/// The longest worker name, bytes.
pub const MAX_NAME_BYTES: usize = 64;
/// The longest message for people that is kept of what a worker says, bytes.
pub const MAX_TEXT_BYTES: usize = 1024;
/// The most leases, reports or wanted jobs in one poll.
pub const MAX_POLL_ITEMS: usize = 256;

/// The longest description of a shard, bytes: several of them fit into one poll.
pub const MAX_DESCRIPTION_BYTES: u64 = 2 << 20;

/// The most descriptors in one grid cell: their counts travel in one message.
pub const MAX_CELL: u64 = 1 << 20;

/// The start of `text` that fits into `bytes`, cut between characters.
pub fn truncate(text: &str, bytes: usize) -> &str {
    &text[..text.floor_char_boundary(bytes)]
}

#[cfg(test)]
mod compatibility;
