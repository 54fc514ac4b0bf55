//! Dense matrices in f64 whose products are the same bits on every processor.
//!
//! nalgebra's product fuses multiplications and additions where the processor can, so that its bits depend on it. Its
//! eigenvectors and its Cholesky factors are plain loops of + − × ÷ √, and are used.

use rayon::prelude::*;

/// A matrix, row after row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Matrix {
    columns: usize,
    values: Vec<f64>,
}

/// Sums that a dot product keeps apart.
const LANES: usize = 8;

/// Σ aᵢ·bᵢ. Eight sums, of every eighth product each, are added up in a fixed order: whatever vectors the processor has,
/// the bits are the same.
#[inline(always)]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let ([a_blocks, b_blocks], [a_rest, b_rest]) = {
        let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
        ([a, b], [a_rest, b_rest])
    };
    let mut sums = [0.0; LANES];
    for (a, b) in a_blocks.iter().zip(b_blocks) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    for ((sum, a), b) in sums.iter_mut().zip(a_rest).zip(b_rest) {
        *sum += a * b;
    }
    let [a, b, c, d, e, f, g, h] = sums;
    ((a + b) + (c + d)) + ((e + f) + (g + h))
}

impl Matrix {
    /// Of so many columns, with these values row after row.
    ///
    /// # Panics
    /// If the last row is not whole: a programming error.
    pub fn new(columns: usize, values: Vec<f64>) -> Self {
        assert!(values.len().is_multiple_of(columns.max(1)), "whole rows");
        Self { columns, values }
    }

    /// The number of rows.
    pub fn rows(&self) -> usize {
        self.values.len().checked_div(self.columns).unwrap_or(0)
    }

    /// The number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// One row.
    pub fn row(&self, row: usize) -> &[f64] {
        &self.values[row * self.columns..][..self.columns]
    }

    /// All values, row after row.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// These rows, in this order.
    pub fn select(&self, rows: &[usize]) -> Self {
        Self { columns: self.columns, values: rows.iter().flat_map(|&row| self.row(row)).copied().collect() }
    }

    /// The first columns.
    pub fn first_columns(&self, columns: usize) -> Self {
        let values = (0..self.rows()).flat_map(|row| &self.row(row)[..columns]).copied().collect();
        Self { columns, values }
    }

    /// Rows as columns.
    pub fn transposed(&self) -> Self {
        let (rows, columns) = (self.rows(), self.columns);
        let mut values = Vec::with_capacity(self.values.len());
        for column in 0..columns {
            values.extend((0..rows).map(|row| self.values[row * columns + column]));
        }
        Self { columns: rows, values }
    }

    /// The mean of the rows, in their order; zeros of none.
    pub fn mean_row(&self) -> Vec<f64> {
        let mut mean = vec![0.0; self.columns];
        for row in 0..self.rows() {
            for (sum, value) in mean.iter_mut().zip(self.row(row)) {
                *sum += value;
            }
        }
        let rows = self.rows().max(1) as f64;
        mean.iter_mut().for_each(|sum| *sum /= rows);
        mean
    }

    /// Each row less `row`.
    pub fn less(mut self, row: &[f64]) -> Self {
        for values in self.values.chunks_exact_mut(self.columns.max(1)) {
            values.iter_mut().zip(row).for_each(|(value, less)| *value -= less);
        }
        self
    }

    /// The product with the transpose of `other`, by the current rayon pool: of each row of this the dot products with
    /// the rows of `other`.
    pub fn times_transposed(&self, other: &Self) -> Self {
        let row = |row: usize| (0..other.rows()).map(move |column| dot(self.row(row), other.row(column)));
        let values: Vec<Vec<f64>> = (0..self.rows()).into_par_iter().map(|one| row(one).collect()).collect();
        Self { columns: other.rows(), values: values.concat() }
    }

    /// The product with its own transpose: half of it is computed, by the current rayon pool.
    pub fn gram(&self) -> Self {
        let rows = self.rows();
        let later = |row: usize| -> Vec<f64> {
            (row..rows).map(|column| dot(self.row(row), self.row(column))).collect()
        };
        let later: Vec<Vec<f64>> = (0..rows).into_par_iter().map(later).collect();
        let values = (0..rows)
            .flat_map(|row| (0..rows).map(move |column| (row.min(column), row.max(column))))
            .map(|(row, column)| later[row][column - row])
            .collect();
        Self { columns: rows, values }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn matrix(rows: usize, columns: usize) -> impl Strategy<Value = Matrix> {
        prop::collection::vec(-4.0..4.0f64, rows * columns)
            .prop_map(move |values| Matrix::new(columns, values))
    }

    proptest! {
        #[test]
        fn products_are_their_definition(
            (a, b) in (1usize..7, 1usize..7, 1usize..20)
                .prop_flat_map(|(rows, others, columns)| (matrix(rows, columns), matrix(others, columns))),
        ) {
            let product = a.times_transposed(&b);
            prop_assert_eq!((product.rows(), product.columns()), (a.rows(), b.rows()));
            for row in 0..a.rows() {
                for column in 0..b.rows() {
                    let plain: f64 = a.row(row).iter().zip(b.row(column)).map(|(a, b)| a * b).sum();
                    prop_assert!((product.row(row)[column] - plain).abs() < 1e-12);
                }
            }
            prop_assert_eq!(a.gram(), a.times_transposed(&a));
            prop_assert_eq!(a.transposed().transposed(), a);
        }
    }

    #[test]
    fn means_are_of_columns() {
        let matrix = Matrix::new(2, vec![1.0, 10.0, 3.0, 30.0]);
        assert_eq!(matrix.mean_row(), [2.0, 20.0]);
        assert_eq!(matrix.clone().less(&[2.0, 20.0]).values(), [-1.0, -10.0, 1.0, 10.0]);
        assert_eq!(matrix.first_columns(1).values(), [1.0, 3.0]);
        assert_eq!(matrix.select(&[1, 1]).values(), [3.0, 30.0, 3.0, 30.0]);
        assert_eq!(Matrix::new(0, Vec::new()).rows(), 0);
    }
}
