//! χ², L1 and Hellinger distances of histograms.

use crate::signature::Signature;

/// Sums a + b below this count as this, so that two of them can be multiplied; what it changes in a term is less.
const LEAST: f32 = 1e-18;

/// How the centroids of two clouds are compared, and, added to that, their deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum SetDistance {
    /// [`chi_squared`], the paper's.
    #[default]
    ChiSquared,
    /// [`l1`].
    L1,
    /// [`hellinger`].
    Hellinger,
}

impl SetDistance {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::ChiSquared, Self::L1, Self::Hellinger];

    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::ChiSquared => "chi2",
            Self::L1 => "l1",
            Self::Hellinger => "hellinger",
        }
    }

    /// The set distance of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|distance| distance.name() == name)
    }
}

/// χ² distance Σ (a − b)² / (2(a + b)) of two histograms of equal length; a term with a + b = 0 is 0 (DESIGN 5.7).
///
/// In f32, in the order of the bins, two terms (of bins 2i and 2i + 1) over one denominator: matching is mostly
/// divisions.
///
/// # Panics
/// If the lengths differ: a programming error.
pub fn chi_squared(a: &[f32], b: &[f32]) -> f32 {
    sum_of::<ChiSquared>(a, b)
}

/// L1 distance Σ |a − b| of two histograms of equal length, in f32, in the order of the bins, two at once.
///
/// # Panics
/// If the lengths differ: a programming error.
pub fn l1(a: &[f32], b: &[f32]) -> f32 {
    sum_of::<L1>(a, b)
}

/// Squared Hellinger distance ½ Σ (√a − √b)² of two histograms of equal length, in f32, in the order of the bins, two at
/// once.
///
/// # Panics
/// If the lengths differ: a programming error.
pub fn hellinger(a: &[f32], b: &[f32]) -> f32 {
    sum_of::<Hellinger>(a, b)
}

/// What a distance is the sum of.
pub(crate) trait Terms {
    /// What the sum is multiplied by.
    const FACTOR: f32;

    /// The terms of two bins.
    fn of_two(a: [f32; 2], b: [f32; 2]) -> f32;
}

pub(crate) struct ChiSquared;

impl Terms for ChiSquared {
    const FACTOR: f32 = 0.5;

    #[inline(always)]
    fn of_two(a: [f32; 2], b: [f32; 2]) -> f32 {
        let (x, y) = (a[0] - b[0], a[1] - b[1]);
        let (s, t) = (at_least(a[0] + b[0]), at_least(a[1] + b[1]));
        (x * x * t + y * y * s) / (s * t)
    }
}

#[inline(always)]
fn at_least(sum: f32) -> f32 {
    if sum > LEAST { sum } else { LEAST }
}

pub(crate) struct L1;

impl Terms for L1 {
    const FACTOR: f32 = 1.0;

    #[inline(always)]
    fn of_two(a: [f32; 2], b: [f32; 2]) -> f32 {
        (a[0] - b[0]).abs() + (a[1] - b[1]).abs()
    }
}

pub(crate) struct Hellinger;

impl Terms for Hellinger {
    const FACTOR: f32 = 0.5;

    #[inline(always)]
    fn of_two(a: [f32; 2], b: [f32; 2]) -> f32 {
        let (x, y) = (a[0].sqrt() - b[0].sqrt(), a[1].sqrt() - b[1].sqrt());
        x * x + y * y
    }
}

fn sum_of<T: Terms>(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len(), "histograms of different channels");
    let (a, a_last) = a.as_chunks::<2>();
    let (b, b_last) = b.as_chunks::<2>();
    let pairs = a.iter().zip(b).fold(0.0, |sum, (&a, &b)| sum + T::of_two(a, b));
    match (a_last, b_last) {
        ([a], [b]) => T::FACTOR * (pairs + T::of_two([*a, 0.0], [*b, 0.0])),
        _ => T::FACTOR * pairs,
    }
}

impl Signature {
    /// χ² distance of the centroids plus that of the deviations.
    pub fn distance(&self, other: &Self) -> f32 {
        self.distance_by(SetDistance::ChiSquared, other)
    }

    /// Distance of the centroids plus that of the deviations.
    pub fn distance_by(&self, distance: SetDistance, other: &Self) -> f32 {
        let of_two = match distance {
            SetDistance::ChiSquared => chi_squared,
            SetDistance::L1 => l1,
            SetDistance::Hellinger => hellinger,
        };
        of_two(&self.centroid, &other.centroid) + of_two(&self.deviation, &other.deviation)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn plain(a: &[f32], b: &[f32]) -> f64 {
        let pairs = a.iter().zip(b).map(|(&a, &b)| (f64::from(a), f64::from(b)));
        pairs.filter(|(a, b)| a + b > 0.0).map(|(a, b)| (a - b) * (a - b) / (2.0 * (a + b))).sum()
    }

    /// Histograms of one length with many zeros.
    fn pair() -> impl Strategy<Value = Vec<(f32, f32)>> {
        let share = || prop_oneof![Just(0.0f32), 0.0f32..1.0, Just(f32::MIN_POSITIVE)];
        prop::collection::vec((share(), share()), 0..100)
    }

    proptest! {
        #[test]
        fn chi_squared_is_its_definition(pair in pair()) {
            let (a, b): (Vec<f32>, Vec<f32>) = pair.into_iter().unzip();
            let found = f64::from(chi_squared(&a, &b));
            prop_assert!((found - plain(&a, &b)).abs() <= 1e-5 * plain(&a, &b) + 1e-30);
            prop_assert_eq!(chi_squared(&a, &b).to_bits(), chi_squared(&b, &a).to_bits());
            prop_assert_eq!(chi_squared(&a, &a), 0.0);
        }

        #[test]
        fn hellinger_is_its_definition(pair in pair()) {
            let (a, b): (Vec<f32>, Vec<f32>) = pair.iter().copied().unzip();
            let terms = || pair.iter().map(|&(a, b)| f64::from(a).sqrt() - f64::from(b).sqrt());
            let plain = 0.5 * terms().map(|difference| difference * difference).sum::<f64>();
            let found = f64::from(hellinger(&a, &b));
            // The difference of two roots near 1 is exact to 1e-7 only.
            let rounding = 1e-5 * plain + 2e-7 * terms().map(f64::abs).sum::<f64>();
            prop_assert!((found - plain).abs() <= rounding + 1e-12, "{} instead of {}", found, plain);
            prop_assert_eq!(hellinger(&a, &b).to_bits(), hellinger(&b, &a).to_bits());
            prop_assert_eq!(hellinger(&a, &a), 0.0);
        }
    }

    #[test]
    fn disjoint_histograms_are_one_apart() {
        assert_eq!(chi_squared(&[0.5, 0.5, 0.0], &[0.0, 0.0, 1.0]), 1.0);
        assert_eq!(hellinger(&[0.25, 0.75, 0.0], &[0.0, 0.0, 1.0]), 1.0);
        assert_eq!(chi_squared(&[0.0; 40], &[0.0; 40]), 0.0);
        assert_eq!(chi_squared(&[], &[]), 0.0);
    }

    #[test]
    fn absolute_differences_add_up() {
        assert_eq!(l1(&[0.5, 0.25, 1.0], &[0.25, 0.5, 0.0]), 1.5);
        assert_eq!(l1(&[], &[]), 0.0);
    }
}
