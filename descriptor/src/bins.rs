//! Which bin each class falls into, and how many neighbours fall into each bin.

/// Bins up to which counts are kept in vectors, a byte each.
const LANES: usize = 64;

/// Most bins that any descriptor has in one histogram: m² for the largest m.
const MAX_BINS: usize = 1024;

/// Neighbours that are counted at once: a count that was just changed takes time until it can be changed again, and
/// half of the neighbours on a smooth surface fall into the same bin.
const TURNS: usize = 4;

/// Entries of a table: a few more than bins, as equal places of tables 4096 bytes apart pass for the same address until
/// late, and their counts wait for each other.
const TABLE: usize = MAX_BINS + 16;

/// The bin of every class, with an entry for every number that half a record can hold: no look-up can be out of bounds.
#[derive(Clone, Debug)]
pub(crate) struct BinOfClass {
    bins: Box<[u16; CLASSES]>,
    /// One a class, if there are few enough bins.
    units: Vec<Lanes>,
}

/// Numbers that half a record can hold.
const CLASSES: usize = 1 << 16;

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
        let mut bins = Box::new([0; CLASSES]);
        let mut classes = 0;
        for (entry, bin) in bins.iter_mut().zip(of_class) {
            *entry = bin;
            classes += 1;
        }
        let of_class = &bins[..classes];
        let is_narrow = of_class.iter().all(|&bin| usize::from(bin) < LANES);
        let units =
            if is_narrow { of_class.iter().map(|&bin| Lanes::unit(bin)).collect() } else { Vec::new() };
        Self { bins, units }
    }

    #[inline(always)]
    pub(crate) fn get(&self, class: u16) -> usize {
        usize::from(self.bins[usize::from(class)])
    }
}

/// Counts the neighbours of one region after the other.
pub(crate) enum Counter<'a> {
    /// In vectors, which needs no memory that would be read again at once.
    Lanes(&'a [Lanes]),
    /// In tables that neighbours are counted in by turns.
    Tables(&'a BinOfClass, Box<[[u32; TABLE]; TURNS]>),
}

impl<'a> Counter<'a> {
    pub(crate) fn new(bins: &'a BinOfClass) -> Self {
        if bins.units.is_empty() {
            Self::Tables(bins, Box::new([[0; TABLE]; TURNS]))
        } else {
            Self::Lanes(&bins.units)
        }
    }

    /// The share of each bin in neighbours of these classes; all zero if there are none.
    #[inline(always)]
    pub(crate) fn shares(&mut self, classes: &[u16], shares: &mut [f32]) {
        let divisor = classes.len().max(1) as f32;
        match self {
            Self::Lanes(units) => {
                let counts = count_in_lanes(classes, units);
                for (share, &count) in shares.iter_mut().zip(&counts) {
                    *share = count as f32 / divisor;
                }
            }
            Self::Tables(bins, tables) => {
                count_in_tables(classes, bins, tables);
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
fn count_in_lanes(classes: &[u16], units: &[Lanes]) -> [u32; LANES] {
    let mut counts = [0; LANES];
    // As many as no lane can overflow with.
    for classes in classes.chunks(TURNS * u8::MAX as usize) {
        let mut sums = [Lanes::default(); TURNS];
        let (groups, rest) = classes.as_chunks::<TURNS>();
        for group in groups {
            for turn in 0..TURNS {
                sums[turn].add(&units[usize::from(group[turn])]);
            }
        }
        for (sum, &class) in sums.iter_mut().zip(rest) {
            sum.add(&units[usize::from(class)]);
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
fn count_in_tables(classes: &[u16], bins: &BinOfClass, tables: &mut [[u32; TABLE]; TURNS]) {
    let (groups, rest) = classes.as_chunks::<TURNS>();
    for group in groups {
        for (table, &class) in tables.iter_mut().zip(group) {
            table[bins.get(class) % MAX_BINS] += 1;
        }
    }
    for &class in rest {
        tables[0][bins.get(class) % MAX_BINS] += 1;
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
        let mut counter = Counter::new(&table);
        assert_eq!(matches!(counter, Counter::Lanes(_)), of_class.iter().all(|&bin| bin < 64));
        for classes in regions {
            let mut found = vec![f32::NAN; bins];
            counter.shares(classes, &mut found);
            assert_eq!(found, shares(classes, of_class, bins), "{} neighbours", classes.len());
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
