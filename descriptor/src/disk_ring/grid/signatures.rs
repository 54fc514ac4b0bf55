//! One cloud under every shape_bins and every m of a cell.

use std::ops::Range;

use pulp::NullaryFnOnce;

use super::Cell;
use crate::disk_ring::quantise::Binning;
use crate::disk_ring::quantised::QuantisedCloud;
use crate::disk_ring::records::Records;
use crate::signature::{MeanAndDeviation, Signature};
use crate::wide::widest;

/// One cloud under all descriptors of a cell.
#[derive(Clone, Debug, PartialEq)]
pub struct CellSignatures {
    /// One a value of shape_bins.
    pub(super) shape: Vec<Signature>,
    /// One a value of m.
    pub(super) colour: Vec<Signature>,
}

impl CellSignatures {
    /// Memory that they take, bytes.
    pub fn bytes(&self) -> usize {
        let all = || self.shape.iter().chain(&self.colour);
        let values: usize = all().map(|one| one.centroid.len() + one.deviation.len()).sum();
        size_of::<Self>() + all().count() * size_of::<Signature>() + values * size_of::<f32>()
    }
}

impl Cell {
    /// A cloud's signatures for every value of shape_bins and of m: each as [`Binning::signature`] has it.
    ///
    /// # Panics
    /// If cloud and cell come from different quantisers: a programming error.
    pub fn signatures(&self, cloud: &QuantisedCloud) -> CellSignatures {
        assert_eq!(*cloud.digest(), self.shape[0].digest, "cloud and cell of different quantisers");
        let regions = cloud.regions([self.shape[0].disk, self.shape[0].ring]);
        let [angle_classes, colour_classes] = self.classes;
        CellSignatures {
            shape: widest(Shapes {
                angles: &cloud.angles,
                classes: angle_classes,
                regions: &regions,
                binnings: &self.shape,
            }),
            colour: widest(Colours {
                colours: &cloud.colours,
                classes: colour_classes,
                regions: &regions,
                binnings: &self.colour,
            }),
        }
    }
}

/// Rows of one descriptor under construction: as `histogram` makes them.
struct Rows {
    bins: usize,
    values: Vec<f32>,
}

impl Rows {
    fn new(bins: usize, keypoints: usize) -> Self {
        Self { bins, values: vec![0.0; keypoints * 2 * bins] }
    }

    /// The histogram of a keypoint's disk (0) or ring (1).
    #[inline(always)]
    fn region(&mut self, keypoint: usize, region: usize) -> &mut [f32] {
        &mut self.values[(2 * keypoint + region) * self.bins..][..self.bins]
    }

    #[inline(always)]
    fn signature(&self) -> Signature {
        if self.bins == 0 {
            return Signature::default();
        }
        MeanAndDeviation { rows: &self.values, width: 2 * self.bins }.call()
    }
}

/// Shape: every bin is a run of angle classes, so its count is the difference of two sums over codes.
struct Shapes<'a> {
    angles: &'a Records,
    classes: usize,
    regions: &'a [[Range<usize>; 2]],
    binnings: &'a [Binning],
}

impl NullaryFnOnce for Shapes<'_> {
    type Output = Vec<Signature>;

    #[inline(always)]
    fn call(self) -> Vec<Signature> {
        let codes = self.angles.codes(self.classes);
        let bin = |binning: &Binning, code| binning.shape.get(self.angles.class(code));
        // The first code of each bin and the end of the last, for all descriptors one after the other.
        let edges: Vec<Vec<usize>> = self
            .binnings
            .iter()
            .map(|binning| edges(binning.shape_bins(), codes, |code| bin(binning, code)))
            .collect();
        let mut rows: Vec<Rows> =
            self.binnings.iter().map(|binning| Rows::new(binning.shape_bins(), self.regions.len())).collect();
        let mut counts = vec![0u32; codes];
        // Neighbours of the codes before each code.
        let mut before = vec![0u32; codes + 1];
        for (keypoint, regions) in self.regions.iter().enumerate() {
            for (region, records) in regions.iter().enumerate() {
                if records.is_empty() {
                    continue;
                }
                counts.fill(0);
                self.angles.count(records.clone(), &mut counts);
                let mut sum = 0;
                for (before, &count) in before[1..].iter_mut().zip(&counts) {
                    sum += count;
                    *before = sum;
                }
                let total = records.len() as f32;
                for (rows, edges) in rows.iter_mut().zip(&edges) {
                    let shares = rows.region(keypoint, region).iter_mut();
                    for (share, bin) in shares.zip(edges.windows(2)) {
                        *share = (before[bin[1]] - before[bin[0]]) as f32 / total;
                    }
                }
            }
        }
        rows.iter().map(Rows::signature).collect()
    }
}

/// The first code of every bin, and the number of codes.
fn edges(bins: usize, codes: usize, bin: impl Fn(u16) -> usize) -> Vec<usize> {
    let all: Vec<usize> = (0..codes).collect();
    (0..bins).map(|k| all.partition_point(|&code| bin(code as u16) < k)).chain([codes]).collect()
}

/// Colour: the classes that occur are few, and each descriptor adds their counts up anew.
struct Colours<'a> {
    colours: &'a Records,
    classes: usize,
    regions: &'a [[Range<usize>; 2]],
    binnings: &'a [Binning],
}

impl NullaryFnOnce for Colours<'_> {
    type Output = Vec<Signature>;

    #[inline(always)]
    fn call(self) -> Vec<Signature> {
        let mut rows: Vec<Rows> = self
            .binnings
            .iter()
            .map(|binning| Rows::new(binning.colour_bins(), self.regions.len()))
            .collect();
        let mut counts = vec![0u32; self.colours.codes(self.classes)];
        let mut present: Vec<(u16, u32)> = Vec::new();
        let mut bins = vec![0u32; rows.iter().map(|rows| rows.bins).max().unwrap_or(0)];
        for (keypoint, regions) in self.regions.iter().enumerate() {
            for (region, records) in regions.iter().enumerate() {
                // Without colour there is nothing to count.
                if records.is_empty() || self.classes == 0 {
                    continue;
                }
                self.colours.count(records.clone(), &mut counts);
                present.clear();
                let of_code = (0u16..).zip(&mut counts).filter(|(_, count)| **count > 0);
                present
                    .extend(of_code.map(|(code, count)| (self.colours.class(code), std::mem::take(count))));
                let total = records.len() as f32;
                for (rows, binning) in rows.iter_mut().zip(self.binnings) {
                    for &(class, count) in &present {
                        bins[binning.colour.get(class)] += count;
                    }
                    for (share, bin) in rows.region(keypoint, region).iter_mut().zip(&mut bins) {
                        *share = std::mem::take(bin) as f32 / total;
                    }
                }
            }
        }
        rows.iter().map(Rows::signature).collect()
    }
}
