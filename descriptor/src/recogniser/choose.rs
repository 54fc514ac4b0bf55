//! The settings of a recogniser that recognise most clouds of a database by those of the other folds.

use rayon::prelude::*;

use super::folds::{cross_validate, folds};
use super::matrix::Matrix;
use super::{Components, KernelRidge, KernelRidgeSettings, ProjectionSettings, Settings, Vote};

/// Settings that were chosen inside a database: the first with fewest errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChosenSettings<S = Settings> {
    /// The settings.
    pub settings: S,
    /// Clouds of the database that were not recognised by those of the other folds.
    pub wrong: u32,
    /// Clouds that were asked.
    pub asked: u32,
}

impl<S> ChosenSettings<S> {
    /// Share of the clouds of the database that are not recognised by those of the other folds; `None` if none was asked,
    /// as where each object has one cloud.
    pub fn error(&self) -> Option<f64> {
        (self.asked > 0).then(|| f64::from(self.wrong) / f64::from(self.asked))
    }

    /// The same of any recogniser.
    pub(super) fn of<T>(self, kind: impl FnOnce(S) -> T) -> ChosenSettings<T> {
        ChosenSettings { settings: kind(self.settings), wrong: self.wrong, asked: self.asked }
    }
}

/// Of a projection of clouds with these values (rows), by the current rayon pool.
pub fn projection(
    values: &Matrix,
    objects: &[u32],
    sequences: &[Option<u32>],
) -> ChosenSettings<ProjectionSettings> {
    let settings = ProjectionSettings::all();
    let judge = |known: &[usize], queries: &[usize]| {
        let components = Components::new(&values.select(known), &at(objects, known)).ok()?;
        let wrong = |settings: &ProjectionSettings| -> Option<u32> {
            let projection = components.projection(settings).ok()?;
            let votes = |query: usize| projection.votes(values.row(query));
            Some(wrong(objects, known, queries, votes))
        };
        Some(settings.iter().map(wrong).collect())
    };
    best(&settings, cross_validate(objects, &folds(objects, sequences), settings.len(), judge))
}

/// Of kernel ridge regression on the distances of each cloud (row) to all, by the current rayon pool.
pub fn kernel_ridge(
    distances: &Matrix,
    objects: &[u32],
    sequences: &[Option<u32>],
) -> ChosenSettings<KernelRidgeSettings> {
    let settings = KernelRidgeSettings::ALL;
    let judge = |known: &[usize], queries: &[usize]| {
        let among = distances.select(known).transposed().select(known);
        let wrong = |settings: &KernelRidgeSettings| -> Option<u32> {
            let ridge = KernelRidge::learn(&among, &at(objects, known), settings).ok()?;
            let votes = |query: usize| {
                let row = distances.row(query);
                ridge.votes(&known.iter().map(|&cloud| row[cloud]).collect::<Vec<f64>>())
            };
            Some(wrong(objects, known, queries, votes))
        };
        Some(settings.iter().map(wrong).collect())
    };
    best(&settings, cross_validate(objects, &folds(objects, sequences), settings.len(), judge))
}

fn best<S: Copy>(settings: &[S], (counts, asked): (Vec<u32>, u32)) -> ChosenSettings<S> {
    let place = least(&counts);
    ChosenSettings { settings: settings[place], wrong: counts[place], asked }
}

/// The place of the least, the first of equals; 0 of none.
fn least(counts: &[u32]) -> usize {
    (0..counts.len()).min_by_key(|&place| counts[place]).unwrap_or(0)
}

/// What these clouds show.
pub fn at(objects: &[u32], clouds: &[usize]) -> Vec<u32> {
    clouds.iter().map(|&cloud| objects[cloud]).collect()
}

/// How many of the queries show another object than the cloud that is found, which is one of those known.
fn wrong(
    objects: &[u32],
    known: &[usize],
    queries: &[usize],
    votes: impl Fn(usize) -> Vec<Vote> + Sync,
) -> u32 {
    let is_wrong = |&&query: &&usize| {
        let found = votes(query).first().map(|best| known[best.cloud as usize]);
        found.is_none_or(|found| objects[found] != objects[query])
    };
    queries.par_iter().filter(is_wrong).count() as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_the_least_is_chosen() {
        assert_eq!([least(&[3, 1, 2, 1]), least(&[0]), least(&[])], [1, 0, 0]);
        assert_eq!(best(&['a', 'b'], (vec![4, 2], 8)), ChosenSettings { settings: 'b', wrong: 2, asked: 8 });
    }
}
