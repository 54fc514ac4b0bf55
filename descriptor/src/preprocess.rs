//! What is done to every cloud whatever the descriptor: unit, keypoint grid, normals, smallest size.

use std::borrow::Cow;
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::Cloud;

/// The unit in which a data set's clouds are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Unit {
    /// Coordinates are metres.
    #[default]
    #[serde(rename = "m")]
    Metre,
    /// Coordinates are millimetres.
    #[serde(rename = "mm")]
    Millimetre,
}

impl Unit {
    /// Metres in one unit.
    pub fn metres(self) -> f32 {
        match self {
            Self::Metre => 1.0,
            Self::Millimetre => 0.001,
        }
    }

    /// The other one.
    pub fn other(self) -> Self {
        match self {
            Self::Metre => Self::Millimetre,
            Self::Millimetre => Self::Metre,
        }
    }

    /// What a length of so many metres would be if its coordinates were in the other unit.
    pub fn in_other(self, metres: f64) -> f64 {
        match self {
            Self::Metre => metres * 0.001,
            Self::Millimetre => metres * 1000.0,
        }
    }
}

/// As in settings.
impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Metre => "m",
            Self::Millimetre => "mm",
        })
    }
}

/// Settings of the stages before the descriptor. Lengths are whole micrometres, so that equal settings are equal
/// values: they are hashed, sent to workers and part of every digest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Preprocess {
    /// Edge of a voxel of the keypoint grid, micrometres.
    pub leaf_um: u32,
    /// Radius of the neighbourhood that a normal is fitted to, micrometres.
    pub normal_radius_um: u32,
    /// A cloud with fewer points is skipped.
    pub min_points: u32,
    /// Whether every cloud must have colours.
    pub colour: bool,
    /// Unit of the stored coordinates.
    pub unit: Unit,
}

impl Default for Preprocess {
    /// The paper's settings: leaf 2 cm, normals from 1 cm, coloured clouds in metres (DESIGN 5.1 to 5.3).
    fn default() -> Self {
        Self { leaf_um: 20_000, normal_radius_um: 10_000, min_points: 10, colour: true, unit: Unit::Metre }
    }
}

impl Preprocess {
    /// Edge of a voxel, metres, as the f32 that PCL's VoxelGrid is given.
    pub fn leaf(&self) -> f32 {
        (f64::from(self.leaf_um) / 1e6) as f32
    }

    /// Radius of a normal's neighbourhood, metres.
    pub fn normal_radius(&self) -> f64 {
        f64::from(self.normal_radius_um) / 1e6
    }

    /// The cloud in metres; borrowed if it already is.
    pub fn in_metres<'a>(&self, cloud: &'a Cloud) -> Cow<'a, Cloud> {
        match self.unit {
            Unit::Metre => Cow::Borrowed(cloud),
            Unit::Millimetre => Cow::Owned(cloud.clone().in_metres(self.unit.metres())),
        }
    }
}
