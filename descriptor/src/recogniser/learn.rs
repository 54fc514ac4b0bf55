//! From the signatures of a database to what recognises clouds by it, its settings chosen inside the database.

use rayon::prelude::*;

use super::folds::{cross_validate, folds};
use super::matrix::Matrix;
use super::{
    Answer, Components, KernelRidge, KernelRidgeSettings, LearnError, Method, Projection, ProjectionSettings,
    Reference,
};
use crate::distance::{DistanceMatrix, set_distances};
use crate::recognise::{Hit, Match};
use crate::signature::Signatures;

/// Reference clouds that are learned from.
pub struct LabelledClouds<'a> {
    /// Of each channel the signatures of the clouds, their distances to each other, and what these are multiplied by:
    /// weight over scale.
    pub channels: &'a [(&'a Signatures, DistanceMatrix, f64)],
    /// What each cloud shows.
    pub objects: &'a [u32],
    /// The sequence of each, where it is known.
    pub sequences: &'a [Option<u32>],
}

/// What has been learned from a database.
#[derive(Clone, Debug, PartialEq)]
pub struct LearnedRecogniser {
    model: Model,
    wrong: u32,
    asked: u32,
}

#[derive(Clone, Debug, PartialEq)]
enum Model {
    Projection(Projection, ProjectionSettings),
    KernelRidge(KernelRidge, KernelRidgeSettings),
}

impl LearnedRecogniser {
    /// Learns by a method from a database, by the current rayon pool; `None` by the nearest neighbour, which learns
    /// nothing.
    ///
    /// # Errors
    /// [`LearnError`] if nothing can be learned from it.
    ///
    /// # Panics
    /// If there are not as many objects and sequences as clouds: a programming error.
    pub fn learn(method: Method, database: &LabelledClouds<'_>) -> Result<Option<Self>, LearnError> {
        let LabelledClouds { objects, sequences, .. } = *database;
        assert_eq!(objects.len(), sequences.len(), "one sequence for each cloud");
        let folds = folds(objects, sequences);
        match method {
            Method::Nearest => Ok(None),
            Method::Projection => Self::projection(database, &folds).map(Some),
            Method::KernelRidge => Self::kernel_ridge(database, &folds).map(Some),
        }
    }

    fn projection(database: &LabelledClouds<'_>, folds: &[usize]) -> Result<Self, LearnError> {
        let values = database.values();
        let (objects, settings) = (database.objects, ProjectionSettings::all());
        let judge = |known: &[usize], queries: &[usize]| {
            let components = Components::new(&values.select(known), &at(objects, known)).ok()?;
            let wrong = |settings: &ProjectionSettings| -> Option<u32> {
                let projection = components.projection(settings).ok()?;
                let recognise = |query: usize| projection.recognise(values.row(query));
                Some(wrong(objects, known, queries, recognise))
            };
            settings.iter().map(wrong).collect()
        };
        let (counts, asked) = cross_validate(objects, folds, settings.len(), judge);
        let best = least(&counts);
        let projection = Components::new(&values, objects)?.projection(&settings[best])?;
        let model = Model::Projection(projection, settings[best]);
        Ok(Self { model, wrong: counts[best], asked })
    }

    fn kernel_ridge(database: &LabelledClouds<'_>, folds: &[usize]) -> Result<Self, LearnError> {
        let distances = database.distances();
        let (objects, settings) = (database.objects, KernelRidgeSettings::ALL);
        let judge = |known: &[usize], queries: &[usize]| {
            let among = distances.select(known).transposed().select(known);
            let wrong = |settings: &KernelRidgeSettings| -> Option<u32> {
                let ridge = KernelRidge::learn(&among, &at(objects, known), settings).ok()?;
                let recognise = |query: usize| {
                    let row = distances.row(query);
                    ridge.recognise(&known.iter().map(|&cloud| row[cloud]).collect::<Vec<f64>>())
                };
                Some(wrong(objects, known, queries, recognise))
            };
            settings.iter().map(wrong).collect()
        };
        let (counts, asked) = cross_validate(objects, folds, settings.len(), judge);
        let best = least(&counts);
        let ridge = KernelRidge::learn(&distances, objects, &settings[best])?;
        Ok(Self { model: Model::KernelRidge(ridge, settings[best]), wrong: counts[best], asked })
    }

    /// Share of the clouds of the database that the chosen settings do not recognise by the other folds; 0 of none.
    pub fn database_error(&self) -> f64 {
        f64::from(self.wrong) / f64::from(self.asked.max(1))
    }

    /// Values that are kept of a cloud if they are others than its signature.
    pub fn size(&self) -> Option<usize> {
        match &self.model {
            Model::Projection(projection, _) => Some(projection.size()),
            Model::KernelRidge(..) => None,
        }
    }

    /// The settings that were chosen, for people.
    pub fn settings(&self) -> String {
        match &self.model {
            Model::Projection(projection, settings) => {
                let ProjectionSettings { components, shrinkage, reference } = settings;
                let reference = match reference {
                    Reference::Cloud => "nearest cloud",
                    Reference::Mean => "nearest object",
                };
                let size = projection.size();
                format!("{components} components, shrinkage {shrinkage}, {size} values, {reference}")
            }
            Model::KernelRidge(_, KernelRidgeSettings { width, ridge }) => {
                format!("kernel width {width}, ridge {ridge}")
            }
        }
    }

    /// What it makes of each query: from the signatures of all of them and their distances to the database in each
    /// channel, with the factor of the channel. Distances are 1 less the score.
    ///
    /// # Panics
    /// If channels or database are others than those that it has learned from: a programming error.
    pub fn recognise(&self, channels: &[(&Signatures, &DistanceMatrix, f64)]) -> Vec<Match> {
        let queries = channels.first().map_or(0, |(signatures, ..)| signatures.clouds());
        let hit = |vote: super::Vote| Hit { index: vote.cloud, distance: 1.0 - vote.score };
        let found = |answer: Answer| Match { nearest: hit(answer.best), runner_up: Some(hit(answer.second)) };
        let distances: Vec<(&DistanceMatrix, f64)> =
            channels.iter().map(|&(_, distances, factor)| (distances, factor)).collect();
        let one = |query: usize| match &self.model {
            Model::Projection(projection, _) => {
                let mut values = Vec::new();
                for (signatures, _, factor) in channels {
                    append_values(signatures, query, *factor, &mut values);
                }
                found(projection.recognise(&values))
            }
            Model::KernelRidge(ridge, _) => {
                let mut sums = Vec::new();
                set_distances(&distances, query, &mut sums);
                found(ridge.recognise(&sums))
            }
        };
        (0..queries).into_par_iter().map(one).collect()
    }
}

impl LabelledClouds<'_> {
    /// Of each cloud (row) the roots of its values, each times weight over scale.
    fn values(&self) -> Matrix {
        let (mut values, mut columns) = (Vec::new(), 0);
        for cloud in 0..self.objects.len() {
            for (signatures, _, factor) in self.channels {
                append_values(signatures, cloud, *factor, &mut values);
            }
            columns = values.len() / (cloud + 1);
        }
        Matrix::new(columns, values)
    }

    fn distances(&self) -> Matrix {
        let channels: Vec<(&DistanceMatrix, f64)> =
            self.channels.iter().map(|(_, distances, factor)| (distances, *factor)).collect();
        let row = |cloud: usize| {
            let mut sums = Vec::new();
            set_distances(&channels, cloud, &mut sums);
            sums
        };
        let rows: Vec<Vec<f64>> = (0..self.objects.len()).into_par_iter().map(row).collect();
        Matrix::new(self.objects.len(), rows.concat())
    }
}

fn append_values(signatures: &Signatures, cloud: usize, factor: f64, values: &mut Vec<f64>) {
    let of_cloud = signatures.get(cloud).into_iter().flatten();
    values.extend(of_cloud.map(|&value| (f64::from(value) * factor).sqrt()));
}

fn at(objects: &[u32], clouds: &[usize]) -> Vec<u32> {
    clouds.iter().map(|&cloud| objects[cloud]).collect()
}

/// How many of the queries show another object than the cloud that is found, which is one of those known.
fn wrong(
    objects: &[u32],
    known: &[usize],
    queries: &[usize],
    recognise: impl Fn(usize) -> Answer + Sync,
) -> u32 {
    let is_wrong = |&&query: &&usize| {
        let found = known[recognise(query).best.cloud as usize];
        objects[found] != objects[query]
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
        recogniser: LearnedRecogniser,
        found: Vec<Match>,
    }

    /// What is learned from every other cloud, sequences by turns, and what it makes of the others.
    fn learned(method: Method, sample: &Sample, has_sequences: bool) -> Learned {
        let known: Vec<usize> = (0..sample.objects.len()).step_by(2).collect();
        let asked: Vec<usize> = (1..sample.objects.len()).step_by(2).collect();
        let [database, queries] = [&known, &asked].map(|clouds| signatures(&sample.values.select(clouds)));
        let weights = [0.75, 2.0];
        let channels: Vec<_> = weights
            .iter()
            .map(|&weight| (&database, DistanceMatrix::among(SetDistance::ChiSquared, &database), weight))
            .collect();
        let sequences: Vec<Option<u32>> =
            (0..known.len() as u32).map(|cloud| has_sequences.then_some(cloud % 3)).collect();
        let objects = at(&sample.objects, &known);
        let database_of = LabelledClouds { channels: &channels, objects: &objects, sequences: &sequences };
        let recogniser = LearnedRecogniser::learn(method, &database_of).unwrap().unwrap();
        let to_database = DistanceMatrix::by(SetDistance::ChiSquared, &queries, &database);
        let asked: Vec<_> = weights.iter().map(|&weight| (&queries, &to_database, weight)).collect();
        Learned { found: recogniser.recognise(&asked), recogniser }
    }

    #[test]
    fn what_is_learned_recognises_clouds_that_it_has_not_seen() {
        let sample = sample(6, 12, 40);
        for method in [Method::Projection, Method::KernelRidge] {
            for has_sequences in [false, true] {
                let Learned { recogniser, found } = learned(method, &sample, has_sequences);
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
                assert_eq!((recogniser.wrong, recogniser.asked), (0, 36));
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
            let error = learned(method, &noise, true).recogniser.database_error();
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
    fn the_nearest_cloud_needs_no_learning() {
        let database = LabelledClouds { channels: &[], objects: &[], sequences: &[] };
        assert_eq!(LearnedRecogniser::learn(Method::Nearest, &database), Ok(None));
        let empty = LearnedRecogniser::learn(Method::Projection, &database);
        assert_eq!(empty, Err(LearnError::Objects { got: 0 }));
        assert_eq!(LearnedRecogniser::learn(Method::KernelRidge, &database), empty);
    }
}
