//! Terms of a query and a few clouds out of many, whose values are gathered into lanes.

use std::marker::PhantomData;

use pulp::NullaryFnOnce;

use crate::distance::{ChiSquared, Hellinger, L1, LANES, SetDistance, Terms, add_terms};
use crate::wide::widest;

/// Values of a cloud that are gathered at once, an even number: so many terms lie between two looks at what they add up to.
pub(super) const CHUNK: usize = 64;

/// Adds the terms of some bins, at most [`CHUNK`], of a query and of a cloud in each lane: those of
/// [`DistanceMatrix`](crate::DistanceMatrix), to the bit, if the first bin of each part but the first has an even number.
pub(super) fn add_gathered(
    distance: SetDistance,
    query: &[f32],
    clouds: &[&[f32]; LANES],
    sums: &mut [f32; LANES],
) {
    match distance {
        SetDistance::ChiSquared => widest(Gathered { query, clouds, sums, terms: PhantomData::<ChiSquared> }),
        SetDistance::L1 => widest(Gathered { query, clouds, sums, terms: PhantomData::<L1> }),
        SetDistance::Hellinger => widest(Gathered { query, clouds, sums, terms: PhantomData::<Hellinger> }),
    }
}

/// What the sum of terms is multiplied by.
pub(super) fn factor(distance: SetDistance) -> f32 {
    match distance {
        SetDistance::ChiSquared => ChiSquared::FACTOR,
        SetDistance::L1 => L1::FACTOR,
        SetDistance::Hellinger => Hellinger::FACTOR,
    }
}

/// The kernel of [`add_gathered`].
struct Gathered<'a, T> {
    query: &'a [f32],
    clouds: &'a [&'a [f32]; LANES],
    sums: &'a mut [f32; LANES],
    terms: PhantomData<T>,
}

impl<T: Terms> NullaryFnOnce for Gathered<'_, T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { query, clouds, sums, terms: _ } = self;
        let mut block = [[[0.0; LANES]; 2]; CHUNK / 2];
        for (lane, values) in clouds.iter().enumerate() {
            let (pairs, last) = values.as_chunks::<2>();
            for (of_pair, values) in block.iter_mut().zip(pairs) {
                of_pair[0][lane] = values[0];
                of_pair[1][lane] = values[1];
            }
            if let (Some(of_last), [value]) = (block.get_mut(pairs.len()), last) {
                of_last[0][lane] = *value;
            }
        }
        add_terms::<T>(query, &block, sums);
    }
}
