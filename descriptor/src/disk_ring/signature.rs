//! Signatures in shape and in colour, from a cloud's quantised neighbours.

use std::borrow::Borrow;

use pulp::NullaryFnOnce;
use rayon::prelude::*;

use crate::disk_ring::histogram::Feature;
use crate::disk_ring::quantise::Binning;
use crate::disk_ring::quantised::QuantisedCloud;
use crate::signature::{MeanAndDeviation, Signature, Signatures};
use crate::wide::widest;

/// Set distance w·d_sh + (1 − w)·d_cl in f64.
#[inline(always)]
pub fn weighted(shape: f32, colour: f32, shape_weight: f64) -> f64 {
    shape_weight * f64::from(shape) + (1.0 - shape_weight) * f64::from(colour)
}

impl Binning {
    /// A cloud in shape and in colour.
    ///
    /// Shape has the histograms of disk and ring without the bins beyond 180 degrees, which are empty by definition, and
    /// depends on shape_bins, R1 and R2. Colour has 2m² values, none without colour, and depends on m, R1 and R2.
    ///
    /// # Panics
    /// If cloud and binning come from different quantisers: a programming error.
    pub fn signature(&self, cloud: &QuantisedCloud) -> [Signature; 2] {
        [Feature::Shape, Feature::Colour].map(|feature| self.of(feature, cloud))
    }

    /// Many clouds, in their order, in shape and in colour, computed by the current rayon pool.
    ///
    /// # Panics
    /// As [`Binning::signature`].
    pub fn signatures<C: Borrow<QuantisedCloud> + Sync>(&self, clouds: &[C]) -> [Signatures; 2] {
        [Feature::Shape, Feature::Colour].map(|feature| {
            let all: Vec<Signature> =
                clouds.par_iter().map(|cloud| self.of(feature, cloud.borrow())).collect();
            all.iter().collect()
        })
    }

    /// A cloud in one of the two.
    pub(crate) fn of(&self, feature: Feature, cloud: &QuantisedCloud) -> Signature {
        if feature.bins(self) == 0 {
            return Signature::default();
        }
        widest(Describe { feature, cloud, binning: self })
    }
}

/// The kernel of [`Binning::of`].
struct Describe<'a> {
    feature: Feature,
    cloud: &'a QuantisedCloud,
    binning: &'a Binning,
}

impl NullaryFnOnce for Describe<'_> {
    type Output = Signature;

    #[inline(always)]
    fn call(self) -> Signature {
        let width = 2 * self.feature.bins(self.binning);
        let mut rows = vec![0.0; self.cloud.keypoints() * width];
        self.feature.fill(self.cloud, self.binning, &mut rows);
        MeanAndDeviation { rows: &rows, width }.call()
    }
}
