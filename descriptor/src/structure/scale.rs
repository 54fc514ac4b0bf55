//! What the distances of a channel are divided by, so that those of different channels can be added up.

use crate::distance::{DistanceMatrix, SetDistance};
use crate::signature::Signatures;

/// Clouds whose distances are computed at once: that many rows are all the memory that the distances take.
const STRIPE: usize = 64;

/// Digits of a distance's bits by which it is found.
const DIGITS: usize = 1 << 16;

/// The distance below which a twentieth of the distances of these clouds lie: of those of all unordered pairs of clouds,
/// sorted, the one at index ⌊pairs/20⌋; 1 if that is 0 or if there is no pair. Computed by the current rayon pool.
pub fn scale(signatures: &Signatures, metric: SetDistance) -> f64 {
    let clouds = signatures.clouds() as u64;
    let pairs = clouds * clouds.saturating_sub(1) / 2;
    if pairs == 0 {
        return 1.0;
    }
    // Sorted by their bits, as none is negative: first the upper half of the bits is found, then the lower half.
    let mut index = pairs / 20;
    let upper = digit_at(&mut index, signatures, metric, |bits| Some(bits >> 16));
    let of_upper = |bits: u32| (bits >> 16 == upper).then_some(bits & 0xffff);
    let lower = digit_at(&mut index, signatures, metric, of_upper);
    let distance = f32::from_bits(upper << 16 | lower);
    if distance == 0.0 { 1.0 } else { f64::from(distance) }
}

/// The digit of the distance at this index of those that have one; the index becomes that among the distances of the same
/// digit.
fn digit_at(
    index: &mut u64,
    signatures: &Signatures,
    metric: SetDistance,
    digit: impl Fn(u32) -> Option<u32> + Sync,
) -> u32 {
    let mut counts = vec![0u64; DIGITS];
    for first in (0..signatures.clouds()).step_by(STRIPE) {
        let clouds = STRIPE.min(signatures.clouds() - first);
        let [queries, others] =
            [clouds, signatures.clouds() - first].map(|clouds| signatures.stripe(first, clouds));
        let matrix = DistanceMatrix::by(metric, &queries, &others);
        let count = |mut counts: Vec<u64>, row: usize| {
            for distance in &matrix.row(row)[row + 1..] {
                if let Some(digit) = digit(distance.to_bits()) {
                    counts[digit as usize] += 1;
                }
            }
            counts
        };
        counts = (0..clouds).fold(counts, count);
    }
    let mut digits = (0..).zip(&counts);
    let found = digits.find(|&(_, &count)| {
        let is_here = *index < count;
        *index -= if is_here { 0 } else { count };
        is_here
    });
    found.map_or(0, |(digit, _)| digit)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::signature::Signature;

    /// The definition: all distances, sorted.
    fn plain(signatures: &[Signature], metric: SetDistance) -> f64 {
        let mut distances = Vec::new();
        for (index, one) in signatures.iter().enumerate() {
            distances.extend(signatures[index + 1..].iter().map(|other| one.distance_by(metric, other)));
        }
        distances.sort_by(f32::total_cmp);
        let place = (0.05 * distances.len() as f64).floor() as usize;
        match distances.get(place) {
            None | Some(0.0) => 1.0,
            Some(&distance) => f64::from(distance),
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn the_scale_is_its_definition(
            values in prop::collection::vec(prop::collection::vec(prop_oneof![Just(0.0f32), 0.0f32..1.0], 4), 0..150),
            repeated in 0usize..40,
        ) {
            let signature =
                |values: &Vec<f32>| Signature { centroid: values[..3].to_vec(), deviation: vec![values[3]; 3] };
            let mut signatures: Vec<Signature> = values.iter().map(signature).collect();
            signatures.extend(std::iter::repeat_n(signatures.first().cloned(), repeated).flatten());
            for metric in SetDistance::ALL {
                prop_assert_eq!(scale(&signatures.iter().collect(), metric), plain(&signatures, metric));
            }
        }
    }

    #[test]
    fn without_a_distance_it_is_1() {
        let signature = |value: f32| Signature { centroid: vec![value, 1.0 - value], deviation: Vec::new() };
        let of = |values: &[f32]| {
            let signatures: Vec<Signature> = values.iter().copied().map(signature).collect();
            scale(&signatures.iter().collect(), SetDistance::L1)
        };
        assert_eq!([of(&[]), of(&[0.5]), of(&[0.5, 0.5])], [1.0; 3]);
        assert_eq!(of(&[0.5, 0.75]), 0.5);
        // Of 21 pairs, the second shortest: six clouds alike would make it 0.
        assert_eq!(of(&[0.0, 0.125, 0.375, 0.75, 1.25, 2.0, 3.0]), 0.5);
    }
}
