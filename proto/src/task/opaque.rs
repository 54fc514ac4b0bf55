//! Bytes that only the crate `descriptor` reads: descriptors, grid cells and what is computed once for all of them.

use std::fmt;
use std::sync::Arc;

use crate::ids::hex;

/// The longest descriptor, bytes.
pub const MAX_DESCRIPTOR_BYTES: usize = 4 << 10;
/// The longest preparation, bytes.
pub const MAX_PREPARATION_BYTES: usize = 64 << 10;

/// More bytes than a descriptor, a grid cell or a preparation may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what}: length must be at most {most} bytes, got {got}\nreport this as a bug")]
pub struct TooLong {
    what: &'static str,
    most: usize,
    got: usize,
}

macro_rules! opaque {
    ($(#[$meta:meta])* $name:ident, $most:ident, $what:literal) => {
        $(#[$meta])*
        #[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(Arc<[u8]>);

        impl $name {
            /// The bytes.
            pub fn bytes(&self) -> &[u8] {
                &self.0
            }
        }

        impl TryFrom<Vec<u8>> for $name {
            type Error = TooLong;

            fn try_from(bytes: Vec<u8>) -> Result<Self, TooLong> {
                if bytes.len() > $most {
                    return Err(TooLong { what: $what, most: $most, got: bytes.len() });
                }
                Ok(Self(bytes.into()))
            }
        }

        impl<const N: usize> From<[u8; N]> for $name {
            fn from(bytes: [u8; N]) -> Self {
                const { assert!(N <= $most) };
                Self(Arc::new(bytes))
            }
        }

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{}({})", stringify!($name), hex(&self.0))
            }
        }
    };
}

opaque!(
    /// A descriptor, or the coordinates of a grid cell: canonical, so that equal bytes mean equal descriptors.
    DescriptorBytes,
    MAX_DESCRIPTOR_BYTES,
    "descriptor"
);
opaque!(
    /// What is computed once for all descriptors of a run: preprocessing and search space.
    Preparation,
    MAX_PREPARATION_BYTES,
    "preparation"
);
