//! Descriptors without genes, which the evolved one is compared with: one histogram a keypoint of all points within one
//! radius, counted as PCL counts it.
//!
//! Keypoints, normals, signatures and distances are those of the paper's descriptor. Points without a normal are left
//! out; a keypoint needs none of its own.

mod arctangent;
mod frame;
pub(crate) mod lab;
mod neighbourhood;
mod pfhrgb;
pub(crate) mod ratio;
mod shot;

#[cfg(test)]
mod oracle;
#[cfg(test)]
mod tests;

use std::fmt;

use crate::column::Column;
use crate::keypoints::Keypoints;
use crate::neighbours::floor_f32;
use crate::normals::Normal;
use crate::prepare::{Normals, keypoints};
use crate::prepare_error::PrepareError;
use crate::signature::Signature;
use crate::surface::{SORTED_ABOVE, Surface};
use crate::{Cloud, Preprocess};

/// The descriptors without genes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum FixedKind {
    /// Point feature histograms with colour (Rusu et al. 2009; PCL: `PFHRGBEstimation`): over all ordered pairs of a
    /// region's points, 125 bins of the three angles between their normals, and 125 of the ratios of their colours.
    PfhRgb,
    /// Signatures of histograms of orientations with colour (Tombari, Salti, Di Stefano 2011; PCL:
    /// `SHOTColorEstimation`): 32 volumes about a local reference frame, in each 11 bins of the angle to the frame's
    /// normal and 31 of the distance to the keypoint's colour, all interpolated.
    ShotColor,
}

impl FixedKind {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::PfhRgb, Self::ShotColor];

    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::PfhRgb => "pfhrgb",
            Self::ShotColor => "shotcolor",
        }
    }

    /// The kind of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Largest value: PFHRGB counts ordered pairs in per cent of unordered ones, SHOT has unit length.
    pub(crate) fn largest(self) -> u8 {
        match self {
            Self::PfhRgb => 200,
            Self::ShotColor => 1,
        }
    }

    /// Values of one histogram.
    pub fn size(self) -> usize {
        match self {
            Self::PfhRgb => pfhrgb::SIZE,
            Self::ShotColor => shot::SIZE,
        }
    }
}

impl fmt::Display for FixedKind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

/// A descriptor without genes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct FixedDescriptor {
    /// How a region is described.
    pub kind: FixedKind,
    /// Radius of the region about a keypoint, micrometres; whole, so that equal descriptors are equal values.
    pub radius_um: u32,
}

/// Why a cloud has no signature.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DescribeError {
    /// The cloud could not be prepared for any descriptor.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// The cloud is sound, but no keypoint has enough points about it.
    #[error(
        "cloud: no keypoint that {kind} can describe, got {keypoints} keypoints\nskip the cloud, or choose a larger radius"
    )]
    NothingDescribed { kind: FixedKind, keypoints: usize },
}

/// A cloud with its keypoints and normals: what all descriptors without genes are computed from.
#[derive(Clone, Debug, PartialEq)]
pub struct OrientedCloud {
    /// In metres, with colours.
    cloud: Cloud,
    keypoints: Keypoints,
    normals: Normals,
}

impl OrientedCloud {
    /// From a cloud as stored.
    ///
    /// # Errors
    /// If the cloud takes no part or cannot be used as it is; colours are needed whatever `preprocess` says.
    pub fn new(cloud: &Cloud, preprocess: &Preprocess) -> Result<Self, PrepareError> {
        let cloud = preprocess.in_metres(cloud).into_owned();
        let keypoints = keypoints(&cloud, preprocess)?;
        let normals = Normals::new(&cloud, &keypoints, preprocess)?;
        if cloud.colours.is_none() {
            return Err(PrepareError::NoColours);
        }
        Ok(Self { cloud, keypoints, normals })
    }

    /// Memory that the cloud takes, bytes.
    pub(crate) fn bytes(&self) -> usize {
        // Position, colour and normal of each point.
        let of_point = size_of::<[f32; 3]>() + size_of::<[u8; 3]>() + size_of::<Normal>();
        size_of::<Self>() + (self.cloud.len() + self.keypoints.len()) * of_point
    }
}

/// The histograms of one cloud's keypoints; there is at least one.
#[derive(Clone, Debug, PartialEq)]
pub struct Histograms {
    size: usize,
    rows: Vec<f32>,
}

/// Largest radius of a region, micrometres.
const MAX_RADIUS_UM: u32 = 1_000_000;

/// Micrometres in a centimetre.
const UM_PER_CM: f64 = 1e4;

impl FixedDescriptor {
    /// The column of its radius.
    pub const COLUMN: Column = Column {
        name: "radius",
        unit: "cm",
        integer: false,
        meaning: "radius of the region about a keypoint",
    };

    /// Radius unless another is given, micrometres.
    pub const DEFAULT_RADIUS_UM: u32 = 50_000;

    /// With a radius from 1 µm to 1 m.
    ///
    /// # Errors
    /// What is wrong with another radius.
    pub fn new(kind: FixedKind, radius_um: u32) -> Result<Self, String> {
        if (1..=MAX_RADIUS_UM).contains(&radius_um) {
            Ok(Self { kind, radius_um })
        } else {
            let limits = format!("1 to {MAX_RADIUS_UM} um, got {radius_um}");
            Err(format!("radius: must be {limits}\nchoose a value inside these limits"))
        }
    }

    /// The descriptor of a radius in centimetres; `None` if it is no whole number of micrometres that may be.
    pub(crate) fn from_value(kind: FixedKind, radius_cm: f64) -> Option<Self> {
        let radius_um = (radius_cm * UM_PER_CM).round();
        let descriptor = Self::new(kind, radius_um as u32).ok()?; // what is no u32 is out of bounds as one
        (descriptor.radius_cm() == radius_cm).then_some(descriptor)
    }

    /// Radius of the region, centimetres.
    pub fn radius_cm(&self) -> f64 {
        f64::from(self.radius_um) / UM_PER_CM
    }

    /// Radius of the region, metres.
    pub fn radius(&self) -> f64 {
        f64::from(self.radius_um) / 1e6
    }

    /// All stages at once, from a cloud as stored.
    ///
    /// # Errors
    /// As for [`OrientedCloud::new`], or [`DescribeError::NothingDescribed`].
    pub fn histograms(&self, cloud: &Cloud, preprocess: &Preprocess) -> Result<Histograms, DescribeError> {
        let OrientedCloud { cloud, keypoints, normals } = OrientedCloud::new(cloud, preprocess)?;
        self.describe(&cloud, &keypoints, &normals)
    }

    /// How many keypoints of a cloud are described, and its signature: zeros if there are none.
    pub(crate) fn signature_or_zeros(&self, cloud: &OrientedCloud) -> Result<(u32, Signature), PrepareError> {
        match self.describe(&cloud.cloud, &cloud.keypoints, &cloud.normals) {
            Ok(histograms) => Ok((histograms.rows().len() as u32, histograms.signature())),
            Err(DescribeError::NothingDescribed { .. }) => {
                let zeros = vec![0.0; self.kind.size()];
                Ok((0, Signature { centroid: zeros.clone(), deviation: zeros }))
            }
            Err(DescribeError::Prepare(error)) => Err(error),
        }
    }

    /// The stage `describe`, for a cloud in metres.
    ///
    /// # Errors
    /// [`PrepareError::NoColours`], or [`DescribeError::NothingDescribed`].
    pub fn describe(
        &self,
        cloud: &Cloud,
        keypoints: &Keypoints,
        normals: &Normals,
    ) -> Result<Histograms, DescribeError> {
        let (Some(colours), Some(keypoint_colours)) = (&cloud.colours, &keypoints.colours) else {
            return Err(PrepareError::NoColours.into());
        };
        let surface = Surface::new(cloud, normals, self.radius(), SORTED_ABOVE)?;
        let colours: Vec<[u8; 3]> = surface.indices.iter().map(|&index| colours[index as usize]).collect();
        let radius = Radius { metres: self.radius(), squared: floor_f32(self.radius() * self.radius()) };
        let keypoints = keypoints.points.iter().copied().zip(keypoint_colours.iter().copied());
        let count = keypoints.len();
        if self.kind == FixedKind::PfhRgb {
            pfhrgb::check(&surface, keypoints.clone().map(|(keypoint, _)| keypoint), radius)?;
        }
        let rows = match self.kind {
            FixedKind::PfhRgb => pfhrgb::rows(&surface, &colours, keypoints, radius),
            FixedKind::ShotColor => shot::rows(&surface, &colours, keypoints, radius),
        };
        if rows.is_empty() {
            return Err(DescribeError::NothingDescribed { kind: self.kind, keypoints: count });
        }
        Ok(Histograms { size: self.kind.size(), rows })
    }
}

/// Radius of a region.
#[derive(Clone, Copy, Debug)]
struct Radius {
    metres: f64,
    /// Largest d² of a neighbour, square metres.
    squared: f32,
}

impl Histograms {
    /// One row a keypoint that could be described, in the order of the keypoints.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[f32]> {
        self.rows.chunks_exact(self.size)
    }

    /// Their mean and spread: what matching needs of the cloud.
    pub fn signature(&self) -> Signature {
        Signature::of_rows(&self.rows, self.size)
    }
}
