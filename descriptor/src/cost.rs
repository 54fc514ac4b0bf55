//! The counted cost of a descriptor: how much work it is, in integers by definition and not by the clock.
//!
//! The cost of describing a cloud is the number of pairs of points that are visited times what is counted or summed for
//! each, plus the values of all histograms, which are summed twice for centroid and deviation. The cost of matching two
//! clouds is the number of values that are compared, of which [`COMPARED_AT_ONCE`] take as long as one count. What is
//! prepared once for all descriptors of a search space costs nothing; what is computed anew for each, such as the
//! normals of [`FixedDescriptor`], does.
//!
//! Costs are of a nominal cloud, so that they are known before any cloud is. Its numbers are means over train1 of
//! `household-rgbd`. One count takes about a nanosecond: a cloud of the paper's best descriptor 60 µs, a pair 60 ns.

use crate::disk_ring::Parameters;
use crate::fixed::{FixedDescriptor, FixedKind};
use crate::structure::{Pairs, Structure};

/// Points of the nominal cloud.
const POINTS: u64 = 1650;
/// Its keypoints.
const KEYPOINTS: u64 = 53;
/// Edge of the voxels of which these are the centroids, micrometres.
const GRID_UM: u64 = 20_000;
/// Points within 1 cm of one of them.
const WITHIN_A_CENTIMETRE: u64 = 35;
/// Radius of the neighbourhoods that normals are fitted to, micrometres.
const NORMAL_RADIUS_UM: u32 = 10_000;
/// Ten sums over a neighbourhood that a plane is fitted with take as long as so many counts.
const COUNTS_OF_A_NORMAL: u64 = 3;
/// What PFHRGB takes of an unordered pair of points: three angles and three ratios, in both orders.
const FEATURES_OF_A_PAIR: u64 = 12;
/// What SHOTCOLOR takes of a neighbour: five votes in each of two histograms, …
const VOTES: u64 = 10;
/// … each with a weight that takes as long as so many counts.
const COUNTS_OF_A_VOTE: u64 = 8;
/// Values of two signatures that are compared in the time of one count.
const COMPARED_AT_ONCE: u64 = 6;

/// Points of the nominal cloud within a radius of one of them: in proportion to the square of the radius, as on a
/// surface, up to the whole cloud.
fn within(radius_um: u32) -> u64 {
    let square = u64::from(radius_um).pow(2) * WITHIN_A_CENTIMETRE / 10_000u64.pow(2);
    square.clamp(1, POINTS)
}

/// Describing a cloud: angle and colour of every neighbour within R2 of a keypoint; `values` a keypoint.
pub(crate) fn disk_ring(parameters: &Parameters, values: u64) -> u64 {
    let features = 1 + u64::from(parameters.has_colour());
    let of_keypoint = (within(parameters.ring_um) * features).saturating_add(values.saturating_mul(2));
    KEYPOINTS.saturating_mul(of_keypoint)
}

/// Describing a cloud, whose normals are fitted anew: all pairs of the points within the radius of a keypoint, or votes
/// of these points.
pub(crate) fn fixed(descriptor: &FixedDescriptor) -> u64 {
    let normals = (POINTS + KEYPOINTS) * within(NORMAL_RADIUS_UM) * COUNTS_OF_A_NORMAL;
    let near = within(descriptor.radius_um);
    let histograms = match descriptor.kind {
        FixedKind::PfhRgb => near * (near - 1) / 2 * FEATURES_OF_A_PAIR,
        FixedKind::ShotColor => near * VOTES * COUNTS_OF_A_VOTE,
    };
    normals + KEYPOINTS * (histograms + 2 * descriptor.kind.size() as u64)
}

/// Describing a cloud: the hue of every point.
pub(crate) fn global_hue() -> u64 {
    POINTS
}

/// Describing a cloud: every feature of every pair that is visited, in each channel, and where a channel needs normals
/// those of all points and keypoints.
pub(crate) fn structure(structure: &Structure) -> u64 {
    let channels = structure.channels.iter().map(|one| &one.channel);
    let describing = channels.clone().map(|channel| {
        let keypoints = keypoints(channel.grid_um);
        let near = within(channel.radius_um);
        let drawn = |points: u64| match u64::from(channel.samples) {
            0 => points * (points - 1),
            samples => samples.min(points * (points - 1)),
        };
        let (rows, pairs) = match channel.pairs {
            Pairs::KeypointNeighbour => (keypoints, keypoints * near),
            Pairs::Neighbours => (keypoints, keypoints * drawn(near)),
            Pairs::Keypoints => (keypoints, keypoints * (keypoints * near).div_ceil(POINTS)),
            Pairs::Cloud => (1, drawn(POINTS)),
        };
        // One more for finding the pair and its distance.
        let features = channel.axes.len() as u64 + 1;
        pairs.saturating_mul(features).saturating_add(rows.saturating_mul(2 * channel.bins()))
    });
    let finest =
        channels.filter(|channel| channel.needs_normals()).map(|channel| keypoints(channel.grid_um)).max();
    let normals = finest.map_or(0, |keypoints| {
        (POINTS + keypoints).saturating_mul(within(NORMAL_RADIUS_UM) * COUNTS_OF_A_NORMAL)
    });
    describing.fold(normals, u64::saturating_add)
}

/// Keypoints of the nominal cloud on a grid: in inverse proportion to the square of its edge; none without a grid.
fn keypoints(grid_um: u32) -> u64 {
    if grid_um == 0 {
        return 0;
    }
    (KEYPOINTS * GRID_UM.pow(2) / u64::from(grid_um).pow(2)).clamp(1, POINTS)
}

/// Of so many clouds, each described at a cost, and so many pairs of clouds, each with so many values.
pub(crate) fn total(describing: u64, clouds: u64, values: u64, pairs: u64) -> u64 {
    let compared = u128::from(pairs) * u128::from(values) / u128::from(COMPARED_AT_ONCE);
    let cost = (u128::from(describing) * u128::from(clouds)).saturating_add(compared);
    u64::try_from(cost).unwrap_or(u64::MAX)
}
