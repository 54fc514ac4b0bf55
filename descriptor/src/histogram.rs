//! Histograms of a cloud's keypoints for one descriptor, from its quantised neighbours (DESIGN 5.5, 5.6).

use crate::prepare::PreparedCloud;
use crate::quantise::{BinOfClass, Binning};

/// Shape histograms: a row a keypoint, `shape_bins` values of the disk, then as many of the ring.
///
/// # Panics
/// If cloud and binning come from different quantisers: a programming error.
pub fn shape_rows(cloud: &PreparedCloud, binning: &Binning) -> Vec<f32> {
    let bins = binning.parameters.shape_bins as usize;
    let mut rows = Vec::new();
    for region in Half::Shape.rows(cloud, binning).chunks_exact(binning.shape_bins()) {
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
pub fn colour_rows(cloud: &PreparedCloud, binning: &Binning) -> Vec<f32> {
    Half::Colour.rows(cloud, binning)
}

/// One half of the descriptor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Half {
    Shape,
    Colour,
}

impl Half {
    /// Bins of a region's histogram that a neighbour can fall into.
    pub(crate) fn bins(self, binning: &Binning) -> usize {
        match self {
            Self::Shape => binning.shape_bins(),
            Self::Colour => binning.colour_bins(),
        }
    }

    /// One row a keypoint: the disk's histogram, then the ring's, each the share of the region's neighbours; an empty
    /// region is all zero.
    fn rows(self, cloud: &PreparedCloud, binning: &Binning) -> Vec<f32> {
        let mut rows = vec![0.0; cloud.keypoints() * 2 * self.bins(binning)];
        self.fill(cloud, binning, &mut rows);
        rows
    }

    /// Fills the rows of all keypoints. Inlined into the kernels that go on with them.
    #[inline(always)]
    pub(crate) fn fill(self, cloud: &PreparedCloud, binning: &Binning, rows: &mut [f32]) {
        assert_eq!(*cloud.digest(), binning.digest, "cloud and binning of different quantisers");
        let bins = self.bins(binning);
        let (classes, bin_of_class) = match self {
            Self::Shape => (&cloud.angles, &binning.shape),
            Self::Colour => (&cloud.colours, &binning.colour),
        };
        if bins == 0 {
            return;
        }
        let mut counts = Counts::default();
        for (keypoint, row) in rows.chunks_exact_mut(2 * bins).enumerate() {
            let regions = cloud.regions(keypoint, binning.disk, binning.ring);
            for (records, shares) in regions.into_iter().zip(row.chunks_exact_mut(bins)) {
                let total = records.len() as f32;
                counts.add(&classes[records], bin_of_class);
                counts.take_shares(total, shares);
            }
        }
    }
}

/// Most bins that any descriptor has in one histogram: m² for the largest m.
const MAX_BINS: usize = 1024;

/// Tables that neighbours in turn are counted in: a count that was just stored takes time until it can be loaded again,
/// and half of the neighbours on a smooth surface fall into the same bin.
const TABLES: usize = 4;

/// Entries of a table: a few more than bins, as equal places of tables 4096 bytes apart pass for the same address until
/// late, and their counts wait for each other.
const TABLE: usize = MAX_BINS + 16;

/// One histogram under construction.
struct Counts {
    tables: [[u32; TABLE]; TABLES],
}

impl Default for Counts {
    fn default() -> Self {
        Self { tables: [[0; TABLE]; TABLES] }
    }
}

impl Counts {
    /// Counts classes by bin.
    #[inline(always)]
    fn add(&mut self, classes: &[u16], bins: &BinOfClass) {
        let (groups, rest) = classes.as_chunks::<TABLES>();
        for group in groups {
            for (table, &class) in self.tables.iter_mut().zip(group) {
                table[bins.get(class) % MAX_BINS] += 1;
            }
        }
        for &class in rest {
            self.tables[0][bins.get(class) % MAX_BINS] += 1;
        }
    }

    /// Turns the counts of the first bins into shares of `total`, and empties them.
    #[inline(always)]
    fn take_shares(&mut self, total: f32, shares: &mut [f32]) {
        let divisor = if total > 0.0 { total } else { 1.0 };
        for (bin, share) in shares.iter_mut().enumerate() {
            let mut count = 0;
            for table in &mut self.tables {
                count += table[bin % MAX_BINS];
                table[bin % MAX_BINS] = 0;
            }
            *share = count as f32 / divisor;
        }
    }
}
