//! χ² distance of histograms, and matrices of it.

use rayon::prelude::*;

use crate::summary::Part;

/// Independent sums of a χ² distance: value i goes to sum i mod `LANES`.
const LANES: usize = 16;

/// χ² distance Σ (a − b)² / (2(a + b)) of two histograms of equal length; a term with a + b = 0 is 0 (DESIGN 5.7).
///
/// Terms and sums are f32: twice as many fit a register as f64, and matching is mostly divisions. The terms are added
/// in sixteen sums, and those pairwise, whatever the target, so the result is the same on all of them.
///
/// # Panics
/// If the lengths differ: a programming error.
pub fn chi_squared(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len(), "histograms of different descriptors");
    let mut sums = [0.0f32; LANES];
    let (a, a_rest) = a.as_chunks::<LANES>();
    let (b, b_rest) = b.as_chunks::<LANES>();
    for (a, b) in a.iter().zip(b) {
        for lane in 0..LANES {
            sums[lane] += term(a[lane], b[lane]);
        }
    }
    for (sum, (&a, &b)) in sums.iter_mut().zip(a_rest.iter().zip(b_rest)) {
        *sum += term(a, b);
    }
    let mut width = LANES / 2;
    while width > 0 {
        for lane in 0..width {
            sums[lane] += sums[lane + width];
        }
        width /= 2;
    }
    sums[0]
}

/// One term. Where a + b = 0 it divides 0 by the smallest normal number, which saves a branch.
#[inline(always)]
fn term(a: f32, b: f32) -> f32 {
    let difference = a - b;
    let twice = 2.0 * (a + b);
    let divisor = if twice > f32::MIN_POSITIVE { twice } else { f32::MIN_POSITIVE };
    difference * difference / divisor
}

/// Distances of every query (row) to every cloud of the database (column).
#[derive(Clone, Debug, PartialEq)]
pub struct DistanceMatrix {
    columns: usize,
    values: Vec<f32>,
}

impl DistanceMatrix {
    /// The distances of one part of the descriptor, computed by the current rayon pool.
    pub fn new(queries: &[&Part], database: &[&Part]) -> Self {
        let columns = database.len();
        let mut values = vec![0.0; queries.len() * columns];
        if columns > 0 {
            values.par_chunks_exact_mut(columns).zip(queries).for_each(|(row, query)| {
                for (value, entry) in row.iter_mut().zip(database) {
                    *value = query.distance(entry);
                }
            });
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

    fn plain(a: &[f32], b: &[f32]) -> f64 {
        let pairs = a.iter().zip(b).map(|(&a, &b)| (f64::from(a), f64::from(b)));
        pairs.filter(|(a, b)| a + b > 0.0).map(|(a, b)| (a - b) * (a - b) / (2.0 * (a + b))).sum()
    }

    /// Histograms of one length with many zeros.
    fn pair() -> impl Strategy<Value = Vec<(f32, f32)>> {
        let share = || prop_oneof![Just(0.0f32), 0.0f32..1.0, Just(f32::MIN_POSITIVE)];
        prop::collection::vec((share(), share()), 0..100)
    }

    proptest! {
        #[test]
        fn chi_squared_is_its_definition(pair in pair()) {
            let (a, b): (Vec<f32>, Vec<f32>) = pair.into_iter().unzip();
            let found = f64::from(chi_squared(&a, &b));
            prop_assert!((found - plain(&a, &b)).abs() <= 1e-5 * plain(&a, &b) + 1e-30);
            prop_assert_eq!(chi_squared(&a, &b).to_bits(), chi_squared(&b, &a).to_bits());
            prop_assert_eq!(chi_squared(&a, &a), 0.0);
        }
    }

    #[test]
    fn disjoint_histograms_are_one_apart() {
        assert_eq!(chi_squared(&[0.5, 0.5, 0.0], &[0.0, 0.0, 1.0]), 1.0);
        assert_eq!(chi_squared(&[0.0; 40], &[0.0; 40]), 0.0);
        assert_eq!(chi_squared(&[], &[]), 0.0);
    }

    #[test]
    fn the_matrix_holds_every_pair() {
        let part = |values: [f32; 2]| Part { centroid: values.to_vec(), deviation: vec![0.0, values[0]] };
        let (queries, database) =
            ([part([0.1, 0.9]), part([0.4, 0.6])], [part([1.0, 0.0]), part([0.4, 0.6]), part([0.0, 1.0])]);
        let matrix = DistanceMatrix::new(&queries.each_ref(), &database.each_ref());
        for (row, query) in queries.iter().enumerate() {
            let expected: Vec<f32> = database.iter().map(|entry| query.distance(entry)).collect();
            assert_eq!(matrix.row(row), expected);
        }
        assert_eq!(matrix.row(1)[1], 0.0);
        let empty = DistanceMatrix::new(&queries.each_ref(), &[]);
        assert_eq!((empty.columns(), empty.row(1)), (0, [].as_slice()));
    }
}
