//! What is kept of a cloud for matching: mean and spread of its keypoints' histograms (DESIGN 5.7).

use std::borrow::Borrow;

use pulp::NullaryFnOnce;
use rayon::prelude::*;

use crate::distance::{SetDistance, chi_squared, l1};
use crate::histogram::Half;
use crate::prepare::PreparedCloud;
use crate::quantise::Binning;
use crate::wide::widest;

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
        if width == 0 { Self::default() } else { widest(Summarise { rows, width }) }
    }

    /// One half of a cloud's descriptor.
    fn of(half: Half, cloud: &PreparedCloud, binning: &Binning) -> Self {
        let bins = half.bins(binning);
        if bins == 0 { Self::default() } else { widest(Describe { half, cloud, binning }) }
    }

    /// χ² distance of the centroids plus that of the deviations.
    pub fn distance(&self, other: &Self) -> f32 {
        self.distance_by(SetDistance::ChiSquared, other)
    }

    /// Distance of the centroids plus that of the deviations.
    pub fn distance_by(&self, distance: SetDistance, other: &Self) -> f32 {
        let of_two = match distance {
            SetDistance::ChiSquared => chi_squared,
            SetDistance::L1 => l1,
        };
        of_two(&self.centroid, &other.centroid) + of_two(&self.deviation, &other.deviation)
    }
}

/// One cloud under one descriptor.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Of the shape histograms, disk and ring, without the bins beyond 180 degrees, which are empty by definition.
    /// Depends on shape_bins, R1 and R2.
    pub shape: Part,
    /// Of the colour histograms, disk and ring: 2m² values. Depends on m, R1 and R2; empty without colour.
    pub colour: Part,
}

impl Summary {
    /// The cloud's summary under the binning's descriptor.
    pub fn new(cloud: &PreparedCloud, binning: &Binning) -> Self {
        Self { shape: Part::of(Half::Shape, cloud, binning), colour: Part::of(Half::Colour, cloud, binning) }
    }

    /// Set distance w·d_sh + (1 − w)·d_cl.
    pub fn distance(&self, other: &Self, shape_weight: f64) -> f64 {
        weighted(self.shape.distance(&other.shape), self.colour.distance(&other.colour), shape_weight)
    }
}

/// w·d_sh + (1 − w)·d_cl in f64.
#[inline(always)]
pub fn weighted(shape: f32, colour: f32, shape_weight: f64) -> f64 {
    shape_weight * f64::from(shape) + (1.0 - shape_weight) * f64::from(colour)
}

/// The kernel of [`Part::of_rows`].
pub(crate) struct Summarise<'a> {
    pub(crate) rows: &'a [f32],
    pub(crate) width: usize,
}

impl NullaryFnOnce for Summarise<'_> {
    type Output = Part;

    #[inline(always)]
    fn call(self) -> Part {
        let count = (self.rows.len() / self.width) as f64;
        let mut mean = vec![0.0f64; self.width];
        for row in self.rows.chunks_exact(self.width) {
            for (sum, &value) in mean.iter_mut().zip(row) {
                *sum += f64::from(value);
            }
        }
        for sum in &mut mean {
            *sum /= count;
        }
        let mut squares = vec![0.0f64; self.width];
        for row in self.rows.chunks_exact(self.width) {
            for ((sum, &value), mean) in squares.iter_mut().zip(row).zip(&mean) {
                let difference = f64::from(value) - mean;
                *sum += difference * difference;
            }
        }
        let degrees = if count > 1.0 { count - 1.0 } else { 1.0 };
        Part {
            centroid: mean.iter().map(|&mean| mean as f32).collect(),
            deviation: squares.iter().map(|&sum| (sum / degrees).sqrt() as f32).collect(),
        }
    }
}

/// The kernel of [`Part::of`].
struct Describe<'a> {
    half: Half,
    cloud: &'a PreparedCloud,
    binning: &'a Binning,
}

impl NullaryFnOnce for Describe<'_> {
    type Output = Part;

    #[inline(always)]
    fn call(self) -> Part {
        let width = 2 * self.half.bins(self.binning);
        let mut rows = vec![0.0; self.cloud.keypoints() * width];
        self.half.fill(self.cloud, self.binning, &mut rows);
        Summarise { rows: &rows, width }.call()
    }
}

/// Summaries of many clouds, in their order, computed by the current rayon pool.
pub fn summarise<C: Borrow<PreparedCloud> + Sync>(clouds: &[C], binning: &Binning) -> Vec<Summary> {
    clouds.par_iter().map(|cloud| Summary::new(cloud.borrow(), binning)).collect()
}

/// One part of the descriptor (shape or colour) of several clouds: what is kept of them between evaluations.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parts {
    /// Values of one cloud: half of them its centroid, half its deviation.
    pub(crate) width: usize,
    pub(crate) clouds: usize,
    pub(crate) values: Vec<f32>,
}

impl Parts {
    /// The shape parts of some clouds, in their order, computed by the current rayon pool.
    pub fn shape<C: Borrow<PreparedCloud> + Sync>(clouds: &[C], binning: &Binning) -> Self {
        Self::of(Half::Shape, clouds, binning)
    }

    /// The colour parts of some clouds, in their order, computed by the current rayon pool.
    pub fn colour<C: Borrow<PreparedCloud> + Sync>(clouds: &[C], binning: &Binning) -> Self {
        Self::of(Half::Colour, clouds, binning)
    }

    fn of<C: Borrow<PreparedCloud> + Sync>(half: Half, clouds: &[C], binning: &Binning) -> Self {
        let parts: Vec<Part> =
            clouds.par_iter().map(|cloud| Part::of(half, cloud.borrow(), binning)).collect();
        parts.iter().collect()
    }

    /// Shape and colour parts.
    pub fn both<C: Borrow<PreparedCloud> + Sync>(clouds: &[C], binning: &Binning) -> [Self; 2] {
        [Self::shape(clouds, binning), Self::colour(clouds, binning)]
    }

    /// Adds the clouds of `other` after these.
    ///
    /// # Panics
    /// If they are of another descriptor: a programming error.
    pub fn append(&mut self, other: &Self) {
        assert!(
            self.clouds == 0 || other.clouds == 0 || self.width == other.width,
            "parts of different descriptors"
        );
        self.width = self.width.max(other.width);
        self.clouds += other.clouds;
        self.values.extend_from_slice(&other.values);
    }

    /// Number of clouds.
    pub fn clouds(&self) -> usize {
        self.clouds
    }

    /// One cloud's centroid and deviation.
    pub fn get(&self, cloud: usize) -> [&[f32]; 2] {
        let (centroid, deviation) = self.values[cloud * self.width..][..self.width].split_at(self.width / 2);
        [centroid, deviation]
    }

    /// Values of one centroid or deviation.
    pub fn bins(&self) -> usize {
        self.width / 2
    }

    /// Memory that the parts take, bytes.
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + size_of_val(self.values.as_slice())
    }
}

impl<'a> FromIterator<&'a Part> for Parts {
    fn from_iter<I: IntoIterator<Item = &'a Part>>(parts: I) -> Self {
        let mut all = Self::default();
        for part in parts {
            let width = part.centroid.len() + part.deviation.len();
            assert!(all.clouds == 0 || all.width == width, "parts of different descriptors");
            all.width = width;
            all.clouds += 1;
            all.values.extend_from_slice(&part.centroid);
            all.values.extend_from_slice(&part.deviation);
        }
        all
    }
}
