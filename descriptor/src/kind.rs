//! Either kind of descriptor: the paper's, or one without genes that it is compared with.

use std::fmt;

use crate::fixed::description as fixed;
use crate::{FixedDescriptor, Parameters, description};
use description::DescriptionError;

/// A descriptor of any kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Descriptor {
    /// The paper's.
    DiskRing(Parameters),
    /// One without genes.
    Fixed(FixedDescriptor),
}

impl Descriptor {
    /// Name of the paper's kind in files and on the command line; the others have [`crate::FixedKind::name`].
    pub const DISK_RING: &'static str = "disk-ring";

    /// Name of its kind.
    pub fn kind_name(&self) -> &'static str {
        match self {
            Self::DiskRing(_) => Self::DISK_RING,
            Self::Fixed(fixed) => fixed.kind.name(),
        }
    }

    /// Its parameters, for people.
    pub fn parameters(&self) -> String {
        match self {
            Self::DiskRing(parameters) => parameters.to_string(),
            Self::Fixed(fixed) => format!("radius={} cm", f64::from(fixed.radius_um) / 1e4),
        }
    }

    /// Values of one keypoint's descriptor.
    pub fn size(&self) -> usize {
        match self {
            Self::DiskRing(parameters) => parameters.size(),
            Self::Fixed(fixed) => fixed.kind.size(),
        }
    }

    /// Length of the description of so many clouds, bytes.
    pub fn description_length(&self, clouds: u32) -> u64 {
        match self {
            Self::DiskRing(parameters) => description::length(parameters, clouds),
            Self::Fixed(descriptor) => fixed::length(descriptor.kind, clouds),
        }
    }

    /// Whether these bytes can be the description of so many clouds.
    ///
    /// # Errors
    /// If they cannot.
    pub fn check_description(&self, bytes: &[u8], clouds: u32) -> Result<(), DescriptionError> {
        match self {
            Self::DiskRing(parameters) => description::check(bytes, parameters, clouds),
            Self::Fixed(descriptor) => fixed::check(bytes, descriptor.kind, clouds),
        }
    }
}

impl fmt::Display for Descriptor {
    /// Its parameters, of the paper's kind without its name.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::DiskRing(parameters) => parameters.fmt(f),
            Self::Fixed(fixed) => write!(f, "{} {}", fixed.kind, self.parameters()),
        }
    }
}
