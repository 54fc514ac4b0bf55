//! A database that is asked one query at a time, on the thread that asks: recognition on a small computer.

use std::collections::BTreeMap;

use crate::distance::{LANES, Turned};
use crate::recognise::{Hit, Label, Match, RecogniseError};
use crate::summary::{Part, Parts, Summary, weighted};

/// Reference clouds under one descriptor, made ready for matching.
///
/// Answers are those of [`crate::recognise()`], bit for bit. Nothing here starts a thread.
pub struct Database {
    shape: Side,
    colour: Side,
    labels: Vec<Label>,
    shape_weight: f64,
}

/// One part of the descriptor.
struct Side {
    bins: usize,
    turned: Turned,
}

impl Side {
    fn new(parts: &Parts) -> Self {
        Self { bins: parts.bins(), turned: Turned::new(parts) }
    }

    /// Distances of a query's part to all clouds, in whole blocks.
    fn distances(&self, query: &Part, clouds: usize) -> Vec<[f32; LANES]> {
        let Part { centroid, deviation } = query;
        assert_eq!([centroid.len(), deviation.len()], [self.bins; 2], "query of another descriptor");
        let mut row = vec![[0.0; LANES]; clouds.div_ceil(LANES)];
        self.turned.distances([centroid, deviation], &mut row);
        row
    }
}

impl Database {
    /// Of clouds with these shape and colour parts, which show `labels`; `shape_weight` is the descriptor's w.
    ///
    /// # Errors
    /// [`RecogniseError::EmptyDatabase`] if there is no cloud.
    ///
    /// # Panics
    /// If there is not one label and one part of each kind for each cloud: a programming error.
    pub fn new(
        [shape, colour]: [&Parts; 2],
        labels: Vec<Label>,
        shape_weight: f64,
    ) -> Result<Self, RecogniseError> {
        assert_eq!([shape.clouds(), colour.clouds()], [labels.len(); 2], "one label for each cloud");
        if labels.is_empty() {
            return Err(RecogniseError::EmptyDatabase);
        }
        Ok(Self { shape: Side::new(shape), colour: Side::new(colour), labels, shape_weight })
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
    pub fn ranking(&self, query: &Summary, most: usize) -> Vec<Hit> {
        let shape = self.shape.distances(&query.shape, self.clouds());
        let colour = self.colour.distances(&query.colour, self.clouds());
        let parts = shape.as_flattened().iter().zip(colour.as_flattened());
        let distances = parts.map(|(&shape, &colour)| weighted(shape, colour, self.shape_weight));
        let mut nearest: BTreeMap<u32, Hit> = BTreeMap::new();
        for ((distance, label), index) in distances.zip(&self.labels).zip(0u32..) {
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

    /// What the query is recognised as.
    ///
    /// # Panics
    /// If the query is of another descriptor: a programming error.
    pub fn recognise(&self, query: &Summary) -> Match {
        let ranking = self.ranking(query, 2);
        Match { nearest: ranking[0], runner_up: ranking.get(1).copied() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::stream;
    use crate::recognise;
    use crate::testing::unit;

    const SHAPE: usize = 7;
    const COLOUR: usize = 4;

    /// Summaries with few different values, so that some are equally near.
    fn summaries(purpose: &str, count: usize, colour: usize) -> Vec<Summary> {
        let mut rng = stream(1, purpose, &[]);
        let mut values =
            |bins: usize| -> Vec<f32> { (0..bins).map(|_| (unit(&mut rng) * 3.0).floor() / 2.0).collect() };
        let mut part = |bins| Part { centroid: values(bins), deviation: values(bins) };
        (0..count).map(|_| Summary { shape: part(SHAPE), colour: part(colour) }).collect()
    }

    fn database(summaries: &[Summary], labels: &[Label], weight: f64) -> Database {
        let shape: Parts = summaries.iter().map(|summary| &summary.shape).collect();
        let colour: Parts = summaries.iter().map(|summary| &summary.colour).collect();
        Database::new([&shape, &colour], labels.to_vec(), weight).unwrap()
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
                (summaries("reference", clouds, colour), summaries("query", 40, colour));
            let labels = labels(clouds, objects);
            for weight in [0.0, 0.41, 1.0] {
                let database = database(&reference, &labels, weight);
                assert_eq!(database.clouds(), clouds);
                let expected = recognise(&queries, &reference, &labels, weight).unwrap();
                let got: Vec<Match> = queries.iter().map(|query| database.recognise(query)).collect();
                assert_eq!(got, expected, "{clouds} clouds, {objects} objects, w = {weight}");
            }
        }
    }

    #[test]
    fn a_ranking_names_each_object_once_by_its_nearest_cloud() {
        let (reference, query) = (summaries("reference", 50, COLOUR), &summaries("query", 1, COLOUR)[0]);
        let labels = labels(50, 9);
        let ranking = database(&reference, &labels, 0.5).ranking(query, 100);
        assert_eq!(ranking.len(), 9);
        assert!(ranking.is_sorted_by(|a, b| (a.distance, a.index) < (b.distance, b.index)));
        for hit in &ranking {
            let object = labels[hit.index as usize].instance;
            let of_object = (0..50).filter(|&index| labels[index].instance == object);
            let distances = of_object.map(|index| (query.distance(&reference[index], 0.5), index as u32));
            assert_eq!(distances.min_by(|a, b| a.partial_cmp(b).unwrap()), Some((hit.distance, hit.index)));
        }
        assert_eq!(database(&reference, &labels, 0.5).ranking(query, 3), ranking[..3]);
    }

    #[test]
    fn a_database_without_clouds_is_refused() {
        let empty = Parts::default();
        let refused = Database::new([&empty, &empty], Vec::new(), 0.5);
        assert!(matches!(refused, Err(RecogniseError::EmptyDatabase)));
    }
}
