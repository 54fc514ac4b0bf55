//! Mutation: in order (Engelbrecht, *Computational Intelligence*, section on binary mutation; DESIGN 5.9), or by field
//! (DESIGN 5b), of all slots or of one.

use std::ops::Range;

use rand::{Rng, RngExt};

use crate::genome::{Field, Genome};

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

/// Mutates a chromosome field by field: each field of two values or more gets another value, independently with
/// probability `rate`. Fields that keep their value keep their bits; of the codes of the new value the lowest is written.
///
/// The new value of an ordered field is, with probability ½, a neighbour: one index down or up, equally likely, at
/// either end the only one there is. Else, and always where the field is not ordered, each other index is equally
/// likely.
///
/// # Panics
/// If the chromosome is not of this genome, or `rate` is not between 0 and 1.
pub fn by_field(chromosome: &mut [bool], genome: &Genome, rate: f64, rng: &mut impl Rng) {
    change_fields(chromosome, genome, |_| true, rate, rng);
}

/// Mutates a chromosome as [`by_field`], but only the fields of one slot ([`Genome::slots`]), which is drawn
/// uniformly. A chromosome without slots stays.
///
/// # Panics
/// If the chromosome is not of this genome, or `rate` is not between 0 and 1.
pub fn by_slot(chromosome: &mut [bool], genome: &Genome, rate: f64, rng: &mut impl Rng) {
    let slots = genome.slots();
    if slots.is_empty() {
        return;
    }
    // Drawn as u64, so that the stream is the same whatever the platform's word.
    let slot = &slots[rng.random_range(0..slots.len() as u64) as usize];
    change_fields(chromosome, genome, |bits| slot.contains(bits), rate, rng);
}

/// Mutates fields whose bits are at such places.
fn change_fields(
    chromosome: &mut [bool],
    genome: &Genome,
    may_change: impl Fn(&Range<usize>) -> bool,
    rate: f64,
    rng: &mut impl Rng,
) {
    assert_eq!(chromosome.len(), genome.bits(), "chromosome length");
    for (field, bits) in genome.fields_with_bits() {
        if field.values > 1 && may_change(&bits) && rng.random_bool(rate) {
            let bits = &mut chromosome[bits];
            let value = another(field, genome.read(field, bits), rng);
            genome.write(field, value, bits);
        }
    }
}

/// A value index of the field, of at least two, that is not `value`.
fn another(field: &Field, value: u32, rng: &mut impl Rng) -> u32 {
    if field.ordered && rng.random_bool(0.5) {
        let (down, up) = (value.checked_sub(1), Some(value + 1).filter(|&up| up < field.values));
        if let (Some(down), Some(up)) = (down, up) {
            return if rng.random_bool(0.5) { down } else { up };
        }
        return down.or(up).unwrap_or(value);
    }
    let other = rng.random_range(0..field.values - 1);
    other + u32::from(other >= value)
}

#[cfg(test)]
mod tests {
    use descriptor::random::stream;
    use proptest::prelude::*;

    use super::*;
    use crate::genome::Encoding;

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

    /// χ² of what one ordered or unordered field of `values` values becomes from `value`, against the definition.
    fn chi_squared(values: u32, value: u32, ordered: bool) -> f64 {
        const TRIALS: u64 = 20_000;
        let genome = Genome::new(vec![Field { ordered, ..Field::new("field", values) }], Encoding::Binary);
        let mut observed = vec![0u32; values as usize];
        for trial in 0..TRIALS {
            let mut chromosome = genome.encode(&[value]);
            by_field(&mut chromosome, &genome, 1.0, &mut stream(8, "test", &[trial]));
            observed[genome.decode(&chromosome)[0] as usize] += 1;
        }
        assert_eq!(observed[value as usize], 0, "the value stayed");
        let neighbours: Vec<u32> =
            (0..values).filter(|&other| other + 1 == value || value + 1 == other).collect();
        let share = |other: u32| {
            let uniform = 1.0 / f64::from(values - 1);
            let near = if neighbours.contains(&other) { 1.0 / neighbours.len() as f64 } else { 0.0 };
            if ordered { 0.5 * near + 0.5 * uniform } else { uniform }
        };
        let term = |other: u32| {
            let expected = share(other) * TRIALS as f64;
            let difference = f64::from(observed[other as usize]) - expected;
            difference * difference / expected
        };
        (0..values).filter(|&other| other != value).map(term).sum()
    }

    #[test]
    fn the_new_value_is_a_neighbour_half_of_the_time_where_the_field_is_ordered() {
        for ordered in [true, false] {
            for value in [0, 1, 3, 6] {
                let got = chi_squared(7, value, ordered);
                assert!(got < 25.7, "above the 99.99 % point with 5 degrees of freedom, got {got}");
            }
            // There is one other value.
            assert_eq!([0, 1].map(|value| chi_squared(2, value, ordered)), [0.0; 2]);
        }
    }

    #[test]
    fn each_field_changes_with_the_rate_and_none_with_another() {
        let genome = Genome::new(vec![Field::new("field", 25); 10], Encoding::Binary);
        const TRIALS: u64 = 4_000;
        for rate in [0.06, 0.4] {
            let (mut changed, mut pairs) = ([0u32; 10], 0);
            for trial in 0..TRIALS {
                let mut chromosome = genome.encode(&[12; 10]);
                by_field(&mut chromosome, &genome, rate, &mut stream(9, "test", &[trial]));
                let now = genome.decode(&chromosome);
                for (count, &value) in changed.iter_mut().zip(&now) {
                    *count += u32::from(value != 12);
                }
                pairs += u32::from(now[0] != 12 && now[1] != 12);
            }
            let near = |count: u32, share: f64| {
                let trials = TRIALS as f64;
                (f64::from(count) - trials * share).abs() < 5.0 * (trials * share * (1.0 - share)).sqrt()
            };
            assert!(changed.iter().all(|&count| near(count, rate)), "{changed:?}");
            assert!(near(pairs, rate * rate), "{pairs}");
        }
    }

    #[test]
    fn by_slot_one_slot_changes_each_as_likely_and_its_fields_with_the_rate() {
        // Three slots of two fields, in no order; one field has a single value.
        let field = |(values, slot)| Field { slot: Some(slot), ..Field::new("field", values) };
        let fields = [(9, 0), (9, 1), (9, 2), (9, 1), (1, 2), (9, 0)].map(field);
        let slot_of = [0, 1, 2, 1, 2, 0];
        let genome = Genome::new(fields.to_vec(), Encoding::Gray);
        const TRIALS: u64 = 9_000;
        for rate in [0.3, 1.0] {
            let (mut changed, mut pairs) = ([0u32; 6], 0);
            for trial in 0..TRIALS {
                let before = genome.encode(&[4, 4, 4, 4, 0, 4]);
                let mut after = before.clone();
                by_slot(&mut after, &genome, rate, &mut stream(10, "test", &[trial]));
                let (before, after) = (genome.decode(&before), genome.decode(&after));
                let places: Vec<usize> = (0..6).filter(|&place| before[place] != after[place]).collect();
                assert!(places.windows(2).all(|pair| slot_of[pair[0]] == slot_of[pair[1]]), "{places:?}");
                pairs += u32::from(places.len() == 2);
                places.iter().for_each(|&place| changed[place] += 1);
            }
            let near = |count: u32, share: f64| {
                let trials = TRIALS as f64;
                (f64::from(count) - trials * share).abs() <= 5.0 * (trials * share * (1.0 - share)).sqrt()
            };
            for place in [0, 1, 2, 3, 5] {
                assert!(near(changed[place], rate / 3.0), "{changed:?}");
            }
            assert_eq!(changed[4], 0);
            assert!(near(pairs, rate * rate * 2.0 / 3.0), "{pairs}");
        }
        by_slot(&mut [], &Genome::new(Vec::new(), Encoding::Gray), 1.0, &mut stream(10, "test", &[]));
    }

    proptest! {
        #[test]
        fn by_field_writes_other_values_and_leaves_the_bits_of_those_that_stay(
            table in prop::collection::vec((1u32..12, any::<bool>()), 0..8),
            bits in prop::collection::vec(any::<bool>(), 32),
            gray in any::<bool>(),
            rate in prop::sample::select(vec![0.0, 0.3, 1.0]),
            seed in any::<u64>(),
        ) {
            let field = |&(values, ordered): &(u32, bool)| Field { ordered, ..Field::new("field", values) };
            let encoding = if gray { Encoding::Gray } else { Encoding::Binary };
            let genome = Genome::new(table.iter().map(field).collect(), encoding);
            // Any bits, so that most values are not written by their lowest code.
            let before = &bits[..genome.bits()];
            let mut after = before.to_vec();
            by_field(&mut after, &genome, rate, &mut stream(seed, "test", &[]));
            let values = [before, &after].map(|chromosome| genome.decode(chromosome));
            let lowest = genome.encode(&values[1]);
            for (index, (field, bits)) in genome.fields_with_bits().enumerate() {
                let changed = values[0][index] != values[1][index];
                let expected = if changed { &lowest } else { before };
                prop_assert_eq!(&after[bits.clone()], &expected[bits]);
                if rate != 0.3 {
                    prop_assert_eq!(changed, rate == 1.0 && field.values > 1);
                }
            }
        }

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
