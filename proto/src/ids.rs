//! Ids as types of their own, so that one cannot be mistaken for another.
//!
//! ```compile_fail
//! fn finish(job: proto::JobId) {}
//! finish(7); // a bare number is no job
//! ```

use std::fmt;
use std::str::FromStr;

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

            /// The inverse of `to_string`; `None` of other texts.
            pub fn from_hex(text: &str) -> Option<Self> {
                parse_hex(text).map(Self)
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
                f.write_str(&hex(&self.0))
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
    /// One start of one worker, kept across reconnects: the digest of its [`WorkerSecret`](crate::WorkerSecret).
    WorkerId,
    16,
    "worker_id"
);
byte_id!(
    /// A keyed hash of a lease and of whom it was granted to, by a key that only the coordinator has.
    #[derive(Default)]
    LeaseNonce,
    16,
    "nonce"
);
byte_id!(
    /// One run of a coordinator, through all its starts.
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

byte_id!(
    /// SHA-256 of a certificate's DER, as `openssl x509 -fingerprint -sha256` shows it.
    Fingerprint,
    32,
    "fingerprint"
);

/// A text that is no fingerprint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("fingerprint: must be 64 hex digits\ncopy it again, whole")]
pub struct InvalidFingerprint;

impl FromStr for Fingerprint {
    type Err = InvalidFingerprint;

    /// Colons between the digits do not matter, nor does the case.
    fn from_str(text: &str) -> Result<Self, InvalidFingerprint> {
        Self::from_hex(&text.replace(':', "")).ok_or(InvalidFingerprint)
    }
}

/// Two lower-case hex digits a byte.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The bytes of exactly two hex digits each.
pub fn parse_hex<const N: usize>(text: &str) -> Option<[u8; N]> {
    if text.len() != 2 * N || !text.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        return None;
    }
    let mut bytes = [0; N];
    for (index, byte) in bytes.iter_mut().enumerate() {
        *byte = u8::from_str_radix(&text[2 * index..2 * index + 2], 16).ok()?;
    }
    Some(bytes)
}

impl Digest {
    /// The digest of `bytes`.
    pub fn of(bytes: &[u8]) -> Self {
        Self(*blake3::hash(bytes).as_bytes())
    }
}

/// A job of one session: named by what it asks, and so the same in every start of a run.
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
    /// Shows that the coordinator granted this lease, and to whom. A worker only repeats it.
    pub nonce: LeaseNonce,
}

impl From<Lease> for crate::v2::Lease {
    fn from(lease: Lease) -> Self {
        Self { job: lease.job.0, attempt: lease.attempt, nonce: lease.nonce.to_vec() }
    }
}

impl From<crate::v2::Lease> for Lease {
    /// A nonce that cannot be one becomes zeros, which no coordinator has granted.
    fn from(lease: crate::v2::Lease) -> Self {
        let nonce = LeaseNonce::try_from(&lease.nonce[..]).unwrap_or_default();
        Self { job: JobId(lease.job), attempt: lease.attempt, nonce }
    }
}
