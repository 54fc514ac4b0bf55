//! Weights for the values of a structure's signatures, learned from labelled clouds: a value counts for as much as it
//! tells objects apart.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use crate::database::Database;
use crate::distance::SetDistance;
use crate::recognise::Label;
use crate::recogniser::LabelledClouds;
use crate::signature::{Signature, Signatures};
use crate::structure::{Scale, Structure, StructureChannel, Weighted, scale_among};

/// Clouds of other objects that a cloud is told apart from: those that it is most easily taken for.
const RIVALS: usize = 20;

/// Additive smoothing: the share of the mean difference within objects that is added to every difference, so that values
/// that hardly ever differ do not decide.
const SMOOTHING: f64 = 0.05;

/// Why values cannot be weighed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WeighError {
    /// They have weights already.
    #[error(
        "structure: values without weights expected, got some with\nname the structure that they were found for"
    )]
    Weighted,
    /// More values than weights may be kept of.
    #[error(
        "structure: at most {} values expected, got {got}\nname a structure with fewer bins",
        Structure::MAX_VALUE_WEIGHTS
    )]
    Values {
        /// Values of all channels together.
        got: u64,
    },
    /// Nothing says what an object looks like in another sequence.
    #[error(
        "clouds: an object seen in two sequences expected, got none\nname sequences in the manifest, or lay clouds out as object_sequence_frame"
    )]
    Sequences,
    /// There is nothing to be told apart.
    #[error(
        "clouds: two objects expected that are seen in different sequences, got fewer\nadd clouds of others"
    )]
    Objects,
}

/// Labelled clouds of one set, which are compared with each other only.
#[derive(Clone, Copy, Debug)]
pub struct LabelledSet<'a> {
    /// The clouds under the structure, with what they show.
    pub clouds: LabelledClouds<'a>,
    /// Of which sequence each is; `None` where it is not known: such clouds teach nothing.
    pub sequences: &'a [Option<u32>],
    /// How much the set counts.
    pub weight: u32,
}

/// Refuses clouds of a set that teach nothing, by the objects that they show and the sequences that they are of.
///
/// # Errors
/// [`WeighError::Sequences`] or [`WeighError::Objects`]
pub fn check_clouds(objects: &[u32], sequences: &[Option<u32>]) -> Result<(), WeighError> {
    let mut seen: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
    for (&object, sequence) in objects.iter().zip(sequences) {
        if let Some(sequence) = sequence {
            seen.entry(object).or_default().insert(*sequence);
        }
    }
    if seen.values().all(|sequences| sequences.len() < 2) {
        return Err(WeighError::Sequences);
    }
    // Whatever sequence another object is in, the one that is seen twice is seen in a different one, too.
    if seen.len() < 2 { Err(WeighError::Objects) } else { Ok(()) }
}

/// A structure with weights for the values of its signatures, learned from sets of labelled clouds, by the current rayon
/// pool.
///
/// Each cloud is compared, value by value, with those of its object in other sequences, and with the 20 nearest clouds of
/// other objects in other sequences. Let s and o be the sums over the clouds of the mean terms of a value, and f a
/// twentieth of the mean of s over all values, in the proportions in which channels are added up: then the weight of the
/// value is ((o + f) / (s + f))². Of several sets, the means over their clouds are added up, each times the set's weight.
/// Weights of a channel are divided by the largest, and the weight of the channel is multiplied by as much and by what
/// changes of its scale, the mean over the sets by their weights. All channels' weights are divided by the mean of the
/// values' weights, s being their share, and by as much as the largest would be beyond [`Weighted::MAX_WEIGHT_PPM`].
/// A set that teaches nothing counts for nothing.
///
/// # Errors
/// [`WeighError`]
///
/// # Panics
/// If the clouds are not described by the structure's channels, or not all labelled: a programming error.
pub fn weighed(structure: &Structure, sets: &[LabelledSet<'_>]) -> Result<Structure, WeighError> {
    for LabelledSet { clouds, sequences, .. } in sets {
        assert_eq!(clouds.channels.len(), structure.channels.len(), "signatures of each channel");
        assert_eq!(clouds.objects.len(), sequences.len(), "labels of each cloud");
    }
    if structure.has_value_weights() {
        return Err(WeighError::Weighted);
    }
    let got = structure.signature_values();
    if got > Structure::MAX_VALUE_WEIGHTS as u64 {
        return Err(WeighError::Values { got });
    }
    let (Differences { same, others, .. }, taught) = Differences::of_all(sets)?;
    let all: f64 = same.iter().sum();
    let smoothing = SMOOTHING * all / same.len() as f64;
    let of_value = |(same, others): (&f64, &f64)| {
        // Where nothing at all differs within objects, no value is better than another.
        let ratio = if smoothing > 0.0 { (others + smoothing) / (same + smoothing) } else { 1.0 };
        ratio * ratio
    };
    let weights: Vec<f64> = same.iter().zip(&others).map(of_value).collect();
    // Distances stay about as large as they were.
    let after: f64 = same.iter().zip(&weights).map(|(same, weight)| same * weight).sum();
    let mean = if all > 0.0 { after / all } else { 1.0 };

    let mut rest = weights.as_slice();
    let mut weighted: Vec<(StructureChannel, f64)> = Vec::new();
    for (number, one) in structure.channels.iter().enumerate() {
        let (of_channel, later) = rest.split_at(one.channel.values() as usize);
        rest = later;
        let sets: Vec<(Clouds<'_>, u32)> =
            taught.iter().map(|set| (Clouds::new(&set.clouds, number), set.weight)).collect();
        let (channel, times) = weigh(one, of_channel, &sets);
        weighted.push((channel, f64::from(one.weight_ppm) * times / mean));
    }
    // Only proportions matter.
    let most = f64::from(Weighted::MAX_WEIGHT_PPM);
    let beyond = weighted.iter().fold(1.0, |beyond: f64, (_, weight)| beyond.max(weight / most));
    let channels = structure.channels.iter().zip(weighted).map(|(one, (channel, weight))| {
        let weight_ppm = (weight / beyond).round().max(1.0) as u32;
        Weighted { channel, weight_ppm, scale: one.scale }
    });
    Ok(Structure { channels: channels.collect() })
}

/// Clouds of a set in one channel.
struct Clouds<'a> {
    signatures: &'a Signatures,
    metric: SetDistance,
}

/// The channel with these weights over the largest, and what its own weight is multiplied by, so that its distances are in
/// the same proportion to others as without the scale.
fn weigh(one: &Weighted, weights: &[f64], sets: &[(Clouds<'_>, u32)]) -> (StructureChannel, f64) {
    let largest = weights.iter().copied().fold(0.0, f64::max);
    let full = f64::from(StructureChannel::FULL);
    let share = |weight: &f64| (weight / largest * full).round() as u16;
    let mut channel =
        StructureChannel { value_weights: weights.iter().map(share).collect(), ..one.channel.clone() };
    let rescaled = match one.scale {
        Scale::None => 1.0,
        Scale::Quantile => {
            let (mut sum, mut all) = (0.0, 0.0);
            for (set, weight) in sets {
                sum += f64::from(*weight) * (set.scale(Some(&channel)) / set.scale(None));
                all += f64::from(*weight);
            }
            sum / all
        }
    };
    if channel.value_weights.iter().all(|&weight| weight == StructureChannel::FULL) {
        channel.value_weights.clear();
    }
    (channel, largest * rescaled)
}

impl<'a> Clouds<'a> {
    fn new(clouds: &LabelledClouds<'a>, channel: usize) -> Self {
        let (signatures, metric, _) = clouds.channels[channel];
        Self { signatures, metric }
    }

    /// What their distances are divided by, if values have the weights of a channel.
    fn scale(&self, weighted: Option<&StructureChannel>) -> f64 {
        let Some(channel) = weighted else { return scale_among(self.metric, self.signatures) };
        scale_among(self.metric, &weighted_by(channel, self.signatures))
    }
}

/// The signatures of clouds, each value times its weight in a channel.
pub fn weighted_by(channel: &StructureChannel, signatures: &Signatures) -> Signatures {
    let weighted = |cloud| channel.weighted(signatures.signature(cloud));
    (0..signatures.clouds()).map(weighted).collect::<Vec<Signature>>().iter().collect()
}

/// How much each value differs: sums over clouds of means, channel after channel, centroid before deviation.
struct Differences {
    /// From clouds of the same object.
    same: Vec<f64>,
    /// From those of other objects that are nearest.
    others: Vec<f64>,
    /// How many clouds they are the sums of.
    clouds: usize,
}

impl Differences {
    /// As if all sets had as many clouds as the first that teaches anything, each set times its weight; and those that do.
    fn of_all<'a>(sets: &'a [LabelledSet<'a>]) -> Result<(Self, Vec<&'a LabelledSet<'a>>), WeighError> {
        let (mut all, mut taught): (Option<Self>, _) = (None, Vec::new());
        let mut refused = WeighError::Sequences;
        for set in sets {
            let found = match Self::between(set) {
                Ok(found) => found,
                Err(why) => {
                    refused = why;
                    continue;
                }
            };
            taught.push(set);
            let clouds = all.as_ref().map_or(found.clouds, |all| all.clouds);
            let share = f64::from(set.weight) * (clouds as f64 / found.clouds as f64);
            let none =
                || Self { same: vec![0.0; found.same.len()], others: vec![0.0; found.same.len()], clouds };
            let sums = all.get_or_insert_with(none);
            for (sum, of_set) in [(&mut sums.same, &found.same), (&mut sums.others, &found.others)] {
                sum.iter_mut().zip(of_set).for_each(|(sum, difference)| *sum += share * difference);
            }
        }
        all.map(|all| (all, taught)).ok_or(refused)
    }

    fn between(set: &LabelledSet<'_>) -> Result<Self, WeighError> {
        let LabelledSet { clouds: LabelledClouds { channels, objects }, sequences, .. } = *set;
        check_clouds(objects, sequences)?;
        let labels = objects.iter().map(|&instance| Label { category: 0, instance }).collect();
        let database = Database::new(channels, labels).map_err(|_| WeighError::Sequences)?;
        let means = |query: usize| -> Option<(Vec<f64>, Vec<f64>)> {
            sequences[query]?;
            let elsewhere =
                |&other: &usize| sequences[other].is_some() && sequences[other] != sequences[query];
            let (same, mut others): (Vec<usize>, Vec<usize>) =
                (0..objects.len()).filter(elsewhere).partition(|&other| objects[other] == objects[query]);
            if same.is_empty() || others.is_empty() {
                return None;
            }
            let of_query = channels.iter().map(|(signatures, ..)| signatures.signature(query));
            let distances = database.distances(&of_query.collect::<Vec<_>>());
            others.sort_by(|&a, &b| distances[a].total_cmp(&distances[b]).then(a.cmp(&b)));
            others.truncate(RIVALS);
            let mean = |of: &[usize]| mean_terms(channels, query, of);
            Some((mean(&same), mean(&others)))
        };
        let means: Vec<_> = (0..objects.len()).into_par_iter().map(means).collect();
        let values = channels.iter().map(|(signatures, ..)| signatures.get(0).concat().len()).sum();
        let mut sums = [vec![0.0; values], vec![0.0; values]];
        let mut clouds = 0;
        // In the order of the clouds.
        for (same, others) in means.into_iter().flatten() {
            clouds += 1;
            for (sum, terms) in sums.iter_mut().zip([same, others]) {
                sum.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
            }
        }
        let [same, others] = sums;
        Ok(Self { same, others, clouds })
    }
}

/// The terms of each value, mean over the distances of a cloud to others, as channels are added up.
fn mean_terms(channels: &[(&Signatures, SetDistance, f64)], query: usize, others: &[usize]) -> Vec<f64> {
    let mut means = Vec::new();
    for &(signatures, metric, factor) in channels {
        let query = signatures.get(query).concat();
        let first = means.len();
        means.resize(first + query.len(), 0.0);
        for &other in others {
            let other = signatures.get(other).concat();
            for ((mean, a), b) in means[first..].iter_mut().zip(&query).zip(other) {
                *mean += term(metric, (*a).into(), b.into()) * factor / others.len() as f64;
            }
        }
    }
    means
}

/// What two values add to a distance.
fn term(metric: SetDistance, a: f64, b: f64) -> f64 {
    match metric {
        SetDistance::ChiSquared if a + b == 0.0 => 0.0,
        SetDistance::ChiSquared => (a - b) * (a - b) / (2.0 * (a + b)),
        SetDistance::L1 => (a - b).abs(),
        SetDistance::Hellinger => {
            let difference = a.sqrt() - b.sqrt();
            difference * difference / 2.0
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

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
                metric,
                value_weights: Vec::new(),
            };
            Weighted { channel, weight_ppm, scale }
        };
        Structure {
            channels: vec![channel(Pairs::Cloud, 3, 1_000_000), channel(Pairs::Keypoints, 2, 250_000)],
        }
    }

    /// Seven values of each cloud in the two channels.
    fn signatures(clouds: &[[f32; 7]]) -> [Signatures; 2] {
        let of = |part: fn(&[f32; 7]) -> Signature| -> Signatures {
            clouds.iter().map(part).collect::<Vec<_>>().iter().collect()
        };
        [
            of(|values| Signature { centroid: values[..3].to_vec(), deviation: Vec::new() }),
            of(|values| Signature { centroid: values[3..5].to_vec(), deviation: values[5..].to_vec() }),
        ]
    }

    fn learned(
        structure: &Structure,
        clouds: &[[f32; 7]],
        objects: &[u32],
        sequences: &[Option<u32>],
    ) -> Result<Structure, WeighError> {
        let signatures = signatures(clouds);
        let channels: Vec<_> = (structure.channels.iter().zip(&signatures))
            .map(|(one, signatures)| (signatures, one.channel.metric, one.weight()))
            .collect();
        let clouds = LabelledClouds { channels: &channels, objects };
        weighed(structure, &[LabelledSet { clouds, sequences, weight: 1 }])
    }

    /// The definition, value by value, from the distances of single pairs.
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
            let own: Vec<usize> =
                elsewhere.iter().copied().filter(|&it| objects[it] == objects[one]).collect();
            let mut rivals: Vec<usize> =
                elsewhere.into_iter().filter(|&it| objects[it] != objects[one]).collect();
            if own.is_empty() || rivals.is_empty() {
                continue;
            }
            seen = true;
            let distance = |it: &usize| (0..7).map(|value| term(value, one, *it)).sum::<f64>();
            rivals.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
            rivals.truncate(20);
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

    /// That weights are those of the definition, but for one factor.
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
        let product = |value: usize| {
            let (channel, first) = if value < 3 { (0, 0) } else { (1, 3) };
            let one = &found.channels[channel];
            let share = one.channel.value_weights.get(value - first).map_or(1.0, |&it| f64::from(it) / 1e4);
            share * one.weight() / structure.channels[channel].weight()
        };
        let products: Vec<f64> = (0..7).map(product).collect();
        let factor = products.iter().sum::<f64>() / expected.iter().sum::<f64>();
        for (value, (product, expected)) in products.iter().zip(&expected).enumerate() {
            // Of a share to a ten-thousandth, of a weight to a millionth.
            let largest = found.channels[usize::from(value > 2)].weight() * 4.0;
            let rounding = 1e-4 * largest + 1e-5 + 1e-5 * expected * factor;
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

    fn noise(seed: usize) -> [f32; 7] {
        std::array::from_fn(|value| ((seed * 37 + value * 11 + seed * value * 5) % 23) as f32 / 23.0)
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
            super::weighed(&structure, &labelled).unwrap()
        };
        let shares = |structure: &Structure| -> Vec<u16> {
            structure.channels.iter().flat_map(|one| one.channel.value_weights.clone()).collect()
        };
        let one = weighed(&[(&few, 1, true)]);
        assert_eq!(weighed(&[(&few, 1, true), (&few, 1, true)]), one);
        assert_eq!(weighed(&[(&few, 3, true), (&few, 3, true)]), one);
        assert_eq!(weighed(&[(&few, 1, true), (&clouds[12..], 1, false)]), one);
        let both = shares(&weighed(&[(&few, 1, true), (&other, 1, true)]));
        assert_ne!(both, shares(&one));
        assert_ne!(shares(&weighed(&[(&few, 1, true), (&other, 2, true)])), both);
        // Twice the clouds do not make a set count twice, but for rounding.
        let repeated = shares(&weighed(&[(&many, 1, true), (&other, 1, true)]));
        assert_eq!(repeated.len(), both.len());
        assert!(repeated.iter().zip(&both).all(|(a, b)| a.abs_diff(*b) <= 1), "{repeated:?} {both:?}");
    }

    #[test]
    fn what_teaches_nothing_is_refused() {
        let plain = structure(SetDistance::ChiSquared, Scale::Quantile);
        let by =
            |objects: [u32; 4], sequences: [Option<u32>; 4]| learned(&plain, &CLOUDS, &objects, &sequences);
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
}
