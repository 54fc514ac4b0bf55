//! The counted cost of a descriptor: how much work it is, in integers by definition and not by the clock.
//!
//! The cost of describing a cloud is the number of pairs of points that are visited times what is counted for each; the
//! cost of matching two clouds is the number of values that are compared, of which a processor does [`COMPARED_AT_ONCE`]
//! in the time of one count. What is prepared once for all descriptors of a search space costs nothing here; what a
//! family computes anew for each descriptor, such as normals, does.
//!
//! Costs are of a nominal cloud, so that they are known before any cloud is. Its numbers are the means over
//! `household-rgbd`. One count takes a processor about a nanosecond and a half.

use crate::disk_ring::Parameters;
use crate::fixed::{FixedDescriptor, FixedKind};

/// Points of the nominal cloud.
const POINTS: u64 = 2_000;
/// Its keypoints.
const KEYPOINTS: u64 = 60;
/// Points within 1 cm of a point.
const WITHIN_A_CENTIMETRE: u64 = 25;
/// Radius of the neighbourhoods that normals are fitted to, micrometres.
const NORMAL_RADIUS_UM: u32 = 10_000;
/// Values of two signatures that are compared in the time of one count.
const COMPARED_AT_ONCE: u64 = 8;

/// Points of the nominal cloud within a radius of one of them: in proportion to the square of the radius, as on a
/// surface, up to half of the cloud.
fn within(radius_um: u32) -> u64 {
    let square = u64::from(radius_um).pow(2) * WITHIN_A_CENTIMETRE / 10_000u64.pow(2);
    square.clamp(1, POINTS / 2)
}

/// Describing a cloud: angle and colour of every neighbour within R2 of a keypoint.
pub(crate) fn disk_ring(parameters: &Parameters) -> u64 {
    KEYPOINTS * within(parameters.ring_um) * (1 + u64::from(parameters.has_colour()))
}

/// Describing a cloud, which has its normals fitted anew: all pairs of the points within the radius of a keypoint, with
/// angles and ratios; or these points, with cosine and colour, each in up to five bins.
pub(crate) fn fixed(descriptor: &FixedDescriptor) -> u64 {
    let normals = (POINTS + KEYPOINTS) * within(NORMAL_RADIUS_UM);
    let near = within(descriptor.radius_um);
    normals
        + match descriptor.kind {
            FixedKind::PfhRgb => KEYPOINTS * (near * (near - 1) / 2) * 2,
            FixedKind::ShotColor => KEYPOINTS * near * 2 * 5,
        }
}

/// Describing a cloud: the hue of every point.
pub(crate) fn global_hue() -> u64 {
    POINTS
}

/// Of so many clouds, each described at a cost, and so many pairs of clouds, each with so many values.
pub(crate) fn total(describing: u64, clouds: u64, values: u64, pairs: u64) -> u64 {
    let compared = u128::from(pairs) * u128::from(values) / u128::from(COMPARED_AT_ONCE);
    u64::try_from(u128::from(describing) * u128::from(clouds) + compared).unwrap_or(u64::MAX)
}
