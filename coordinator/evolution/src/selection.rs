//! Selection of parents: roulette wheel over scaled correct counts (DESIGN 5.9).

use rand::{Rng, RngExt};

use crate::settings::Scaling;

/// Whole-number selection weights from correct counts; an individual is drawn with probability weight / sum.
///
/// With n individuals and counts f of sum S:
/// - `none`: f.
/// - `linear`: Goldberg's scaling f' = a·f + b, which keeps the mean f̄ and gives the best C = 2 times the mean:
///   a = f̄ / (max − f̄), b = f̄·(max − 2f̄) / (max − f̄). Where that makes the worst negative (min < 2f̄ − max),
///   the worst is put at 0 and the mean kept instead: a = f̄ / (f̄ − min), b = −min·f̄ / (f̄ − min) (Goldberg,
///   *Genetic Algorithms in Search, Optimization and Machine Learning*, 1989, chapter 3, `prescale`).
///   Divided by a / n and by a respectively, which changes no probability, these are the whole numbers
///   n·f + n·max − 2S and f − min.
/// - `rank`: the rank, 1 for the worst and n for the best; equal counts share the mean of their ranks. Doubled,
///   so that half ranks are whole numbers.
///
/// If all weights would be 0 (all counts 0; with `linear`, all counts equal), all are 1. The sum fits 64 bits for
/// populations up to [`MAX_POPULATION`](crate::MAX_POPULATION).
pub fn weights(correct: &[u32], scaling: Scaling) -> Vec<u64> {
    let weights: Vec<u64> = match scaling {
        Scaling::None => correct.iter().map(|&f| u64::from(f)).collect(),
        Scaling::Linear => linear(correct),
        Scaling::Rank => ranks(correct),
    };
    if weights.iter().all(|&weight| weight == 0) { vec![1; correct.len()] } else { weights }
}

fn linear(correct: &[u32]) -> Vec<u64> {
    let n = correct.len() as u64;
    let sum: u64 = correct.iter().copied().map(u64::from).sum();
    let max = u64::from(correct.iter().copied().max().unwrap_or(0));
    let min = u64::from(correct.iter().copied().min().unwrap_or(0));
    if n * (min + max) >= 2 * sum {
        correct.iter().map(|&f| n * (u64::from(f) + max) - 2 * sum).collect()
    } else {
        correct.iter().map(|&f| u64::from(f) - min).collect()
    }
}

fn ranks(correct: &[u32]) -> Vec<u64> {
    let mut sorted = correct.to_vec();
    sorted.sort_unstable();
    let rank_sum = |&f: &u32| {
        let below = sorted.partition_point(|&other| other < f) as u64;
        let up_to = sorted.partition_point(|&other| other <= f) as u64;
        // Equal counts hold the ranks below + 1 to up_to: twice their mean is the sum of first and last.
        below + 1 + up_to
    };
    correct.iter().map(rank_sum).collect()
}

/// A roulette wheel: one slot for each individual, as wide as its weight.
#[derive(Clone, Debug)]
pub struct Roulette {
    /// End of each individual's slot; the start is the end of the one before.
    ends: Vec<u64>,
}

impl Roulette {
    /// The wheel of one generation's correct counts.
    pub fn new(correct: &[u32], scaling: Scaling) -> Self {
        let ends = weights(correct, scaling)
            .into_iter()
            .scan(0, |end, weight| {
                *end += weight;
                Some(*end)
            })
            .collect();
        Self { ends }
    }

    /// One turn of the wheel: the index of an individual. Draws are independent, with replacement.
    ///
    /// # Panics
    /// If the wheel has no individuals.
    pub fn draw(&self, rng: &mut impl Rng) -> u32 {
        let total = self.ends.last().copied().unwrap_or(0);
        let ball = rng.random_range(0..total);
        self.ends.partition_point(|&end| end <= ball) as u32
    }
}

#[cfg(test)]
mod tests {
    use descriptor::random::stream;
    use proptest::prelude::*;

    use super::*;

    const SCALINGS: [Scaling; 3] = [Scaling::None, Scaling::Linear, Scaling::Rank];

    /// χ² of observed draws against the expected shares, over the individuals with a share.
    fn chi_squared(correct: &[u32], scaling: Scaling, shares: &[f64]) -> f64 {
        const DRAWS: u32 = 60_000;
        let roulette = Roulette::new(correct, scaling);
        let mut rng = stream(7, "test", &[scaling as u64]);
        let mut observed = vec![0u32; correct.len()];
        for _ in 0..DRAWS {
            observed[roulette.draw(&mut rng) as usize] += 1;
        }
        let mut sum = 0.0;
        for (&count, &share) in observed.iter().zip(shares) {
            let expected = share * f64::from(DRAWS);
            if share == 0.0 {
                assert_eq!(count, 0, "drawn without a share");
            } else {
                let difference = f64::from(count) - expected;
                sum += difference * difference / expected;
            }
        }
        sum
    }

    /// 99.99 % point of χ² with 4 degrees of freedom; fewer degrees have a lower one.
    const CRITICAL: f64 = 23.51;

    #[test]
    fn draws_follow_the_counts() {
        assert!(
            chi_squared(&[10, 20, 30, 15, 25], Scaling::None, &[0.10, 0.20, 0.30, 0.15, 0.25]) < CRITICAL
        );
        assert!(chi_squared(&[0, 1, 0, 3, 0], Scaling::None, &[0.0, 0.25, 0.0, 0.75, 0.0]) < CRITICAL);
        // The statistic sees a wheel that is off by two hundredths.
        assert!(
            chi_squared(&[10, 20, 30, 15, 25], Scaling::None, &[0.12, 0.18, 0.30, 0.15, 0.25]) > CRITICAL
        );
    }

    #[test]
    fn draws_follow_the_scaled_counts() {
        // Linear: mean 20, best 30 becomes 40 by f' = 2f − 20.
        assert!(chi_squared(&[10, 20, 30, 15, 25], Scaling::Linear, &[0.0, 0.2, 0.4, 0.1, 0.3]) < CRITICAL);
        let shares = [1.0, 3.0, 5.0, 2.0, 4.0].map(|rank| rank / 15.0);
        assert!(chi_squared(&[10, 20, 30, 15, 25], Scaling::Rank, &shares) < CRITICAL);
    }

    #[test]
    fn all_counts_zero_draws_uniformly() {
        for scaling in SCALINGS {
            assert!(chi_squared(&[0; 5], scaling, &[0.2; 5]) < CRITICAL);
        }
    }

    #[test]
    fn consecutive_draws_are_independent() {
        // Parents are drawn with replacement: all nine ordered pairs of three, also the equal ones.
        let roulette = Roulette::new(&[1, 1, 1], Scaling::None);
        let mut observed = [[0u32; 3]; 3];
        for pair in 0..36_000 {
            let mut rng = stream(7, "test pairs", &[pair]);
            observed[roulette.draw(&mut rng) as usize][roulette.draw(&mut rng) as usize] += 1;
        }
        let chi_squared: f64 = observed
            .as_flattened()
            .iter()
            .map(|&count| (f64::from(count) - 4000.0) * (f64::from(count) - 4000.0))
            .sum::<f64>()
            / 4000.0;
        assert!(chi_squared < 31.83, "99.99 % point with 8 degrees of freedom, got {chi_squared}");
    }

    #[test]
    fn linear_scaling_follows_goldbergs_formula() {
        // Mean 4, max 6, min 2: f' = 2f − 4 = 0, 4, 8. The weights n·f + n·max − 2S are that times 3/2.
        assert_eq!(weights(&[2, 4, 6], Scaling::Linear), [0, 6, 12]);
        // Mean 10, max 30 (a superfit one): a = 1/2, b = 5, so 3 becomes 6.5 and 30 becomes 20 = 2·mean.
        assert_eq!(weights(&[3, 3, 4, 30], Scaling::Linear), [52, 52, 56, 160]);
        // Mean 8, max 10, min 2 < 16 − 10: the guard puts the worst at 0: f − 2.
        assert_eq!(weights(&[10, 10, 10, 2], Scaling::Linear), [8, 8, 8, 0]);
        // No difference, no preference.
        assert_eq!(weights(&[5, 5, 5], Scaling::Linear), [1, 1, 1]);
    }

    #[test]
    fn rank_scaling_counts_from_the_worst_and_ties_share_their_mean() {
        // Ranks 1, 4, 2, 3, doubled.
        assert_eq!(weights(&[10, 400, 20, 30], Scaling::Rank), [2, 8, 4, 6]);
        // Ranks 2.5 and 2.5 for the two in the middle.
        assert_eq!(weights(&[7, 1, 7, 9], Scaling::Rank), [5, 2, 5, 8]);
        assert_eq!(weights(&[3, 3, 3], Scaling::Rank), [4, 4, 4]);
    }

    #[test]
    fn the_largest_counts_and_populations_do_not_overflow() {
        let mut correct = vec![0; crate::MAX_POPULATION as usize];
        correct[1] = u32::MAX;
        for scaling in SCALINGS {
            let roulette = Roulette::new(&correct, scaling);
            assert!(roulette.ends.is_sorted());
        }
        correct.fill(u32::MAX);
        correct[1] = 0;
        for scaling in SCALINGS {
            let roulette = Roulette::new(&correct, scaling);
            assert!(roulette.ends.is_sorted());
            assert_ne!(roulette.draw(&mut stream(1, "test", &[])), 1);
        }
    }

    proptest! {
        #[test]
        fn linear_weights_are_goldbergs_up_to_one_factor(correct in prop::collection::vec(0u32..500, 2..20)) {
            let n = correct.len() as f64;
            let mean = correct.iter().copied().map(f64::from).sum::<f64>() / n;
            let max = f64::from(*correct.iter().max().unwrap());
            let min = f64::from(*correct.iter().min().unwrap());
            let (a, b) = if max == min {
                (1.0, 0.0)
            } else if min > 2.0 * mean - max {
                (mean / (max - mean), mean * (max - 2.0 * mean) / (max - mean))
            } else {
                (mean / (mean - min), -min * mean / (mean - min))
            };
            let weights = weights(&correct, Scaling::Linear);
            let total: u64 = weights.iter().sum();
            for (&f, &weight) in correct.iter().zip(&weights) {
                // Scaled fitness keeps its mean, so its sum is n·mean.
                let expected = if max == 0.0 { 1.0 / n } else { (a * f64::from(f) + b) / (n * mean) };
                prop_assert!((weight as f64 / total as f64 - expected).abs() < 1e-9);
            }
        }

        #[test]
        fn a_higher_count_never_has_a_lower_weight(correct in prop::collection::vec(0u32..50, 1..20)) {
            for scaling in SCALINGS {
                let weights = weights(&correct, scaling);
                for i in 0..correct.len() {
                    for j in 0..correct.len() {
                        prop_assert!(correct[i] < correct[j] || weights[i] >= weights[j]);
                        prop_assert!(correct[i] != correct[j] || weights[i] == weights[j]);
                    }
                }
            }
        }

        #[test]
        fn an_individual_with_count_zero_is_drawn_only_if_all_are(
            correct in prop::collection::vec(0u32..3, 1..12),
            seed in any::<u64>(),
        ) {
            let roulette = Roulette::new(&correct, Scaling::None);
            let mut rng = stream(seed, "test", &[]);
            for _ in 0..100 {
                let drawn = roulette.draw(&mut rng) as usize;
                prop_assert!(correct[drawn] > 0 || correct.iter().all(|&f| f == 0));
            }
        }
    }
}
