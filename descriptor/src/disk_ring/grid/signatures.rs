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
    /// One a value of shape_bins.
    shape: Vec<Signature>,
    /// One a value of m.
    colour: Vec<Signature>,
}

/// One cloud under all descriptors of a cell.
#[derive(Clone, Debug, PartialEq)]
pub struct CellSignatures {
    /// One a value of shape_bins.
    pub(super) shape: Vec<Signature>,
    /// One a value of m.
    pub(super) colour: Vec<Signature>,
}

impl RegionSignatures {
    /// Memory that they take, bytes.
    pub fn bytes(&self) -> usize {
        let all = || self.shape.iter().chain(&self.colour);
        let values: usize = all().map(|one| one.centroid.len() + one.deviation.len()).sum();
        size_of::<Self>() + all().count() * size_of::<Signature>() + values * size_of::<f32>()
    }
}

impl CellSignatures {
    /// Clouds of which both regions are described.
    ///
    /// # Panics
    /// If there are not as many disks as rings, or they are of cells with different descriptors: a programming error.
    pub fn join(disks: &[RegionSignatures], rings: &[RegionSignatures]) -> Vec<Self> {
        assert_eq!(disks.len(), rings.len(), "disks and rings of different clouds");
        let both = |[disks, rings]: [&[Signature]; 2]| -> Vec<Signature> {
            assert_eq!(disks.len(), rings.len(), "disks and rings of different descriptors");
            let both = disks.iter().zip(rings).map(|(disk, ring)| Signature {
                centroid: [&disk.centroid[..], &ring.centroid].concat(),
                deviation: [&disk.deviation[..], &ring.deviation].concat(),
            });
            both.collect()
        };
        let joined = disks.par_iter().zip(rings).map(|(disk, ring)| Self {
            shape: both([&disk.shape, &ring.shape]),
            colour: both([&disk.colour, &ring.colour]),
        });
        joined.collect()
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
        CellSignatures::join(&disks, &rings)
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
        let of_cloud = |room: &mut Room, cloud: &C| self.describe_one(region, cloud.borrow(), room);
        clouds.par_iter().map_init(Room::default, of_cloud).collect()
    }

    fn describe_one(&self, region: Region, cloud: &QuantisedCloud, room: &mut Room) -> RegionSignatures {
        assert_eq!(*cloud.digest(), self.shape[0].digest, "cloud and cell of different quantisers");
        let regions = cloud.regions([self.shape[0].disk, self.shape[0].ring]).into_iter();
        let regions: Vec<Range<usize>> = regions.map(|[disk, ring]| region.of(disk, ring)).collect();
        let [angle_classes, colour_classes] = self.classes;
        RegionSignatures {
            shape: widest(Shapes {
                angles: &cloud.angles,
                classes: angle_classes,
                first: &self.first_angle,
                regions: &regions,
                binnings: &self.shape,
                room,
            }),
            colour: widest(Colours {
                colours: &cloud.colours,
                classes: colour_classes,
                regions: &regions,
                binnings: &self.colour,
                room,
            }),
        }
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

/// Memory for one cloud after the other: a processor would spend much of its time on clearing new memory for each.
struct Room {
    /// Neighbours by their codes, all 0 between regions: those of one code are in two counts
    /// ([`Records::count_in_turn`]).
    counts: Box<[[u32; 2]; CODES]>,
    /// Neighbours of the codes before each.
    before: Box<[u32; CODES]>,
    rows: Vec<f32>,
}

impl Default for Room {
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
    /// Bins of each descriptor's histogram.
    bins: Vec<usize>,
    /// Their sum.
    width: usize,
    values: &'a mut [f32],
}

impl<'a> Rows<'a> {
    /// Rows whose values are still those of another cloud: all have to be written.
    fn new(bins: Vec<usize>, keypoints: usize, room: &'a mut Vec<f32>) -> Self {
        let width = bins.iter().sum();
        if room.len() < keypoints * width {
            room.resize(keypoints * width, 0.0);
        }
        Self { bins, width, values: &mut room[..keypoints * width] }
    }

    /// The signatures: as `histogram` makes the rows of each descriptor. Sums of columns do not depend on each other.
    #[inline(always)]
    fn signatures(&self) -> Vec<Signature> {
        if self.width == 0 {
            return vec![Signature::default(); self.bins.len()];
        }
        let all = MeanAndDeviation { rows: self.values, width: self.width }.call();
        let mut start = 0;
        let mut signatures = Vec::with_capacity(self.bins.len());
        for &bins in &self.bins {
            let of = |values: &[f32]| values[start..start + bins].to_vec();
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
    /// The first class of each bin, for all descriptors one after the other.
    first: &'a [u16],
    regions: &'a [Range<usize>],
    binnings: &'a [Binning],
    room: &'a mut Room,
}

impl NullaryFnOnce for Shapes<'_> {
    type Output = Vec<Signature>;

    #[inline(always)]
    fn call(self) -> Vec<Signature> {
        let bins = self.binnings.iter().map(Binning::shape_bins).collect();
        let Room { counts, before, rows } = self.room;
        let rows = Rows::new(bins, self.regions.len(), rows);
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
            let mut end = 0;
            for bins in &rows.bins {
                end += bins;
                shares[end - 1] = (records.len() as u32 - starts[end - 1]) as f32 / total;
            }
        }
        rows.signatures()
    }
}

/// Colour: the classes that occur are few, and each descriptor adds their counts up anew.
struct Colours<'a> {
    colours: &'a Records,
    classes: usize,
    regions: &'a [Range<usize>],
    binnings: &'a [Binning],
    room: &'a mut Room,
}

impl NullaryFnOnce for Colours<'_> {
    type Output = Vec<Signature>;

    #[inline(always)]
    fn call(self) -> Vec<Signature> {
        let bins = self.binnings.iter().map(Binning::colour_bins).collect();
        let Room { counts, rows, .. } = self.room;
        let rows = Rows::new(bins, self.regions.len(), rows);
        let width = rows.width;
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
        rows.signatures()
    }
}
