//! What the distances of a channel are divided by, so that those of different channels can be added up.

use std::cmp::Ordering;

use crate::distance::DistanceMatrix;

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

/// Of distances, sorted, the one at index ⌊number/20⌋; `None` of none. Their order is lost.
pub(crate) fn quantile<T: Copy>(distances: &mut [T], order: impl FnMut(&T, &T) -> Ordering) -> Option<T> {
    let place = distances.len() / ONE_IN;
    (!distances.is_empty()).then(|| *distances.select_nth_unstable_by(place, order).1)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::distance::SetDistance;
    use crate::signature::{Signature, Signatures};

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
