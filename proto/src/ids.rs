//! Ids as types of their own, so that one cannot be mistaken for another.
//!
//! ```compile_fail
//! fn finish(job: proto::JobId) {}
//! finish(7); // a bare number is no job
//! ```

use std::fmt;

/// An id on the wire that has the wrong length.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{what}: length must be {expected} bytes, got {got}\nuse a worker and a coordinator of the same release"
)]
pub struct InvalidId {
    what: &'static str,
    expected: usize,
    got: usize,
}

macro_rules! byte_id {
    ($(#[$meta:meta])* $name:ident, $length:literal, $what:literal) => {
        $(#[$meta])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(pub [u8; $length]);

        impl $name {
            /// The bytes as they travel in messages.
            pub fn to_vec(self) -> Vec<u8> {
                self.0.to_vec()
            }
        }

        impl TryFrom<&[u8]> for $name {
            type Error = InvalidId;

            fn try_from(bytes: &[u8]) -> Result<Self, InvalidId> {
                let got = bytes.len();
                bytes.try_into().map(Self).map_err(|_| InvalidId { what: $what, expected: $length, got })
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
            }
        }

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{}({self})", stringify!($name))
            }
        }
    };
}

byte_id!(
    /// One start of one worker: random, kept across reconnects.
    WorkerId,
    16,
    "worker_id"
);
byte_id!(
    /// One start of a coordinator.
    SessionId,
    16,
    "session_id"
);
byte_id!(
    /// BLAKE3 of a blob's bytes: its name.
    Digest,
    32,
    "digest"
);

impl Digest {
    /// The digest of `bytes`.
    pub fn of(bytes: &[u8]) -> Self {
        Self(*blake3::hash(bytes).as_bytes())
    }
}

/// A job of one session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct JobId(pub u64);

impl fmt::Display for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0)
    }
}

/// The right to work on a job: attempts are counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Lease {
    /// The job.
    pub job: JobId,
    /// Which time this job is handed out.
    pub attempt: u32,
}

impl From<Lease> for crate::v1::Lease {
    fn from(lease: Lease) -> Self {
        Self { job: lease.job.0, attempt: lease.attempt }
    }
}

impl From<crate::v1::Lease> for Lease {
    fn from(lease: crate::v1::Lease) -> Self {
        Self { job: JobId(lease.job), attempt: lease.attempt }
    }
}
