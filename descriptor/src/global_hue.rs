//! The family `global-hue`: one histogram of hue over all points of a cloud, a cheap baseline.
//!
//! It needs neither keypoints nor normals. Grey points, whose hue is 0 by definition, count like red ones.

use crate::Cloud;
use crate::colour::{Component, HueSaturation};
use crate::domain::Domain;
use crate::gene::{GeneError, GeneSpec};
use crate::prepare_error::{PrepareError, Skip};
use crate::preprocess::Preprocess;
use crate::signature::Signature;

/// A descriptor of the family.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GlobalHue {
    bins: u32,
}

impl Default for GlobalHue {
    fn default() -> Self {
        Self { bins: 32 }
    }
}

impl GlobalHue {
    /// Its only gene.
    pub(crate) const GENE: GeneSpec = GeneSpec {
        name: "bins",
        unit: "",
        meaning: "bins of the histogram of hue",
        needs_colour: true,
        ticks_per_unit: 1,
        limits: (2, 64),
        default: (2, 64, 1),
    };

    /// With 2 to 64 bins.
    ///
    /// # Errors
    /// What is wrong with another number.
    pub fn new(bins: u32) -> Result<Self, GeneError> {
        Self::GENE.check(&Domain::fixed(bins))?;
        Ok(Self { bins })
    }

    /// Number of bins.
    pub fn bins(self) -> u32 {
        self.bins
    }

    /// What signatures are made of: the colours of a cloud as stored.
    ///
    /// # Errors
    /// [`Skip::TooFewPoints`], or if there is not one colour for each point.
    pub(crate) fn colours(cloud: &Cloud, preprocess: &Preprocess) -> Result<Vec<[u8; 3]>, PrepareError> {
        let colours = cloud.colours.as_ref().ok_or(PrepareError::NoColours)?;
        if colours.len() != cloud.len() {
            return Err(PrepareError::ColourCount { points: cloud.len(), colours: colours.len() });
        }
        if cloud.len() < preprocess.min_points as usize {
            return Err(Skip::TooFewPoints { least: preprocess.min_points, points: cloud.len() }.into());
        }
        Ok(colours.clone())
    }

    /// The share of each bin in these colours; there is one row a cloud, and so no deviation.
    pub fn signature(self, colours: &[[u8; 3]]) -> Signature {
        let mut counts = vec![0u32; self.bins as usize];
        for &colour in colours {
            counts[Component::Hue.bin(HueSaturation::new(colour).hue, self.bins) as usize] += 1;
        }
        let points = colours.len().max(1) as f32;
        let centroid = counts.iter().map(|&count| count as f32 / points).collect();
        Signature { centroid, deviation: Vec::new() }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::oracle::hue;
    use crate::testing::sheet;

    proptest! {
        #[test]
        fn a_signature_is_the_share_of_points_in_each_bin(
            bins in 2u32..=64,
            colours in prop::collection::vec(any::<[u8; 3]>(), 1..200),
        ) {
            // On the edge of a bin rounding decides.
            let position = |colour: &[u8; 3]| hue(*colour) * f64::from(bins) / 360.0;
            let is_clear = |colour: &[u8; 3]| {
                let at = position(colour);
                at == 0.0 || (at - at.round()).abs() > 1e-4
            };
            let colours: Vec<[u8; 3]> = colours.into_iter().filter(is_clear).collect();
            prop_assume!(!colours.is_empty());
            let signature = GlobalHue::new(bins).unwrap().signature(&colours);
            prop_assert_eq!(signature.centroid.len(), bins as usize);
            for (bin, &share) in signature.centroid.iter().enumerate() {
                let count = colours.iter().filter(|colour| position(colour).floor() == bin as f64).count();
                prop_assert_eq!(share, count as f32 / colours.len() as f32, "bin {}", bin);
            }
            prop_assert!(signature.deviation.is_empty());
        }
    }

    #[test]
    fn clouds_that_cannot_be_described_are_refused() {
        let preprocess = Preprocess::default();
        let cloud = sheet(1, 40);
        assert_eq!(GlobalHue::colours(&cloud, &preprocess), Ok(cloud.colours.clone().unwrap()));
        let few = GlobalHue::colours(&sheet(1, 7), &preprocess);
        assert_eq!(few, Err(Skip::TooFewPoints { least: 10, points: 7 }.into()));
        let short = Cloud { points: cloud.points[1..].to_vec(), ..cloud.clone() };
        assert!(matches!(GlobalHue::colours(&short, &preprocess), Err(PrepareError::ColourCount { .. })));
        let grey = Cloud { colours: None, ..cloud };
        assert_eq!(GlobalHue::colours(&grey, &preprocess), Err(PrepareError::NoColours));
    }

    #[test]
    fn bins_outside_2_to_64_are_refused() {
        for bins in [0, 1, 65, u32::MAX] {
            assert!(GlobalHue::new(bins).is_err(), "{bins}");
        }
        for bins in 2..=64 {
            assert_eq!(GlobalHue::new(bins).map(GlobalHue::bins), Ok(bins));
        }
    }
}
