//! Descriptors without genes, which the evolved one is compared with: one histogram a keypoint of all points within one
//! radius, counted as PCL counts it.
//!
//! Keypoints, normals, summaries and distances are those of the paper's descriptor. Points without a normal are left
//! out; a keypoint needs none of its own.

pub mod description;

mod arctangent;
mod frame;
mod lab;
mod neighbourhood;
mod pfhrgb;
mod ratio;
mod shot;

#[cfg(test)]
mod oracle;
#[cfg(test)]
mod tests;

use std::fmt;

use crate::keypoints::Keypoints;
use crate::neighbours::floor_f32;
use crate::prepare::{Normals, PrepareError, keypoints};
use crate::summary::Part;
use crate::surface::{SORTED_ABOVE, Surface};
use crate::{Cloud, Preprocess};
pub use description::DescribedClouds;

/// The descriptors without genes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FixedDescriptor {
    /// How a region is described.
    pub kind: FixedKind,
    /// Radius of the region about a keypoint, micrometres; whole, so that equal descriptors are equal values.
    pub radius_um: u32,
}

/// Why a cloud has no summary.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FixedError {
    /// The cloud could not be prepared for any descriptor.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// The cloud is sound, but no keypoint has enough points about it.
    #[error(
        "cloud: no keypoint that {kind} can describe, got {keypoints} keypoints\nskip the cloud, or choose a larger radius"
    )]
    NothingDescribed { kind: FixedKind, keypoints: usize },
}

/// The histograms of one cloud's keypoints; there is at least one.
#[derive(Clone, Debug, PartialEq)]
pub struct Histograms {
    size: usize,
    rows: Vec<f32>,
}

impl FixedDescriptor {
    /// Radius of the region, metres.
    pub fn radius(&self) -> f64 {
        f64::from(self.radius_um) / 1e6
    }

    /// All stages at once, from a cloud as stored.
    ///
    /// # Errors
    /// As for [`crate::PreparedCloud::new`], or [`FixedError::NothingDescribed`]; colours are needed whatever
    /// `preprocess` says.
    pub fn histograms(&self, cloud: &Cloud, preprocess: &Preprocess) -> Result<Histograms, FixedError> {
        let cloud = preprocess.in_metres(cloud);
        let keypoints = keypoints(&cloud, preprocess)?;
        let normals = Normals::new(&cloud, &keypoints, preprocess)?;
        self.describe(&cloud, &keypoints, &normals)
    }

    /// As [`FixedDescriptor::histograms`]: what matching needs of a cloud.
    ///
    /// # Errors
    /// The same.
    pub fn summary(&self, cloud: &Cloud, preprocess: &Preprocess) -> Result<Part, FixedError> {
        Ok(self.histograms(cloud, preprocess)?.summary())
    }

    /// The stage `describe`, for a cloud in metres.
    ///
    /// # Errors
    /// [`PrepareError::NoColours`], or [`FixedError::NothingDescribed`].
    pub fn describe(
        &self,
        cloud: &Cloud,
        keypoints: &Keypoints,
        normals: &Normals,
    ) -> Result<Histograms, FixedError> {
        let (Some(colours), Some(keypoint_colours)) = (&cloud.colours, &keypoints.colours) else {
            return Err(PrepareError::NoColours.into());
        };
        let surface = Surface::new(cloud, normals, self.radius(), SORTED_ABOVE)?;
        let colours: Vec<[u8; 3]> = surface.indices.iter().map(|&index| colours[index as usize]).collect();
        let radius = Radius { metres: self.radius(), squared: floor_f32(self.radius() * self.radius()) };
        let keypoints = keypoints.points.iter().copied().zip(keypoint_colours.iter().copied());
        let count = keypoints.len();
        let rows = match self.kind {
            FixedKind::PfhRgb => pfhrgb::rows(&surface, &colours, keypoints, radius),
            FixedKind::ShotColor => shot::rows(&surface, &colours, keypoints, radius),
        };
        if rows.is_empty() {
            return Err(FixedError::NothingDescribed { kind: self.kind, keypoints: count });
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

    /// Their mean and spread.
    pub fn summary(&self) -> Part {
        Part::of_rows(&self.rows, self.size)
    }
}
