//! χ², L1 and Hellinger distances of histograms, and matrices of them.

use std::borrow::Borrow;
use std::marker::PhantomData;

use pulp::NullaryFnOnce;
use rayon::prelude::*;

use crate::signature::{Signature, Signatures};
use crate::wide::widest;

/// Clouds of a database that are compared with a query at once.
pub(crate) const LANES: usize = 16;

/// Sums a + b below this count as this, so that two of them can be multiplied; what it changes in a term is less.
const LEAST: f32 = 1e-18;

/// How the centroids of two clouds are compared, and, added to that, their deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum SetDistance {
    /// [`chi_squared`], the paper's.
    #[default]
    ChiSquared,
    /// [`l1`].
    L1,
    /// [`hellinger`].
    Hellinger,
}

impl SetDistance {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::ChiSquared, Self::L1, Self::Hellinger];

    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::ChiSquared => "chi2",
            Self::L1 => "l1",
            Self::Hellinger => "hellinger",
        }
    }

    /// The set distance of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|distance| distance.name() == name)
    }
}

/// χ² distance Σ (a − b)² / (2(a + b)) of two histograms of equal length; a term with a + b = 0 is 0 (DESIGN 5.7).
///
/// In f32, in the order of the bins, two terms (of bins 2i and 2i + 1) over one denominator: matching is mostly
/// divisions.
///
/// # Panics
/// If the lengths differ: a programming error.
pub fn chi_squared(a: &[f32], b: &[f32]) -> f32 {
    sum_of::<ChiSquared>(a, b)
}

/// L1 distance Σ |a − b| of two histograms of equal length, in f32, in the order of the bins, two at once.
///
/// # Panics
/// If the lengths differ: a programming error.
pub fn l1(a: &[f32], b: &[f32]) -> f32 {
    sum_of::<L1>(a, b)
}

/// Squared Hellinger distance ½ Σ (√a − √b)² of two histograms of equal length, in f32, in the order of the bins, two at
/// once.
///
/// # Panics
/// If the lengths differ: a programming error.
pub fn hellinger(a: &[f32], b: &[f32]) -> f32 {
    sum_of::<Hellinger>(a, b)
}

/// What a distance is the sum of.
pub(crate) trait Terms {
    /// What the sum is multiplied by.
    const FACTOR: f32;

    /// The terms of two bins.
    fn of_two(a: [f32; 2], b: [f32; 2]) -> f32;
}

pub(crate) struct ChiSquared;

impl Terms for ChiSquared {
    const FACTOR: f32 = 0.5;

    #[inline(always)]
    fn of_two(a: [f32; 2], b: [f32; 2]) -> f32 {
        let (x, y) = (a[0] - b[0], a[1] - b[1]);
        let (s, t) = (at_least(a[0] + b[0]), at_least(a[1] + b[1]));
        (x * x * t + y * y * s) / (s * t)
    }
}

#[inline(always)]
fn at_least(sum: f32) -> f32 {
    if sum > LEAST { sum } else { LEAST }
}

pub(crate) struct L1;

impl Terms for L1 {
    const FACTOR: f32 = 1.0;

    #[inline(always)]
    fn of_two(a: [f32; 2], b: [f32; 2]) -> f32 {
        (a[0] - b[0]).abs() + (a[1] - b[1]).abs()
    }
}

pub(crate) struct Hellinger;

impl Terms for Hellinger {
    const FACTOR: f32 = 0.5;

    #[inline(always)]
    fn of_two(a: [f32; 2], b: [f32; 2]) -> f32 {
        let (x, y) = (a[0].sqrt() - b[0].sqrt(), a[1].sqrt() - b[1].sqrt());
        x * x + y * y
    }
}

fn sum_of<T: Terms>(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len(), "histograms of different channels");
    let (a, a_last) = a.as_chunks::<2>();
    let (b, b_last) = b.as_chunks::<2>();
    let pairs = a.iter().zip(b).fold(0.0, |sum, (&a, &b)| sum + T::of_two(a, b));
    match (a_last, b_last) {
        ([a], [b]) => T::FACTOR * (pairs + T::of_two([*a, 0.0], [*b, 0.0])),
        _ => T::FACTOR * pairs,
    }
}

impl Signature {
    /// χ² distance of the centroids plus that of the deviations.
    pub fn distance(&self, other: &Self) -> f32 {
        self.distance_by(SetDistance::ChiSquared, other)
    }

    /// Distance of the centroids plus that of the deviations.
    pub fn distance_by(&self, distance: SetDistance, other: &Self) -> f32 {
        let of_two = match distance {
            SetDistance::ChiSquared => chi_squared,
            SetDistance::L1 => l1,
            SetDistance::Hellinger => hellinger,
        };
        of_two(&self.centroid, &other.centroid) + of_two(&self.deviation, &other.deviation)
    }
}

/// One query's set distances to every cloud of the database: Σ weight · distance over the channels, in their order and
/// in f64. They replace what is in `sums`.
pub fn set_distances<M: Borrow<DistanceMatrix>>(channels: &[(M, f64)], query: usize, sums: &mut Vec<f64>) {
    sums.clear();
    let Some(((matrix, weight), others)) = channels.split_first() else { return };
    sums.extend(matrix.borrow().row(query).iter().map(|&distance| weight * f64::from(distance)));
    for (matrix, weight) in others {
        for (sum, &distance) in sums.iter_mut().zip(matrix.borrow().row(query)) {
            *sum += weight * f64::from(distance);
        }
    }
}

/// Distances of every query (row) to every cloud of the database (column).
#[derive(Clone, Debug, PartialEq)]
pub struct DistanceMatrix {
    columns: usize,
    values: Vec<f32>,
}

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
        let pairs = 2 * database.bins().div_ceil(2);
        let mut blocks = vec![[[0.0; LANES]; 2]; database.clouds().div_ceil(LANES) * pairs];
        for cloud in 0..database.clouds() {
            let block = &mut blocks[cloud / LANES * pairs..][..pairs];
            let (centroids, deviations) = block.split_at_mut(pairs / 2);
            for (part, values) in [centroids, deviations].into_iter().zip(database.get(cloud)) {
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

    fn distances_by<T: Terms>(&self, query: [&[f32]; 2], row: &mut [[f32; LANES]]) {
        self.distances_from::<T>(0, query, row);
    }

    /// As [`Transposed::distances_by`], to the clouds of block `first` and of later ones.
    fn distances_from<T: Terms>(
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
            let centroids = lanes::<T>(self.centroid, centroids);
            let deviations = lanes::<T>(self.deviation, deviations);
            for lane in 0..LANES {
                row[lane] = T::FACTOR * centroids[lane] + T::FACTOR * deviations[lane];
            }
        }
    }
}

/// Sums of the terms of one histogram and those of a block.
#[inline(always)]
fn lanes<T: Terms>(query: &[f32], block: &[[[f32; LANES]; 2]]) -> [f32; LANES] {
    let mut sums = [0.0f32; LANES];
    let (pairs, last) = query.as_chunks::<2>();
    let last = last.first().map(|&last| [last, 0.0]);
    for (a, b) in pairs.iter().chain(&last).zip(block) {
        for lane in 0..LANES {
            sums[lane] += T::of_two(*a, [b[0][lane], b[1][lane]]);
        }
    }
    sums
}

impl DistanceMatrix {
    /// The χ² distances in one channel, computed by the current rayon pool.
    ///
    /// # Panics
    /// If queries and database are of different channels: a programming error.
    pub fn new(queries: &Signatures, database: &Signatures) -> Self {
        Self::of_terms::<ChiSquared>(queries, database)
    }

    /// As [`DistanceMatrix::new`], with any set distance.
    pub fn by(distance: SetDistance, queries: &Signatures, database: &Signatures) -> Self {
        match distance {
            SetDistance::ChiSquared => Self::of_terms::<ChiSquared>(queries, database),
            SetDistance::L1 => Self::of_terms::<L1>(queries, database),
            SetDistance::Hellinger => Self::of_terms::<Hellinger>(queries, database),
        }
    }

    /// The distances of some clouds to the same clouds: as [`DistanceMatrix::by`] of them and themselves, to the bit, in
    /// half the time.
    pub fn among(distance: SetDistance, clouds: &Signatures) -> Self {
        match distance {
            SetDistance::ChiSquared => Self::among_of_terms::<ChiSquared>(clouds),
            SetDistance::L1 => Self::among_of_terms::<L1>(clouds),
            SetDistance::Hellinger => Self::among_of_terms::<Hellinger>(clouds),
        }
    }

    /// The terms of a pair are the same whichever cloud is the query, so that half of the distances are copies.
    fn among_of_terms<T: Terms>(clouds: &Signatures) -> Self {
        let columns = clouds.clouds();
        let transposed = Transposed::new(clouds);
        // Of each cloud those to the clouds of its own block and of later ones.
        let later = |query: usize| {
            let first = query / LANES;
            let mut row = vec![[0.0; LANES]; columns.div_ceil(LANES) - first];
            transposed.distances_from::<T>(first, clouds.get(query), &mut row);
            row
        };
        let later: Vec<Vec<[f32; LANES]>> = (0..columns).into_par_iter().map(later).collect();
        let mut values = vec![0.0; columns * columns];
        let blocks = values.par_chunks_mut((LANES * columns).max(1)).enumerate();
        blocks.for_each(|(block, rows)| {
            let first = block * LANES;
            for (lane, row) in rows.chunks_exact_mut(columns).enumerate() {
                let (before, rest) = row.split_at_mut(first);
                for (cloud, distance) in before.iter_mut().enumerate() {
                    *distance = later[cloud][block - cloud / LANES][lane];
                }
                let columns = rest.len();
                rest.copy_from_slice(&later[first + lane].as_flattened()[..columns]);
            }
        });
        Self { columns, values }
    }

    fn of_terms<T: Terms>(queries: &Signatures, database: &Signatures) -> Self {
        let (rows, columns) = (queries.clouds(), database.clouds());
        let mut values = vec![0.0; rows * columns];
        if rows > 0 && columns > 0 {
            assert_eq!(queries.bins(), database.bins(), "signatures of different channels");
            let transposed = Transposed::new(database);
            let blocks = columns.div_ceil(LANES);
            values.par_chunks_exact_mut(columns).enumerate().for_each_init(
                || vec![[0.0; LANES]; blocks],
                |row, (query, values)| {
                    transposed.distances_by::<T>(queries.get(query), row);
                    values.copy_from_slice(&row.as_flattened()[..columns]);
                },
            );
        }
        Self { columns, values }
    }

    /// One query's distances, by index of the database.
    pub fn row(&self, query: usize) -> &[f32] {
        &self.values[query * self.columns..(query + 1) * self.columns]
    }

    /// Number of clouds in the database.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Memory that the matrix takes, bytes.
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + size_of_val(self.values.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn plain(a: &[f32], b: &[f32]) -> f64 {
        let pairs = a.iter().zip(b).map(|(&a, &b)| (f64::from(a), f64::from(b)));
        pairs.filter(|(a, b)| a + b > 0.0).map(|(a, b)| (a - b) * (a - b) / (2.0 * (a + b))).sum()
    }

    /// Histograms of one length with many zeros.
    fn pair() -> impl Strategy<Value = Vec<(f32, f32)>> {
        let share = || prop_oneof![Just(0.0f32), 0.0f32..1.0, Just(f32::MIN_POSITIVE)];
        prop::collection::vec((share(), share()), 0..100)
    }

    proptest! {
        #[test]
        fn chi_squared_is_its_definition(pair in pair()) {
            let (a, b): (Vec<f32>, Vec<f32>) = pair.into_iter().unzip();
            let found = f64::from(chi_squared(&a, &b));
            prop_assert!((found - plain(&a, &b)).abs() <= 1e-5 * plain(&a, &b) + 1e-30);
            prop_assert_eq!(chi_squared(&a, &b).to_bits(), chi_squared(&b, &a).to_bits());
            prop_assert_eq!(chi_squared(&a, &a), 0.0);
        }

        #[test]
        fn hellinger_is_its_definition(pair in pair()) {
            let (a, b): (Vec<f32>, Vec<f32>) = pair.iter().copied().unzip();
            let terms = || pair.iter().map(|&(a, b)| f64::from(a).sqrt() - f64::from(b).sqrt());
            let plain = 0.5 * terms().map(|difference| difference * difference).sum::<f64>();
            let found = f64::from(hellinger(&a, &b));
            // The difference of two roots near 1 is exact to 1e-7 only.
            let rounding = 1e-5 * plain + 2e-7 * terms().map(f64::abs).sum::<f64>();
            prop_assert!((found - plain).abs() <= rounding + 1e-12, "{} instead of {}", found, plain);
            prop_assert_eq!(hellinger(&a, &b).to_bits(), hellinger(&b, &a).to_bits());
            prop_assert_eq!(hellinger(&a, &a), 0.0);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn distances_among_clouds_are_those_to_a_database_of_them(
            values in prop::collection::vec(prop::collection::vec(prop_oneof![Just(0.0f32), 0.0f32..1.0], 5), 0..70),
            bins in 0usize..=4,
        ) {
            let signature =
                |values: &Vec<f32>| Signature { centroid: values[..bins].to_vec(), deviation: values[1..=bins].to_vec() };
            let clouds: Vec<Signature> = values.iter().map(signature).collect();
            let clouds: Signatures = clouds.iter().collect();
            for distance in SetDistance::ALL {
                let expected = DistanceMatrix::by(distance, &clouds, &clouds);
                prop_assert_eq!(DistanceMatrix::among(distance, &clouds), expected);
            }
        }
    }

    #[test]
    fn disjoint_histograms_are_one_apart() {
        assert_eq!(chi_squared(&[0.5, 0.5, 0.0], &[0.0, 0.0, 1.0]), 1.0);
        assert_eq!(hellinger(&[0.25, 0.75, 0.0], &[0.0, 0.0, 1.0]), 1.0);
        assert_eq!(chi_squared(&[0.0; 40], &[0.0; 40]), 0.0);
        assert_eq!(chi_squared(&[], &[]), 0.0);
    }

    #[test]
    fn absolute_differences_add_up() {
        assert_eq!(l1(&[0.5, 0.25, 1.0], &[0.25, 0.5, 0.0]), 1.5);
        assert_eq!(l1(&[], &[]), 0.0);
    }

    #[test]
    fn the_matrix_holds_every_pair() {
        let signature =
            |values: [f32; 2]| Signature { centroid: values.to_vec(), deviation: vec![0.0, values[0]] };
        let (queries, database) = (
            [signature([0.1, 0.9]), signature([0.4, 0.6])],
            [signature([1.0, 0.0]), signature([0.4, 0.6]), signature([0.0, 1.0])],
        );
        let matrix = DistanceMatrix::new(&queries.iter().collect(), &database.iter().collect());
        for (row, query) in queries.iter().enumerate() {
            let expected: Vec<f32> = database.iter().map(|entry| query.distance(entry)).collect();
            assert_eq!(matrix.row(row), expected);
        }
        assert_eq!(matrix.row(1)[1], 0.0);
        for distance in SetDistance::ALL {
            let matrix = DistanceMatrix::by(distance, &queries.iter().collect(), &database.iter().collect());
            for (row, query) in queries.iter().enumerate() {
                let expected: Vec<f32> =
                    database.iter().map(|entry| query.distance_by(distance, entry)).collect();
                assert_eq!(matrix.row(row), expected, "{distance:?}");
            }
            assert_eq!(SetDistance::named(distance.name()), Some(distance));
        }
        let empty = DistanceMatrix::new(&queries.iter().collect(), &Signatures::default());
        assert_eq!((empty.columns(), empty.row(1)), (0, [].as_slice()));
    }
}
