//! Histograms of a cloud's keypoints for one descriptor, from its quantised neighbours (DESIGN 5.5, 5.6).

use crate::prepare::{PreparedCloud, Record};
use crate::quantise::Binning;

/// Shape histograms: a row a keypoint, `shape_bins` values of the disk, then as many of the ring.
///
/// # Panics
/// If cloud and binning come from different quantisers: a programming error.
pub fn shape_rows(cloud: &PreparedCloud, binning: &Binning) -> Vec<f32> {
    rows(cloud, binning, binning.parameters.shape_bins as usize, |record| {
        binning.shape[record.angle as usize]
    })
}

/// Colour histograms: a row a keypoint, m² values of the disk (bin m·hue + saturation), then as many of the ring.
/// Empty without colour.
///
/// # Panics
/// If cloud and binning come from different quantisers: a programming error.
pub fn colour_rows(cloud: &PreparedCloud, binning: &Binning) -> Vec<f32> {
    let m = binning.parameters.colour_bins as usize;
    rows(cloud, binning, m * m, |record| binning.colour[record.colour as usize])
}

/// One histogram of `bins` bins a region, each the share of the region's neighbours; an empty region is all zero.
fn rows(cloud: &PreparedCloud, binning: &Binning, bins: usize, bin: impl Fn(Record) -> u16) -> Vec<f32> {
    assert_eq!(*cloud.digest(), binning.digest, "cloud and binning of different quantisers");
    if bins == 0 {
        return Vec::new();
    }
    let mut rows = vec![0.0f32; cloud.keypoints() * 2 * bins];
    let mut counts = vec![0u32; bins];
    for (keypoint, row) in rows.chunks_exact_mut(2 * bins).enumerate() {
        let regions = cloud.regions(keypoint, binning.disk, binning.ring);
        for (records, shares) in regions.into_iter().zip(row.chunks_exact_mut(bins)) {
            if records.is_empty() {
                continue;
            }
            counts.fill(0);
            for &record in records {
                counts[bin(record) as usize] += 1;
            }
            let total = records.len() as f32;
            for (share, &count) in shares.iter_mut().zip(&counts) {
                *share = count as f32 / total;
            }
        }
    }
    rows
}
