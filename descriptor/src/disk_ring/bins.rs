//! Which bin each class falls into, and how many neighbours fall into each bin.

use std::borrow::Cow;

use crate::GENES;

/// Bins up to which counts are kept in vectors, a byte each.
const LANES: usize = 64;

/// Most bins that any descriptor has in one histogram: m² for the largest m.
const MAX_BINS: usize = 1024;
const _: () = {
    let [shape_bins, colour_bins] = [GENES[0].limits.1 as usize, GENES[1].limits.1 as usize];
    assert!(shape_bins <= MAX_BINS && colour_bins * colour_bins <= MAX_BINS);
};

/// Consecutive neighbours that are counted independently of each other: a count that was just changed takes time until it can be changed again, and
/// half of the neighbours on a smooth surface fall into the same bin.
const INTERLEAVED: usize = 4;

/// Entries of a table: a few more than bins, as equal positions of tables 4096 bytes apart pass for the same address until
/// late, and their counts wait for each other.
const TABLE: usize = MAX_BINS + 16;

/// The bin of every class.
#[derive(Clone, Debug)]
pub(crate) struct BinOfClass {
    bins: Vec<u16>,
    /// As many, if there are few enough bins.
    units: Vec<Lanes>,
}

/// [`LANES`] counts of a byte, eight in each word: adding words adds their bytes as long as none exceeds 255. Aligned to
/// the line of a cache, so that no load needs two.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(crate) struct Lanes([u64; LANES / 8]);

impl Lanes {
    /// A one in the lane of one bin.
    fn unit(bin: u16) -> Self {
        let mut lanes = Self::default();
        lanes.0[usize::from(bin) / 8] = 1 << (bin % 8 * 8);
        lanes
    }

    /// By index, as is what calls it: through iterators the sums would stay in memory.
    #[inline(always)]
    fn add(&mut self, other: &Self) {
        for word in 0..LANES / 8 {
            self.0[word] = self.0[word].wrapping_add(other.0[word]);
        }
    }

    #[inline(always)]
    fn bytes(self) -> [[u8; 8]; LANES / 8] {
        self.0.map(u64::to_le_bytes)
    }
}

impl BinOfClass {
    /// From the bin of each class.
    pub(crate) fn new(of_class: impl IntoIterator<Item = u16>) -> Self {
        let bins: Vec<u16> = of_class.into_iter().collect();
        let is_narrow = bins.iter().all(|&bin| usize::from(bin) < LANES);
        let units = if is_narrow { bins.iter().map(|&bin| Lanes::unit(bin)).collect() } else { Vec::new() };
        Self { bins, units }
    }

    pub(crate) fn get(&self, class: u16) -> usize {
        usize::from(self.bins[usize::from(class)])
    }

    /// The first class that is not of a lower bin, if bins ascend with their classes.
    pub(crate) fn first(&self, bin: usize) -> u16 {
        self.bins.partition_point(|&of_class| usize::from(of_class) < bin) as u16
    }
}

/// Counts the neighbours of one region after the other.
pub(crate) enum Counter<'a> {
    /// In vectors, which needs no memory that would be read again at once.
    Lanes(Cow<'a, [Lanes]>),
    /// In tables that take consecutive neighbours in rotation.
    Tables(Cow<'a, [u16]>, Box<[[u32; TABLE]; INTERLEAVED]>),
}

impl<'a> Counter<'a> {
    /// For codes that are positions in a list of classes, or, without one, classes.
    pub(crate) fn new(bins: &'a BinOfClass, listed: Option<&[u16]>) -> Self {
        fn of_codes<'a, T: Clone>(of_classes: &'a [T], listed: Option<&[u16]>) -> Cow<'a, [T]> {
            let Some(listed) = listed else { return Cow::Borrowed(of_classes) };
            listed.iter().map(|&class| of_classes[usize::from(class)].clone()).collect()
        }
        if bins.units.is_empty() {
            Self::Tables(of_codes(&bins.bins, listed), Box::new([[0; TABLE]; INTERLEAVED]))
        } else {
            Self::Lanes(of_codes(&bins.units, listed))
        }
    }

    /// The share of each bin in neighbours of these codes; all zero if there are none.
    #[inline(always)]
    pub(crate) fn shares<C: Copy + Into<usize>>(&mut self, codes: &[C], shares: &mut [f32]) {
        let divisor = codes.len().max(1) as f32;
        match self {
            Self::Lanes(units) => {
                let counts = count_in_lanes(codes, units);
                let (counted, empty) = shares.split_at_mut(shares.len().min(LANES));
                for (share, &count) in counted.iter_mut().zip(&counts) {
                    *share = count as f32 / divisor;
                }
                empty.fill(0.0);
            }
            Self::Tables(bins, tables) => {
                count_in_tables(codes, bins, tables);
                for (bin, share) in shares.iter_mut().enumerate() {
                    let mut count = 0;
                    for table in tables.iter_mut() {
                        count += std::mem::take(&mut table[bin % MAX_BINS]);
                    }
                    *share = count as f32 / divisor;
                }
            }
        }
    }
}

#[inline(always)]
fn count_in_lanes<C: Copy + Into<usize>>(codes: &[C], units: &[Lanes]) -> [u32; LANES] {
    let mut counts = [0; LANES];
    // As many as no lane can overflow with.
    for codes in codes.chunks(INTERLEAVED * u8::MAX as usize) {
        let mut sums = [Lanes::default(); INTERLEAVED];
        let (groups, rest) = codes.as_chunks::<INTERLEAVED>();
        for group in groups {
            for way in 0..INTERLEAVED {
                sums[way].add(&units[group[way].into()]);
            }
        }
        for (sum, &code) in sums.iter_mut().zip(rest) {
            sum.add(&units[code.into()]);
        }
        for sum in sums {
            for (count, &byte) in counts.iter_mut().zip(sum.bytes().as_flattened()) {
                *count += u32::from(byte);
            }
        }
    }
    counts
}

#[inline(always)]
fn count_in_tables<C: Copy + Into<usize>>(
    codes: &[C],
    bins: &[u16],
    tables: &mut [[u32; TABLE]; INTERLEAVED],
) {
    let bin = |code: C| usize::from(bins[code.into()]) % MAX_BINS;
    let (groups, rest) = codes.as_chunks::<INTERLEAVED>();
    for group in groups {
        for (table, &code) in tables.iter_mut().zip(group) {
            table[bin(code)] += 1;
        }
    }
    for &code in rest {
        tables[0][bin(code)] += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Shares by the definition: the bins of all classes, one after the other.
    fn shares(classes: &[u16], of_class: &[u16], bins: usize) -> Vec<f32> {
        let mut counts = vec![0u32; bins];
        for &class in classes {
            counts[usize::from(of_class[usize::from(class)])] += 1;
        }
        counts.iter().map(|&count| count as f32 / classes.len().max(1) as f32).collect()
    }

    fn check(regions: &[Vec<u16>], of_class: &[u16], bins: usize) {
        let table = BinOfClass::new(of_class.iter().copied());
        let listed: Vec<u16> = (0..of_class.len().min(256) as u16).rev().collect();
        let mut by_class = Counter::new(&table, None);
        let mut by_place = Counter::new(&table, Some(&listed));
        let is_narrow = of_class.iter().all(|&bin| bin < 64);
        assert!([&by_class, &by_place].iter().all(|way| matches!(way, Counter::Lanes(_)) == is_narrow));
        for classes in regions {
            let expected = shares(classes, of_class, bins);
            let mut found = vec![f32::NAN; bins];
            by_class.shares(classes, &mut found);
            assert_eq!(found, expected, "{} neighbours", classes.len());
            let position = |&class: &u16| {
                listed.len().checked_sub(1 + usize::from(class)).map(|position| position as u8)
            };
            if let Some(positions) = classes.iter().map(position).collect::<Option<Vec<u8>>>() {
                by_place.shares(&positions, &mut found);
                assert_eq!(found, expected, "{} neighbours by position", classes.len());
            }
        }
    }

    #[test]
    fn neighbours_that_are_all_alike_overflow_no_count() {
        for bins in [1, 2, 64, 65, 1024u16] {
            let of_class: Vec<u16> = (0..bins).collect();
            let regions: Vec<Vec<u16>> =
                (0..12).chain(1000..1040).chain([4093, 70_000]).map(|count| vec![bins - 1; count]).collect();
            check(&regions, &of_class, usize::from(bins));
        }
    }

    #[test]
    fn bins_that_no_class_falls_into_are_empty() {
        check(&[vec![0, 1, 1, 0, 1], Vec::new()], &[3, 1], 1000);
    }

    proptest! {
        #[test]
        fn shares_are_the_definition(
            (bins, of_class) in (1u16..130).prop_flat_map(|bins| (Just(bins), prop::collection::vec(0..bins, 1..700))),
            regions in prop::collection::vec(prop::collection::vec(any::<prop::sample::Index>(), 0..1500), 1..4),
        ) {
            let class = |index: &prop::sample::Index| index.index(of_class.len()) as u16;
            let regions: Vec<Vec<u16>> =
                regions.iter().map(|region| region.iter().map(class).collect()).collect();
            check(&regions, &of_class, usize::from(bins));
        }
    }
}
