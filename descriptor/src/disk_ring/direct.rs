//! Signatures of one descriptor straight from a cloud, without the records that other descriptors could be made of.

use pulp::NullaryFnOnce;

use crate::Cloud;
use crate::disk_ring::bins::Counter;
use crate::disk_ring::histogram::Feature;
use crate::disk_ring::near::{Field, Near};
use crate::disk_ring::quantise::{Binning, Quantiser};
use crate::disk_ring::quantised::QuantisedCloud;
use crate::keypoints::Keypoints;
use crate::prepare::Normals;
use crate::prepare_error::PrepareError;
use crate::signature::Signature;
use crate::surface::SORTED_ABOVE;
use crate::wide::widest;

impl Binning {
    /// A cloud in metres in shape and in colour: as [`Binning::signature`] of [`QuantisedCloud::describe`], to the bit.
    /// Faster if the quantiser is that of a single descriptor.
    ///
    /// # Errors
    /// As [`QuantisedCloud::describe`].
    pub(crate) fn signature_of(
        &self,
        cloud: &Cloud,
        keypoints: &Keypoints,
        normals: &Normals,
        quantiser: &Quantiser,
    ) -> Result<[Signature; 2], PrepareError> {
        // A disk lies inside its ring: of two radii, shell 0 is the disk and shell 1 the ring.
        if quantiser.radii() != 2 {
            return Ok(self.signature(&QuantisedCloud::describe(cloud, keypoints, normals, quantiser)?));
        }
        let field = Field::new(cloud, normals, quantiser, SORTED_ABOVE)?;
        let [shape_bins, colour_bins] = [Feature::Shape, Feature::Colour].map(|feature| feature.bins(self));
        let described = normals.keypoints.iter().flatten().count();
        let [mut shapes, mut colours] = [shape_bins, colour_bins].map(|bins| vec![0.0; described * 2 * bins]);
        let mut shape_counter = Counter::new(&self.shape, None);
        let mut colour_counter = Counter::new(&self.colour, field.colour_records.listed());
        let mut count = field.count(keypoints.len())?;
        let mut near = Near::new(&field, quantiser);
        let [mut angle_codes, mut colour_codes] = [Vec::new(), Vec::new()];
        let axes = keypoints.points.iter().zip(&normals.keypoints);
        for (row, (keypoint, axis)) in axes.filter_map(|(&point, axis)| Some((point, (*axis)?))).enumerate() {
            field.find(keypoint, axis, quantiser, &mut near);
            count.add(near.found())?;
            for (shell, list) in near.lists.iter().enumerate() {
                let region = 2 * row + shell;
                field.codes(&near, list, quantiser, [&mut angle_codes, &mut colour_codes]);
                let shares = &mut shapes[region * shape_bins..][..shape_bins];
                widest(Shares { counter: &mut shape_counter, codes: &angle_codes, shares });
                if colour_bins > 0 {
                    let shares = &mut colours[region * colour_bins..][..colour_bins];
                    widest(Shares { counter: &mut colour_counter, codes: &colour_codes, shares });
                }
            }
        }
        Ok([Signature::of_rows(&shapes, 2 * shape_bins), Signature::of_rows(&colours, 2 * colour_bins)])
    }
}

/// A kernel: the shares of one region.
struct Shares<'a, 'b> {
    counter: &'a mut Counter<'b>,
    codes: &'a [u16],
    shares: &'a mut [f32],
}

impl NullaryFnOnce for Shares<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.counter.shares(self.codes, self.shares);
    }
}
