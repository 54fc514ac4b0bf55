//! Ratios of colour channels in five bins, both ways round at once, as [`super::pfhrgb`] counts them.

use std::array;
use std::sync::LazyLock;

use super::neighbourhood::GROUP;

/// Bins of a ratio.
const BINS: u8 = 5;

/// Most changes of the code as the other channel goes from 0 to 255.
const CHANGES: usize = 9;

/// How the bins of one channel's ratio to another depend on the other: a step function.
///
/// The code of two channels is the bin of one : other plus five times that of other : one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ratio {
    /// Code for 0.
    first: u8,
    /// What is added to the code, modulo 256, for all that is above the step; unused steps are never exceeded.
    steps: [(u8, u8); CHANGES],
}

impl Ratio {
    /// The step function of a channel.
    pub(super) fn of(channel: u8) -> Self {
        static ALL: LazyLock<[Ratio; 256]> = LazyLock::new(|| array::from_fn(|one| Ratio::new(one as u8)));
        ALL[usize::from(channel)]
    }

    fn new(one: u8) -> Self {
        let code = |other| bin(one, other) + BINS * bin(other, one);
        let mut steps = [(u8::MAX, 0); CHANGES];
        let changes = (0..u8::MAX).filter(|&other| code(other) != code(other + 1));
        for (step, other) in steps.iter_mut().zip(changes) {
            *step = (other, code(other + 1).wrapping_sub(code(other)));
        }
        Self { first: code(0), steps }
    }

    /// Codes with a group of channels.
    #[inline(always)]
    pub(super) fn codes(&self, others: &[u8; GROUP]) -> [u8; GROUP] {
        let mut codes = [self.first; GROUP];
        for (step, change) in self.steps {
            for lane in 0..GROUP {
                let added = if others[lane] > step { change } else { 0 };
                codes[lane] = codes[lane].wrapping_add(added);
            }
        }
        codes
    }
}

/// The bin of one : other, in five. Ratios of small numbers on the edge of a bin are common, so that rounding shows in the
/// histograms.
pub(super) fn bin(one: u8, other: u8) -> u8 {
    part(ratio(one, other), BINS)
}

/// The ratio of one : other, in the arithmetic of PCL (`computeRGBPairFeatures`): those above 1 become the opposite of their
/// inverse, and 1 stands for those to 0.
pub(crate) fn ratio(one: u8, other: u8) -> f32 {
    let ratio = if other == 0 { 1.0 } else { f32::from(one) / f32::from(other) };
    if ratio > 1.0 { -1.0 / ratio } else { ratio }
}

/// Which of so many equal parts of [−1, 1] a ratio is in, in the arithmetic of PCL (`PFHRGBEstimation`).
pub(crate) fn part(ratio: f32, parts: u8) -> u8 {
    let feature = (f64::from(parts) * ((f64::from(ratio) + 1.0) * 0.5)) as f32;
    (feature as u8).min(parts - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_the_bins_both_ways_round() {
        let others: [u8; 256] = array::from_fn(|other| other as u8);
        for one in 0..=255 {
            let ratio = Ratio::of(one);
            let codes = others.as_chunks().0.iter().flat_map(|group| ratio.codes(group));
            for (other, code) in (0..=255).zip(codes) {
                assert_eq!([code % BINS, code / BINS], [bin(one, other), bin(other, one)], "{one} : {other}");
            }
        }
    }

    #[test]
    fn known_ratios() {
        for (one, other, expected) in [
            (0, 0, 4),
            (7, 0, 4),
            (0, 7, 2),
            (7, 7, 4),
            (1, 5, 3),
            (5, 1, 2),
            (3, 5, 4),
            (5, 3, 0),
            (2, 1, 1),
        ] {
            assert_eq!(bin(one, other), expected, "{one} : {other}");
        }
    }
}
