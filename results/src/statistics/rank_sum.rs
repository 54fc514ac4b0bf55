//! Whether one sample tends to be larger than another: the rank-sum test of Mann and Whitney, and how much.

use statrs::stats_tests::Alternative;
use statrs::stats_tests::mannwhitneyu::{MannWhitneyUMethod, mannwhitneyu};

/// Values up to which every way to share them out is counted: 60 take a few milliseconds.
const EXACT: usize = 60;

/// What the ranks of two samples say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RankSum {
    /// Pairs of one value from each sample in which that of the first is larger, equal ones as a half.
    pub u: f64,
    /// u as a share of all pairs: the chance that a value of the first sample is larger than one of the second (A. Vargha,
    /// H. Delaney, A critique and improvement of the CL common language effect size statistics, 2000, there A12). 0.5: no
    /// difference; 0.56 and 0.44 they call small, 0.64 and 0.36 medium, 0.71 and 0.29 large.
    pub a12: f64,
    /// Two-sided p-value of the test of H. Mann and D. Whitney (On a test of whether one of two random variables is
    /// stochastically larger than the other, 1947).
    pub p_value: f64,
}

/// Compares two samples. Up to 60 values the p-value is exact, also with ties: the share of all ways to divide the
/// values into samples of these sizes whose rank sum is as far from its mean; beyond, it is that of the normal
/// approximation, corrected for ties and continuity. `None` if a sample is empty or a value is not finite.
pub fn rank_sum(first: &[f64], second: &[f64]) -> Option<RankSum> {
    if first.is_empty() || second.is_empty() || !first.iter().chain(second).all(|value| value.is_finite()) {
        return None;
    }
    let doubled: u64 = first
        .iter()
        .flat_map(|a| second.iter().map(move |b| if a > b { 2 } else { u64::from(a == b) }))
        .sum();
    let u = doubled as f64 / 2.0;
    let a12 = u / (first.len() * second.len()) as f64;
    let p_value = if first.len() + second.len() <= EXACT {
        exact(first, second)
    } else {
        let method = MannWhitneyUMethod::AsymptoticInclContinuityCorrection;
        let (_, p_value) = mannwhitneyu(first, second, method, Alternative::TwoSided).ok()?;
        // If all values are equal, there is no spread to divide by.
        if p_value.is_nan() { 1.0 } else { p_value }
    };
    Some(RankSum { u, a12, p_value })
}

/// The exact two-sided p-value.
fn exact(first: &[f64], second: &[f64]) -> f64 {
    let all: Vec<f64> = first.iter().chain(second).copied().collect();
    // Twice the mean rank, a whole number: values below, twice, and those that are equal, itself among them, and 1.
    let rank = |value: &f64| {
        let below = all.iter().filter(|other| *other < value).count();
        let equal = all.iter().filter(|other| *other == value).count();
        2 * below + equal + 1
    };
    let ranks: Vec<usize> = all.iter().map(rank).collect();
    let most: usize = ranks.iter().sum();
    // ways[k][s]: choices of k of the ranks so far whose sum is s.
    let mut ways = vec![vec![0.0; most + 1]; first.len() + 1];
    ways[0][0] = 1.0;
    for &rank in &ranks {
        for chosen in (1..=first.len()).rev() {
            for sum in (rank..=most).rev() {
                ways[chosen][sum] += ways[chosen - 1][sum - rank];
            }
        }
    }
    let observed: usize = ranks[..first.len()].iter().sum();
    let mean = first.len() * (all.len() + 1); // twice n1 (n + 1) / 2
    let ways = &ways[first.len()];
    let as_far = |sum: usize| sum.abs_diff(mean) >= observed.abs_diff(mean);
    let extreme: f64 = ways.iter().enumerate().filter(|(sum, _)| as_far(*sum)).map(|(_, ways)| ways).sum();
    extreme / ways.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// U by its definition.
    fn u(first: &[f64], second: &[f64]) -> f64 {
        let mut u = 0.0;
        for a in first {
            for b in second {
                u += if a > b { 1.0 } else { 0.0 } + if a == b { 0.5 } else { 0.0 };
            }
        }
        u
    }

    /// The share of all divisions of the values whose U is as far from its mean, one by one.
    fn by_permutation(first: &[f64], second: &[f64]) -> f64 {
        let all: Vec<f64> = first.iter().chain(second).copied().collect();
        let mean = (first.len() * second.len()) as f64 / 2.0;
        let (mut extreme, mut divisions) = (0u32, 0u32);
        for chosen in (0u32..1 << all.len()).filter(|chosen| chosen.count_ones() as usize == first.len()) {
            let part = |of: bool| {
                let place = |(index, _): &(usize, &f64)| (chosen >> index & 1 == 1) == of;
                all.iter().enumerate().filter(place).map(|(_, &value)| value).collect::<Vec<_>>()
            };
            divisions += 1;
            extreme +=
                u32::from((u(&part(true), &part(false)) - mean).abs() >= (u(first, second) - mean).abs());
        }
        f64::from(extreme) / f64::from(divisions)
    }

    #[test]
    fn small_samples_are_compared_with_every_permutation_with_and_without_ties() {
        let cases: [(&[f64], &[f64]); 6] = [
            (&[1.0, 2.0, 3.0], &[4.0, 5.0, 6.0, 7.0]),
            (&[5.0, 1.0, 4.0, 9.0, 3.5], &[2.0, 8.0, 7.0, 6.0, 3.0]),
            (&[1.0, 1.0, 2.0, 3.0], &[2.0, 2.0, 3.0, 4.0, 4.0, 4.0]),
            (&[0.25, 0.25], &[0.25, 0.25, 0.25]),
            (&[7.0], &[1.0, 2.0, 3.0]),
            (&[-1.0, 0.0, 0.0, 5.0, 5.0, 5.0], &[0.0, 5.0, 6.0, 6.0, 7.0, 7.0]),
        ];
        for (first, second) in cases {
            let got = rank_sum(first, second).unwrap();
            assert_eq!(got.u, u(first, second));
            assert_eq!(got.a12, got.u / (first.len() * second.len()) as f64);
            let expected = by_permutation(first, second);
            assert!((got.p_value - expected).abs() < 1e-12, "{first:?} {second:?}: {got:?} {expected}");
            let turned = rank_sum(second, first).unwrap();
            assert!(
                (turned.p_value - got.p_value).abs() < 1e-12 && (turned.a12 + got.a12 - 1.0).abs() < 1e-12
            );
        }
    }

    #[test]
    fn a_textbook_example() {
        // Hettmansperger's ages at diagnosis, as in the manual of scipy.stats.mannwhitneyu: U = 17, p = 0.1111.
        let (males, females) = ([19.0, 22.0, 16.0, 29.0, 24.0], [20.0, 11.0, 17.0, 12.0]);
        let got = rank_sum(&males, &females).unwrap();
        assert_eq!((got.u, got.a12), (17.0, 0.85));
        assert!((got.p_value - 1.0 / 9.0).abs() < 1e-12, "{got:?}");
    }

    #[test]
    fn large_samples_are_close_to_what_the_exact_test_gives() {
        let sample = |count: u32, shift: f64| -> Vec<f64> {
            (0..count).map(|n| f64::from(n * 37 % 101) / 10.0 + shift).collect()
        };
        let (first, second) = (sample(31, 0.0), sample(31, 1.7));
        assert!(first.len() + second.len() > EXACT);
        let (approximate, exact) = (rank_sum(&first, &second).unwrap().p_value, exact(&first, &second));
        assert!((approximate - exact).abs() < 0.005, "{approximate} {exact}");
        assert!((0.01..0.2).contains(&exact), "{exact}");
    }

    #[test]
    fn what_cannot_be_compared_and_what_does_not_differ() {
        assert_eq!(rank_sum(&[], &[1.0]), None);
        assert_eq!(rank_sum(&[1.0], &[f64::NAN]), None);
        for count in [3, 80] {
            let equal = vec![4.0; count];
            let got = rank_sum(&equal, &equal).unwrap();
            assert_eq!((got.a12, got.p_value), (0.5, 1.0));
        }
    }
}
