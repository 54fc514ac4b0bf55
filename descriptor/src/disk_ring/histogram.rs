//! Histograms of a cloud's keypoints for one descriptor, from its quantised neighbours (DESIGN 5.5, 5.6).

use std::ops::Range;

use crate::disk_ring::bins::Counter;
use crate::disk_ring::quantise::Binning;
use crate::disk_ring::quantised::QuantisedCloud;
use crate::disk_ring::records::Records;

/// Keypoints whose records are copied at once.
const AT_ONCE: usize = 16;

/// Shape histograms: a row a keypoint, `shape_bins` values of the disk, then as many of the ring.
///
/// # Panics
/// If cloud and binning come from different quantisers: a programming error.
pub fn shape_rows(cloud: &QuantisedCloud, binning: &Binning) -> Vec<f32> {
    let bins = binning.parameters.shape_bins as usize;
    let mut rows = Vec::new();
    for region in Feature::Shape.rows(cloud, binning).chunks_exact(binning.shape_bins()) {
        rows.extend_from_slice(region);
        // Angles end at 180 of 360 degrees: the bins beyond stay empty (paper, eq. 2).
        rows.resize(rows.len() + bins - region.len(), 0.0);
    }
    rows
}

/// Colour histograms: a row a keypoint, m² values of the disk (bin m·hue + saturation), then as many of the ring.
/// Empty without colour.
///
/// # Panics
/// If cloud and binning come from different quantisers: a programming error.
pub fn colour_rows(cloud: &QuantisedCloud, binning: &Binning) -> Vec<f32> {
    Feature::Colour.rows(cloud, binning)
}

/// What of its neighbours a keypoint's histograms count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Feature {
    /// The angle between the normals.
    Shape,
    /// Hue and saturation.
    Colour,
}

impl Feature {
    /// Bins of a region's histogram that a neighbour can fall into.
    pub(crate) fn bins(self, binning: &Binning) -> usize {
        match self {
            Self::Shape => binning.shape_bins(),
            Self::Colour => binning.colour_bins(),
        }
    }

    /// One row a keypoint: the disk's histogram, then the ring's, each the share of the region's neighbours; an empty
    /// region is all zero.
    fn rows(self, cloud: &QuantisedCloud, binning: &Binning) -> Vec<f32> {
        let mut rows = vec![0.0; cloud.keypoints() * 2 * self.bins(binning)];
        self.fill(cloud, binning, &mut rows);
        rows
    }

    /// Fills the rows of all keypoints. Inlined into the kernels that go on with them.
    #[inline(always)]
    pub(crate) fn fill(self, cloud: &QuantisedCloud, binning: &Binning, rows: &mut [f32]) {
        assert_eq!(*cloud.digest(), binning.digest, "cloud and binning of different quantisers");
        let bins = self.bins(binning);
        let (records, bin_of_class) = match self {
            Self::Shape => (&cloud.angles, &binning.shape),
            Self::Colour => (&cloud.colours, &binning.colour),
        };
        if bins == 0 {
            return;
        }
        let regions = cloud.regions([binning.disk, binning.ring]);
        let mut counter = Counter::new(bin_of_class, records.listed());
        match records {
            Records::Listed { positions, .. } => count(positions, &regions, &mut counter, bins, rows),
            Records::Plain(classes) => count(classes, &regions, &mut counter, bins, rows),
        }
    }
}

/// Counts the records of all keypoints.
#[inline(always)]
fn count<C: Copy + Into<usize>>(
    codes: &[C],
    regions: &[[Range<usize>; 2]],
    counter: &mut Counter,
    bins: usize,
    rows: &mut [f32],
) {
    let mut near = Vec::new();
    for (regions, rows) in regions.chunks(AT_ONCE).zip(rows.chunks_mut(AT_ONCE * 2 * bins)) {
        // Clouds lie in memory far from the processor: copying asks for many lines of it at once, counting for one
        // after the other.
        near.clear();
        for [disk, ring] in regions {
            near.extend_from_slice(&codes[disk.start..ring.end]);
        }
        let mut rest = near.as_slice();
        for (records, shares) in regions.as_flattened().iter().zip(rows.chunks_exact_mut(bins)) {
            let (region, others) = rest.split_at(records.len());
            counter.shares(region, shares);
            rest = others;
        }
    }
}
