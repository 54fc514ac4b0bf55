//! McNemar's test: whether two descriptors err differently on the same clouds.

use statrs::distribution::{Binomial, DiscreteCDF as _};

/// Two-sided p-value of McNemar's exact test (Q. McNemar, Note on the sampling error of the difference between
/// correlated proportions, 1947): `only_a` clouds were recognised by one descriptor alone, `only_b` by the other alone.
/// If both err alike, each of these clouds falls to either side with probability 1/2; the value is twice the chance of
/// a split at least as uneven, at most 1. Clouds of one object are not independent, so that the truth is less certain.
pub fn mcnemar(only_a: u32, only_b: u32) -> f64 {
    let discordant = u64::from(only_a) + u64::from(only_b);
    match Binomial::new(0.5, discordant) {
        Ok(fair) => (2.0 * fair.cdf(u64::from(only_a.min(only_b)))).min(1.0),
        Err(_) => 1.0, // one half is a probability
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All outcomes of `n` fair coins, counted.
    fn by_counting(only_a: u32, only_b: u32) -> f64 {
        let n = only_a + only_b;
        let uneven = |heads: u32| heads.min(n - heads) <= only_a.min(only_b);
        let outcomes = (0..1u64 << n).filter(|coins| uneven(coins.count_ones())).count();
        outcomes as f64 / (1u64 << n) as f64
    }

    #[test]
    fn the_value_is_the_share_of_coin_throws_that_are_as_uneven() {
        for only_a in 0..9 {
            for only_b in 0..9 {
                let (got, expected) = (mcnemar(only_a, only_b), by_counting(only_a, only_b));
                assert!((got - expected).abs() < 1e-12, "{only_a} {only_b}: {got} {expected}");
            }
        }
    }

    #[test]
    fn a_textbook_value_and_large_counts() {
        // Fagerland, Lydersen, Laake (2013), airway hyper-responsiveness: 1 against 7 children, exact p = 0.0703.
        assert!((mcnemar(1, 7) - 0.0703).abs() < 5e-5);
        assert_eq!(mcnemar(0, 0), 1.0);
        assert_eq!(mcnemar(500, 500), 1.0);
        let tiny = mcnemar(0, 1000);
        assert!(tiny > 0.0 && tiny < 1e-300, "{tiny}");
        assert_eq!(mcnemar(3, 40), mcnemar(40, 3));
    }
}
