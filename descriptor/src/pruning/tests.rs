//! What is found by pruning is what is found without, and takes fewer terms.

use std::borrow::Cow;

use proptest::prelude::*;
use rand::RngExt;

use crate::distance::{DistanceMatrix, SetDistance, set_distances};
use crate::pruning::gathered::ROWS;
use crate::pruning::{PrunedDatabase, Ranked, Scratch};
use crate::random::stream;
use crate::recognise::{Hit, Label, Match, RecogniseError, recognise_from};
use crate::signature::{Signature, Signatures};
use crate::testing::unit;
use crate::transposed::LANES;

/// Lengths of a centroid and of a deviation, a metric and a weight.
type Channel = ([usize; 2], SetDistance, f64);

fn channels() -> impl Strategy<Value = Vec<Channel>> {
    let lengths = (0usize..150, any::<bool>())
        .prop_map(|(bins, has_deviation)| [bins, if has_deviation { bins } else { 0 }]);
    let weight = prop_oneof![Just(0.0), Just(1.0), 1e-12f64..1e-9, 0.01f64..3.0, 1e6f64..1e12];
    let metric = prop::sample::select(SetDistance::ALL.to_vec());
    prop::collection::vec((lengths, metric, weight), 1..4)
}

/// Signatures in each channel of clouds that show some objects: histograms with zeros, copies and near copies of each other.
fn clouds(seed: u64, purpose: &str, channels: &[Channel], count: usize) -> Vec<Signatures> {
    let mut rng = stream(seed, purpose, &[]);
    let mut of_channel = |&([bins, deviations], ..): &Channel| -> Signatures {
        let mut all: Vec<Signature> = Vec::new();
        for cloud in 0..count {
            let mut values = |length: usize| -> Vec<f32> {
                let kind = rng.random::<u32>() % 4;
                (0..length)
                    .map(|_| match (kind, rng.random::<u32>() % 3) {
                        (0, _) | (_, 0) => 0.0,
                        (1, _) => (unit(&mut rng) * 3.0).floor() / 2.0,
                        (2, _) => unit(&mut rng) / length as f32,
                        _ => unit(&mut rng) * unit(&mut rng) * 1e-18,
                    })
                    .collect()
            };
            let drawn = Signature { centroid: values(bins), deviation: values(deviations) };
            let earlier =
                cloud.checked_sub(1).map(|last| all[rng.random::<u64>() as usize % (last + 1)].clone());
            all.push(match (earlier, rng.random::<u32>() % 4) {
                (Some(same), 0) => same,
                (Some(mut near), 1) => {
                    for value in near.centroid.iter_mut().chain(&mut near.deviation) {
                        *value *= 1.0 + 1e-6 * (unit(&mut rng) - 0.5);
                    }
                    near
                }
                _ => drawn,
            });
        }
        all.iter().collect()
    };
    channels.iter().map(&mut of_channel).collect()
}

fn labels(seed: u64, clouds: usize, objects: u32) -> Vec<Label> {
    let mut rng = stream(seed, "labels", &[]);
    (0..clouds).map(|_| Label { category: 0, instance: rng.random::<u32>() % objects }).collect()
}

fn pruned<'a>(channels: &[Channel], known: &'a [Signatures], labels: &[Label]) -> PrunedDatabase<'a> {
    let own = known.iter().zip(channels);
    let own = own.map(|(known, &(_, metric, weight))| (Cow::Borrowed(known), metric, weight));
    PrunedDatabase::new(own.collect(), labels).unwrap()
}

fn matrices(channels: &[Channel], asked: &[Signatures], known: &[Signatures]) -> Vec<(DistanceMatrix, f64)> {
    let sides = asked.iter().zip(known);
    let matrix = |(&(_, metric, weight), (asked, known)): (&Channel, (&Signatures, &Signatures))| {
        (DistanceMatrix::by(metric, asked, known), weight)
    };
    channels.iter().zip(sides).map(matrix).collect()
}

fn in_full(channels: &[Channel], asked: &[Signatures], known: &[Signatures], labels: &[Label]) -> Vec<Match> {
    recognise_from(asked[0].clouds(), &matrices(channels, asked, known), labels).unwrap()
}

fn bits(found: &[Match]) -> Vec<[Option<(u32, u64)>; 2]> {
    let of = |hit: Hit| (hit.index, hit.distance.to_bits());
    found.iter().map(|found| [Some(of(found.nearest)), found.runner_up.map(of)]).collect()
}

fn assert_equal(channels: &[Channel], asked: &[Signatures], known: &[Signatures], labels: &[Label]) {
    let expected = in_full(channels, asked, known, labels);
    let database = pruned(channels, known, labels);
    let asked: Vec<&Signatures> = asked.iter().collect();
    let (got, _) = database.recognise(&asked, true);
    assert_eq!(bits(&got), bits(&expected));
    let (nearest, _) = database.recognise(&asked, false);
    let alone: Vec<Match> = expected.iter().map(|found| Match { runner_up: None, ..*found }).collect();
    assert_eq!(bits(&nearest), bits(&alone));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn what_is_found_is_what_recognition_in_full_finds(
        channels in channels(),
        seed in any::<u64>(),
        count in 1usize..=70,
        objects in prop_oneof![Just(1u32), 2u32..12],
    ) {
        let known = clouds(seed, "known", &channels, count);
        let mut asked = clouds(seed, "asked", &channels, 5);
        // Clouds of the database are asked for, too.
        asked.iter_mut().zip(&known).for_each(|(asked, known)| asked.append(&known.first(3)));
        assert_equal(&channels, &asked, &known, &labels(seed, count, objects));
    }

    #[test]
    fn no_bound_is_above_the_limit_of_its_distance(
        channels in channels(),
        seed in any::<u64>(),
        count in 1usize..=40,
    ) {
        let [known, asked] = ["known", "asked"].map(|purpose| clouds(seed, purpose, &channels, count));
        let database = pruned(&channels, &known, &labels(seed, count, 3));
        let matrices = matrices(&channels, &asked, &known);
        let mut distances = Vec::new();
        for query in 0..count {
            let Some(bounds) = &database.bounds else { break };
            let values: Vec<[&[f32]; 2]> = asked.iter().map(|channel| channel.get(query)).collect();
            let Some(merged) = bounds.query(&values) else { continue };
            set_distances(&matrices, query, &mut distances);
            let mut row = vec![[0.0; LANES]; count.div_ceil(LANES)];
            bounds.coarse(&merged, &mut row, &mut Vec::new());
            for (cloud, &distance) in distances.iter().enumerate() {
                let limit = bounds.limit(&merged, distance);
                prop_assert!(row.as_flattened()[cloud] <= limit, "coarse, {distance}");
                prop_assert!(bounds.fine(&merged, &[cloud as u32; ROWS]).0[0] <= limit, "fine, {distance}");
            }
        }
    }

    #[test]
    fn a_ranking_has_each_of_the_nearest_objects_once(
        seed in any::<u64>(),
        count in 1usize..=70,
        objects in 1u32..12,
        most in 0usize..14,
    ) {
        let channels = [([20, 20], SetDistance::ChiSquared, 0.3), ([9, 0], SetDistance::Hellinger, 0.7)];
        let [known, asked] = ["known", "asked"].map(|purpose| clouds(seed, purpose, &channels, count));
        let labels = labels(seed, count, objects);
        let own = known.iter().zip(channels).map(|(known, (_, metric, weight))| (known, metric, weight));
        let plain = crate::Database::new(&own.collect::<Vec<_>>(), labels.clone()).unwrap();
        let query: Vec<[&[f32]; 2]> = asked.iter().map(|channel| channel.get(0)).collect();
        let owned = |[centroid, deviation]: [&[f32]; 2]| {
            Signature { centroid: centroid.to_vec(), deviation: deviation.to_vec() }
        };
        let expected = plain.ranking(&query.iter().copied().map(owned).collect::<Vec<_>>(), most);
        let Ranked { hits, .. } = pruned(&channels, &known, &labels).ranking(&query, most, &mut Scratch::default());
        prop_assert_eq!(hits, expected);
    }
}

/// Objects that are each a histogram of their own, seen by clouds that differ by smooth changes of it.
fn clustered(purpose: &str, objects: u32, views: u32, bins: usize) -> (Vec<Signatures>, Vec<Label>) {
    let mut labels = Vec::new();
    let mut all = Vec::new();
    let mut rng = stream(7, purpose, &[]);
    for instance in 0..objects {
        let mut own = stream(7, "objects", &[u64::from(instance)]);
        let shape: Vec<f32> = (0..bins / 8).map(|_| unit(&mut own) * unit(&mut own)).collect();
        for _ in 0..views {
            let change: Vec<f32> = (0..bins / 8).map(|_| 0.2 * unit(&mut rng)).collect();
            let values: Vec<f32> = (0..bins)
                .map(|bin| shape[bin / 8] * (1.0 + change[bin / 8]) * (1.0 + 0.05 * unit(&mut rng)))
                .collect();
            let sum: f32 = values.iter().sum();
            let centroid: Vec<f32> = values.iter().map(|value| value / sum).collect();
            let deviation = centroid.iter().map(|value| value * 0.5).collect();
            all.push(Signature { centroid, deviation });
            labels.push(Label { category: 0, instance });
        }
    }
    (vec![all.iter().collect()], labels)
}

#[test]
fn clustered_clouds_take_less_than_a_fifth_of_the_terms() {
    let (known, labels) = clustered("known", 40, 50, 128);
    let (asked, _) = clustered("asked", 40, 8, 128);
    for metric in SetDistance::ALL {
        let channels = [([128, 128], metric, 0.7)];
        assert_equal(&channels, &asked, &known, &labels);
        let database = pruned(&channels, &known, &labels);
        let full = 320 * database.terms_in_full();
        assert_eq!(full, 320 * 2000 * 256);
        for runner_up in [false, true] {
            let (_, terms) = database.recognise(&[&asked[0]], runner_up);
            assert!(5 * (terms + database.terms()) < full, "{metric:?} {runner_up}: {terms} of {full}");
        }
    }
}

#[test]
fn results_and_terms_do_not_depend_on_threads() {
    let (known, labels) = clustered("known", 10, 20, 64);
    let (asked, _) = clustered("asked", 10, 4, 64);
    let database = pruned(&[([64, 64], SetDistance::ChiSquared, 1.0)], &known, &labels);
    let by = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| database.recognise(&[&asked[0]], true))
    };
    assert_eq!(by(1), by(3));
}

#[test]
fn values_and_weights_without_bounds_are_compared_in_full() {
    for value in [-0.25, f32::NAN, f32::INFINITY, 1e20] {
        for side in 0..2 {
            let channels = [([6, 6], SetDistance::ChiSquared, 0.5)];
            let mut sides = ["known", "asked"].map(|purpose| clouds(3, purpose, &channels, 20));
            sides[side][0].values[30] = value;
            assert_equal(&channels, &sides[1], &sides[0], &labels(3, 20, 4));
        }
    }
    for weight in [-1.0, -0.0, f64::INFINITY, f64::NAN, 1e300, 1e-300] {
        let channels = [([6, 6], SetDistance::ChiSquared, weight), ([4, 0], SetDistance::L1, 1.0)];
        let [known, asked] = ["known", "asked"].map(|purpose| clouds(3, purpose, &channels, 20));
        assert_equal(&channels, &asked, &known, &labels(3, 20, 4));
    }
}

#[test]
fn a_database_without_clouds_is_refused() {
    let refused = PrunedDatabase::new(vec![(Cow::Owned(Signatures::default()), SetDistance::L1, 1.0)], &[]);
    assert!(matches!(refused, Err(RecogniseError::EmptyDatabase)));
}
