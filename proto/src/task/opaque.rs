//! Bytes that only the crate `descriptor` reads: descriptors, grid cells and what is computed once for all of them.

use std::fmt;
use std::sync::Arc;

use crate::ids::hex;

/// The longest descriptor or grid cell that is taken from a message, bytes.
pub const MAX_DESCRIPTOR_BYTES: usize = 4 << 10;
/// The longest preparation that is taken from a message, bytes.
pub const MAX_PREPARATION_BYTES: usize = 64 << 10;

macro_rules! opaque {
    ($(#[$meta:meta])* $name:ident) => {
        $(#[$meta])*
        #[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(Arc<[u8]>);

        impl $name {
            /// The bytes.
            pub fn bytes(&self) -> &[u8] {
                &self.0
            }
        }

        impl From<Vec<u8>> for $name {
            fn from(bytes: Vec<u8>) -> Self {
                Self(bytes.into())
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
    DescriptorBytes
);
opaque!(
    /// What is computed once for all descriptors of a run: preprocessing and search space.
    Preparation
);
