//! Channels: what of a cloud a descriptor looks at, and how it becomes signatures and distances.

use std::borrow::Borrow;
use std::sync::Arc;

use rayon::prelude::*;

use crate::bytes;
use crate::disk_ring::histogram::Feature;
use crate::disk_ring::{Binning, GeneKind, Parameters, QuantiseError};
use crate::distance::{DistanceMatrix, SetDistance};
use crate::family::Family;
use crate::fixed::FixedDescriptor;
use crate::global_hue::GlobalHue;
use crate::prepare_error::PrepareError;
use crate::prepared::{PreparedCloud, Preparer};
use crate::signature::{Signature, Signatures};
use crate::structure::{StructureChannel, StructurePlan};

/// One channel of a descriptor, without its weight. Descriptors that share a channel have equal signatures and equal
/// distances in it: it is the key that these are kept under.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Channel(Kind);

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Kind {
    Shape { bins: u32, disk_um: u32, ring_um: u32 },
    Colour { m: u32, disk_um: u32, ring_um: u32 },
    Fixed(FixedDescriptor),
    GlobalHue(GlobalHue),
    Structure(Arc<StructureChannel>),
}

/// Why a channel has no signatures.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ChannelError {
    /// Clouds are prepared for a search space that the descriptor is not of.
    #[error(transparent)]
    Quantise(#[from] QuantiseError),
    /// Clouds are prepared for another family.
    #[error(
        "clouds: prepared for {channel} expected, got {prepared}\nprepare them with a space of {channel}"
    )]
    Family {
        /// The channel's.
        channel: Family,
        /// What they are prepared for.
        prepared: Family,
    },
}

impl Channel {
    /// Shape and colour of the paper's descriptor.
    pub(crate) fn disk_ring(parameters: &Parameters) -> [Self; 2] {
        let Parameters { shape_bins, colour_bins, disk_um, ring_um, .. } = *parameters;
        [
            Self(Kind::Shape { bins: shape_bins, disk_um, ring_um }),
            Self(Kind::Colour { m: colour_bins, disk_um, ring_um }),
        ]
    }

    /// The only channel of a descriptor without genes.
    pub(crate) fn fixed(descriptor: FixedDescriptor) -> Self {
        Self(Kind::Fixed(descriptor))
    }

    /// The only channel of a global histogram.
    pub(crate) fn global_hue(descriptor: GlobalHue) -> Self {
        Self(Kind::GlobalHue(descriptor))
    }

    /// A channel of a structure.
    pub(crate) fn structure(channel: StructureChannel) -> Self {
        Self(Kind::Structure(Arc::new(channel)))
    }

    /// The family of the descriptors that have it.
    pub fn family(&self) -> Family {
        match &self.0 {
            Kind::Shape { .. } | Kind::Colour { .. } => Family::DiskRing,
            Kind::Fixed(descriptor) => descriptor.kind.into(),
            Kind::GlobalHue(_) => Family::GlobalHue,
            Kind::Structure(_) => Family::Structure,
        }
    }

    /// Canonical bytes: equal for equal channels only.
    pub fn to_bytes(&self) -> Vec<u8> {
        let numbers: &[u32] = match &self.0 {
            Kind::Shape { bins, disk_um, ring_um } => &[0, *bins, *disk_um, *ring_um],
            Kind::Colour { m, disk_um, ring_um } => &[1, *m, *disk_um, *ring_um],
            Kind::Fixed(descriptor) => &[0, descriptor.radius_um],
            Kind::GlobalHue(descriptor) => &[0, descriptor.bins()],
            Kind::Structure(channel) => &channel.numbers(),
        };
        bytes::write(self.family(), numbers.iter().copied())
    }

    /// The channel of a structure; `None` of other families.
    pub(crate) fn as_structure(&self) -> Option<&StructureChannel> {
        match &self.0 {
            Kind::Structure(channel) => Some(channel),
            _ => None,
        }
    }

    /// What makes its signatures of clouds that were prepared by `preparer`.
    ///
    /// # Errors
    /// If they were prepared for descriptors that do not have this channel.
    pub fn extractor(&self, preparer: &Preparer) -> Result<Extractor, ChannelError> {
        let quantiser = preparer.quantiser();
        let mismatch = ChannelError::Family { channel: self.family(), prepared: preparer.family() };
        // Histograms of either feature need bins of the other no more than a weight: any of the table will do.
        let binning =
            |feature, shape_bins: Option<u32>, colour_bins: Option<u32>, [disk_um, ring_um]: [u32; 2]| {
                let quantiser = quantiser.ok_or(mismatch.clone())?;
                let lowest = |kind| quantiser.table().domain(kind).map_or(0, |domain| domain.low);
                let parameters = Parameters {
                    shape_bins: shape_bins.unwrap_or_else(|| lowest(GeneKind::ShapeBins)),
                    colour_bins: colour_bins.unwrap_or_else(|| lowest(GeneKind::ColourBins)),
                    disk_um,
                    ring_um,
                    shape_weight_ppm: 0,
                };
                Ok(Extractor(Way::DiskRing(feature, quantiser.binning(&parameters)?)))
            };
        match &self.0 {
            &Kind::Shape { bins, disk_um, ring_um } => {
                binning(Feature::Shape, Some(bins), None, [disk_um, ring_um])
            }
            &Kind::Colour { m, disk_um, ring_um } => {
                binning(Feature::Colour, None, Some(m), [disk_um, ring_um])
            }
            Kind::Fixed(descriptor) if preparer.is_of_oriented() => Ok(Extractor(Way::Fixed(*descriptor))),
            Kind::GlobalHue(descriptor) if preparer.is_of_colours() => {
                Ok(Extractor(Way::GlobalHue(*descriptor)))
            }
            Kind::Structure(channel) if preparer.is_of_structures() => {
                Ok(Extractor(Way::Structure(Arc::new(StructurePlan::new(channel)))))
            }
            Kind::Fixed(_) | Kind::GlobalHue(_) | Kind::Structure(_) => Err(mismatch),
        }
    }

    /// How it compares clouds: χ², unless a structure has another metric.
    pub fn metric(&self) -> SetDistance {
        match &self.0 {
            Kind::Structure(channel) => channel.metric,
            _ => SetDistance::ChiSquared,
        }
    }

    /// A set distance, or its own if that is χ².
    pub fn metric_or(&self, distance: SetDistance) -> SetDistance {
        match distance {
            SetDistance::ChiSquared => self.metric(),
            other => other,
        }
    }

    /// Distances between clouds by their signatures in this channel, computed by the current rayon pool.
    ///
    /// # Panics
    /// If the signatures are of different channels: a programming error.
    pub fn distances(&self, queries: &Signatures, database: &Signatures) -> DistanceMatrix {
        DistanceMatrix::by(self.metric(), queries, database)
    }

    /// As [`Channel::distances`] of some clouds to the same clouds, in half the time.
    pub fn distances_among(&self, clouds: &Signatures) -> DistanceMatrix {
        DistanceMatrix::among(self.metric(), clouds)
    }
}

/// Makes the signatures of one channel.
#[derive(Clone, Debug)]
pub struct Extractor(Way);

#[derive(Clone, Debug)]
enum Way {
    DiskRing(Feature, Binning),
    Fixed(FixedDescriptor),
    GlobalHue(GlobalHue),
    Structure(Arc<StructurePlan>),
}

impl Extractor {
    /// Signatures of clouds, in their order, computed by the current rayon pool.
    ///
    /// # Errors
    /// If a cloud cannot be described, which preparing it has not shown.
    ///
    /// # Panics
    /// If a cloud was prepared by another preparer: a programming error.
    pub fn signatures<C: Borrow<PreparedCloud> + Sync>(
        &self,
        clouds: &[C],
    ) -> Result<Signatures, PrepareError> {
        let described: Vec<(Signature, Option<u32>)> =
            clouds.par_iter().map(|cloud| self.signature(cloud.borrow())).collect::<Result<_, _>>()?;
        let mut signatures: Signatures = described.iter().map(|(signature, _)| signature).collect();
        signatures.keypoints = described.iter().filter_map(|(_, keypoints)| *keypoints).collect();
        Ok(signatures)
    }

    /// One cloud's signature, and how many of its keypoints are described, where the family tells.
    fn signature(&self, cloud: &PreparedCloud) -> Result<(Signature, Option<u32>), PrepareError> {
        match (&self.0, cloud) {
            (Way::DiskRing(feature, binning), PreparedCloud::Quantised(cloud)) => {
                Ok((binning.of(*feature, cloud), None))
            }
            (Way::Fixed(descriptor), PreparedCloud::Oriented(cloud)) => {
                let (keypoints, signature) = descriptor.signature_or_zeros(cloud)?;
                Ok((signature, Some(keypoints)))
            }
            (Way::GlobalHue(descriptor), PreparedCloud::Colours(colours)) => {
                Ok((descriptor.signature(colours), None))
            }
            (Way::Structure(plan), PreparedCloud::Structure(cloud)) => Ok((plan.signature(cloud)?, None)),
            _ => panic!("a cloud prepared for another family"),
        }
    }
}
