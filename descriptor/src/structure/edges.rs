//! Where the bins of features begin.
//!
//! A bin is the number of edges that a value has reached; each edge is the smallest f32 of its bin, so that comparing in
//! f32 is comparing exactly.

use std::cmp::Ordering;
use std::f64::consts::TAU;

use crate::colour::Component;
use crate::disk_ring::angle::Turn;
use crate::fixed::ratio;
use crate::neighbours::floor_f32;
use crate::structure::channel::Axis;
use crate::structure::feature::{Feature, Range};

/// Whole numbers up to this size are f32.
const EXACT: i64 = 1 << 24;

/// The edges of an axis, ascending: those of the negative cosine where the range is half a turn, in the units of
/// [`super::colours::write_values`] where it is squashed; none where edges are not what decides (`d`, `f1`).
pub(super) fn edges(axis: &Axis, squash_milli: u32) -> Vec<f32> {
    let Axis { feature, bins, full_turn } = *axis;
    let inner = 1..bins;
    match (feature, feature.range()) {
        (Feature::Hue, _) => Component::Hue.bounds(std::iter::once(bins)),
        (Feature::Saturation, _) => Component::Saturation.bounds(std::iter::once(bins)),
        (Feature::RatioRed | Feature::RatioGreen | Feature::RatioBlue, _) => {
            inner.map(|bin| ratio_edge(bin, bins)).collect()
        }
        (_, Range::HalfTurn) => {
            let (parts, edges) = if full_turn { (bins - 1, 1..axis.kept_bins()) } else { (2 * bins, inner) };
            edges.map(|bin| ceil_f32(-Turn::new(bin, parts).cosine())).collect()
        }
        (_, Range::Fixed(low, high)) => {
            let [low, high] = [low, high].map(f64::from);
            inner.map(|bin| ceil_f32(low + (high - low) * f64::from(bin) / f64::from(bins))).collect()
        }
        (_, Range::Squashed) => {
            let units = if is_doubled(feature) { 2 << 16 } else { 1 << 16 };
            inner.map(|bin| squashed_edge(bin, bins, units, squash_milli)).collect()
        }
        (_, Range::Longest | Range::FullTurn) => Vec::new(),
    }
}

/// Whether values are counted in halves, to be whole numbers.
pub(super) fn is_doubled(feature: Feature) -> bool {
    matches!(feature, Feature::C2 | Feature::W2 | Feature::O2)
}

/// ⌈units · s·y/(1 − |y|)⌉ with y = 2·bin/bins − 1: no value is as large as what does not fit an f32.
fn squashed_edge(bin: u32, bins: u32, units: i64, squash_milli: u32) -> f32 {
    let [bin, bins] = [bin, bins].map(i64::from);
    let over = i128::from(units) * i128::from(squash_milli) * i128::from(2 * bin - bins);
    let under = i128::from(1000 * (bins - (2 * bin - bins).abs()));
    let edge = -(-over).div_euclid(under);
    edge.clamp(i128::from(-EXACT), i128::from(EXACT)) as f32
}

/// The smallest ratio of a bin.
fn ratio_edge(bin: u32, bins: u32) -> f32 {
    // By halves over the numbers that stand for floats in their order.
    let (mut below, mut reached) = (order(-2.0), order(2.0));
    while below + 1 < reached {
        let middle = below + (reached - below) / 2;
        if u32::from(ratio::part(of_order(middle), bins as u8)) >= bin {
            reached = middle
        } else {
            below = middle
        }
    }
    of_order(reached)
}

/// A number that grows with a float.
fn order(value: f32) -> i64 {
    let size = i64::from(value.abs().to_bits());
    if value.total_cmp(&0.0) == Ordering::Less { -1 - size } else { size }
}

fn of_order(order: i64) -> f32 {
    if order < 0 { -f32::from_bits((-1 - order) as u32) } else { f32::from_bits(order as u32) }
}

/// The smallest f32 not below `value`.
pub(super) fn ceil_f32(value: f64) -> f32 {
    -floor_f32(-value)
}

/// The bins of an angle from −180 to 180 degrees that is given by a point.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Turns {
    /// Cosine and sine of the edges above 0 and below 180 degrees.
    pub(super) edges: Vec<[f32; 2]>,
    /// Bin of the angle 0.
    pub(super) of_zero: u32,
    /// Bin of the smallest negative angle.
    pub(super) below_zero: u32,
}

impl Turns {
    pub(super) fn new(bins: u32) -> Self {
        let half = (bins - 1) / 2;
        let angle = |bin: u32| TAU * f64::from(2 * bin - bins) / f64::from(2 * bins);
        let edge = |angle: f64| [libm::cos(angle) as f32, libm::sin(angle) as f32];
        let edges = (bins - half..bins).map(angle).map(edge).collect();
        Self { edges, of_zero: bins - 1 - half, below_zero: half }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(feature: Feature, bins: u32, squash_milli: u32) -> Vec<f32> {
        edges(&Axis { feature, bins, full_turn: false }, squash_milli)
    }

    fn bin(edges: &[f32], value: f32) -> u32 {
        edges.iter().filter(|&&edge| value >= edge).count() as u32
    }

    #[test]
    fn there_is_an_edge_between_any_two_bins() {
        for feature in Feature::ALL {
            let range = feature.range();
            for bins in 1..=64 {
                let edges = of(feature, bins, 300);
                let expected = if matches!(range, Range::Longest | Range::FullTurn) { 0 } else { bins - 1 };
                assert_eq!(edges.len() as u32, expected, "{feature}, {bins}");
                assert!(edges.is_sorted_by(|a, b| a < b), "{feature}, {bins}: {edges:?}");
            }
        }
    }

    #[test]
    fn ratios_fall_into_the_bins_that_pcl_computes() {
        for bins in [2, 3, 5, 7, 13, 64] {
            let edges = of(Feature::RatioGreen, bins, 0);
            for (one, other) in (0..=255).flat_map(|one| (0..=255).map(move |other| (one, other))) {
                let ratio = ratio::ratio(one, other);
                assert_eq!(bin(&edges, ratio), u32::from(ratio::part(ratio, bins as u8)), "{one} : {other}");
            }
        }
    }

    #[test]
    fn edges_of_what_is_squashed_are_whole_and_exact() {
        // Five bins of x/(|x| + s) begin at −3/5, −1/5, 1/5 and 3/5: x = ∓ 3s/2 and ∓ s/4.
        assert_eq!(of(Feature::LogRed, 5, 500), [-49_152.0, -8_192.0, 8_192.0, 49_152.0]);
        assert_eq!(of(Feature::O2, 5, 500), [-98_304.0, -16_384.0, 16_384.0, 98_304.0]);
        // s/4 = 0.025 is 1638.4 units, and twice as many of half the size.
        assert_eq!(of(Feature::C1, 5, 100)[1..3], [-1_638.0, 1_639.0]);
        assert_eq!(of(Feature::C2, 5, 100)[1..3], [-3_276.0, 3_277.0]);
        assert_eq!(of(Feature::W1, 2, 100), [0.0]);
        // Beyond what any value can be.
        assert_eq!(of(Feature::W1, 64, 1_000_000)[62], EXACT as f32);
    }

    #[test]
    fn the_last_bin_is_closed_and_a_value_on_an_edge_begins_a_bin() {
        for (feature, bins, value, expected) in [
            (Feature::Value, 5, 255.0, 4),
            (Feature::Value, 5, 51.0, 1),
            (Feature::Value, 5, 50.0, 0),
            (Feature::F2, 4, 1.0, 3),
            (Feature::F3, 4, 0.5, 3),
            (Feature::F3, 4, -1.000_000_1, 0),
            (Feature::L, 10, 1.0, 9),
            (Feature::B, 4, -0.5, 1),
            (Feature::Hue, 8, 45.0, 1),
            (Feature::Saturation, 4, 100.0, 3),
            // By the negative cosine.
            (Feature::Angle, 2, 0.0, 1),
            (Feature::A3, 3, -0.5, 1),
            (Feature::A2, 3, 0.5, 2),
            (Feature::Angle, 13, 1.0, 12),
        ] {
            assert_eq!(bin(&of(feature, bins, 0), value), expected, "{feature}, {bins}: {value}");
        }
    }

    #[test]
    fn bins_of_a_full_turn_end_at_half_of_it() {
        for bins in 2..=64 {
            let axis = Axis { feature: Feature::Angle, bins, full_turn: true };
            let edges = edges(&axis, 0);
            assert_eq!(edges.len() as u32 + 1, axis.kept_bins());
            assert_eq!(bin(&edges, 1.0), (bins - 1) / 2, "180 of 360 degrees, {bins}");
        }
    }
}
