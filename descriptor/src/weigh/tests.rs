//! Weights of values are those of their definition.

use proptest::prelude::*;

use super::testing::{noise, signatures};
use super::*;
use crate::structure::{Axis, Feature, Pairs};

/// Channels of three values a cloud and of two with deviations, compared by a metric.
fn structure(metric: SetDistance, scale: Scale) -> Structure {
    let channel = |pairs, bins, weight_ppm| {
        let channel = StructureChannel {
            pairs,
            axes: vec![Axis { feature: Feature::Distance, bins, full_turn: false }],
            is_joint: true,
            squash_milli: 0,
            radius_um: 50_000,
            shells_um: vec![50_000],
            least_um: 0,
            grid_um: if pairs == Pairs::Cloud { 0 } else { 20_000 },
            samples: 0,
            oriented: false,
            all_keypoints: false,
            metric,
            value_weights: Vec::new(),
        };
        Weighted { channel, weight_ppm, scale }
    };
    Structure { channels: vec![channel(Pairs::Cloud, 3, 1_000_000), channel(Pairs::Keypoints, 2, 250_000)] }
}

/// What is found of clouds as one set.
fn of_set<T>(
    structure: &Structure,
    clouds: &[[f32; 7]],
    objects: &[u32],
    sequences: &[Option<u32>],
    find: impl FnOnce(&[LabelledSet<'_>; 1]) -> T,
) -> T {
    let signatures = signatures(clouds);
    let channels: Vec<_> = (structure.channels.iter().zip(&signatures))
        .map(|(one, signatures)| (signatures, one.channel.metric, one.weight()))
        .collect();
    let clouds = LabelledClouds { channels: &channels, objects };
    find(&[LabelledSet { clouds, sequences, weight: 1 }])
}

fn learned(
    structure: &Structure,
    clouds: &[[f32; 7]],
    objects: &[u32],
    sequences: &[Option<u32>],
) -> Result<Structure, WeighError> {
    of_set(structure, clouds, objects, sequences, |sets| weighed(structure, sets, Weighing::Jointly))
}

/// The weights that begin, by their definition, value by value, from the distances of single pairs.
fn expected(
    structure: &Structure,
    clouds: &[[f32; 7]],
    objects: &[u32],
    sequences: &[Option<u32>],
) -> Option<Vec<f64>> {
    let metric = structure.channels[0].channel.metric;
    let term = |value: usize, a: usize, b: usize| {
        let [a, b] = [a, b].map(|cloud| f64::from(clouds[cloud][value]));
        let weight = structure.channels[usize::from(value > 2)].weight();
        weight
            * match metric {
                SetDistance::ChiSquared if a + b == 0.0 => 0.0,
                SetDistance::ChiSquared => (a - b) * (a - b) / (2.0 * (a + b)),
                SetDistance::L1 => (a - b).abs(),
                SetDistance::Hellinger => 0.5 * (a + b) - (a * b).sqrt(),
            }
    };
    let (mut same, mut others, mut seen) = ([0.0; 7], [0.0; 7], false);
    for one in 0..clouds.len() {
        let elsewhere: Vec<usize> = (0..clouds.len())
            .filter(|&it| {
                sequences[one].is_some() && sequences[it].is_some() && sequences[it] != sequences[one]
            })
            .collect();
        let mut own: Vec<usize> =
            elsewhere.iter().copied().filter(|&it| objects[it] == objects[one]).collect();
        let mut rivals: Vec<usize> =
            elsewhere.into_iter().filter(|&it| objects[it] != objects[one]).collect();
        if own.is_empty() || rivals.is_empty() {
            continue;
        }
        seen = true;
        let distance = |it: &usize| (0..7).map(|value| term(value, one, *it)).sum::<f64>();
        for side in [&mut own, &mut rivals] {
            side.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
            side.truncate(20);
        }
        for value in 0..7 {
            let mean =
                |of: &[usize]| of.iter().map(|&it| term(value, one, it)).sum::<f64>() / of.len() as f64;
            same[value] += mean(&own);
            others[value] += mean(&rivals);
        }
    }
    let smoothing = same.iter().sum::<f64>() / 7.0 / 20.0;
    let ratio = |value: usize| {
        if smoothing > 0.0 { (others[value] + smoothing) / (same[value] + smoothing) } else { 1.0 }
    };
    let weight = |value: usize| ratio(value) * ratio(value);
    seen.then(|| (0..7).map(weight).collect())
}

/// That weights begin as the definition has it and end at their products with what is found for them, but for one factor.
fn check_definition(
    structure: &Structure,
    clouds: &[[f32; 7]],
    objects: &[u32],
    sequences: &[Option<u32>],
) -> Result<(), TestCaseError> {
    let found = learned(structure, clouds, objects, sequences);
    let Some(expected) = expected(structure, clouds, objects, sequences) else {
        prop_assert!(matches!(found, Err(WeighError::Sequences | WeighError::Objects)), "{:?}", found);
        return Ok(());
    };
    let found = found.unwrap();
    prop_assert_eq!(found.check(), Ok(()));
    let (begun, factors) = of_set(structure, clouds, objects, sequences, |sets| {
        let (differences, taught) = Differences::of_all(sets).unwrap();
        let begun = differences.weights();
        let factors = factors(&taught, &begun);
        (begun, factors)
    });
    for (begun, expected) in begun.iter().zip(&expected) {
        prop_assert!((begun - expected).abs() <= 1e-9 * expected, "{begun} {expected}");
    }
    let expected: Vec<f64> = expected.iter().zip(factors).map(|(begun, factor)| begun * factor).collect();
    let product = |value: usize| {
        let (channel, first) = if value < 3 { (0, 0) } else { (1, 3) };
        let one = &found.channels[channel];
        let share = one.channel.value_weights.get(value - first).map_or(1.0, |&it| f64::from(it) / 1e4);
        share * one.weight() / structure.channels[channel].weight()
    };
    let products: Vec<f64> = (0..7).map(product).collect();
    let factor = products.iter().sum::<f64>() / expected.iter().sum::<f64>();
    for (value, (product, expected)) in products.iter().zip(&expected).enumerate() {
        // Of a share to a ten-thousandth, of a weight to a millionth; and of seven shares in the factor, whose sum is at least
        // as large as the largest.
        let largest = found.channels[usize::from(value > 2)].weight() * 4.0;
        let rounding = 1e-4 * largest + 1e-5 + 4e-4 * expected * factor;
        prop_assert!(
            (product - expected * factor).abs() <= rounding,
            "{}: {:?} {:?}",
            value,
            products,
            expected
        );
    }
    Ok(())
}

proptest! {
    #[test]
    fn weights_are_their_definition(
        clouds in prop::collection::vec(prop::array::uniform7(0.0f32..1.0), 2..24),
        labels in prop::collection::vec((0u32..3, prop::option::weighted(0.9, 0u32..3)), 24),
        metric in prop::sample::select(&SetDistance::ALL),
    ) {
        let (objects, sequences): (Vec<u32>, Vec<Option<u32>>) = labels.into_iter().take(clouds.len()).unzip();
        check_definition(&structure(metric, Scale::None), &clouds, &objects, &sequences)?;
    }
}

/// Of each cloud 27 in the other sequence show other objects.
#[test]
fn the_nearest_rivals_count_and_others_do_not() {
    let clouds: Vec<[f32; 7]> = (0..60).map(noise).collect();
    let (objects, sequences): (Vec<u32>, Vec<Option<u32>>) =
        (0..60).map(|cloud| (cloud % 10, Some(cloud / 10 % 2))).unzip();
    for metric in SetDistance::ALL {
        check_definition(&structure(metric, Scale::None), &clouds, &objects, &sequences).unwrap();
    }
}

/// Two objects in two sequences: the first value tells them apart, the second tells sequences apart, others are alike.
const CLOUDS: [[f32; 7]; 4] = [
    [0.125, 0.25, 0.5, 0.5, 0.5, 0.5, 0.5],
    [0.125, 0.75, 0.5, 0.5, 0.5, 0.5, 0.5],
    [0.1875, 0.25, 0.5, 0.5, 0.5, 0.5, 0.5],
    [0.1875, 0.75, 0.5, 0.5, 0.5, 0.5, 0.5],
];

#[test]
fn what_tells_objects_apart_counts_and_what_tells_sequences_apart_hardly() {
    let sequences = [Some(0), Some(1), Some(0), Some(1)];
    let found =
        learned(&structure(SetDistance::L1, Scale::None), &CLOUDS, &[0, 0, 1, 1], &sequences).unwrap();
    // s is 4 × 1/2 of the second value and 0 of the others, o 4 × 1/16 of the first, 4 × 1/2 of the second and 0 of the
    // others, and f is 2/7/20: weights are (18.5)² of the first value and 1 of the others.
    assert_eq!(found.channels[0].channel.value_weights, [10_000, 29, 29]);
    assert!(found.channels[1].channel.value_weights.is_empty());
    assert_eq!([0, 1].map(|channel| found.channels[channel].weight_ppm), [342_250_000, 250_000]);
}

#[test]
fn a_channel_that_is_scaled_adds_as_much_as_without() {
    let sequences = [Some(0), Some(1), Some(0), Some(1)];
    let weighed =
        |scale| learned(&structure(SetDistance::L1, scale), &CLOUDS, &[0, 0, 1, 1], &sequences).unwrap();
    let [plain, scaled] = [Scale::None, Scale::Quantile].map(|scale| weighed(scale).channels[0].clone());
    assert_eq!(plain.channel, scaled.channel);
    // A twentieth of six is the shortest distance: before of clouds that differ in the first value, now of those that
    // differ in the second.
    let ratio = scaled.weight() / plain.weight();
    assert!((ratio - 0.5 * 0.0029 / 0.0625).abs() < 1e-6, "{ratio}");
}

#[test]
fn sets_count_alike_but_for_their_weights_and_those_that_teach_nothing_not_at_all() {
    let structure = structure(SetDistance::ChiSquared, Scale::Quantile);
    let clouds: Vec<[f32; 7]> = (0..24).map(noise).collect();
    let (objects, sequences): (Vec<u32>, Vec<Option<u32>>) =
        (0..24).map(|cloud| (cloud % 3, Some(cloud / 3 % 2))).unzip();
    // Each twice: as many again, which say the same.
    let twice = |clouds: &[[f32; 7]]| [clouds, clouds].concat();
    let [few, many, other] = [clouds[..12].to_vec(), twice(&clouds[..12]), clouds[12..].to_vec()];
    let weighed = |sets: &[(&[[f32; 7]], u32, bool)]| {
        let signatures: Vec<_> = sets.iter().map(|(clouds, ..)| signatures(clouds)).collect();
        let channels: Vec<Vec<_>> = signatures
            .iter()
            .map(|set| {
                let channels = structure.channels.iter().zip(set);
                channels.map(|(one, clouds)| (clouds, one.channel.metric, one.weight())).collect()
            })
            .collect();
        let (objects, sequences, none) = (objects.repeat(2), sequences.repeat(2), vec![None; 48]);
        let labelled: Vec<LabelledSet<'_>> = (sets.iter().zip(&channels))
            .map(|(&(clouds, weight, is_known), channels)| LabelledSet {
                clouds: LabelledClouds { channels, objects: &objects[..clouds.len()] },
                sequences: &(if is_known { &sequences } else { &none })[..clouds.len()],
                weight,
            })
            .collect();
        let begun = Differences::of_all(&labelled).unwrap().0.weights();
        (super::weighed(&structure, &labelled, Weighing::Jointly).unwrap(), begun)
    };
    let shares = |structure: &Structure| -> Vec<u16> {
        structure.channels.iter().flat_map(|one| one.channel.value_weights.clone()).collect()
    };
    let one = weighed(&[(&few, 1, true)]);
    for same in [
        weighed(&[(&few, 1, true), (&few, 1, true)]),
        weighed(&[(&few, 3, true), (&few, 3, true)]),
        weighed(&[(&few, 1, true), (&clouds[12..], 1, false)]),
    ] {
        assert_eq!(same.0, one.0);
    }
    let (both, begun) = weighed(&[(&few, 1, true), (&other, 1, true)]);
    assert_ne!(shares(&both), shares(&one.0));
    assert_ne!(shares(&weighed(&[(&few, 1, true), (&other, 2, true)]).0), shares(&both));
    // Twice the clouds do not make a set count twice, but for rounding; of twice as many, the ridge holds less.
    let (_, repeated) = weighed(&[(&many, 1, true), (&other, 1, true)]);
    assert!(repeated.iter().zip(&begun).all(|(a, b)| (a - b).abs() < 1e-9 * b), "{repeated:?} {begun:?}");
}

/// A channel whose values differ within objects only, and two that differ but between them.
#[test]
fn a_channel_that_is_of_no_use_keeps_a_largest_weight() {
    let clouds: Vec<[f32; 7]> = (0..40)
        .map(|cloud| {
            let [misleads, helps] = [cloud / 2 % 10, cloud % 2].map(|place| 0.1 + 0.05 * place as f32);
            [misleads, misleads, 0.9 - misleads, 0.5, 0.2 + 0.1 * helps, 0.5, 0.5]
        })
        .collect();
    let (objects, sequences): (Vec<u32>, Vec<Option<u32>>) =
        (0..40).map(|cloud| (cloud % 2, Some(cloud / 20))).unzip();
    for metric in SetDistance::ALL {
        let found = learned(&structure(metric, Scale::Quantile), &clouds, &objects, &sequences).unwrap();
        assert_eq!(found.check(), Ok(()), "{found:?}");
    }
}

#[test]
fn what_teaches_nothing_is_refused() {
    let plain = structure(SetDistance::ChiSquared, Scale::Quantile);
    let by = |objects: [u32; 4], sequences: [Option<u32>; 4]| learned(&plain, &CLOUDS, &objects, &sequences);
    let two = [Some(0), Some(1), Some(0), Some(1)];
    for (objects, sequences, error) in [
        ([0, 0, 1, 1], [None; 4], WeighError::Sequences),
        ([0, 0, 1, 1], [Some(3); 4], WeighError::Sequences),
        ([0, 1, 2, 3], two, WeighError::Sequences),
        ([0; 4], two, WeighError::Objects),
    ] {
        assert_eq!(by(objects, sequences), Err(error));
    }
    let found = by([0, 0, 1, 1], two).unwrap();
    assert_eq!(learned(&found, &CLOUDS, &[0, 0, 1, 1], &two), Err(WeighError::Weighted));
    let mut large = plain.clone();
    large.channels[1].channel.axes[0].bins = 64;
    large.channels[1].channel.shells_um = (1..=8).map(|shell| shell * 6_000).collect();
    assert_eq!(learned(&large, &CLOUDS, &[0, 0, 1, 1], &two), Err(WeighError::Values { got: 3 + 1024 }));
}
