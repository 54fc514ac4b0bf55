//! The genes of structures: 15 fields a slot, their values, and how they appear in files and tables.

use crate::gene::GeneSpec;
use crate::structure::Pairs;

/// Most slots of a genome: most channels that a search gives a structure.
pub(super) const SLOTS: usize = 8;

/// Slots of a genome unless an experiment says otherwise, and the least that tables have columns for.
pub(super) const DEFAULT_SLOTS: usize = 4;

/// Genes of a slot.
pub(super) const FIELDS: usize = 15;

/// Positions in a slot of the genes whose values have no order: active, pairs and the three features.
pub(super) static CATEGORIES: [usize; 5] = [0, 1, 2, 3, 4];

/// Most features of a slot's channel.
pub(super) const FEATURES: usize = 3;

/// Values of the squash, thousandths.
pub(super) static SQUASHES: [u32; 6] = [100, 200, 300, 500, 800, 1200];

/// Numbers of shells.
pub(super) static SHELLS: [u32; 2] = [1, 2];

/// Smallest distances of a pair, micrometres.
pub(super) static LEAST_DISTANCES: [u32; 4] = [0, 5_000, 10_000, 20_000];

/// Edges of the keypoint grid's voxels, micrometres.
pub(super) static GRIDS: [u32; 4] = [10_000, 15_000, 20_000, 30_000];

/// Weights, millionths: 0.05·100^(k/31).
pub(super) static WEIGHTS: [u32; 32] = [
    50_000, 58_008, 67_298, 78_076, 90_580, 105_087, 121_918, 141_443, 164_096, 190_377, 220_867, 256_240,
    297_279, 344_889, 400_125, 464_207, 538_553, 624_805, 724_870, 840_962, 975_647, 1_131_902, 1_313_182,
    1_523_495, 1_767_491, 2_050_564, 2_378_972, 2_759_977, 3_202_002, 3_714_820, 4_309_768, 5_000_000,
];

/// Values of R by what a channel pairs, micrometres.
pub(super) fn radii(pairs: Pairs) -> &'static [u32; 8] {
    match pairs {
        Pairs::KeypointNeighbour | Pairs::Neighbours => {
            &[10_000, 15_000, 20_000, 25_000, 30_000, 35_000, 40_000, 50_000]
        }
        Pairs::Keypoints | Pairs::Cloud => {
            &[40_000, 60_000, 80_000, 100_000, 120_000, 160_000, 200_000, 300_000]
        }
    }
}

/// Numbers of pairs that are drawn; of pairs that are not sampled 0.
pub(super) fn samples(pairs: Pairs) -> &'static [u32; 4] {
    match pairs {
        Pairs::KeypointNeighbour | Pairs::Keypoints => &[0; 4],
        Pairs::Neighbours => &[64, 128, 256, 512],
        Pairs::Cloud => &[1024, 2048, 4096, 8192],
    }
}

const fn gene(
    name: &'static str,
    (unit, ticks_per_unit): (&'static str, u32),
    limits: (u32, u32),
    default: (u32, u32, u32),
    meaning: &'static str,
) -> GeneSpec {
    GeneSpec { name, unit, meaning, needs_colour: false, ticks_per_unit, limits, default }
}

const WHOLE: (&str, u32) = ("", 1);
const CENTIMETRES: (&str, u32) = ("cm", 10_000);

macro_rules! slot {
    ($slot:literal) => {
        [
            gene(concat!("s", $slot, "_active"), WHOLE, (0, 1), (0, 1, 1), "1 if the slot is a channel, 0 if not"),
            gene(
                concat!("s", $slot, "_pairs"),
                WHOLE,
                (0, 3),
                (0, 3, 1),
                "which pairs: 0 keypoint-neighbour, 1 neighbours, 2 keypoints, 3 cloud",
            ),
            gene(
                concat!("s", $slot, "_feature_1"),
                WHOLE,
                (0, 24),
                (0, 24, 1),
                "first feature: 0 d, 1 angle, 2 f1, 3 f2, 4 f3, 5 a2, 6 a3, 7 hue, 8 saturation, 9 value, 10 c1, \
                 11 c2, 12 w1, 13 w2, 14 L, 15 a, 16 b, 17 lr, 18 lg, 19 lb, 20 o1, 21 o2, 22 qr, 23 qg, 24 qb",
            ),
            gene(
                concat!("s", $slot, "_feature_2"),
                WHOLE,
                (0, 24),
                (0, 24, 1),
                "second feature, coded as the first; empty: none",
            ),
            gene(
                concat!("s", $slot, "_feature_3"),
                WHOLE,
                (0, 24),
                (0, 24, 1),
                "third feature, coded as the first; empty: none",
            ),
            gene(concat!("s", $slot, "_bins_1"), WHOLE, (2, 64), (3, 30, 1), "bins of the first feature"),
            gene(concat!("s", $slot, "_bins_2"), WHOLE, (2, 64), (3, 13, 1), "bins of the second feature"),
            gene(concat!("s", $slot, "_bins_3"), WHOLE, (2, 64), (3, 13, 1), "bins of the third feature"),
            gene(
                concat!("s", $slot, "_squash"),
                ("", 1000),
                (1, 10_000),
                (100, 1200, 100),
                "s of the squash of unbounded features",
            ),
            gene(
                concat!("s", $slot, "_R"),
                CENTIMETRES,
                (1, 1_000_000),
                (10_000, 300_000, 5_000),
                "radius of the neighbourhood, or longest distance of a pair",
            ),
            gene(
                concat!("s", $slot, "_shells"),
                WHOLE,
                (1, 2),
                (1, 2, 1),
                "shells by the distance of a pair, of equal width",
            ),
            gene(
                concat!("s", $slot, "_least"),
                CENTIMETRES,
                (0, 1_000_000),
                (0, 20_000, 5_000),
                "smallest distance of a pair",
            ),
            gene(
                concat!("s", $slot, "_grid"),
                CENTIMETRES,
                (1_000, 1_000_000),
                (10_000, 30_000, 5_000),
                "edge of the keypoint grid's voxels",
            ),
            gene(
                concat!("s", $slot, "_samples"),
                WHOLE,
                (1, 65_536),
                (64, 8192, 64),
                "pairs that are drawn at a keypoint, or of a cloud",
            ),
            gene(
                concat!("s", $slot, "_weight"),
                ("", 1_000_000),
                (1, 1_000_000_000),
                (50_000, 5_000_000, 1),
                "weight of the channel's distances",
            ),
        ]
    };
}

/// The genes, slot after slot: what tables say of the channels, in order, whatever slots they were decoded from.
///
/// Values of a gene need not be evenly spaced, so its default is only the interval that they lie in; a search takes
/// them from [`super::StructureSpace::fields`].
pub(super) static GENES: [[GeneSpec; FIELDS]; SLOTS] =
    [slot!(1), slot!(2), slot!(3), slot!(4), slot!(5), slot!(6), slot!(7), slot!(8)];

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::structure::Feature;

    #[test]
    fn weights_are_the_literals_of_their_formula() {
        for (k, weight) in (0..).zip(WEIGHTS) {
            let exact = 50_000.0 * libm::pow(100.0, f64::from(k) / 31.0);
            assert_eq!(f64::from(weight), exact.round(), "{k}");
            assert!((exact.fract() - 0.5).abs() > 1e-6, "{k}: too close to call");
        }
    }

    #[test]
    fn the_meanings_say_the_codes() {
        let coded = |names: Vec<&str>| {
            let codes = names.iter().enumerate().map(|(code, name)| format!("{code} {name}"));
            codes.collect::<Vec<_>>().join(", ")
        };
        let pairs = coded(Pairs::ALL.map(Pairs::name).to_vec());
        let features = coded(Feature::ALL.map(Feature::name).to_vec());
        for slot in &GENES {
            assert_eq!(slot[1].meaning, format!("which pairs: {pairs}"));
            assert_eq!(slot[2].meaning, format!("first feature: {features}"));
        }
    }

    #[test]
    fn every_value_of_a_gene_is_in_its_interval_and_its_limits() {
        let lists = |pairs| {
            [
                (8, SQUASHES.as_slice()),
                (9, radii(pairs)),
                (10, &SHELLS),
                (11, &LEAST_DISTANCES),
                (12, &GRIDS),
                (13, samples(pairs)),
                (14, &WEIGHTS),
            ]
        };
        for (field, values) in Pairs::ALL.into_iter().flat_map(lists) {
            assert!(values.is_sorted());
            for &value in values.iter().filter(|&&value| field != 13 || value != 0) {
                for spec in GENES.iter().map(|slot| &slot[field]) {
                    let (low, high, _) = spec.default;
                    assert!(low <= value && value <= high, "{}: {value}", spec.name);
                    assert!(spec.limits.0 <= low && high <= spec.limits.1, "{}", spec.name);
                }
            }
        }
        let names: BTreeSet<&str> = GENES.as_flattened().iter().map(|spec| spec.name).collect();
        assert_eq!(names.len(), SLOTS * FIELDS);
        assert_eq!((GENES[0][1].name, GENES[7][14].name), ("s1_pairs", "s8_weight"));
    }
}
