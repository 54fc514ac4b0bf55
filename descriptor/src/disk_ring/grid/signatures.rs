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

/// Rows of several descriptors under construction, side by side: of each keypoint the histograms of its disk by all of
/// them, then those of its ring.
struct Rows {
    /// Bins of each descriptor's histograms.
    bins: Vec<usize>,
    values: Vec<f32>,
}

impl Rows {
    fn new(bins: Vec<usize>, keypoints: usize) -> Self {
        let values = vec![0.0; keypoints * 2 * bins.iter().sum::<usize>()];
        Self { bins, values }
    }

    /// Bins of all histograms of a region.
    fn width(&self) -> usize {
        self.bins.iter().sum()
    }

    /// The signatures: as `histogram` makes the rows of each descriptor. Sums of columns do not depend on each other.
    #[inline(always)]
    fn signatures(&self) -> Vec<Signature> {
        let width = self.width();
        if width == 0 {
            return vec![Signature::default(); self.bins.len()];
        }
        let all = MeanAndDeviation { rows: &self.values, width: 2 * width }.call();
        let mut start = 0;
        let mut signatures = Vec::with_capacity(self.bins.len());
        for &bins in &self.bins {
            let of = |values: &[f32]| [&values[start..][..bins], &values[width + start..][..bins]].concat();
            signatures.push(Signature { centroid: of(&all.centroid), deviation: of(&all.deviation) });
            start += bins;
        }
        signatures
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
        let mut rows = Rows::new(self.binnings.iter().map(Binning::shape_bins).collect(), self.regions.len());
        // The first code of each bin, for all descriptors one after the other.
        let mut first: Vec<u32> = Vec::with_capacity(rows.width());
        for binning in self.binnings {
            first.extend(firsts(binning.shape_bins(), codes, |code| bin(binning, code)));
        }
        let mut counts = vec![[0u32; 2]; codes];
        // Neighbours of the codes before each code, and of those before each bin.
        let mut before = vec![0u32; codes + 1];
        let mut before_bin = vec![0u32; first.len()];
        let regions = self.regions.as_flattened().iter();
        for (records, shares) in regions.zip(rows.values.chunks_exact_mut(first.len().max(1))) {
            if records.is_empty() {
                continue;
            }
            counts.fill([0; 2]);
            self.angles.count_in_turn(records.clone(), &mut counts);
            let mut sum = 0;
            for (before, [even, odd]) in before[1..].iter_mut().zip(&counts) {
                sum += even + odd;
                *before = sum;
            }
            for (count, &first) in before_bin.iter_mut().zip(&first) {
                *count = before[first as usize];
            }
            let total = records.len() as f32;
            for ((share, &here), &next) in shares.iter_mut().zip(&before_bin).zip(&before_bin[1..]) {
                *share = next.wrapping_sub(here) as f32 / total;
            }
            // What follows a descriptor's last bin is another one's first.
            let mut end = 0;
            for bins in &rows.bins {
                end += bins;
                shares[end - 1] = (sum - before_bin[end - 1]) as f32 / total;
            }
        }
        rows.signatures()
    }
}

/// The first code of every bin.
fn firsts(bins: usize, codes: usize, bin: impl Fn(u16) -> usize) -> impl Iterator<Item = u32> {
    let of_code: Vec<usize> = (0..codes).map(|code| bin(code as u16)).collect();
    (0..bins).map(move |k| of_code.partition_point(|&bin| bin < k) as u32)
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
        let mut rows =
            Rows::new(self.binnings.iter().map(Binning::colour_bins).collect(), self.regions.len());
        let width = rows.width();
        // Without colour there is nothing to count.
        if self.classes == 0 || width == 0 {
            return rows.signatures();
        }
        let codes = self.colours.codes(self.classes);
        // Of each code its bin in every descriptor's histogram, which lie side by side.
        let mut bins_of_code: Vec<u32> = Vec::with_capacity(codes * self.binnings.len());
        for code in 0..codes {
            let class = self.colours.class(code as u16);
            let mut start = 0;
            for binning in self.binnings {
                bins_of_code.push((start + binning.colour.get(class)) as u32);
                start += binning.colour_bins();
            }
        }
        let mut counts = vec![[0u32; 2]; codes];
        let mut bins = vec![0u32; width];
        let regions = self.regions.as_flattened().iter();
        for (records, shares) in regions.zip(rows.values.chunks_exact_mut(width)) {
            if records.is_empty() {
                continue;
            }
            self.colours.count_in_turn(records.clone(), &mut counts);
            for ([even, odd], places) in counts.iter_mut().zip(bins_of_code.chunks_exact(self.binnings.len()))
            {
                let count = std::mem::take(even) + std::mem::take(odd);
                if count > 0 {
                    for &place in places {
                        bins[place as usize] += count;
                    }
                }
            }
            let total = records.len() as f32;
            for (share, bin) in shares.iter_mut().zip(&mut bins) {
                *share = std::mem::take(bin) as f32 / total;
            }
        }
        rows.signatures()
    }
}
