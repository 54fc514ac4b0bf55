//! What the distances of a channel are divided by, so that those of different channels can be added up.

use std::cmp::Ordering;

use rayon::prelude::*;

use crate::distance::{DistanceMatrix, SetDistance};
use crate::signature::Signatures;
use crate::transposed::{LANES, Transposed};

/// One distance in so many lies below the scale.
const ONE_IN: usize = 20;

/// The distance below which a twentieth of the distances of some clouds to the same clouds lie: of those of all unordered
/// pairs of clouds, sorted, the one at index ⌊pairs/20⌋; 1 if that is 0 or if there is no pair.
///
/// # Panics
/// If there are not as many queries as clouds of the database: a programming error.
pub fn scale(distances: &DistanceMatrix) -> f64 {
    let clouds = distances.columns();
    let mut pairs: Vec<f32> =
        (0..clouds).flat_map(|cloud| &distances.row(cloud)[cloud + 1..]).copied().collect();
    let scale = quantile(&mut pairs, f32::total_cmp).map_or(0.0, f64::from);
    if scale > 0.0 { scale } else { 1.0 }
}

/// More distances are counted instead of kept: they would take 256 MiB.
const LARGEST_DISTANCES: usize = 64 << 20;

/// The [`scale`] of some clouds, by the current rayon pool. Of many, their distances are computed twice, but never kept.
pub fn scale_among(distance: SetDistance, clouds: &Signatures) -> f64 {
    scale_within(LARGEST_DISTANCES, distance, clouds)
}

fn scale_within(most: usize, distance: SetDistance, clouds: &Signatures) -> f64 {
    let count = clouds.clouds();
    if count < 2 || count.saturating_mul(count) <= most {
        return scale(&DistanceMatrix::among(distance, clouds));
    }
    let place = (count * (count - 1) / 2 / ONE_IN) as u64;
    let transposed = Transposed::new(clouds);
    // Distances are not negative: their bits are in their order. First the upper half of the bits, then the lower.
    let upper = Counts::new(&transposed, distance, clouds, |bits| Some(bits >> 16)).at(place);
    let of_upper = |bits: u32| (bits >> 16 == upper.value).then_some(bits & 0xFFFF);
    let lower = Counts::new(&transposed, distance, clouds, of_upper).at(place - upper.before);
    let scale = f64::from(f32::from_bits(upper.value << 16 | lower.value));
    if scale > 0.0 { scale } else { 1.0 }
}

/// How many distances have each value of half of their bits.
struct Counts(Vec<u64>);

/// The value at some place, and how many are less.
struct Found {
    value: u32,
    before: u64,
}

impl Counts {
    /// Of the distances of all unordered pairs that have a value.
    fn new(
        transposed: &Transposed,
        distance: SetDistance,
        clouds: &Signatures,
        value: impl Fn(u32) -> Option<u32> + Sync,
    ) -> Self {
        let none = || (vec![0u64; 1 << 16], Vec::new());
        let count = |(mut counts, mut row): (Vec<u64>, Vec<[f32; LANES]>), cloud: usize| {
            let first = cloud / LANES;
            row.resize(clouds.clouds().div_ceil(LANES) - first, [0.0; LANES]);
            transposed.later(distance, first, clouds.get(cloud), &mut row);
            let later = &row.as_flattened()[cloud % LANES + 1..clouds.clouds() - first * LANES];
            for value in later.iter().filter_map(|distance| value(distance.to_bits())) {
                counts[value as usize] += 1;
            }
            (counts, row)
        };
        let counted = (0..clouds.clouds()).into_par_iter().fold(none, count).map(|(counts, _)| counts);
        let add = |mut all: Vec<u64>, more: Vec<u64>| {
            all.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
            all
        };
        Self(counted.reduce(|| none().0, add))
    }

    fn at(&self, place: u64) -> Found {
        let mut before = 0;
        let value = self.0.iter().position(|&count| {
            before += count;
            before > place
        });
        let value = value.unwrap_or(self.0.len() - 1);
        Found { value: value as u32, before: before - self.0[value] }
    }
}

/// Of distances, sorted, the one at index ⌊number/20⌋; `None` of none. Their order is lost.
pub(crate) fn quantile<T: Copy>(distances: &mut [T], order: impl FnMut(&T, &T) -> Ordering) -> Option<T> {
    let place = distances.len() / ONE_IN;
    (!distances.is_empty()).then(|| *distances.select_nth_unstable_by(place, order).1)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::signature::Signature;

    /// Of signatures, by their distances to each other.
    fn of(signatures: &[Signature], metric: SetDistance) -> f64 {
        let signatures: Signatures = signatures.iter().collect();
        scale(&DistanceMatrix::by(metric, &signatures, &signatures))
    }

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
                prop_assert_eq!(of(&signatures, metric), plain(&signatures, metric));
                let clouds: Signatures = signatures.iter().collect();
                for most in [0, usize::MAX] {
                    prop_assert_eq!(scale_within(most, metric, &clouds), plain(&signatures, metric));
                }
            }
        }
    }

    #[test]
    fn without_a_distance_it_is_1() {
        let signature = |value: f32| Signature { centroid: vec![value, 1.0 - value], deviation: Vec::new() };
        let of =
            |values: &[f32]| of(&values.iter().copied().map(signature).collect::<Vec<_>>(), SetDistance::L1);
        assert_eq!([of(&[]), of(&[0.5]), of(&[0.5, 0.5])], [1.0; 3]);
        assert_eq!(of(&[0.5, 0.75]), 0.5);
        // Of 21 pairs, the second shortest: six clouds alike would make it 0.
        assert_eq!(of(&[0.0, 0.125, 0.375, 0.75, 1.25, 2.0, 3.0]), 0.5);
    }
}
