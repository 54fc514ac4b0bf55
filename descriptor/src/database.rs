//! A database that is asked one query at a time, on the thread that asks: recognition on a small computer.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};

use crate::distance::SetDistance;
use crate::pruning::{PrunedDatabase, Scratch};
use crate::recognise::{Hit, Label, Match, RecogniseError};
use crate::signature::{Signature, Signatures};
use crate::transposed::{LANES, Transposed};

/// Databases of fewer clouds are always matched in full, in 0.1 ms or so.
const PRUNED_FROM: usize = 4000;
/// Preparing to prune takes as long as 20 to 80 queries in full.
const ASKED_BEFORE: u32 = 64;
/// Rankings of more objects leave little to prune.
const MOST: usize = 16;

/// Reference clouds under one descriptor, made ready for matching.
///
/// Answers are those of [`crate::recognise()`], bit for bit. Nothing here starts a thread. A large database is matched by
/// pruning ([`PrunedDatabase`]) once it has been asked so often that preparing for it pays; it then takes about twice the memory.
pub struct Database {
    channels: Vec<Channel>,
    labels: Vec<Label>,
    asked: AtomicU32,
    pruned: OnceLock<PrunedDatabase<'static>>,
}

/// The clouds in one channel.
struct Channel {
    /// Lengths of a centroid and of a deviation.
    lengths: [usize; 2],
    transposed: Transposed,
    metric: SetDistance,
    weight: f64,
}

impl Database {
    /// Of clouds that show `labels`, with their signatures in each channel, how these are compared, and the channel's
    /// weight: of a structure its weight over its scale.
    ///
    /// # Errors
    /// [`RecogniseError::EmptyDatabase`] if there is no cloud.
    ///
    /// # Panics
    /// If there is not one label and one signature a channel for each cloud: a programming error.
    pub fn new(
        channels: &[(&Signatures, SetDistance, f64)],
        labels: Vec<Label>,
    ) -> Result<Self, RecogniseError> {
        let channel = |&(signatures, metric, weight): &(&Signatures, SetDistance, f64)| {
            assert_eq!(signatures.clouds(), labels.len(), "one label for each cloud");
            let lengths = [signatures.bins, signatures.width - signatures.bins];
            Channel { lengths, transposed: Transposed::new(signatures), metric, weight }
        };
        let channels = channels.iter().map(channel).collect();
        if labels.is_empty() {
            return Err(RecogniseError::EmptyDatabase);
        }
        Ok(Self { channels, labels, asked: AtomicU32::new(0), pruned: OnceLock::new() })
    }

    /// How many values a centroid and a deviation have, channel by channel.
    pub fn lengths(&self) -> impl Iterator<Item = [usize; 2]> {
        self.channels.iter().map(|channel| channel.lengths)
    }

    /// Number of clouds, at least 1.
    pub fn clouds(&self) -> usize {
        self.labels.len()
    }

    /// The nearest cloud of each of the `most` nearest objects, nearest first; of equal distances the lowest index
    /// counts.
    ///
    /// # Panics
    /// If the query is of another descriptor: a programming error.
    pub fn ranking(&self, query: &[Signature], most: usize) -> Vec<Hit> {
        let pruned = if most <= MOST { self.pruned() } else { None };
        let Some(pruned) = pruned else { return self.ranking_by(&self.distances(query), most) };
        let query: Vec<[&[f32]; 2]> = query.iter().map(Signature::parts).collect();
        pruned.ranking(&query, most, &mut Scratch::default()).hits
    }

    /// The same clouds with bounds, if that pays by now.
    fn pruned(&self) -> Option<&PrunedDatabase<'static>> {
        if self.clouds() < PRUNED_FROM {
            return None;
        }
        if let Some(pruned) = self.pruned.get() {
            return Some(pruned);
        }
        if self.asked.fetch_add(1, Ordering::Relaxed) < ASKED_BEFORE {
            return None;
        }
        let channel = |Channel { lengths, transposed, metric, weight }: &Channel| {
            (Cow::Owned(transposed.signatures(self.clouds(), *lengths)), *metric, *weight)
        };
        // There is a cloud: no database is without.
        let pruned = || PrunedDatabase::new(self.channels.iter().map(channel).collect(), &self.labels).ok();
        if self.pruned.get().is_none() {
            self.pruned.set(pruned()?).ok();
        }
        self.pruned.get()
    }

    /// As [`Database::ranking`], from the set distances of the query to all clouds.
    pub fn ranking_by(&self, distances: &[f64], most: usize) -> Vec<Hit> {
        let mut nearest: BTreeMap<u32, Hit> = BTreeMap::new();
        for ((&distance, label), index) in distances.iter().zip(&self.labels).zip(0u32..) {
            let hit = Hit { index, distance };
            let best = nearest.entry(label.instance).or_insert(hit);
            if distance.total_cmp(&best.distance).is_lt() {
                *best = hit;
            }
        }
        let mut ranking: Vec<Hit> = nearest.into_values().collect();
        ranking.sort_by(|a, b| a.distance.total_cmp(&b.distance).then(a.index.cmp(&b.index)));
        ranking.truncate(most);
        ranking
    }

    /// The set distances of a query to all clouds.
    ///
    /// # Panics
    /// If the query is of another descriptor: a programming error.
    pub fn distances(&self, query: &[Signature]) -> Vec<f64> {
        assert_eq!(query.len(), self.channels.len(), "query of another descriptor");
        let mut row = vec![[0.0; LANES]; self.clouds().div_ceil(LANES)];
        let mut distances = vec![0.0; self.clouds()];
        for (Channel { lengths, transposed, metric, weight }, Signature { centroid, deviation }) in
            self.channels.iter().zip(query)
        {
            assert_eq!([centroid.len(), deviation.len()], *lengths, "query of another descriptor");
            transposed.by(*metric, [centroid, deviation], &mut row);
            for (sum, &distance) in distances.iter_mut().zip(row.as_flattened()) {
                *sum += weight * f64::from(distance);
            }
        }
        distances
    }

    /// What the query is recognised as.
    ///
    /// # Panics
    /// If the query is of another descriptor: a programming error.
    pub fn recognise(&self, query: &[Signature]) -> Match {
        let ranking = self.ranking(query, 2);
        Match { nearest: ranking[0], runner_up: ranking.get(1).copied() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distance::DistanceMatrix;
    use crate::random::stream;
    use crate::recognise::{self, recognise_from};
    use crate::testing::{by_channel, set_distance, unit};

    const SHAPE: usize = 7;
    const COLOUR: usize = 4;

    /// Clouds with few different values, so that some are equally near.
    fn clouds(purpose: &str, count: usize, colour: usize) -> Vec<[Signature; 2]> {
        let mut rng = stream(1, purpose, &[]);
        let mut values =
            |bins: usize| -> Vec<f32> { (0..bins).map(|_| (unit(&mut rng) * 3.0).floor() / 2.0).collect() };
        let mut signature = |bins| Signature { centroid: values(bins), deviation: values(bins) };
        (0..count).map(|_| [signature(SHAPE), signature(colour)]).collect()
    }

    fn database(clouds: &[[Signature; 2]], labels: &[Label], weight: f64) -> Database {
        let [shape, colour] = by_channel(clouds);
        let chi_squared = SetDistance::ChiSquared;
        let channels = [(&shape, chi_squared, weight), (&colour, chi_squared, 1.0 - weight)];
        Database::new(&channels, labels.to_vec()).unwrap()
    }

    /// Some clouds show the same object, in no order.
    fn labels(clouds: usize, objects: u32) -> Vec<Label> {
        (0..clouds as u32)
            .map(|index| Label { category: 0, instance: (index * 7 + index / 3) % objects })
            .collect()
    }

    #[test]
    fn answers_are_those_of_recognition_of_many() {
        for (clouds, objects, colour) in
            [(1, 1, COLOUR), (5, 1, 0), (16, 3, COLOUR), (50, 9, 0), (50, 9, COLOUR)]
        {
            let (reference, queries) =
                (self::clouds("reference", clouds, colour), self::clouds("query", 40, colour));
            let labels = labels(clouds, objects);
            for weight in [0.0, 0.41, 1.0] {
                let database = database(&reference, &labels, weight);
                assert_eq!(database.clouds(), clouds);
                let (weights, asked) = ([weight, 1.0 - weight], by_channel(&queries));
                let expected =
                    recognise::recognise(&asked, &by_channel(&reference), &weights, &labels).unwrap();
                let got: Vec<Match> = queries.iter().map(|query| database.recognise(query)).collect();
                assert_eq!(got, expected, "{clouds} clouds, {objects} objects, w = {weight}");
            }
        }
    }

    /// Of a structure: three channels, each compared in another way, one of which keeps no deviation.
    #[test]
    fn every_channel_is_compared_in_its_own_way() {
        let of_one_row = |clouds: &[[Signature; 2]]| -> Signatures {
            let rows: Vec<Signature> = clouds
                .iter()
                .map(|[shape, _]| Signature { centroid: shape.centroid.clone(), deviation: Vec::new() })
                .collect();
            rows.iter().collect()
        };
        let channels = |clouds: &[[Signature; 2]]| {
            let [shape, colour] = by_channel(clouds);
            [shape, colour, of_one_row(clouds)]
        };
        let (reference, queries) = (clouds("reference", 50, COLOUR), clouds("query", 40, COLOUR));
        let (labels, weights) = (labels(50, 9), [0.3 / 0.125, 1.7 / 0.3, 0.05]);
        let (known, asked) = (channels(&reference), channels(&queries));
        let own: Vec<_> = (0..3).map(|i| (&known[i], SetDistance::ALL[i], weights[i])).collect();
        let database = Database::new(&own, labels.clone()).unwrap();
        let matrix = |i: usize| DistanceMatrix::by(SetDistance::ALL[i], &asked[i], &known[i]);
        let distances: Vec<_> = (0..3).map(|i| (matrix(i), weights[i])).collect();
        let expected = recognise_from(40, &distances, &labels).unwrap();
        let query = |i: usize| {
            asked.each_ref().map(|channel| {
                let [centroid, deviation] = channel.get(i).map(<[f32]>::to_vec);
                Signature { centroid, deviation }
            })
        };
        let got: Vec<Match> = (0..40).map(|i| database.recognise(&query(i))).collect();
        assert_eq!(got, expected);
    }

    #[test]
    fn a_ranking_names_each_object_once_by_its_nearest_cloud() {
        let (reference, query) = (clouds("reference", 50, COLOUR), &clouds("query", 1, COLOUR)[0]);
        let labels = labels(50, 9);
        let ranking = database(&reference, &labels, 0.5).ranking(query, 100);
        assert_eq!(ranking.len(), 9);
        assert!(ranking.is_sorted_by(|a, b| (a.distance, a.index) < (b.distance, b.index)));
        for hit in &ranking {
            let object = labels[hit.index as usize].instance;
            let of_object = (0..50).filter(|&index| labels[index].instance == object);
            let distances =
                of_object.map(|index| (set_distance(query, &reference[index], 0.5), index as u32));
            assert_eq!(distances.min_by(|a, b| a.partial_cmp(b).unwrap()), Some((hit.distance, hit.index)));
        }
        assert_eq!(database(&reference, &labels, 0.5).ranking(query, 3), ranking[..3]);
    }

    #[test]
    fn a_large_database_answers_as_before_once_it_prunes() {
        for colour in [0, COLOUR] {
            let reference = clouds("reference", PRUNED_FROM + 5, colour);
            let database = database(&reference, &labels(PRUNED_FROM + 5, 9), 0.41);
            for query in &clouds("query", ASKED_BEFORE as usize + 8, colour) {
                for most in [1, 2, 5, MOST + 1] {
                    let expected = database.ranking_by(&database.distances(query), most);
                    assert_eq!(database.ranking(query, most), expected);
                }
            }
            assert!(database.pruned.get().is_some());
        }
    }

    #[test]
    fn a_database_without_clouds_is_refused() {
        let empty = Signatures::default();
        let refused = Database::new(&[(&empty, SetDistance::ChiSquared, 0.5)], Vec::new());
        assert!(matches!(refused, Err(RecogniseError::EmptyDatabase)));
    }
}
