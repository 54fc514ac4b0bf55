//! Structures for tests, from anything that a file may say.

use proptest::prelude::*;
use proptest::sample::{Index, select, subsequence};

use crate::FieldSpec;
use crate::distance::SetDistance;
use crate::structure::{Axis, Feature, Pairs, Scale, Structure, StructureChannel, StructureSpace, Weighted};

/// Most values of a channel that may have weights, so that eight channels together stay within a structure's limit.
const MOST_WEIGHTS: usize = Structure::MAX_VALUE_WEIGHTS / 8;

/// A channel that any experiment may use.
fn channel() -> impl Strategy<Value = StructureChannel> {
    let bins = || prop_oneof![2u32..=6, 2u32..=64];
    let axes = (subsequence(Feature::ALL.to_vec(), 1..=8).prop_shuffle(), prop::collection::vec(bins(), 8));
    let lengths = (
        prop_oneof![Just(50_000u32), 1u32..=1_000_000],
        prop::collection::vec(any::<Index>(), 0..=8),
        1_000u32..=1_000_000,
    );
    let least = prop::option::of(any::<Index>());
    let numbers = (1u32..=10_000, 0u32..=65_536, least);
    let switches = (any::<bool>(), any::<bool>(), any::<bool>(), any::<bool>());
    let weights = prop::option::of(prop::collection::vec(0..StructureChannel::FULL, MOST_WEIGHTS));
    let parts = (select(&Pairs::ALL), axes, lengths, numbers, switches, select(&SetDistance::ALL));
    (parts.prop_map(made_of), weights).prop_map(|(mut made, weights)| {
        // The largest weight is 1, so that one value alone has none.
        if let Some(mut weights) = weights.filter(|_| (2..=MOST_WEIGHTS as u64).contains(&made.values())) {
            weights.truncate(made.values() as usize);
            let largest = usize::from(weights[0]) % weights.len();
            weights[largest] = StructureChannel::FULL;
            made.value_weights = weights;
        }
        made
    })
}

type Parts = (
    Pairs,
    (Vec<Feature>, Vec<u32>),
    (u32, Vec<Index>, u32),
    (u32, u32, Option<Index>),
    (bool, bool, bool, bool),
    SetDistance,
);

fn made_of(
    (pairs, (features, bins), (radius_um, bounds, grid_um), numbers, switches, metric): Parts,
) -> StructureChannel {
    let (squash_milli, samples, least) = numbers;
    let (is_joint, full_turn, oriented, all_keypoints) = switches;
    let axis = |(&feature, bins)| Axis { feature, bins, full_turn: full_turn && feature == Feature::Angle };
    let mut made = StructureChannel {
        pairs,
        axes: features.iter().zip(bins).map(axis).collect(),
        is_joint: is_joint || features.len() == 1,
        squash_milli,
        radius_um,
        shells_um: Vec::new(),
        least_um: 0,
        grid_um: if pairs == Pairs::Cloud { 0 } else { grid_um },
        samples: if pairs.is_sampled() { samples } else { 0 },
        oriented: oriented && !features.iter().any(|feature| feature.needs_normals()),
        all_keypoints: false,
        metric,
        value_weights: Vec::new(),
    };
    if !made.is_squashed() {
        made.squash_milli = 0;
    }
    made.all_keypoints = all_keypoints && pairs == Pairs::Neighbours && made.needs_normals();
    let longest = made.longest_um();
    made.shells_um = bounds.iter().map(|bound| 1 + bound.index(longest as usize) as u32).collect();
    made.shells_um.sort_unstable();
    made.shells_um.dedup();
    if made.shells_um.is_empty() {
        made.shells_um = made.equal_shells(squash_milli % 5 + 1);
        if made.check().is_err() {
            made.shells_um = vec![longest];
        }
    }
    if let (Some(least), Some(&last)) = (least, made.shells_um.last()) {
        made.least_um = least.index(last as usize) as u32;
    }
    // One histogram for each feature is small enough whatever they are.
    made.is_joint &= made.axes.len() == 1 || made.bins() <= StructureChannel::MAX_ROW;
    made
}

/// A structure that any experiment may use.
pub(super) fn structure() -> impl Strategy<Value = Structure> {
    let weight = prop_oneof![Just(1_000_000u32), 1u32..=1_000_000_000];
    let weighted = (channel(), weight, select(&Scale::ALL))
        .prop_map(|(channel, weight_ppm, scale)| Weighted { channel, weight_ppm, scale });
    prop::collection::vec(weighted, 1..=8).prop_map(|channels| Structure { channels })
}

/// A space that may be searched.
pub(super) fn space() -> impl Strategy<Value = StructureSpace> {
    let divisions: Vec<[u32; 2]> = (1..=8).map(|slots| [slots, 1]).chain(DIVISIONS).collect();
    let more_bins = prop_oneof![0u32..60, 0u32..20_000];
    let spaces = (any::<bool>(), select(divisions), more_bins, select(&SetDistance::ALL));
    spaces.prop_map(|(colour, [slots, members], more_bins, metric)| StructureSpace {
        colour,
        slots,
        members,
        max_bins: slots * 54 + members * more_bins,
        metric,
    })
}

/// Slots and members of spaces with several members.
pub(super) const DIVISIONS: [[u32; 2]; 9] =
    [[2, 2], [3, 3], [4, 4], [5, 5], [6, 3], [6, 6], [7, 7], [8, 4], [8, 8]];

/// A space and indices of one of its structures.
pub(super) fn point() -> impl Strategy<Value = (StructureSpace, Vec<u32>)> {
    (space(), prop::collection::vec(any::<Index>(), 120)).prop_map(|(space, indices)| {
        let fields = space.fields();
        let of_field = |(field, index): (&FieldSpec, &Index)| index.index(field.values as usize) as u32;
        let indices = fields.iter().zip(&indices).map(of_field).collect();
        (space, indices)
    })
}

/// The same numbers but for one, which is another, and close to what it was or a small code as often as not.
pub(super) fn altered(mut numbers: Vec<u32>, place: Index, by: u32, to: u32) -> Vec<u32> {
    let place = place.index(numbers.len());
    let before = numbers[place];
    numbers[place] = if by == 0 { to } else { before.wrapping_add(by).wrapping_sub(4) };
    if numbers[place] == before {
        numbers[place] = before ^ 1;
    }
    numbers
}

#[test]
fn any_structure_may_be_used() {
    proptest!(|(structure in structure())| prop_assert_eq!(structure.check(), Ok(())));
}
