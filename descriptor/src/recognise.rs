//! Recognition: the nearest database cloud names a query's object and category (DESIGN 5.7).

use std::borrow::Borrow;

use rayon::prelude::*;

use crate::distance::{DistanceMatrix, set_distances};
use crate::signature::Signatures;

/// What a cloud shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Label {
    /// Class of the object.
    pub category: u32,
    /// The object; unique over all categories.
    pub instance: u32,
}

/// A database cloud and its set distance to a query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index in the database.
    pub index: u32,
    /// Set distance.
    pub distance: f64,
}

/// What one query was recognised as. Of equal distances the lowest index counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// The nearest cloud.
    pub nearest: Hit,
    /// The nearest cloud of another object than the nearest cloud's; `None` if the database shows one object only.
    pub runner_up: Option<Hit>,
}

/// Why nothing could be recognised.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RecogniseError {
    /// There is nothing to match with.
    #[error("database: no cloud to match with, got 0\nadd clouds, or find out why all of them were skipped")]
    EmptyDatabase,
}

/// Matches every query with a database whose clouds show `labels`, by the current rayon pool. Queries, database and
/// weights are channel by channel.
///
/// # Errors
/// [`RecogniseError::EmptyDatabase`] if there are queries but no cloud to match with.
///
/// # Panics
/// If there is not one label for each cloud of the database: a programming error.
pub fn recognise(
    queries: &[Signatures],
    database: &[Signatures],
    weights: &[f64],
    labels: &[Label],
) -> Result<Vec<Match>, RecogniseError> {
    let distances: Vec<(DistanceMatrix, f64)> = queries
        .iter()
        .zip(database)
        .zip(weights)
        .map(|((queries, database), &weight)| (DistanceMatrix::new(queries, database), weight))
        .collect();
    recognise_from(queries.first().map_or(0, Signatures::clouds), &distances, labels)
}

/// As [`recognise()`], from the distances in each channel and its weight: equal matches, bit for bit.
///
/// # Errors
/// [`RecogniseError::EmptyDatabase`] if there are queries but no cloud to match with.
///
/// # Panics
/// If the matrices and the labels differ in size: a programming error.
pub fn recognise_from<M: Borrow<DistanceMatrix> + Sync>(
    queries: usize,
    channels: &[(M, f64)],
    labels: &[Label],
) -> Result<Vec<Match>, RecogniseError> {
    for (matrix, _) in channels {
        assert_eq!(matrix.borrow().columns(), labels.len(), "one label for each cloud of the database");
    }
    let matched = |distances: &mut Vec<f64>, query| {
        set_distances(channels, query, distances);
        nearest(distances, labels).ok_or(RecogniseError::EmptyDatabase)
    };
    (0..queries).into_par_iter().map_init(Vec::new, matched).collect()
}

/// The nearest cloud and the nearest of another object, in one pass, from a query's distances to a database whose clouds
/// show `labels`; `None` without clouds.
pub fn nearest(distances: &[f64], labels: &[Label]) -> Option<Match> {
    let mut found: Option<Match> = None;
    for ((&distance, label), index) in distances.iter().zip(labels).zip(0u32..) {
        let hit = Hit { index, distance };
        let Some(best) = &mut found else {
            found = Some(Match { nearest: hit, runner_up: None });
            continue;
        };
        let same_object = labels[best.nearest.index as usize].instance == label.instance;
        if distance.total_cmp(&best.nearest.distance).is_lt() {
            // What was nearest so far beats any runner-up seen so far, if it shows another object.
            if !same_object {
                best.runner_up = Some(best.nearest);
            }
            best.nearest = hit;
        } else if !same_object
            && best.runner_up.is_none_or(|second| distance.total_cmp(&second.distance).is_lt())
        {
            best.runner_up = Some(hit);
        }
    }
    found
}

/// How many queries were recognised.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Correct {
    /// Queries in all.
    pub queries: usize,
    /// Queries whose nearest cloud shows the same object.
    pub object: usize,
    /// Queries whose nearest cloud shows an object of the same category.
    pub category: usize,
}

impl Correct {
    /// Counts the matches of queries that show `queries` with a database that shows `database`.
    pub fn count(matches: &[Match], queries: &[Label], database: &[Label]) -> Self {
        Self::of_nearest(matches.iter().map(|found| found.nearest.index), queries, database)
    }

    /// As [`Correct::count`], from the index of each query's nearest cloud.
    pub fn of_nearest(
        nearest: impl ExactSizeIterator<Item = u32>,
        queries: &[Label],
        database: &[Label],
    ) -> Self {
        assert_eq!(nearest.len(), queries.len(), "one label for each query");
        let mut correct = Self { queries: queries.len(), ..Self::default() };
        for (index, query) in nearest.zip(queries) {
            let named = database[index as usize];
            correct.object += usize::from(named.instance == query.instance);
            correct.category += usize::from(named.category == query.category);
        }
        correct
    }
}
