//! What is kept of a cloud for matching: mean and spread of its keypoints' histograms (DESIGN 5.7).

use std::borrow::Borrow;

use rayon::prelude::*;

use crate::distance::chi_squared;
use crate::histogram::{colour_rows, shape_rows};
use crate::prepare::PreparedCloud;
use crate::quantise::Binning;

/// Centroid and standard deviation of the rows of one part of the descriptor, value by value.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Part {
    /// Mean of the rows.
    pub centroid: Vec<f32>,
    /// Square root of the sum of squared differences from the mean over N − 1; 0 for a single row.
    pub deviation: Vec<f32>,
}

impl Part {
    /// Summarises rows of `width` values that lie one after the other. Sums run in f64 in the order of the rows, the
    /// deviation in a second pass about the unrounded mean.
    pub fn of_rows(rows: &[f32], width: usize) -> Self {
        if width == 0 {
            return Self::default();
        }
        let count = (rows.len() / width) as f64;
        let mut mean = vec![0.0f64; width];
        for row in rows.chunks_exact(width) {
            for (sum, &value) in mean.iter_mut().zip(row) {
                *sum += f64::from(value);
            }
        }
        for sum in &mut mean {
            *sum /= count;
        }
        let mut squares = vec![0.0f64; width];
        for row in rows.chunks_exact(width) {
            for ((sum, &value), mean) in squares.iter_mut().zip(row).zip(&mean) {
                let difference = f64::from(value) - mean;
                *sum += difference * difference;
            }
        }
        let degrees = if count > 1.0 { count - 1.0 } else { 1.0 };
        Self {
            centroid: mean.iter().map(|&mean| mean as f32).collect(),
            deviation: squares.iter().map(|&sum| (sum / degrees).sqrt() as f32).collect(),
        }
    }

    /// χ² distance of the centroids plus that of the deviations.
    pub fn distance(&self, other: &Self) -> f32 {
        chi_squared(&self.centroid, &other.centroid) + chi_squared(&self.deviation, &other.deviation)
    }
}

/// One cloud under one descriptor.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Of the shape histograms, disk and ring: 2·shape_bins values. Depends on shape_bins, R1 and R2.
    pub shape: Part,
    /// Of the colour histograms, disk and ring: 2m² values. Depends on m, R1 and R2; empty without colour.
    pub colour: Part,
}

impl Summary {
    /// The cloud's summary under the binning's descriptor.
    pub fn new(cloud: &PreparedCloud, binning: &Binning) -> Self {
        Self { shape: shape_part(cloud, binning), colour: colour_part(cloud, binning) }
    }

    /// Set distance w·d_sh + (1 − w)·d_cl.
    pub fn distance(&self, other: &Self, shape_weight: f64) -> f64 {
        weighted(self.shape.distance(&other.shape), self.colour.distance(&other.colour), shape_weight)
    }
}

/// w·d_sh + (1 − w)·d_cl in f64.
pub fn weighted(shape: f32, colour: f32, shape_weight: f64) -> f64 {
    shape_weight * f64::from(shape) + (1.0 - shape_weight) * f64::from(colour)
}

/// The shape half of [`Summary::new`].
pub fn shape_part(cloud: &PreparedCloud, binning: &Binning) -> Part {
    Part::of_rows(&shape_rows(cloud, binning), 2 * binning.parameters().shape_bins as usize)
}

/// The colour half of [`Summary::new`].
pub fn colour_part(cloud: &PreparedCloud, binning: &Binning) -> Part {
    let m = binning.parameters().colour_bins as usize;
    Part::of_rows(&colour_rows(cloud, binning), 2 * m * m)
}

/// Summaries of many clouds, in their order, computed by the current rayon pool.
pub fn summarise<C: Borrow<PreparedCloud> + Sync>(clouds: &[C], binning: &Binning) -> Vec<Summary> {
    clouds.par_iter().map(|cloud| Summary::new(cloud.borrow(), binning)).collect()
}
