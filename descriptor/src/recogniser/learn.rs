//! From the signatures of a database to what recognises clouds by it, its settings chosen inside the database.

use rayon::prelude::*;

use super::choose::{self, ChosenSettings};
use super::matrix::Matrix;
use super::{Components, KernelRidge, LearnError, Method, Projection, Settings, Vote};
use crate::distance::{DistanceMatrix, SetDistance, set_distances};
use crate::recognise::{Hit, Match};
use crate::signature::{Signature, Signatures};

/// Clouds that are learned from.
#[derive(Clone, Copy, Debug)]
pub struct LabelledClouds<'a> {
    /// Of each channel the signatures of the clouds, how they are compared, and what distances are multiplied by: weight
    /// over scale.
    pub channels: &'a [(&'a Signatures, SetDistance, f64)],
    /// What each cloud shows.
    pub objects: &'a [u32],
}

/// What has been learned from a database.
#[derive(Clone, Debug, PartialEq)]
pub struct LearnedRecogniser {
    model: Model,
    /// Of each channel.
    factors: Vec<f64>,
}

#[derive(Clone, Debug, PartialEq)]
enum Model {
    Projection(Projection),
    KernelRidge(KernelRidge),
}

impl ChosenSettings {
    /// Chooses the settings of a method that recognise most clouds of a database by those of the other folds, by the
    /// current rayon pool; `None` of the nearest cloud, which has none. Folds go by the sequences of the clouds, where they
    /// are known.
    ///
    /// # Errors
    /// [`LearnError`] if nothing can be learned from it.
    ///
    /// # Panics
    /// If there are not as many objects and sequences as clouds: a programming error.
    pub fn new(
        method: Method,
        clouds: &LabelledClouds<'_>,
        sequences: &[Option<u32>],
    ) -> Result<Option<Self>, LearnError> {
        assert_eq!(clouds.objects.len(), sequences.len(), "one sequence for each cloud");
        let objects = clouds.objects;
        Ok(match method {
            Method::Nearest => None,
            Method::Projection => {
                Some(choose::projection(&clouds.values(), objects, sequences).of(Settings::Projection))
            }
            Method::KernelRidge => {
                KernelRidge::check(objects)?; // before the distances of too many
                Some(choose::kernel_ridge(&clouds.distances(), objects, sequences).of(Settings::KernelRidge))
            }
        })
    }
}

impl LearnedRecogniser {
    /// Learns from all clouds of a database, by the current rayon pool.
    ///
    /// # Errors
    /// [`LearnError`] if nothing can be learned from it.
    pub fn new(settings: &Settings, clouds: &LabelledClouds<'_>) -> Result<Self, LearnError> {
        let objects = clouds.objects;
        let model = match settings {
            Settings::Projection(settings) => {
                Model::Projection(Components::new(&clouds.values(), objects)?.projection(settings)?)
            }
            Settings::KernelRidge(settings) => {
                KernelRidge::check(objects)?; // before the distances of too many
                Model::KernelRidge(KernelRidge::learn(&clouds.distances(), objects, settings)?)
            }
        };
        Ok(Self { model, factors: clouds.channels.iter().map(|&(.., factor)| factor).collect() })
    }

    /// Values that are kept of a cloud if they are others than its signature.
    pub fn size(&self) -> Option<usize> {
        match &self.model {
            Model::Projection(projection) => Some(projection.size()),
            Model::KernelRidge(_) => None,
        }
    }

    /// What it makes of each query, by the current rayon pool: from the signatures of all of them in each channel, and
    /// their distances to the database with the factor of the channel. Distances are 1 less the score.
    ///
    /// # Panics
    /// If channels or database are others than those that it has learned from: a programming error.
    pub fn recognise(&self, queries: &[&Signatures], distances: &[(DistanceMatrix, f64)]) -> Vec<Match> {
        let one = |query: usize| {
            let parts = || queries.iter().map(|signatures| signatures.get(query));
            let sums = || {
                let mut sums = Vec::new();
                set_distances(distances, query, &mut sums);
                sums
            };
            let ranking = self.votes(parts(), sums);
            // Two objects at least: no other database is learned from.
            Match { nearest: hit(ranking[0]), runner_up: ranking.get(1).copied().map(hit) }
        };
        (0..queries.first().map_or(0, |signatures| signatures.clouds())).into_par_iter().map(one).collect()
    }

    /// The cloud that stands for each object, best first, at a distance of 1 less its score, on the calling thread:
    /// from the signature of a query in each channel and, where they are asked for, its distances to the database.
    ///
    /// # Panics
    /// As [`LearnedRecogniser::recognise`].
    pub fn ranking(&self, query: &[Signature], distances: impl FnOnce() -> Vec<f64>) -> Vec<Hit> {
        let parts = query.iter().map(Signature::parts);
        self.votes(parts, distances).into_iter().map(hit).collect()
    }

    fn votes<'a>(
        &self,
        parts: impl Iterator<Item = [&'a [f32]; 2]>,
        distances: impl FnOnce() -> Vec<f64>,
    ) -> Vec<Vote> {
        match &self.model {
            Model::Projection(projection) => {
                let mut values = Vec::new();
                parts.zip(&self.factors).for_each(|(part, factor)| append_values(part, *factor, &mut values));
                projection.votes(&values)
            }
            Model::KernelRidge(ridge) => ridge.votes(&distances()),
        }
    }
}

fn hit(vote: Vote) -> Hit {
    Hit { index: vote.cloud, distance: 1.0 - vote.score }
}

impl LabelledClouds<'_> {
    /// Of each cloud (row) the roots of its values, each times weight over scale.
    pub(super) fn values(&self) -> Matrix {
        let (mut values, mut columns) = (Vec::new(), 0);
        for cloud in 0..self.objects.len() {
            for (signatures, _, factor) in self.channels {
                append_values(signatures.get(cloud), *factor, &mut values);
            }
            columns = values.len() / (cloud + 1);
        }
        Matrix::new(columns, values)
    }

    pub(super) fn distances(&self) -> Matrix {
        let of = |&(signatures, distance, factor): &(&Signatures, SetDistance, f64)| {
            (DistanceMatrix::among(distance, signatures), factor)
        };
        let channels: Vec<(DistanceMatrix, f64)> = self.channels.iter().map(of).collect();
        let row = |cloud: usize| {
            let mut sums = Vec::new();
            set_distances(&channels, cloud, &mut sums);
            sums
        };
        let rows: Vec<Vec<f64>> = (0..self.objects.len()).into_par_iter().map(row).collect();
        Matrix::new(self.objects.len(), rows.concat())
    }
}

fn append_values(part: [&[f32]; 2], factor: f64, values: &mut Vec<f64>) {
    values.extend(part.into_iter().flatten().map(|&value| (f64::from(value) * factor).sqrt()));
}

#[cfg(test)]
mod tests {
    use super::super::KernelRidgeSettings;
    use super::super::testing::{Sample, sample};
    use super::*;
    use crate::distance::SetDistance;
    use crate::signature::Signature;

    /// Signatures whose centroids and deviations are halves of the values.
    fn signatures(values: &Matrix) -> Signatures {
        let signature = |row: &[f64]| {
            let values: Vec<f32> = row.iter().map(|&value| value as f32).collect();
            let (centroid, deviation) = values.split_at(values.len() / 2);
            Signature { centroid: centroid.to_vec(), deviation: deviation.to_vec() }
        };
        (0..values.rows()).map(|row| signature(values.row(row))).collect::<Vec<_>>().iter().collect()
    }

    struct Learned {
        chosen: ChosenSettings,
        recogniser: LearnedRecogniser,
        found: Vec<Match>,
    }

    /// What is learned from every other cloud, sequences by turns, and what it makes of the others.
    fn learned(method: Method, sample: &Sample, has_sequences: bool) -> Learned {
        let known: Vec<usize> = (0..sample.objects.len()).step_by(2).collect();
        let asked: Vec<usize> = (1..sample.objects.len()).step_by(2).collect();
        let [database, queries] = [&known, &asked].map(|clouds| signatures(&sample.values.select(clouds)));
        let weights = [0.75, 2.0];
        let chi_squared = SetDistance::ChiSquared;
        let channels = weights.map(|weight| (&database, chi_squared, weight));
        let sequences: Vec<Option<u32>> =
            (0..known.len() as u32).map(|cloud| has_sequences.then_some(cloud % 3)).collect();
        let objects = choose::at(&sample.objects, &known);
        let clouds = LabelledClouds { channels: &channels, objects: &objects };
        let chosen = ChosenSettings::new(method, &clouds, &sequences).unwrap().unwrap();
        assert_eq!(chosen.settings.method(), method);
        let recogniser = LearnedRecogniser::new(&chosen.settings, &clouds).unwrap();
        let distances = weights.map(|weight| (DistanceMatrix::by(chi_squared, &queries, &database), weight));
        let found = recogniser.recognise(&[&queries, &queries], &distances);
        // One cloud at a time, without a thread: the same bits.
        for (query, found) in found.iter().enumerate() {
            let [centroid, deviation] = queries.get(query).map(<[f32]>::to_vec);
            let signature = Signature { centroid, deviation };
            let ranking = recogniser.ranking(&[signature.clone(), signature], || {
                let mut sums = Vec::new();
                set_distances(&distances, query, &mut sums);
                sums
            });
            assert_eq!(
                [Some(found.nearest), found.runner_up],
                [ranking.first(), ranking.get(1)].map(Option::<&_>::copied)
            );
            assert!(ranking.is_sorted_by(|a, b| a.distance <= b.distance));
        }
        Learned { chosen, recogniser, found }
    }

    #[test]
    fn what_is_learned_recognises_clouds_that_it_has_not_seen() {
        let sample = sample(6, 12, 40);
        for method in [Method::Projection, Method::KernelRidge] {
            for has_sequences in [false, true] {
                let Learned { chosen, found, .. } = learned(method, &sample, has_sequences);
                // The clouds of the database are the even ones.
                let object = |hit: Hit| sample.objects[2 * hit.index as usize];
                let wrong = found
                    .iter()
                    .enumerate()
                    .filter(|(query, found)| object(found.nearest) != sample.objects[2 * query + 1])
                    .count();
                assert_eq!((wrong, found.len()), (0, 36), "{method:?}");
                for found in &found {
                    let other = found.runner_up.unwrap();
                    assert!(object(other) != object(found.nearest));
                    assert!(other.distance >= found.nearest.distance);
                }
                assert_eq!((chosen.wrong, chosen.asked, chosen.error()), (0, 36, Some(0.0)));
            }
        }
        assert_eq!(learned(Method::Projection, &sample, true).recogniser.size(), Some(5));
        assert_eq!(learned(Method::KernelRidge, &sample, true).recogniser.size(), None);
    }

    #[test]
    fn settings_are_the_first_with_fewest_errors() {
        // Clouds that say nothing: a quarter is right by chance, and the error inside says so.
        let mut noise = sample(4, 24, 40);
        let clouds = noise.objects.len();
        noise.objects = (0..clouds as u32).map(|cloud| cloud / 2 % 4).collect();
        for method in [Method::Projection, Method::KernelRidge] {
            let error = learned(method, &noise, true).chosen.error().unwrap();
            assert!(error > 0.5, "{method:?} {error}");
        }
    }

    #[test]
    fn bits_are_those_of_every_machine() {
        let sample = sample(6, 12, 40);
        let digests = [Method::Projection, Method::KernelRidge].map(|method| {
            let mut hasher = blake3::Hasher::new();
            for found in learned(method, &sample, true).found {
                let other = found.runner_up.map_or(0.0, |other| other.distance);
                hasher.update(&found.nearest.distance.to_le_bytes()).update(&other.to_le_bytes());
            }
            hasher.finalize().to_hex()[..16].to_owned()
        });
        assert_eq!(digests, ["ec6d517d84683dd9", "8f1580b38a54e222"]);
    }

    #[test]
    fn the_nearest_cloud_has_no_settings_and_nothing_is_learned_from_nothing() {
        let nothing = LabelledClouds { channels: &[], objects: &[] };
        assert_eq!(ChosenSettings::new(Method::Nearest, &nothing, &[]), Ok(None));
        let none = Err(LearnError::Objects { got: 0 });
        assert_eq!(ChosenSettings::new(Method::KernelRidge, &nothing, &[]), none);
        let of_projection = ChosenSettings::new(Method::Projection, &nothing, &[]).unwrap().unwrap();
        assert_eq!((of_projection.wrong, of_projection.asked, of_projection.error()), (0, 0, None));
        for settings in [of_projection.settings, Settings::KernelRidge(KernelRidgeSettings::ALL[0])] {
            let learned = LearnedRecogniser::new(&settings, &nothing);
            assert_eq!(learned, Err(LearnError::Objects { got: 0 }));
        }
    }
}
