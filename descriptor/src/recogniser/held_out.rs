//! What a recogniser says of clouds that are left out of what it learns from, whichever these are.

use std::collections::BTreeSet;

use rayon::prelude::*;

use super::Settings;
use super::learn::LabelledClouds;
use super::matrix::Matrix;
use super::{Components, KernelRidge, Vote};
use crate::recognise::{Hit, Label, nearest};

/// What recognisers that are learned at the same time may take.
const MOST_BYTES: usize = 2 << 30;

/// Clouds that may be asked and learned from in many ways: their distances, or their values, are computed once.
pub struct HeldOut<'a> {
    objects: &'a [u32],
    /// Of all pairs.
    distances: Matrix,
    recogniser: Recogniser,
}

enum Recogniser {
    Nearest,
    KernelRidge(super::KernelRidgeSettings),
    /// With the values of each cloud.
    Projection(Matrix, super::ProjectionSettings),
}

/// What an answer is judged by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    /// Of the nearest object; of a recogniser that learns 1 less its score.
    pub distance: f64,
    /// How much farther the next object is.
    pub margin: f64,
    /// Set distance to the nearest cloud of all, whatever answers.
    pub nearest: f64,
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
    /// Of the best object and the next, and the set distance to the nearest cloud of the database.
    pub fn of(best: Hit, next: Hit, nearest: f64) -> Self {
        Self { distance: best.distance, margin: next.distance - best.distance, nearest }
    }
}

/// The least of some distances, infinite if there is none.
fn least(distances: &[f64]) -> f64 {
    distances.iter().copied().fold(f64::INFINITY, f64::min)
}

impl<'a> HeldOut<'a> {
    /// Of these clouds, by the current rayon pool; without settings the nearest cloud answers.
    pub fn new(settings: Option<&Settings>, clouds: &LabelledClouds<'a>) -> Self {
        let recogniser = match settings {
            None => Recogniser::Nearest,
            Some(Settings::KernelRidge(settings)) => Recogniser::KernelRidge(*settings),
            Some(Settings::Projection(settings)) => Recogniser::Projection(clouds.values(), *settings),
        };
        Self { objects: clouds.objects, distances: clouds.distances(), recogniser }
    }

    /// What the objects of `known` clouds make of each of the queries, on the calling thread; both are indices. `None` where
    /// the known clouds show fewer than two objects, or nothing can be learned from them.
    pub fn ask(&self, known: &[usize], queries: &[usize]) -> Option<Vec<HeldOutAnswer>> {
        let objects: Vec<u32> = known.iter().map(|&cloud| self.objects[cloud]).collect();
        if objects.iter().collect::<BTreeSet<_>>().len() < 2 {
            return None;
        }
        let distances = |query: usize| -> Vec<f64> {
            let row = self.distances.row(query);
            known.iter().map(|&cloud| row[cloud]).collect()
        };
        let answer = |best: Hit, second: Hit, distances: &[f64]| HeldOutAnswer {
            object: objects[best.index as usize],
            evidence: Evidence::of(best, second, least(distances)),
        };
        let of_votes = |votes: Vec<Vote>, distances: &[f64]| {
            let hit = |vote: &Vote| Hit { index: vote.cloud, distance: 1.0 - vote.score };
            Some(answer(hit(votes.first()?), hit(votes.get(1)?), distances))
        };
        match &self.recogniser {
            Recogniser::Nearest => {
                let labels: Vec<Label> =
                    objects.iter().map(|&instance| Label { category: 0, instance }).collect();
                let asked = |&query: &usize| {
                    let distances = distances(query);
                    let found = nearest(&distances, &labels)?;
                    Some(answer(found.nearest, found.runner_up?, &distances))
                };
                queries.iter().map(asked).collect()
            }
            Recogniser::KernelRidge(settings) => {
                let among = self.distances.select(known).transposed().select(known);
                let learned = KernelRidge::learn(&among, &objects, settings).ok()?;
                let asked = |&query: &usize| {
                    let distances = distances(query);
                    of_votes(learned.votes(&distances), &distances)
                };
                queries.iter().map(asked).collect()
            }
            Recogniser::Projection(values, settings) => {
                let components = Components::new(&values.select(known), &objects).ok()?;
                let learned = components.projection(settings).ok()?;
                let asked = |&query: &usize| of_votes(learned.votes(values.row(query)), &distances(query));
                queries.iter().map(asked).collect()
            }
        }
    }

    /// As [`HeldOut::ask`], of many pairs of known clouds and queries, by the current rayon pool: as many at a time as 2 GiB
    /// have room for, at least one. Without an answer where there is none.
    pub fn ask_all(&self, rounds: &[(Vec<usize>, Vec<usize>)]) -> Vec<Vec<HeldOutAnswer>> {
        let at_once = (MOST_BYTES / self.bytes_of_one().max(1)).max(1);
        let ask = |(known, queries): &(Vec<usize>, Vec<usize>)| self.ask(known, queries).unwrap_or_default();
        let some = |rounds: &[(Vec<usize>, Vec<usize>)]| rounds.par_iter().map(ask).collect::<Vec<_>>();
        rounds.chunks(at_once).flat_map(some).collect()
    }

    /// Bytes that one [`HeldOut::ask`] takes beside what is kept, at most and roughly.
    fn bytes_of_one(&self) -> usize {
        let clouds = self.objects.len();
        match &self.recogniser {
            Recogniser::Nearest => 16 * clouds,
            // The kernel, its copy and its factor.
            Recogniser::KernelRidge(..) => 32 * clouds * clouds,
            Recogniser::Projection(values, _) => 40 * values.columns() * clouds.max(values.columns()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Sample, sample};
    use super::super::{KernelRidgeSettings, LearnedRecogniser, ProjectionSettings};
    use super::*;
    use crate::distance::{DistanceMatrix, SetDistance};
    use crate::signature::{Signature, Signatures};

    /// Whatever is left out, the answers are those of a recogniser that is made from the known clouds alone, bit for bit.
    #[test]
    fn answers_are_those_of_the_known_clouds_alone() {
        let Sample { values, objects } = sample(5, 8, 30);
        let signatures = |clouds: &[usize]| -> Signatures {
            let signature = |&cloud: &usize| {
                let values: Vec<f32> = values.row(cloud).iter().map(|&value| value as f32).collect();
                Signature { centroid: values[..10].to_vec(), deviation: values[10..20].to_vec() }
            };
            clouds.iter().map(signature).collect::<Vec<_>>().iter().collect()
        };
        let all: Vec<usize> = (0..objects.len()).collect();
        let (known, queries): (Vec<usize>, Vec<usize>) =
            all.iter().partition(|&&cloud| objects[cloud] != 2 && cloud % 3 > 0);
        let channel = (SetDistance::ChiSquared, 0.7);
        let (of_all, of_known, asked) = (signatures(&all), signatures(&known), signatures(&queries));
        let channels = [(&of_all, channel.0, channel.1)];
        let shown: Vec<u32> = known.iter().map(|&cloud| objects[cloud]).collect();
        let distances = [(DistanceMatrix::by(channel.0, &asked, &of_known), channel.1)];
        for settings in [
            None,
            Some(Settings::KernelRidge(KernelRidgeSettings::ALL[4])),
            Some(Settings::Projection(ProjectionSettings::all()[1])),
        ] {
            let clouds = LabelledClouds { channels: &channels, objects: &objects };
            let held_out = HeldOut::new(settings.as_ref(), &clouds);
            let answers = held_out.ask(&known, &queries).unwrap();
            let found = match settings {
                Some(settings) => {
                    let channels = [(&of_known, channel.0, channel.1)];
                    let clouds = LabelledClouds { channels: &channels, objects: &shown };
                    LearnedRecogniser::new(&settings, &clouds).unwrap().recognise(&[&asked], &distances)
                }
                None => {
                    let label = |&instance: &u32| Label { category: 0, instance };
                    let labels: Vec<Label> = shown.iter().map(label).collect();
                    crate::recognise::recognise_from(queries.len(), &distances, &labels).unwrap()
                }
            };
            assert_eq!((answers.len(), found.len()), (queries.len(), queries.len()));
            for ((answer, found), query) in answers.iter().zip(&found).zip(0..) {
                let next = found.runner_up.unwrap();
                let row = distances[0].0.row(query).iter().map(|&distance| 0.7 * f64::from(distance));
                let expected = Evidence::of(found.nearest, next, least(&row.collect::<Vec<_>>()));
                assert_eq!(answer.evidence, expected, "{settings:?}");
                assert_eq!(answer.object, shown[found.nearest.index as usize]);
            }
            let rounds = [(known.clone(), queries.clone()), (known[..1].to_vec(), queries.clone())];
            assert_eq!(held_out.ask_all(&rounds), [answers, Vec::new()], "of one object nothing is learned");
        }
    }
}
