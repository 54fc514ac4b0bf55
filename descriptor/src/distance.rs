//! Matrices of distances of clouds.

use std::borrow::Borrow;

use rayon::prelude::*;

use crate::set_distance::{ChiSquared, Hellinger, L1, Terms};
pub use crate::set_distance::{SetDistance, chi_squared, hellinger, l1};
use crate::signature::Signatures;
use crate::transposed::{LANES, Transposed};

/// One query's set distances to every cloud of the database: Σ weight · distance over the channels, in their order and
/// in f64. They replace what is in `sums`.
pub fn set_distances<M: Borrow<DistanceMatrix>>(channels: &[(M, f64)], query: usize, sums: &mut Vec<f64>) {
    sums.clear();
    let Some(((matrix, weight), others)) = channels.split_first() else { return };
    sums.extend(matrix.borrow().row(query).iter().map(|&distance| weight * f64::from(distance)));
    for (matrix, weight) in others {
        for (sum, &distance) in sums.iter_mut().zip(matrix.borrow().row(query)) {
            *sum += weight * f64::from(distance);
        }
    }
}

/// Distances of every query (row) to every cloud of the database (column).
#[derive(Clone, Debug, PartialEq)]
pub struct DistanceMatrix {
    columns: usize,
    values: Vec<f32>,
}

impl DistanceMatrix {
    /// The χ² distances in one channel, computed by the current rayon pool.
    ///
    /// # Panics
    /// If queries and database are of different channels: a programming error.
    pub fn new(queries: &Signatures, database: &Signatures) -> Self {
        Self::of_terms::<ChiSquared>(queries, database)
    }

    /// As [`DistanceMatrix::new`], with any set distance.
    pub fn by(distance: SetDistance, queries: &Signatures, database: &Signatures) -> Self {
        match distance {
            SetDistance::ChiSquared => Self::of_terms::<ChiSquared>(queries, database),
            SetDistance::L1 => Self::of_terms::<L1>(queries, database),
            SetDistance::Hellinger => Self::of_terms::<Hellinger>(queries, database),
        }
    }

    /// The distances of some clouds to the same clouds: as [`DistanceMatrix::by`] of them and themselves, to the bit, in
    /// half the time.
    pub fn among(distance: SetDistance, clouds: &Signatures) -> Self {
        match distance {
            SetDistance::ChiSquared => Self::among_of_terms::<ChiSquared>(clouds),
            SetDistance::L1 => Self::among_of_terms::<L1>(clouds),
            SetDistance::Hellinger => Self::among_of_terms::<Hellinger>(clouds),
        }
    }

    /// The terms of a pair are the same whichever cloud is the query, so that half of the distances are copies.
    fn among_of_terms<T: Terms>(clouds: &Signatures) -> Self {
        let columns = clouds.clouds();
        let transposed = Transposed::new(clouds);
        // Of each cloud those to the clouds of its own block and of later ones.
        let later = |query: usize| {
            let first = query / LANES;
            let mut row = vec![[0.0; LANES]; columns.div_ceil(LANES) - first];
            transposed.distances_from::<T>(first, clouds.get(query), &mut row);
            row
        };
        let later: Vec<Vec<[f32; LANES]>> = (0..columns).into_par_iter().map(later).collect();
        let mut values = vec![0.0; columns * columns];
        let blocks = values.par_chunks_mut((LANES * columns).max(1)).enumerate();
        blocks.for_each(|(block, rows)| {
            let first = block * LANES;
            for (lane, row) in rows.chunks_exact_mut(columns).enumerate() {
                let (before, rest) = row.split_at_mut(first);
                for (cloud, distance) in before.iter_mut().enumerate() {
                    *distance = later[cloud][block - cloud / LANES][lane];
                }
                let columns = rest.len();
                rest.copy_from_slice(&later[first + lane].as_flattened()[..columns]);
            }
        });
        Self { columns, values }
    }

    fn of_terms<T: Terms>(queries: &Signatures, database: &Signatures) -> Self {
        let (rows, columns) = (queries.clouds(), database.clouds());
        let mut values = vec![0.0; rows * columns];
        if rows > 0 && columns > 0 {
            assert_eq!(queries.bins(), database.bins(), "signatures of different channels");
            let transposed = Transposed::new(database);
            let blocks = columns.div_ceil(LANES);
            values.par_chunks_exact_mut(columns).enumerate().for_each_init(
                || vec![[0.0; LANES]; blocks],
                |row, (query, values)| {
                    transposed.distances_by::<T>(queries.get(query), row);
                    values.copy_from_slice(&row.as_flattened()[..columns]);
                },
            );
        }
        Self { columns, values }
    }

    /// One query's distances, by index of the database.
    pub fn row(&self, query: usize) -> &[f32] {
        &self.values[query * self.columns..(query + 1) * self.columns]
    }

    /// Number of clouds in the database.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Memory that the matrix takes, bytes.
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + size_of_val(self.values.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::signature::Signature;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn distances_among_clouds_are_those_to_a_database_of_them(
            values in prop::collection::vec(prop::collection::vec(prop_oneof![Just(0.0f32), 0.0f32..1.0], 5), 0..70),
            bins in 0usize..=4,
        ) {
            let signature =
                |values: &Vec<f32>| Signature { centroid: values[..bins].to_vec(), deviation: values[1..=bins].to_vec() };
            let clouds: Vec<Signature> = values.iter().map(signature).collect();
            let clouds: Signatures = clouds.iter().collect();
            for distance in SetDistance::ALL {
                let expected = DistanceMatrix::by(distance, &clouds, &clouds);
                prop_assert_eq!(DistanceMatrix::among(distance, &clouds), expected);
            }
        }
    }

    #[test]
    fn the_matrix_holds_every_pair() {
        let signature =
            |values: [f32; 2]| Signature { centroid: values.to_vec(), deviation: vec![0.0, values[0]] };
        let (queries, database) = (
            [signature([0.1, 0.9]), signature([0.4, 0.6])],
            [signature([1.0, 0.0]), signature([0.4, 0.6]), signature([0.0, 1.0])],
        );
        let matrix = DistanceMatrix::new(&queries.iter().collect(), &database.iter().collect());
        for (row, query) in queries.iter().enumerate() {
            let expected: Vec<f32> = database.iter().map(|entry| query.distance(entry)).collect();
            assert_eq!(matrix.row(row), expected);
        }
        assert_eq!(matrix.row(1)[1], 0.0);
        for distance in SetDistance::ALL {
            let matrix = DistanceMatrix::by(distance, &queries.iter().collect(), &database.iter().collect());
            for (row, query) in queries.iter().enumerate() {
                let expected: Vec<f32> =
                    database.iter().map(|entry| query.distance_by(distance, entry)).collect();
                assert_eq!(matrix.row(row), expected, "{distance:?}");
            }
            assert_eq!(SetDistance::named(distance.name()), Some(distance));
        }
        let empty = DistanceMatrix::new(&queries.iter().collect(), &Signatures::default());
        assert_eq!((empty.columns(), empty.row(1)), (0, [].as_slice()));
    }
}
