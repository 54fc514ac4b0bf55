//! One cloud under every shape_bins and every m of a cell.

use std::borrow::Borrow;
use std::ops::Range;

use pulp::NullaryFnOnce;
use rayon::prelude::*;

use super::Cell;
use crate::disk_ring::quantise::Binning;
use crate::disk_ring::quantised::QuantisedCloud;
use crate::disk_ring::records::{CODES, Records};
use crate::signature::{MeanAndDeviation, Signature};
use crate::wide::widest;

/// One of a keypoint's two regions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Region {
    /// Within R1.
    Disk,
    /// Between R1 and R2.
    Ring,
}

/// One region of a cloud under all descriptors of a cell. That of the disk depends on R1 and not on R2.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionSignatures {
    /// Of shape the signature that has the bins of all values of shape_bins, of colour that of all values of m: value
    /// after value, as [`Cell`] has them.
    parts: [Signature; 2],
}

/// One cloud under all descriptors of a cell.
#[derive(Clone, Debug, PartialEq)]
pub struct CellSignatures {
    /// As in [`RegionSignatures`]; of each value the disk's bins, then the ring's.
    pub(super) parts: [Signature; 2],
}

impl RegionSignatures {
    /// Memory that they take, bytes.
    pub fn bytes(&self) -> usize {
        let values: usize = self.parts.iter().map(|one| one.centroid.len() + one.deviation.len()).sum();
        size_of::<Self>() + values * size_of::<f32>()
    }
}

impl CellSignatures {
    /// Centroid and deviation of shape (0) or colour (1) under the value whose bins of one region lie in this range.
    pub(super) fn of_value(&self, channel: usize, bins: &Range<usize>) -> [&[f32]; 2] {
        self.parts[channel].parts().map(|all| &all[2 * bins.start..2 * bins.end])
    }
}

impl Cell {
    /// The signatures of clouds for every value of shape_bins and of m, in their order, computed by the current rayon pool:
    /// each as [`Binning::signature`] has it.
    ///
    /// # Panics
    /// As [`Cell::describe`].
    pub fn signatures<C: Borrow<QuantisedCloud> + Sync>(&self, clouds: &[C]) -> Vec<CellSignatures> {
        let [disks, rings] = [Region::Disk, Region::Ring].map(|region| self.describe(region, clouds));
        self.join(&disks, &rings)
    }

    /// Clouds of which both regions are described.
    ///
    /// # Panics
    /// If there are not as many disks as rings, or they are of cells with other descriptors: a programming error.
    pub fn join(&self, disks: &[RegionSignatures], rings: &[RegionSignatures]) -> Vec<CellSignatures> {
        assert_eq!(disks.len(), rings.len(), "disks and rings of different clouds");
        let both = |bins: &[Range<usize>], disk: &[f32], ring: &[f32]| -> Vec<f32> {
            let width = width(bins);
            assert_eq!([disk.len(), ring.len()], [width; 2], "disks and rings of other descriptors");
            let mut values = Vec::with_capacity(2 * width);
            for bins in bins {
                values.extend_from_slice(&disk[bins.clone()]);
                values.extend_from_slice(&ring[bins.clone()]);
            }
            values
        };
        let joined = disks.par_iter().zip(rings).map(|(disk, ring)| CellSignatures {
            parts: [0, 1].map(|channel| {
                let (bins, disk, ring) = (&self.bins[channel], &disk.parts[channel], &ring.parts[channel]);
                Signature {
                    centroid: both(bins, &disk.centroid, &ring.centroid),
                    deviation: both(bins, &disk.deviation, &ring.deviation),
                }
            }),
        });
        joined.collect()
    }

    /// One region of clouds, in their order, computed by the current rayon pool. The disk's serves all cells with the same R1
    /// of one quantiser.
    ///
    /// # Panics
    /// If clouds and cell come from different quantisers: a programming error.
    pub fn describe<C: Borrow<QuantisedCloud> + Sync>(
        &self,
        region: Region,
        clouds: &[C],
    ) -> Vec<RegionSignatures> {
        let of_cloud = |scratch: &mut Scratch, cloud: &C| self.describe_one(region, cloud.borrow(), scratch);
        clouds.par_iter().map_init(Scratch::default, of_cloud).collect()
    }

    fn describe_one(
        &self,
        region: Region,
        cloud: &QuantisedCloud,
        scratch: &mut Scratch,
    ) -> RegionSignatures {
        assert_eq!(*cloud.digest(), self.shape[0].digest, "cloud and cell of different quantisers");
        let regions = cloud.regions([self.shape[0].disk, self.shape[0].ring]).into_iter();
        let regions: Vec<Range<usize>> = regions.map(|[disk, ring]| region.of(disk, ring)).collect();
        let [angle_classes, colour_classes] = self.classes;
        let [shape_bins, colour_bins] = &self.bins;
        let shape = widest(Shapes {
            angles: &cloud.angles,
            classes: angle_classes,
            first: &self.first_angle,
            regions: &regions,
            bins: shape_bins,
            scratch,
        });
        let colour = widest(Colours {
            colours: &cloud.colours,
            classes: colour_classes,
            regions: &regions,
            binnings: &self.colour,
            bins: colour_bins,
            scratch,
        });
        RegionSignatures { parts: [shape, colour] }
    }
}

impl Region {
    fn of<T>(self, disk: T, ring: T) -> T {
        match self {
            Self::Disk => disk,
            Self::Ring => ring,
        }
    }
}

/// Bins of all histograms together.
fn width(bins: &[Range<usize>]) -> usize {
    bins.last().map_or(0, |bins| bins.end)
}

/// Memory for one cloud after the other: a processor would spend much of its time on clearing new memory for each.
struct Scratch {
    /// Neighbours by their codes, all 0 between regions: those of one code are in two counts
    /// ([`Records::count_in_turn`]).
    counts: Box<[[u32; 2]; CODES]>,
    /// Neighbours of the codes before each.
    before: Box<[u32; CODES]>,
    rows: Vec<f32>,
}

impl Default for Scratch {
    fn default() -> Self {
        Self { counts: zeros(), before: zeros(), rows: Vec::new() }
    }
}

fn zeros<T: Clone + Default>() -> Box<[T; CODES]> {
    let zeros = vec![T::default(); CODES].into_boxed_slice();
    zeros.try_into().unwrap_or_else(|_| unreachable!("its length is that of the array"))
}

/// Rows of several descriptors under construction, side by side: of each keypoint the histograms of a region by all of them.
struct Rows<'a> {
    /// Bins of all histograms together.
    width: usize,
    values: &'a mut [f32],
}

impl<'a> Rows<'a> {
    /// Rows whose values are still those of another cloud: all have to be written.
    fn new(bins: &[Range<usize>], keypoints: usize, scratch: &'a mut Vec<f32>) -> Self {
        let width = width(bins);
        if scratch.len() < keypoints * width {
            scratch.resize(keypoints * width, 0.0);
        }
        Self { width, values: &mut scratch[..keypoints * width] }
    }

    /// The signature: as `histogram` makes the rows of each descriptor. Sums of columns do not depend on each other.
    #[inline(always)]
    fn signature(&self) -> Signature {
        if self.width == 0 {
            return Signature::default();
        }
        MeanAndDeviation { rows: self.values, width: self.width }.call()
    }
}

/// Shape: every bin is a run of angle classes, so its count is the difference of two sums over codes.
struct Shapes<'a> {
    angles: &'a Records,
    classes: usize,
    /// The first class of each bin, for all descriptors one after the other.
    first: &'a [u16],
    regions: &'a [Range<usize>],
    /// Where each descriptor's bins lie.
    bins: &'a [Range<usize>],
    scratch: &'a mut Scratch,
}

impl NullaryFnOnce for Shapes<'_> {
    type Output = Signature;

    #[inline(always)]
    fn call(self) -> Signature {
        let Scratch { counts, before, rows } = self.scratch;
        let rows = Rows::new(self.bins, self.regions.len(), rows);
        let codes = self.angles.codes(self.classes);
        // Of each bin its first code, and the neighbours before it.
        let first: Vec<u16> = self.angles.first_codes(self.first).collect();
        let mut starts = vec![0; rows.width];
        for (records, shares) in self.regions.iter().zip(rows.values.chunks_exact_mut(rows.width.max(1))) {
            if records.is_empty() {
                shares.fill(0.0);
                continue;
            }
            self.angles.count_in_turn(records.clone(), counts);
            for (before, [even, odd]) in before[1..].iter_mut().zip(&counts[..codes]) {
                *before = even + odd;
            }
            counts[..codes].fill([0; 2]);
            let mut sum = 0;
            for before in before[1..].iter_mut().take(codes) {
                sum += *before;
                *before = sum;
            }
            for (start, &first) in starts.iter_mut().zip(&first) {
                *start = before[usize::from(first)];
            }
            let total = records.len() as f32;
            for ((share, &here), &next) in shares.iter_mut().zip(&starts).zip(&starts[1..]) {
                *share = next.wrapping_sub(here) as f32 / total;
            }
            // What follows a descriptor's last bin is another one's first.
            for &Range { end, .. } in self.bins {
                shares[end - 1] = (records.len() as u32 - starts[end - 1]) as f32 / total;
            }
        }
        rows.signature()
    }
}

/// Colour: the classes that occur are few, and each descriptor adds their counts up anew.
struct Colours<'a> {
    colours: &'a Records,
    classes: usize,
    regions: &'a [Range<usize>],
    binnings: &'a [Binning],
    /// Where each descriptor's bins lie.
    bins: &'a [Range<usize>],
    scratch: &'a mut Scratch,
}

impl NullaryFnOnce for Colours<'_> {
    type Output = Signature;

    #[inline(always)]
    fn call(self) -> Signature {
        let Scratch { counts, rows, .. } = self.scratch;
        let rows = Rows::new(self.bins, self.regions.len(), rows);
        let width = rows.width;
        // Without colour there is nothing to count.
        if self.classes == 0 || width == 0 {
            return rows.signature();
        }
        let codes = self.colours.codes(self.classes);
        // Of each code its bin in every descriptor's histogram, which lie side by side.
        let mut bins_of_code: Vec<u32> = Vec::with_capacity(codes * self.binnings.len());
        for code in 0..codes {
            let class = self.colours.class(code as u16);
            for (binning, bins) in self.binnings.iter().zip(self.bins) {
                bins_of_code.push((bins.start + binning.colour.get(class)) as u32);
            }
        }
        let mut bins = vec![0u32; width];
        for (records, shares) in self.regions.iter().zip(rows.values.chunks_exact_mut(width)) {
            if records.is_empty() {
                shares.fill(0.0);
                continue;
            }
            self.colours.count_in_turn(records.clone(), counts);
            for ([even, odd], places) in
                counts[..codes].iter_mut().zip(bins_of_code.chunks_exact(self.binnings.len()))
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
        rows.signature()
    }
}
