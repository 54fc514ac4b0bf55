//! What a recogniser says of clouds that are left out of what it learns from, whichever these are.

use std::collections::BTreeSet;

use super::learn::{LabelledClouds, Settings};
use super::matrix::Matrix;
use super::{Components, KernelRidge, Vote};
use crate::recognise::{Hit, Label, nearest};

/// Clouds that may be asked and learned from in many ways: their distances, or their values, are computed once.
pub struct HeldOut<'a> {
    objects: &'a [u32],
    recogniser: Recogniser,
}

enum Recogniser {
    /// By the distances of all pairs.
    Nearest(Matrix),
    KernelRidge(Matrix, super::KernelRidgeSettings),
    /// By the values of each cloud.
    Projection(Matrix, super::ProjectionSettings),
}

/// What an answer is judged by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    /// Of the nearest object; of a recogniser that learns 1 less its score.
    pub distance: f64,
    /// How much farther the next object is.
    pub margin: f64,
}

/// An answer about a cloud that was left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldOutAnswer {
    /// What the cloud is taken for.
    pub object: u32,
    /// What speaks for it.
    pub evidence: Evidence,
}

impl Evidence {
    /// Of the nearest object and the next.
    pub fn of(nearest: Hit, runner_up: Hit) -> Self {
        Self { distance: nearest.distance, margin: runner_up.distance - nearest.distance }
    }
}

impl<'a> HeldOut<'a> {
    /// Of these clouds, by the current rayon pool; without settings the nearest cloud answers.
    pub fn new(settings: Option<&Settings>, clouds: &LabelledClouds<'a>) -> Self {
        let recogniser = match settings {
            None => Recogniser::Nearest(clouds.distances()),
            Some(Settings::KernelRidge(settings)) => Recogniser::KernelRidge(clouds.distances(), *settings),
            Some(Settings::Projection(settings)) => Recogniser::Projection(clouds.values(), *settings),
        };
        Self { objects: clouds.objects, recogniser }
    }

    /// What the objects of `known` clouds make of each of the queries, on the calling thread; both are indices. `None` where
    /// the known clouds show fewer than two objects, or nothing can be learned from them.
    pub fn ask(&self, known: &[usize], queries: &[usize]) -> Option<Vec<HeldOutAnswer>> {
        let objects: Vec<u32> = known.iter().map(|&cloud| self.objects[cloud]).collect();
        if objects.iter().collect::<BTreeSet<_>>().len() < 2 {
            return None;
        }
        let of_known = |distances: &Matrix, query: usize| -> Vec<f64> {
            let row = distances.row(query);
            known.iter().map(|&cloud| row[cloud]).collect()
        };
        let answer = |best: Hit, second: Hit| HeldOutAnswer {
            object: objects[best.index as usize],
            evidence: Evidence::of(best, second),
        };
        let of_votes = |votes: Vec<Vote>| {
            let hit = |vote: &Vote| Hit { index: vote.cloud, distance: 1.0 - vote.score };
            Some(answer(hit(votes.first()?), hit(votes.get(1)?)))
        };
        match &self.recogniser {
            Recogniser::Nearest(distances) => {
                let labels: Vec<Label> =
                    objects.iter().map(|&instance| Label { category: 0, instance }).collect();
                let asked = |&query: &usize| {
                    let found = nearest(&of_known(distances, query), &labels)?;
                    Some(answer(found.nearest, found.runner_up?))
                };
                queries.iter().map(asked).collect()
            }
            Recogniser::KernelRidge(distances, settings) => {
                let among = distances.select(known).transposed().select(known);
                let learned = KernelRidge::learn(&among, &objects, settings).ok()?;
                queries.iter().map(|&query| of_votes(learned.votes(&of_known(distances, query)))).collect()
            }
            Recogniser::Projection(values, settings) => {
                let components = Components::new(&values.select(known), &objects).ok()?;
                let learned = components.projection(settings).ok()?;
                queries.iter().map(|&query| of_votes(learned.votes(values.row(query)))).collect()
            }
        }
    }

    /// Bytes that one [`HeldOut::ask`] takes beside what is kept, at most and roughly.
    pub(super) fn bytes_of_one(&self) -> usize {
        let clouds = self.objects.len();
        match &self.recogniser {
            Recogniser::Nearest(_) => 16 * clouds,
            // The kernel, its copy and its factor.
            Recogniser::KernelRidge(..) => 32 * clouds * clouds,
            Recogniser::Projection(values, _) => 40 * values.columns() * clouds.max(values.columns()),
        }
    }
}
