//! Recognisers that learn from the vectors of a database, or from the distances among its clouds, whoever computed them.

use super::choose::{self, ChosenSettings};
use super::matrix::Matrix;
use super::{Components, KernelRidge, LearnError, Projection, Settings, Vote};

/// What has been learned, with settings that were chosen inside the database.
#[derive(Clone, Debug, PartialEq)]
pub struct GivenRecogniser {
    model: Model,
    /// The settings.
    pub chosen: ChosenSettings,
}

#[derive(Clone, Debug, PartialEq)]
enum Model {
    Projection(Projection),
    KernelRidge(KernelRidge),
}

impl GivenRecogniser {
    /// A projection, from the values of each cloud (row), by the current rayon pool. Folds go by the sequences of the
    /// clouds, where they are known.
    ///
    /// # Errors
    /// [`LearnError`] if nothing can be learned from them.
    ///
    /// # Panics
    /// If there are not as many objects and sequences as clouds: a programming error.
    pub fn projection(
        values: &Matrix,
        objects: &[u32],
        sequences: &[Option<u32>],
    ) -> Result<Self, LearnError> {
        assert_eq!([values.rows(), sequences.len()], [objects.len(); 2], "one row for each cloud");
        let chosen = choose::projection(values, objects, sequences);
        let projection = Components::new(values, objects)?.projection(&chosen.settings)?;
        Ok(Self { model: Model::Projection(projection), chosen: chosen.of(Settings::Projection) })
    }

    /// Kernel ridge regression, from the distances of each cloud (row) to all; they are asked for if there are not too many
    /// clouds.
    ///
    /// # Errors
    /// As [`GivenRecogniser::projection`].
    ///
    /// # Panics
    /// As [`GivenRecogniser::projection`].
    pub fn kernel_ridge(
        distances: impl FnOnce() -> Matrix,
        objects: &[u32],
        sequences: &[Option<u32>],
    ) -> Result<Self, LearnError> {
        KernelRidge::check(objects)?;
        let distances = distances();
        assert_eq!([distances.rows(), sequences.len()], [objects.len(); 2], "one row for each cloud");
        let chosen = choose::kernel_ridge(&distances, objects, sequences);
        let ridge = KernelRidge::learn(&distances, objects, &chosen.settings)?;
        Ok(Self { model: Model::KernelRidge(ridge), chosen: chosen.of(Settings::KernelRidge) })
    }

    /// Values that are kept of a cloud if they are others than those that were given.
    pub fn size(&self) -> Option<usize> {
        match &self.model {
            Model::Projection(projection) => Some(projection.size()),
            Model::KernelRidge(_) => None,
        }
    }

    /// What speaks for each object, best first: from the values of a cloud for a projection, from its distances to the
    /// database for kernel ridge regression.
    pub fn votes(&self, given: &[f64]) -> Vec<Vote> {
        match &self.model {
            Model::Projection(projection) => projection.votes(given),
            Model::KernelRidge(ridge) => ridge.votes(given),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Sample, distances, sample};
    use super::super::{LabelledClouds, LearnedRecogniser};
    use super::*;
    use crate::signature::{Signature, Signatures};
    use crate::{DistanceMatrix, SetDistance};

    #[test]
    fn what_is_learned_recognises_clouds_that_it_has_not_seen() {
        let Sample { values, objects } = sample(6, 12, 40);
        let (known, asked): (Vec<usize>, Vec<usize>) = (0..objects.len()).partition(|cloud| cloud % 2 == 0);
        let (database, shown) = (values.select(&known), choose::at(&objects, &known));
        let all = distances(&values);
        let sequences: Vec<Option<u32>> = (0..known.len() as u32).map(|cloud| Some(cloud % 3)).collect();
        let projection = GivenRecogniser::projection(&database, &shown, &sequences).unwrap();
        let among = || all.select(&known).transposed().select(&known);
        let ridge = GivenRecogniser::kernel_ridge(among, &shown, &sequences).unwrap();
        assert_eq!([projection.chosen.error(), ridge.chosen.error()], [Some(0.0); 2]);
        assert_eq!([projection.size(), ridge.size()], [Some(5), None]);
        let mut wrong = [0; 2];
        for &query in &asked {
            let to_known: Vec<f64> = known.iter().map(|&cloud| all.row(query)[cloud]).collect();
            let votes = [projection.votes(values.row(query)), ridge.votes(&to_known)];
            for (wrong, votes) in wrong.iter_mut().zip(votes) {
                *wrong += usize::from(shown[votes[0].cloud as usize] != objects[query]);
                assert!(votes.is_sorted_by(|a, b| a.score >= b.score));
            }
        }
        // By chance it would be 30 of 36.
        assert!(wrong.iter().all(|&wrong| wrong <= 2), "{wrong:?}");
    }

    /// What is learned of signatures is learned of their values and distances.
    #[test]
    fn it_is_the_recogniser_of_a_descriptor_with_the_same_values() {
        let Sample { values, objects } = sample(4, 9, 12);
        let signature = |row: &[f64]| {
            let centroid = row.iter().map(|&value| value as f32).collect();
            Signature { centroid, deviation: Vec::new() }
        };
        let signatures: Vec<Signature> = (0..values.rows()).map(|row| signature(values.row(row))).collect();
        let signatures: Signatures = signatures.iter().collect();
        let metric = SetDistance::ChiSquared;
        let channels = [(&signatures, metric, 1.0)];
        let clouds = LabelledClouds { channels: &channels, objects: &objects };
        let sequences = vec![None; objects.len()];
        let roots = |row: usize| {
            signatures.get(row)[0].iter().map(|&value| f64::from(value).sqrt()).collect::<Vec<f64>>()
        };
        let rooted = Matrix::new(values.columns(), (0..values.rows()).flat_map(roots).collect());
        let matrix = DistanceMatrix::among(metric, &signatures);
        let row =
            |row: usize| matrix.row(row).iter().map(|&distance| f64::from(distance)).collect::<Vec<f64>>();
        let among = || Matrix::new(matrix.columns(), (0..values.rows()).flat_map(row).collect());
        let projection = GivenRecogniser::projection(&rooted, &objects, &sequences).unwrap();
        let ridge = GivenRecogniser::kernel_ridge(among, &objects, &sequences).unwrap();
        let check = |given: &GivenRecogniser, of_query: &dyn Fn(usize) -> Vec<f64>| {
            let learned = LearnedRecogniser::new(&given.chosen.settings, &clouds).unwrap();
            for query in 0..values.rows() {
                let [centroid, _] = signatures.get(query).map(<[f32]>::to_vec);
                let ranking =
                    learned.ranking(&[Signature { centroid, deviation: Vec::new() }], || row(query));
                let votes = given.votes(&of_query(query));
                assert!(ranking.iter().map(|hit| hit.index).eq(votes.iter().map(|vote| vote.cloud)));
                let distances = votes.iter().map(|vote| 1.0 - vote.score);
                assert!(ranking.iter().map(|hit| hit.distance).eq(distances));
            }
        };
        check(&projection, &roots);
        check(&ridge, &row);
    }

    #[test]
    fn nothing_is_learned_from_one_object_or_too_many_clouds() {
        let one = Matrix::new(1, vec![1.0, 2.0]);
        let none = Err(LearnError::Objects { got: 1 });
        assert_eq!(GivenRecogniser::projection(&one, &[3, 3], &[None; 2]), none);
        assert_eq!(GivenRecogniser::kernel_ridge(|| one, &[3, 3], &[None; 2]), none);
        let many = vec![0; super::super::MAX_CLOUDS + 1];
        let asked = || panic!("distances of too many clouds");
        let refused = GivenRecogniser::kernel_ridge(asked, &many, &vec![None; many.len()]);
        assert!(matches!(refused, Err(LearnError::Clouds { .. })));
    }
}
