//! Databases for the tests of recognisers: objects as points about a centre of their own.

use rand::RngExt as _;

use super::matrix::Matrix;
use crate::random;

/// Clouds with what they show.
pub struct Sample {
    /// A row a cloud, values from 0 to 1.
    pub values: Matrix,
    /// Object by object.
    pub objects: Vec<u32>,
}

/// So many objects with so many clouds each, of so many values.
pub fn sample(objects: u32, clouds: u32, columns: usize) -> Sample {
    let mut rng = random::stream(1, "recogniser.sample", &[u64::from(objects), u64::from(clouds)]);
    let mut values = Vec::new();
    for _ in 0..objects {
        let centre: Vec<f64> = (0..columns).map(|_| rng.random_range(0.2..0.8)).collect();
        for _ in 0..clouds {
            values.extend(centre.iter().map(|value| value + rng.random_range(-0.2..0.2)));
        }
    }
    let objects = (0..objects).flat_map(|object| vec![object; clouds as usize]).collect();
    Sample { values: Matrix::new(columns, values), objects }
}

/// Of all pairs Σ |a − b|.
pub fn distances(values: &Matrix) -> Matrix {
    let distance = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum() };
    let rows = 0..values.rows();
    let all = rows
        .clone()
        .flat_map(|a| rows.clone().map(move |b| (a, b)))
        .map(|(a, b)| distance(values.row(a), values.row(b)));
    Matrix::new(values.rows(), all.collect())
}
