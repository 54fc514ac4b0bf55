//! In-order mutation (Engelbrecht, *Computational Intelligence*, section on binary mutation; DESIGN 5.9).

use rand::{Rng, RngExt};

/// Mutates a chromosome: two points, then a chance `rate` for each bit between them. An empty chromosome stays.
///
/// # Panics
/// If `rate` is not between 0 and 1.
pub fn in_order(chromosome: &mut [bool], rate: f64, rng: &mut impl Rng) {
    if let Some(points) = points(chromosome.len(), rng) {
        flip_between(chromosome, points, rate, rng);
    }
}

/// Two bits of a chromosome, uniform with replacement, the lower first; `None` if there are no bits.
pub fn points(bits: usize, rng: &mut impl Rng) -> Option<(usize, usize)> {
    // Drawn as u64, so that the stream is the same whatever the platform's word.
    let bits = bits as u64;
    (bits > 0).then(|| {
        let (a, b) = (rng.random_range(0..bits) as usize, rng.random_range(0..bits) as usize);
        (a.min(b), a.max(b))
    })
}

/// Flips each bit from the first point to the second, both included, independently with probability `rate`.
///
/// # Panics
/// If the points are not in order inside the chromosome, or `rate` is not between 0 and 1.
pub fn flip_between(chromosome: &mut [bool], (low, high): (usize, usize), rate: f64, rng: &mut impl Rng) {
    for bit in &mut chromosome[low..=high] {
        *bit ^= rng.random_bool(rate);
    }
}

#[cfg(test)]
mod tests {
    use descriptor::random::stream;
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn points_are_uniform_with_replacement() {
        // Of 6·6 ordered draws a sorted pair of different points comes from two, of equal points from one.
        const BITS: usize = 6;
        const TRIALS: u64 = 36_000;
        let mut observed = [[0u32; BITS]; BITS];
        for trial in 0..TRIALS {
            let (low, high) = points(BITS, &mut stream(11, "test", &[trial])).unwrap();
            observed[low][high] += 1;
        }
        let mut chi_squared = 0.0;
        for (low, row) in observed.iter().enumerate() {
            for (high, &count) in row.iter().enumerate() {
                let expected = match low.cmp(&high) {
                    std::cmp::Ordering::Less => 2000.0,
                    std::cmp::Ordering::Equal => 1000.0,
                    std::cmp::Ordering::Greater => {
                        assert_eq!(count, 0, "points out of order");
                        continue;
                    }
                };
                let difference = f64::from(count) - expected;
                chi_squared += difference * difference / expected;
            }
        }
        assert!(chi_squared < 53.0, "above the 99.99 % point with 20 degrees of freedom, got {chi_squared}");
    }

    #[test]
    fn each_bit_between_the_points_flips_with_the_rate() {
        const TRIALS: u64 = 4_000;
        for rate in [0.40, 0.1] {
            let mut flipped = [0u32; 25];
            for trial in 0..TRIALS {
                let mut chromosome = [trial % 2 == 0; 25];
                flip_between(&mut chromosome, (4, 20), rate, &mut stream(5, "test", &[trial]));
                for (count, bit) in flipped.iter_mut().zip(chromosome) {
                    *count += u32::from(bit != (trial % 2 == 0));
                }
            }
            let deviation = (TRIALS as f64 * rate * (1.0 - rate)).sqrt();
            for (bit, &count) in flipped.iter().enumerate() {
                if (4..=20).contains(&bit) {
                    let expected = TRIALS as f64 * rate;
                    assert!((f64::from(count) - expected).abs() < 5.0 * deviation, "bit {bit}: {count}");
                } else {
                    assert_eq!(count, 0, "bit {bit} lies outside");
                }
            }
        }
    }

    #[test]
    fn equal_points_flip_that_bit_or_none() {
        let mut flips = 0;
        for trial in 0..1_000 {
            let mut chromosome = [false; 9];
            flip_between(&mut chromosome, (4, 4), 0.4, &mut stream(5, "test", &[trial]));
            let ones: Vec<usize> = (0..9).filter(|&bit| chromosome[bit]).collect();
            assert!(ones.is_empty() || ones == [4], "{ones:?}");
            flips += ones.len();
        }
        assert!((323..=477).contains(&flips), "400 ± 5 deviations, got {flips}");
    }

    #[test]
    fn an_empty_chromosome_has_no_points_and_stays() {
        let mut rng = stream(1, "test", &[]);
        assert_eq!(points(0, &mut rng), None);
        in_order(&mut [], 0.4, &mut rng);
        let mut one = [false];
        in_order(&mut one, 1.0, &mut rng);
        assert_eq!(one, [true]);
    }

    proptest! {
        #[test]
        fn no_bit_outside_its_points_is_touched(
            before in prop::collection::vec(any::<bool>(), 1..60),
            rate in 0.0..=1.0f64,
            seed in any::<u64>(),
        ) {
            // The points are the first that the stream gives: the same stream tells which they were.
            let (low, high) = points(before.len(), &mut stream(seed, "test", &[])).unwrap();
            let mut after = before.clone();
            in_order(&mut after, rate, &mut stream(seed, "test", &[]));
            prop_assert_eq!(&after[..low], &before[..low]);
            prop_assert_eq!(&after[high + 1..], &before[high + 1..]);
        }

        #[test]
        fn rate_one_flips_exactly_the_bits_from_point_to_point(
            before in prop::collection::vec(any::<bool>(), 1..60),
            seed in any::<u64>(),
        ) {
            let mut rng = stream(seed, "test", &[]);
            let (low, high) = points(before.len(), &mut rng).unwrap();
            let mut after = before.clone();
            flip_between(&mut after, (low, high), 1.0, &mut rng);
            for bit in 0..before.len() {
                prop_assert_eq!(before[bit] != after[bit], (low..=high).contains(&bit));
            }
            flip_between(&mut after, (low, high), 0.0, &mut rng);
            flip_between(&mut after, (low, high), 1.0, &mut rng);
            prop_assert_eq!(after, before);
        }
    }
}
