//! The protocol between coordinator and workers: the vocabulary of tasks, generated messages, ids, versions and bounds.
//!
//! `descry/v2/coordinator.proto` and `descry/v2/task.proto` are the manual.

#[cfg(feature = "services")]
mod codec;
mod compressed;
mod ids;
mod introduction;
mod join;
pub mod journal;
mod message;
mod principal;
mod printable;
pub mod task;
#[cfg(feature = "services")]
pub mod tls;

#[cfg(feature = "services")]
pub use codec::BoundedCodec;
pub use compressed::{Compressed, InvalidBlock};
pub use ids::{
    Digest, Fingerprint, InvalidFingerprint, InvalidId, JobId, Lease, LeaseNonce, SessionId, WorkerId, hex,
    parse_hex,
};
pub use introduction::Introduction;
pub use join::{DEFAULT_PORT, InvalidJoinAddress, InvalidToken, JoinAddress, Token, Trust};
pub use message::{Message, root_cause};
pub use principal::{InvalidPrincipal, Origin, Principal, WorkerSecret};
pub use printable::{is_printable, printable, printable_lines};

/// What is left of `descry.v1`: the refusal of its workers.
pub mod v1 {
    #![allow(missing_docs, clippy::all, clippy::disallowed_methods, clippy::unwrap_used)] // generated code
    include!(concat!(env!("OUT_DIR"), "/descry.v1.rs"));
}

/// Messages of `descry.v2`; with the feature `services` its client and server.
pub mod v2 {
    #![allow(missing_docs, clippy::all, clippy::disallowed_methods, clippy::unwrap_used)] // generated code
    include!(concat!(env!("OUT_DIR"), "/descry.v2.rs"));
}

/// The compiled .proto files, for gRPC reflection and the test of compatibility.
pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/descriptor_set.bin"));

/// Must be equal on both sides.
pub const PROTOCOL_MAJOR: u32 = 2;
/// Grows when something is added that a worker must not pass over.
pub const PROTOCOL_MINOR: u32 = 2;

/// The largest message either side accepts, bytes: some 300 000 matches of one final test.
pub const MAX_MESSAGE_BYTES: usize = 16 << 20;
/// Size of one piece of a blob, bytes.
pub const BLOB_CHUNK_BYTES: usize = 64 << 10;
/// The largest blob a worker accepts, bytes: a cloud of 16 million points.
pub const MAX_BLOB_BYTES: u64 = 256 << 20;
/// The longest worker name, bytes.
pub const MAX_NAME_BYTES: usize = 64;
/// The longest message for people that is kept of what a worker says, bytes.
pub const MAX_TEXT_BYTES: usize = 1024;
/// The most leases, reports or wanted jobs in one poll.
pub const MAX_POLL_ITEMS: usize = 256;
/// The kind of objects in a bucket that are blobs, named by their digests.
pub const BLOB_KIND: &str = "";
/// The least bytes of a description of a shard that workers give each other by a bucket: smaller ones cost more as objects than
/// on their way through the coordinator.
pub const MIN_SHARED_DESCRIPTION_BYTES: usize = 64 << 10;
/// The most URLs that are asked for in one call.
pub const MAX_PRESIGNED_URLS: usize = 1024;

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
