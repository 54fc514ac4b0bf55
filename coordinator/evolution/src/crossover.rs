//! Crossover: uniform, bit by bit (DESIGN 5.9), or by whole slots (DESIGN 5b), at their places or at any.

use std::ops::Range;

use rand::seq::SliceRandom;
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

/// Two children of two parents of equal length: of each slot, independently with probability `rate`, the first child
/// takes the second parent's bits and the second child the first's, all of them; else each takes its own parent's.
/// `slots`: the bits of each ([`Genome::slots`](crate::Genome::slots)).
///
/// # Panics
/// If the parents differ in length, a slot has bits beyond it, or `rate` is not between 0 and 1.
pub fn by_slots(
    a: &[bool],
    b: &[bool],
    slots: &[Vec<Range<usize>>],
    rate: f64,
    rng: &mut impl Rng,
) -> (Vec<bool>, Vec<bool>) {
    assert_eq!(a.len(), b.len(), "parents of one length");
    let (mut first, mut second) = (a.to_vec(), b.to_vec());
    for slot in slots {
        if rng.random_bool(rate) {
            for bits in slot {
                first[bits.clone()].swap_with_slice(&mut second[bits.clone()]);
            }
        }
    }
    (first, second)
}

/// A chromosome with the same slots in uniformly random order. `slots`: the bits of each
/// ([`Genome::slots`](crate::Genome::slots)).
///
/// # Panics
/// If the slots are not alike, place by place of the same length, or a slot has bits beyond the chromosome.
pub fn shuffle_slots(chromosome: &[bool], slots: &[Vec<Range<usize>>], rng: &mut impl Rng) -> Vec<bool> {
    let mut order: Vec<&Vec<Range<usize>>> = slots.iter().collect();
    order.shuffle(rng);
    let mut shuffled = chromosome.to_vec();
    for (to, from) in slots.iter().zip(order) {
        assert_eq!(to.len(), from.len(), "fields of a slot");
        for (to, from) in to.iter().zip(from) {
            shuffled[to.clone()].copy_from_slice(&chromosome[from.clone()]);
        }
    }
    shuffled
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

    /// The places of single bits.
    fn places(bits: &[usize]) -> Vec<Range<usize>> {
        bits.iter().map(|&bit| bit..bit + 1).collect()
    }

    #[test]
    fn slots_are_swapped_whole_independently_and_with_the_rate() {
        // Slot 1 lies in two places, slot 2 has no bits.
        let slots = [vec![0..1, 1..3], vec![3..4, 6..9], vec![], vec![4..5, 5..6]];
        const TRIALS: u64 = 8_000;
        for rate in [0.5, 0.2] {
            let (mut swapped, mut both) = ([0u32; 4], 0);
            for trial in 0..TRIALS {
                let mut rng = stream(4, "test", &[trial]);
                // Parents of all zeros and all ones show the mask itself.
                let (mask, _) = by_slots(&[false; 9], &[true; 9], &slots, rate, &mut rng);
                for (count, slot) in swapped.iter_mut().zip(&slots) {
                    let bits: Vec<bool> = slot.iter().flat_map(|bits| &mask[bits.clone()]).copied().collect();
                    assert!(bits.windows(2).all(|pair| pair[0] == pair[1]), "a slot in two: {mask:?}");
                    *count += u32::from(bits.first() == Some(&true));
                }
                both += u32::from(mask[0] && mask[3]);
            }
            let near = |count: u32, share: f64| {
                let trials = TRIALS as f64;
                (f64::from(count) - trials * share).abs() < 5.0 * (trials * share * (1.0 - share)).sqrt()
            };
            assert!([0, 1, 3].iter().all(|&slot| near(swapped[slot], rate)), "{swapped:?}");
            assert!(near(both, rate * rate), "{both}");
        }
    }

    #[test]
    fn slots_come_to_all_places_alike_and_what_is_in_no_slot_stays() {
        // Three slots of a long and a short field; bits 0 and 10 are in none.
        let slots = [vec![1..3, 7..8], vec![3..5, 8..9], vec![5..7, 9..10]];
        let in_slots = [false, true, true, false, true, true, false, false, true, true];
        let mut before = vec![true];
        before.extend(&in_slots[1..]);
        before.push(true);
        // Which slot a content comes from: the three are 11·0, 01·1 and 10·1.
        let contents = |bits: &[bool], slot: &[Range<usize>]| -> Vec<bool> {
            slot.iter().flat_map(|place| bits[place.clone()].to_vec()).collect()
        };
        let originals = slots.each_ref().map(|slot| contents(&before, slot));
        const TRIALS: u64 = 6_000;
        let mut orders = std::collections::BTreeMap::new();
        for trial in 0..TRIALS {
            let after = shuffle_slots(&before, &slots, &mut stream(6, "test", &[trial]));
            assert_eq!((after.len(), after[0], after[10]), (11, true, true));
            let order = slots.each_ref().map(|slot| {
                originals
                    .iter()
                    .position(|original| *original == contents(&after, slot))
                    .expect("a slot in two")
            });
            *orders.entry(order).or_insert(0u32) += 1;
        }
        assert_eq!(orders.len(), 6);
        let expected = TRIALS as f64 / 6.0;
        let term = |&count: &u32| {
            let difference = f64::from(count) - expected;
            difference * difference / expected
        };
        let chi_squared: f64 = orders.values().map(term).sum();
        assert!(chi_squared < 25.7, "above the 99.99 % point with 5 degrees of freedom, got {chi_squared}");
    }

    /// A library that drew other orders would change the digests of runs.
    #[test]
    fn the_orders_that_streams_draw_are_pinned() {
        let order = |trial| {
            // Each slot holds its own number.
            let numbers = [false, false, false, true, true, false, true, true];
            let slots: Vec<_> =
                (0..4).map(|slot| vec![2 * slot..2 * slot + 1, 2 * slot + 1..2 * slot + 2]).collect();
            let shuffled = shuffle_slots(&numbers, &slots, &mut stream(1, "test", &[trial]));
            shuffled.chunks(2).map(|bits| 2 * usize::from(bits[0]) + usize::from(bits[1])).collect::<Vec<_>>()
        };
        let pinned = [[3, 2, 1, 0], [3, 2, 1, 0], [2, 3, 0, 1], [0, 2, 3, 1], [1, 2, 3, 0]];
        assert_eq!([0, 1, 2, 3, 4].map(order), pinned);
    }

    #[test]
    #[should_panic(expected = "fields of a slot")]
    fn slots_that_are_not_alike_are_not_shuffled() {
        let slots = [vec![0..1, 1..2], vec![2..3, 3..4, 4..6]];
        for trial in 0..100 {
            shuffle_slots(&[false; 6], &slots, &mut stream(6, "test", &[trial]));
        }
    }

    proptest! {
        #[test]
        fn children_by_slots_are_complementary_and_each_slot_is_of_one_parent(
            parents in prop::collection::vec(any::<(bool, bool)>(), 0..40),
            // The slot of each bit, in no order.
            numbers in prop::collection::vec(0usize..5, 40),
            rate in 0.0..=1.0f64,
            seed in any::<u64>(),
        ) {
            let (a, b): (Vec<bool>, Vec<bool>) = parents.into_iter().unzip();
            let bits_of = |slot| (0..a.len()).filter(|&bit| numbers[bit] == slot).collect::<Vec<usize>>();
            let slots: Vec<Vec<usize>> = (0..5).map(bits_of).collect();
            let ranges: Vec<_> = slots.iter().map(|slot| places(slot)).collect();
            let (first, second) = by_slots(&a, &b, &ranges, rate, &mut stream(seed, "test", &[]));
            prop_assert_eq!((first.len(), second.len()), (a.len(), a.len()));
            for slot in slots {
                let kept = slot.iter().all(|&bit| (first[bit], second[bit]) == (a[bit], b[bit]));
                let swapped = slot.iter().all(|&bit| (first[bit], second[bit]) == (b[bit], a[bit]));
                prop_assert!(kept || swapped);
            }
            let mut rng = stream(seed, "test", &[]);
            prop_assert_eq!(by_slots(&a, &b, &ranges, 0.0, &mut rng), (a.clone(), b.clone()));
            prop_assert_eq!(by_slots(&a, &b, &ranges, 1.0, &mut rng), (b, a));
        }

        #[test]
        fn with_a_slot_for_each_bit_it_is_uniform_crossover(
            parents in prop::collection::vec(any::<(bool, bool)>(), 0..60),
            rate in 0.0..=1.0f64,
            seed in any::<u64>(),
        ) {
            let (a, b): (Vec<bool>, Vec<bool>) = parents.into_iter().unzip();
            let slots: Vec<_> = (0..a.len()).map(|bit| places(&[bit])).collect();
            prop_assert_eq!(
                by_slots(&a, &b, &slots, rate, &mut stream(seed, "test", &[])),
                uniform(&a, &b, rate, &mut stream(seed, "test", &[]))
            );
        }

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
