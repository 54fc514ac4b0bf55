//! From the signatures of a database to what recognises clouds by it, its settings chosen inside the database.

use std::fmt;

use rayon::prelude::*;

use super::folds::{cross_validate, folds};
use super::matrix::Matrix;
use super::{
    Components, KernelRidge, KernelRidgeSettings, LearnError, Method, Projection, ProjectionSettings,
    Reference, Vote,
};
use crate::distance::{DistanceMatrix, SetDistance, set_distances};
use crate::recognise::{Hit, Match};
use crate::signature::{Signature, Signatures};

/// Clouds that are learned from.
pub struct LabelledClouds<'a> {
    /// Of each channel the signatures of the clouds, how they are compared, and what distances are multiplied by: weight
    /// over scale.
    pub channels: &'a [(&'a Signatures, SetDistance, f64)],
    /// What each cloud shows.
    pub objects: &'a [u32],
}

/// What a recogniser that learns is set to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Settings {
    /// Of a projection.
    Projection(ProjectionSettings),
    /// Of kernel ridge regression.
    KernelRidge(KernelRidgeSettings),
}

/// Settings that were chosen inside a database.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChosenSettings {
    /// The settings.
    pub settings: Settings,
    /// Clouds of the database that were not recognised by those of the other folds.
    pub wrong: u32,
    /// Clouds that were asked.
    pub asked: u32,
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

impl Settings {
    /// Whose settings they are.
    pub fn method(&self) -> Method {
        match self {
            Self::Projection(_) => Method::Projection,
            Self::KernelRidge(_) => Method::KernelRidge,
        }
    }
}

impl fmt::Display for Settings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Projection(ProjectionSettings { components, shrinkage, reference }) => {
                let reference = match reference {
                    Reference::Cloud => "cloud",
                    Reference::Object => "object",
                };
                write!(f, "{components} components, shrinkage {shrinkage}, nearest {reference}")
            }
            Self::KernelRidge(KernelRidgeSettings { width, ridge }) => {
                write!(f, "kernel width {width}, ridge {ridge}")
            }
        }
    }
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
        let folds = folds(clouds.objects, sequences);
        match method {
            Method::Nearest => Ok(None),
            Method::Projection => Ok(Some(Self::of_projection(clouds, &folds))),
            Method::KernelRidge => Self::of_kernel_ridge(clouds, &folds).map(Some),
        }
    }

    /// Share of the clouds of the database that are not recognised by those of the other folds; `None` if none was asked,
    /// as where each object has one cloud.
    pub fn error(&self) -> Option<f64> {
        (self.asked > 0).then(|| f64::from(self.wrong) / f64::from(self.asked))
    }

    fn of_projection(clouds: &LabelledClouds<'_>, folds: &[usize]) -> Self {
        let values = clouds.values();
        let (objects, settings) = (clouds.objects, ProjectionSettings::all());
        let judge = |known: &[usize], queries: &[usize]| {
            let components = Components::new(&values.select(known), &at(objects, known)).ok()?;
            let wrong = |settings: &ProjectionSettings| -> Option<u32> {
                let projection = components.projection(settings).ok()?;
                let votes = |query: usize| projection.votes(values.row(query));
                Some(wrong(objects, known, queries, votes))
            };
            Some(settings.iter().map(wrong).collect())
        };
        let (counts, asked) = cross_validate(objects, folds, settings.len(), judge);
        let best = least(&counts);
        Self { settings: Settings::Projection(settings[best]), wrong: counts[best], asked }
    }

    fn of_kernel_ridge(clouds: &LabelledClouds<'_>, folds: &[usize]) -> Result<Self, LearnError> {
        KernelRidge::check(clouds.objects)?; // before the distances of too many
        let distances = clouds.distances();
        let (objects, settings) = (clouds.objects, KernelRidgeSettings::ALL);
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
        let (counts, asked) = cross_validate(objects, folds, settings.len(), judge);
        let best = least(&counts);
        Ok(Self { settings: Settings::KernelRidge(settings[best]), wrong: counts[best], asked })
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
        let parts = query.iter().map(|Signature { centroid, deviation }| [&centroid[..], deviation]);
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

fn at(objects: &[u32], clouds: &[usize]) -> Vec<u32> {
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

/// The place of the least, the first of equals; 0 of none.
fn least(counts: &[u32]) -> usize {
    (0..counts.len()).min_by_key(|&place| counts[place]).unwrap_or(0)
}

#[cfg(test)]
mod tests {
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
        let objects = at(&sample.objects, &known);
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
        assert_eq!([least(&[3, 1, 2, 1]), least(&[0]), least(&[])], [1, 0, 0]);
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
        assert_eq!(digests, ["ec6d517d84683dd9", "575ba04a82960589"]);
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
