//! A database laid out so that one query is compared with several of its clouds at once.

use std::marker::PhantomData;

use pulp::NullaryFnOnce;

use crate::set_distance::{ChiSquared, Hellinger, L1, SetDistance, Terms};
use crate::signature::Signatures;
use crate::wide::widest;

/// Clouds of a database that are compared with a query at once.
pub(crate) const LANES: usize = 16;

/// Sums over the first bins of one query and of [`LANES`] clouds: those of centroids, those of deviations.
pub(crate) type Sums = [[f32; LANES]; 2];

/// A database transposed so that a bin of [`LANES`] clouds lies in one vector.
pub(crate) struct Transposed {
    /// Pairs of bins of one cloud.
    pairs: usize,
    /// Block after block of [`LANES`] clouds (the last filled up with zeros), in each pair after pair of bins: those
    /// of the centroids, then those of the deviations.
    blocks: Vec<[[f32; LANES]; 2]>,
}

impl Transposed {
    /// Transposes the signatures of a database.
    pub(crate) fn new(database: &Signatures) -> Self {
        Self::of(database.bins(), (0..database.clouds()).map(|cloud| database.get(cloud)))
    }

    /// Transposes the centroids and deviations of clouds.
    pub(crate) fn of<'a>(bins: usize, database: impl ExactSizeIterator<Item = [&'a [f32]; 2]>) -> Self {
        let pairs = 2 * bins.div_ceil(2);
        let mut blocks = vec![[[0.0; LANES]; 2]; database.len().div_ceil(LANES) * pairs];
        for (cloud, parts) in database.enumerate() {
            let block = &mut blocks[cloud / LANES * pairs..][..pairs];
            let (centroids, deviations) = block.split_at_mut(pairs / 2);
            for (part, values) in [centroids, deviations].into_iter().zip(parts) {
                for (bin, &value) in values.iter().enumerate() {
                    part[bin / 2][bin % 2][cloud % LANES] = value;
                }
            }
        }
        Self { pairs, blocks }
    }

    /// The signatures again; lengths are those of a centroid and of a deviation.
    pub(crate) fn signatures(&self, clouds: usize, [bins, deviation]: [usize; 2]) -> Signatures {
        let mut values = Vec::with_capacity(clouds * (bins + deviation));
        for cloud in 0..clouds {
            let block = &self.blocks[cloud / LANES * self.pairs..][..self.pairs];
            for (part, length) in block.chunks_exact((self.pairs / 2).max(1)).zip([bins, deviation]) {
                values.extend((0..length).map(|bin| part[bin / 2][bin % 2][cloud % LANES]));
            }
        }
        Signatures { bins, width: bins + deviation, clouds, values, keypoints: Vec::new() }
    }

    /// One query's χ² distances to every cloud; `row` has room for the whole blocks.
    pub(crate) fn distances(&self, query: [&[f32]; 2], row: &mut [[f32; LANES]]) {
        self.distances_by::<ChiSquared>(query, row);
    }

    /// What [`Transposed::distances_after`] starts from: the sums of χ² over the first `before` pairs of bins, of one query
    /// and every cloud; `sums` has room for the whole blocks.
    pub(crate) fn first_sums(&self, before: usize, [centroid, deviation]: [&[f32]; 2], sums: &mut [Sums]) {
        if self.pairs > 0 {
            let of_query = [&centroid[..2 * before], &deviation[..2 * before]];
            widest(FirstSums { pairs: self.pairs / 2, blocks: &self.blocks, of_query, sums });
        }
    }

    /// As [`Transposed::distances`], to the bit, from the sums over the first `before` pairs of bins.
    pub(crate) fn distances_after(
        &self,
        before: usize,
        sums: &[Sums],
        [centroid, deviation]: [&[f32]; 2],
        row: &mut [[f32; LANES]],
    ) {
        if self.pairs == 0 {
            row.fill([0.0; LANES]);
            return;
        }
        let of_query = [&centroid[2 * before..], &deviation[2 * before..]];
        widest(LaterDistances { before, pairs: self.pairs / 2, blocks: &self.blocks, sums, of_query, row });
    }

    /// As [`Transposed::distances`], by any set distance.
    pub(crate) fn by(&self, distance: SetDistance, query: [&[f32]; 2], row: &mut [[f32; LANES]]) {
        self.later(distance, 0, query, row);
    }

    /// As [`Transposed::by`], to the clouds of block `first` and of later ones.
    pub(crate) fn later(
        &self,
        distance: SetDistance,
        first: usize,
        query: [&[f32]; 2],
        row: &mut [[f32; LANES]],
    ) {
        match distance {
            SetDistance::ChiSquared => self.distances_from::<ChiSquared>(first, query, row),
            SetDistance::L1 => self.distances_from::<L1>(first, query, row),
            SetDistance::Hellinger => self.distances_from::<Hellinger>(first, query, row),
        }
    }

    pub(crate) fn distances_by<T: Terms>(&self, query: [&[f32]; 2], row: &mut [[f32; LANES]]) {
        self.distances_from::<T>(0, query, row);
    }

    /// As [`Transposed::distances_by`], to the clouds of block `first` and of later ones.
    pub(crate) fn distances_from<T: Terms>(
        &self,
        first: usize,
        [centroid, deviation]: [&[f32]; 2],
        row: &mut [[f32; LANES]],
    ) {
        if self.pairs == 0 {
            row.fill([0.0; LANES]);
            return;
        }
        let (pairs, blocks, terms) = (self.pairs / 2, &self.blocks[first * self.pairs..], PhantomData::<T>);
        widest(Distances { pairs, blocks, centroid, deviation, row, terms });
    }
}

/// The kernel of [`Transposed::distances_by`]: each lane is the distance of centroids plus that of deviations.
struct Distances<'a, T> {
    pairs: usize,
    blocks: &'a [[[f32; LANES]; 2]],
    centroid: &'a [f32],
    deviation: &'a [f32],
    row: &'a mut [[f32; LANES]],
    terms: PhantomData<T>,
}

impl<T: Terms> NullaryFnOnce for Distances<'_, T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (block, row) in self.blocks.chunks_exact(2 * self.pairs).zip(self.row) {
            let (centroids, deviations) = block.split_at(self.pairs);
            let centroids = add::<T>([0.0; LANES], self.centroid, centroids);
            let deviations = add::<T>([0.0; LANES], self.deviation, deviations);
            *row = of_parts::<T>(centroids, deviations);
        }
    }
}

/// The kernel of [`Transposed::first_sums`].
struct FirstSums<'a> {
    pairs: usize,
    blocks: &'a [[[f32; LANES]; 2]],
    of_query: [&'a [f32]; 2],
    sums: &'a mut [Sums],
}

impl NullaryFnOnce for FirstSums<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let [centroid, deviation] = self.of_query;
        for (block, sums) in self.blocks.chunks_exact(2 * self.pairs).zip(self.sums) {
            let (centroids, deviations) = block.split_at(self.pairs);
            sums[0] = add::<ChiSquared>([0.0; LANES], centroid, centroids);
            sums[1] = add::<ChiSquared>([0.0; LANES], deviation, deviations);
        }
    }
}

/// The kernel of [`Transposed::distances_after`].
struct LaterDistances<'a> {
    /// Pairs of bins that the sums have.
    before: usize,
    pairs: usize,
    blocks: &'a [[[f32; LANES]; 2]],
    sums: &'a [Sums],
    /// The query's centroid and deviation, from the first bin after those on.
    of_query: [&'a [f32]; 2],
    row: &'a mut [[f32; LANES]],
}

impl NullaryFnOnce for LaterDistances<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let [centroid, deviation] = self.of_query;
        for ((block, sums), row) in self.blocks.chunks_exact(2 * self.pairs).zip(self.sums).zip(self.row) {
            let (centroids, deviations) = block.split_at(self.pairs);
            let centroids = add::<ChiSquared>(sums[0], centroid, &centroids[self.before..]);
            let deviations = add::<ChiSquared>(sums[1], deviation, &deviations[self.before..]);
            *row = of_parts::<ChiSquared>(centroids, deviations);
        }
    }
}

/// The distances of centroids plus those of deviations.
#[inline(always)]
fn of_parts<T: Terms>(centroids: [f32; LANES], deviations: [f32; LANES]) -> [f32; LANES] {
    let mut distances = [0.0; LANES];
    for lane in 0..LANES {
        distances[lane] = T::FACTOR * centroids[lane] + T::FACTOR * deviations[lane];
    }
    distances
}

/// Adds the terms of one histogram and those of a block.
#[inline(always)]
fn add<T: Terms>(mut sums: [f32; LANES], query: &[f32], block: &[[[f32; LANES]; 2]]) -> [f32; LANES] {
    let (pairs, last) = query.as_chunks::<2>();
    let last = last.first().map(|&last| [last, 0.0]);
    for (a, b) in pairs.iter().chain(&last).zip(block) {
        for lane in 0..LANES {
            sums[lane] += T::of_two(*a, [b[0][lane], b[1][lane]]);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::signature::Signature;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn a_distance_in_two_parts_is_the_distance(
            values in prop::collection::vec(prop::collection::vec(prop_oneof![Just(0.0f32), 0.0f32..1.0], 10), 1..40),
            bins in 0usize..=9,
            first in 0usize..=4,
        ) {
            let signature =
                |values: &Vec<f32>| Signature { centroid: values[..bins].to_vec(), deviation: values[1..=bins].to_vec() };
            let clouds: Vec<Signature> = values.iter().map(signature).collect();
            let (query, first) = ([&clouds[0].centroid[..], &clouds[0].deviation], first.min(bins / 2));
            let database = Transposed::new(&clouds.iter().collect());
            let blocks = clouds.len().div_ceil(LANES);
            let [mut expected, mut found] = [const { Vec::new() }; 2];
            expected.resize(blocks, [0.0; LANES]);
            found.resize(blocks, [f32::NAN; LANES]);
            database.distances(query, &mut expected);
            let mut sums = vec![[[0.0; LANES]; 2]; blocks];
            database.first_sums(first, query, &mut sums);
            database.distances_after(first, &sums, query, &mut found);
            prop_assert_eq!(&found, &expected);
            let plain: Vec<f32> = clouds.iter().map(|cloud| clouds[0].distance(cloud)).collect();
            prop_assert_eq!(&found.as_flattened()[..clouds.len()], &plain);
        }
    }
}
