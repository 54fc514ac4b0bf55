//! Uniform crossover (DESIGN 5.9).

use rand::{Rng, RngExt};

/// Two children of two parents of equal length: at each bit, independently with probability `rate`, the first
/// child takes the second parent's bit and the second child the first's; else each takes its own parent's.
///
/// # Panics
/// If the parents differ in length or `rate` is not between 0 and 1.
pub fn uniform(a: &[bool], b: &[bool], rate: f64, rng: &mut impl Rng) -> (Vec<bool>, Vec<bool>) {
    assert_eq!(a.len(), b.len(), "parents of one length");
    a.iter().zip(b).map(|(&a, &b)| if rng.random_bool(rate) { (b, a) } else { (a, b) }).unzip()
}

#[cfg(test)]
mod tests {
    use descriptor::random::stream;
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_mask_swaps_each_bit_with_the_rate() {
        // Parents of all zeros and all ones show the mask itself.
        const BITS: usize = 40;
        const TRIALS: u64 = 4_000;
        for rate in [0.5, 0.2] {
            let mut swapped = [0u32; BITS];
            let mut both = 0;
            for trial in 0..TRIALS {
                let mut rng = stream(3, "test", &[trial]);
                let (mask, _) = uniform(&[false; BITS], &[true; BITS], rate, &mut rng);
                for (count, &bit) in swapped.iter_mut().zip(&mask) {
                    *count += u32::from(bit);
                }
                both += mask.windows(2).filter(|pair| pair[0] && pair[1]).count();
            }
            // Five standard deviations of a binomial count.
            let near = |count: f64, trials: f64, share: f64| {
                (count - trials * share).abs() < 5.0 * (trials * share * (1.0 - share)).sqrt()
            };
            let trials = TRIALS as f64;
            assert!(swapped.iter().all(|&count| near(f64::from(count), trials, rate)), "{swapped:?}");
            let total: u32 = swapped.iter().sum();
            assert!(near(f64::from(total), trials * BITS as f64, rate));
            // Neighbouring bits are swapped independently. Overlapping pairs are correlated: one in two would be
            // independent, hence the halved trials.
            let pairs = trials * (BITS - 1) as f64;
            assert!(near(both as f64 / 2.0, pairs / 2.0, rate * rate), "{both} of {pairs}");
        }
    }

    proptest! {
        #[test]
        fn children_are_complementary_bit_by_bit(
            parents in prop::collection::vec(any::<(bool, bool)>(), 0..60),
            rate in 0.0..=1.0f64,
            seed in any::<u64>(),
        ) {
            let (a, b): (Vec<bool>, Vec<bool>) = parents.into_iter().unzip();
            let (first, second) = uniform(&a, &b, rate, &mut stream(seed, "test", &[]));
            prop_assert_eq!((first.len(), second.len()), (a.len(), a.len()));
            for bit in 0..a.len() {
                let kept = (first[bit], second[bit]) == (a[bit], b[bit]);
                let swapped = (first[bit], second[bit]) == (b[bit], a[bit]);
                prop_assert!(kept || swapped);
            }
        }

        #[test]
        fn rate_zero_keeps_the_parents_and_rate_one_swaps_them(
            parents in prop::collection::vec(any::<(bool, bool)>(), 0..60),
            seed in any::<u64>(),
        ) {
            let (a, b): (Vec<bool>, Vec<bool>) = parents.into_iter().unzip();
            let mut rng = stream(seed, "test", &[]);
            prop_assert_eq!(uniform(&a, &b, 0.0, &mut rng), (a.clone(), b.clone()));
            prop_assert_eq!(uniform(&a, &b, 1.0, &mut rng), (b, a));
        }
    }
}
