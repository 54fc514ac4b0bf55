//! Terms of a query and a few clouds out of many, wherever they lie in the database.

use std::marker::PhantomData;

use pulp::NullaryFnOnce;

use crate::set_distance::{ChiSquared, Hellinger, L1, SetDistance, Terms};
use crate::wide::widest;

/// Clouds that are compared with a query at once: so many sums wait for their next term together.
pub(super) const ROWS: usize = 8;

/// Values of a cloud that are compared at once, an even number: so many terms lie between two looks at what they add up to.
pub(super) const CHUNK: usize = 64;

/// Adds the terms of some bins, at most [`CHUNK`], of a query and of some clouds: those of
/// [`DistanceMatrix`](crate::DistanceMatrix), to the bit, if all parts of a histogram but the last have [`CHUNK`] bins.
pub(super) fn add_gathered(
    distance: SetDistance,
    query: &[f32],
    clouds: &[&[f32]; ROWS],
    sums: &mut [f32; ROWS],
) {
    match distance {
        SetDistance::ChiSquared => {
            widest(Gathered { query, clouds, sums, terms: PhantomData::<ChiSquared> });
        }
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

/// The kernel of [`add_gathered`]: terms of one cloud after the other in vectors along the bins, then all sums in the order
/// of the bins.
struct Gathered<'a, T> {
    query: &'a [f32],
    clouds: &'a [&'a [f32]; ROWS],
    sums: &'a mut [f32; ROWS],
    terms: PhantomData<T>,
}

impl<T: Terms> NullaryFnOnce for Gathered<'_, T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let mut terms = [[0.0; CHUNK / 2]; ROWS];
        let (pairs, last) = self.query.as_chunks::<2>();
        for (terms, cloud) in terms.iter_mut().zip(self.clouds) {
            let (of_cloud, last_of_cloud) = cloud.as_chunks::<2>();
            for ((term, a), b) in terms.iter_mut().zip(pairs).zip(of_cloud) {
                *term = T::of_two(*a, *b);
            }
            if let ([a], [b]) = (last, last_of_cloud) {
                terms[pairs.len()] = T::of_two([*a, 0.0], [*b, 0.0]);
            }
        }
        let mut sums = *self.sums;
        for pair in 0..self.query.len().div_ceil(2).min(CHUNK / 2) {
            for (sum, terms) in sums.iter_mut().zip(&terms) {
                *sum += terms[pair];
            }
        }
        *self.sums = sums;
    }
}
