//! The families of descriptors.

use std::fmt;
use std::slice;

use crate::column::Column;
use crate::disk_ring::GENES;
use crate::fixed::{FixedDescriptor, FixedKind};
use crate::gene::GeneSpec;
use crate::global_hue::GlobalHue;
use crate::structure::Structure;

/// A family of descriptors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Family {
    /// The paper's.
    DiskRing,
    /// [`FixedKind::PfhRgb`].
    PfhRgb,
    /// [`FixedKind::ShotColor`].
    ShotColor,
    /// [`crate::GlobalHue`].
    GlobalHue,
    /// [`crate::structure::Structure`].
    Structure,
}

impl Family {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::DiskRing, Self::PfhRgb, Self::ShotColor, Self::GlobalHue, Self::Structure];

    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::DiskRing => "disk-ring",
            Self::PfhRgb => FixedKind::PfhRgb.name(),
            Self::ShotColor => FixedKind::ShotColor.name(),
            Self::GlobalHue => "global-hue",
            Self::Structure => "structure",
        }
    }

    /// The family of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|family| family.name() == name)
    }

    /// Its genes, in chromosome order; none of a family that is only compared with.
    pub fn genes(self) -> &'static [GeneSpec] {
        match self {
            Self::DiskRing => &GENES,
            Self::PfhRgb | Self::ShotColor => &[],
            Self::GlobalHue => slice::from_ref(&GlobalHue::GENE),
            Self::Structure => Structure::genes(),
        }
    }

    /// The columns that its descriptors have in tables.
    pub fn columns(self) -> Vec<Column> {
        match self.fixed_kind() {
            Some(_) => vec![FixedDescriptor::COLUMN],
            None => self.genes().iter().map(GeneSpec::column).collect(),
        }
    }

    /// The kind, of a family without genes.
    pub(crate) fn fixed_kind(self) -> Option<FixedKind> {
        FixedKind::ALL.into_iter().find(|&kind| Self::from(kind) == self)
    }

    /// The first of the canonical bytes of its descriptors, channels and search spaces.
    pub(crate) fn tag(self) -> u8 {
        match self {
            Self::DiskRing => 1,
            Self::PfhRgb => 2,
            Self::ShotColor => 3,
            Self::GlobalHue => 4,
            Self::Structure => 5,
        }
    }
}

impl From<FixedKind> for Family {
    fn from(kind: FixedKind) -> Self {
        match kind {
            FixedKind::PfhRgb => Self::PfhRgb,
            FixedKind::ShotColor => Self::ShotColor,
        }
    }
}

impl fmt::Display for Family {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}
