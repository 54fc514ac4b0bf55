//! The family `global-hue`: one histogram of hue over all points of a cloud, a cheap baseline.
//!
//! It needs neither keypoints nor normals. Grey points, whose hue is 0 by definition, count like red ones.

use crate::Cloud;
use crate::colour::{Component, HueSaturation};
use crate::column::Column;
use crate::domain::Domain;
use crate::prepare_error::{PrepareError, Skip};
use crate::preprocess::Preprocess;
use crate::signature::Signature;

/// Fewest and most bins.
const BINS: [u32; 2] = [2, 64];

/// A descriptor of the family.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct GlobalHue {
    bins: u32,
}

impl GlobalHue {
    /// The column of its gene.
    pub const COLUMN: Column =
        Column { name: "bins", unit: "", integer: true, meaning: "bins of the histogram of hue" };

    /// The whole search space.
    pub const SPACE: Domain = Domain { low: BINS[0], step: 1, count: BINS[1] - BINS[0] + 1 };

    /// With 2 to 64 bins.
    ///
    /// # Errors
    /// What is wrong with another number.
    pub fn new(bins: u32) -> Result<Self, String> {
        let [least, most] = BINS;
        if (least..=most).contains(&bins) {
            Ok(Self { bins })
        } else {
            Err(format!("bins: must be {least} to {most}, got {bins}\nchoose a value inside these limits"))
        }
    }

    /// Number of bins.
    pub fn bins(self) -> u32 {
        self.bins
    }

    /// A search space of some numbers of bins.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn space(domain: Domain) -> Result<Domain, String> {
        let is_sound = domain.count > 0
            && (domain.step > 0 || domain.count == 1)
            && domain.low >= BINS[0]
            && u64::from(domain.low) + u64::from(domain.count - 1) * u64::from(domain.step)
                <= u64::from(BINS[1]);
        let [least, most] = BINS;
        let got = || format!("{} values from {} in steps of {}", domain.count, domain.low, domain.step);
        let refusal = || format!("bins: values must be {least} to {most}, got {}\nchoose others", got());
        is_sound.then_some(domain).ok_or_else(refusal)
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
    use crate::testing::sheet;

    /// Hue in degrees, from the definition of the hexcone in f64.
    fn hue([r, g, b]: [u8; 3]) -> f64 {
        let [r, g, b] = [r, g, b].map(f64::from);
        let (most, least) = (r.max(g).max(b), r.min(g).min(b));
        let range = most - least;
        if range == 0.0 {
            return 0.0;
        }
        let sextant = if r == most {
            (g - b) / range
        } else if g == most {
            (b - r) / range + 2.0
        } else {
            (r - g) / range + 4.0
        };
        (60.0 * sextant).rem_euclid(360.0)
    }

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
        assert_eq!(GlobalHue::space(GlobalHue::SPACE), Ok(GlobalHue::SPACE));
        for (low, step, count) in [(1, 1, 3), (2, 1, 64), (2, u32::MAX, u32::MAX), (5, 1, 0), (5, 0, 2)] {
            assert!(GlobalHue::space(Domain { low, step, count }).is_err(), "{low} {step} {count}");
        }
    }
}
