//! How far a measured share can be trusted: Wilson's interval.

/// Two-sided 95 % quantile of the standard normal distribution.
pub(super) const Z: f64 = 1.959_963_984_540_054;

/// The 95 % interval of a share by Wilson's score (E. B. Wilson, Probable inference, the law of succession, and
/// statistical inference, 1927): of `of` trials, at least 1, `count` had the outcome. It holds for independent trials;
/// clouds of one object are not, so that the truth is less certain still.
pub fn wilson(count: u32, of: u32) -> [f64; 2] {
    wilson_of_share(f64::from(count) / f64::from(of), f64::from(of))
}

/// The same of a share of trials that are worth `n` independent ones, above 0.
pub fn wilson_of_share(share: f64, n: f64) -> [f64; 2] {
    let shrunk = share + Z * Z / (2.0 * n);
    let spread = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
    let all = 1.0 + Z * Z / n;
    // By rounding alone an end may lie beyond what a share can be.
    [((shrunk - spread) / all).clamp(0.0, share), ((shrunk + spread) / all).clamp(share, 1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_are_the_shares_from_which_the_count_is_z_deviations_away() {
        // The definition: |count/n - p| = z * sqrt(p (1 - p) / n).
        for (count, of) in [(1, 10), (5, 10), (99, 475), (110, 475), (474, 475), (3, 100_000)] {
            let (n, share) = (f64::from(of), f64::from(count) / f64::from(of));
            for end in wilson(count, of) {
                let deviations = (share - end).abs() / (end * (1.0 - end) / n).sqrt();
                assert!((deviations - Z).abs() < 1e-9, "{count} of {of}: {end} is {deviations} away");
            }
        }
    }

    #[test]
    fn textbook_values_and_shares_of_none_and_all() {
        // Newcombe (1998), Two-sided confidence intervals for the single proportion, table I: 81/263, 15/148, 0/20, 1/29.
        let close = |interval: [f64; 2], ends: [f64; 2]| {
            interval.iter().zip(ends).all(|(got, end)| (got - end).abs() < 0.000_05)
        };
        assert!(close(wilson(81, 263), [0.2553, 0.3662]), "{:?}", wilson(81, 263));
        assert!(close(wilson(15, 148), [0.0624, 0.1605]), "{:?}", wilson(15, 148));
        assert!(close(wilson(0, 20), [0.0, 0.1611]), "{:?}", wilson(0, 20));
        assert!(close(wilson(1, 29), [0.0061, 0.1718]), "{:?}", wilson(1, 29));
        assert_eq!(wilson(0, 7)[0], 0.0);
        assert_eq!(wilson(7, 7)[1], 1.0);
    }
}
