//! One channel of a structure: which pairs of points are binned, by which features, and how.

use crate::distance::SetDistance;
use crate::signature::Signature;
use crate::structure::feature::Feature;

/// Which pairs of points a channel looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Pairs {
    /// A keypoint and each neighbour within the radius.
    KeypointNeighbour,
    /// Ordered pairs of a keypoint's neighbours within the radius, sampled.
    Neighbours,
    /// A keypoint and each other keypoint within the radius.
    Keypoints,
    /// Ordered pairs of points of the whole cloud, sampled: one row a cloud.
    Cloud,
}

/// A feature and the number of its bins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Axis {
    /// What is binned.
    pub feature: Feature,
    /// Into how many parts of its range.
    pub bins: u32,
    /// Of `angle` only: bins are parts of 360 degrees instead of 180, as the paper counts them (eq. 2), with the last
    /// one for 360 itself; those beyond 180 degrees are not kept.
    pub full_turn: bool,
}

/// What a channel's distances are divided by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Scale {
    /// The distance below which a twentieth of the distances of labelled clouds lie.
    #[default]
    Quantile,
    /// 1.
    None,
}

/// A channel without its weight: equal channels make equal signatures. Lengths are whole micrometres and factors whole
/// thousandths, so that equal channels are equal values.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct StructureChannel {
    /// Which pairs.
    pub pairs: Pairs,
    /// What is binned: 1 to [`StructureChannel::MAX_AXES`], no feature twice.
    pub axes: Vec<Axis>,
    /// Whether there is one bin for each combination of the axes' bins; otherwise one histogram for each axis, side by
    /// side.
    pub is_joint: bool,
    /// s of the squash of unbounded features, thousandths; 0 in a channel without one.
    pub squash_milli: u32,
    /// Radius of the neighbourhood, micrometres; for `Cloud` the longest distance of a pair.
    pub radius_um: u32,
    /// Outer bounds of the shells by pair distance, ascending, micrometres; pairs beyond the last are dropped. A pair
    /// on a bound belongs to the inner shell.
    pub shells_um: Vec<u32>,
    /// Pairs closer than this are dropped, micrometres.
    pub least_um: u32,
    /// Edge of the keypoint grid's voxels, micrometres; 0 for `Cloud`, which has no keypoints.
    pub grid_um: u32,
    /// Pairs that are drawn at each keypoint (`Neighbours`) or of the cloud (`Cloud`); 0: all of them, and always for
    /// the other two.
    pub samples: u32,
    /// Whether points without a normal are left out although no feature needs one.
    pub oriented: bool,
    /// Of `Neighbours` only, and where points without a normal are left out: whether keypoints without one stay, as
    /// nothing but their position is read.
    pub all_keypoints: bool,
    /// How rows are compared.
    pub metric: SetDistance,
    /// What each value of a signature is multiplied by, those of the centroid first, then those of the deviation:
    /// ten-thousandths, the largest of them [`StructureChannel::FULL`]. Empty: every value counts in full.
    pub value_weights: Vec<u16>,
}

impl Scale {
    /// Both of them.
    pub const ALL: [Self; 2] = [Self::Quantile, Self::None];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Quantile => "quantile",
            Self::None => "none",
        }
    }
}

impl Pairs {
    /// All of them, in the order of their codes in a genome.
    pub const ALL: [Self; 4] = [Self::KeypointNeighbour, Self::Neighbours, Self::Keypoints, Self::Cloud];

    /// Its name in files and in the text of a channel.
    pub fn name(self) -> &'static str {
        match self {
            Self::KeypointNeighbour => "keypoint-neighbour",
            Self::Neighbours => "neighbours",
            Self::Keypoints => "keypoints",
            Self::Cloud => "cloud",
        }
    }

    /// The pairs of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|pairs| pairs.name() == name)
    }

    /// Whether they are drawn.
    pub fn is_sampled(self) -> bool {
        matches!(self, Self::Neighbours | Self::Cloud)
    }
}

impl StructureChannel {
    /// Most axes of a channel.
    pub const MAX_AXES: usize = 8;

    /// Weight of a value that counts in full.
    pub const FULL: u16 = 10_000;

    /// The longest distance that a pair may have, micrometres.
    pub fn longest_um(&self) -> u32 {
        match self.pairs {
            Pairs::Neighbours => self.radius_um.saturating_mul(2),
            _ => self.radius_um,
        }
    }

    /// Values of one row: shell after shell, in each the joint histogram (the first axis slowest) or the axes'
    /// histograms side by side.
    pub fn bins(&self) -> u64 {
        let kept = |axis: &Axis| u64::from(axis.kept_bins());
        let in_shell = if self.is_joint {
            self.axes.iter().map(kept).fold(1, u64::saturating_mul)
        } else {
            self.axes.iter().map(kept).sum()
        };
        in_shell.saturating_mul(self.shells_um.len() as u64)
    }

    /// Whether rows have a deviation: all but those of `Cloud`, of which there is one.
    pub fn has_deviation(&self) -> bool {
        self.pairs != Pairs::Cloud
    }

    /// A signature, each value times its weight.
    pub fn weighted(&self, mut signature: Signature) -> Signature {
        let values = signature.centroid.iter_mut().chain(&mut signature.deviation);
        for (value, &weight) in values.zip(&self.value_weights) {
            *value *= f32::from(weight) / f32::from(Self::FULL);
        }
        signature
    }

    /// Values of a cloud's centroid and of its deviation.
    pub fn lengths(&self) -> [u64; 2] {
        [self.bins(), if self.has_deviation() { self.bins() } else { 0 }]
    }

    /// Values of a cloud's signature.
    pub fn values(&self) -> u64 {
        self.lengths().into_iter().fold(0, u64::saturating_add)
    }

    /// Whether the points that it pairs must have a normal.
    pub fn needs_normals(&self) -> bool {
        self.oriented || self.axes.iter().any(|axis| axis.feature.needs_normals())
    }

    /// Whether its keypoints must have one.
    pub(crate) fn needs_normals_of_keypoints(&self) -> bool {
        self.needs_normals() && !self.all_keypoints
    }

    /// Whether it is nothing without colours.
    pub fn needs_colour(&self) -> bool {
        self.axes.iter().any(|axis| axis.feature.needs_colour())
    }

    /// Whether a feature is squashed.
    pub fn is_squashed(&self) -> bool {
        self.axes.iter().any(|axis| axis.feature.is_squashed())
    }
}

impl Axis {
    /// Bins that a row has of it.
    pub fn kept_bins(&self) -> u32 {
        if self.full_turn { self.bins.saturating_sub(1) / 2 + 1 } else { self.bins }
    }
}
