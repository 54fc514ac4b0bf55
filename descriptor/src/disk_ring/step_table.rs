//! A fast step function: how many sorted thresholds a value exceeds.

/// Entries of the table; a power of two small enough for the first-level cache.
const BUCKETS: usize = 4096;

/// Sorted thresholds with a table over equal slices of their range.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct StepTable {
    thresholds: Vec<f32>,
    slices: Vec<Slice>,
    /// Whether no slice has more than one threshold.
    is_fine: bool,
    slicer: Slicer,
}

/// What is known of the values in one slice.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Slice {
    /// Number of thresholds in earlier slices.
    before: u32,
    /// The threshold after these, which no value of an earlier slice exceeds; infinite if there is none.
    next: f32,
}

/// Which slice of the thresholds' range a value lies in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Slicer {
    low: f32,
    slices_per_unit: f32,
}

impl Slicer {
    /// The slice; never decreases with its argument, however it rounds.
    #[inline(always)]
    pub(crate) fn slice(self, value: f32) -> u16 {
        // The comparisons map what is below the range to 0; above it, the last slice takes all.
        let slice = (value - self.low) * self.slices_per_unit;
        let slice = if slice > 0.0 { slice } else { 0.0 };
        let slice = if slice < (BUCKETS - 1) as f32 { slice } else { (BUCKETS - 1) as f32 };
        // Adding 2²³ leaves the nearest whole number in the lowest bits; a cast would ask about NaN and overflow.
        (slice + 8_388_608.0).to_bits() as u16
    }
}

impl StepTable {
    /// `thresholds` must be ascending and finite.
    pub(crate) fn new(thresholds: Vec<f32>) -> Self {
        let (low, high) = match (thresholds.first(), thresholds.last()) {
            (Some(&low), Some(&high)) => (low, high),
            _ => (0.0, 0.0),
        };
        let slices_per_unit = if high > low { BUCKETS as f32 / (high - low) } else { 0.0 };
        let slicer = Slicer { low, slices_per_unit };
        let slice_of = |threshold: &f32| usize::from(slicer.slice(*threshold));
        let slice = |slice: usize| {
            let before = thresholds.partition_point(|threshold| slice_of(threshold) < slice);
            Slice { before: before as u32, next: thresholds.get(before).copied().unwrap_or(f32::INFINITY) }
        };
        let slices = (0..BUCKETS).map(slice).collect();
        let is_fine = thresholds.windows(2).all(|pair| slice_of(&pair[0]) < slice_of(&pair[1]));
        Self { thresholds, slices, is_fine, slicer }
    }

    /// Number of thresholds below `value`.
    #[inline(always)]
    pub(crate) fn below(&self, value: f32) -> usize {
        self.below_in(self.slicer.slice(value), value)
    }

    /// Number of thresholds below `value`, which lies in `slice`.
    ///
    /// Exact for every value: as slices never decrease, thresholds of earlier slices are below the value and those of
    /// later slices are not; the rest is compared.
    #[inline(always)]
    pub(crate) fn below_in(&self, slice: u16, value: f32) -> usize {
        let Slice { before, next } = self.slices[usize::from(slice)];
        let mut count = before as usize + usize::from(next < value);
        if self.is_fine {
            return count;
        }
        while self.thresholds.get(count).is_some_and(|&threshold| threshold < value) {
            count += 1;
        }
        count
    }

    /// Fills a list with the numbers of thresholds below some values, whose slices are known, at these places.
    #[inline(always)]
    pub(crate) fn fill(&self, values: &[f32], slices: &[u16], places: &[u32], list: &mut Vec<u16>) {
        list.resize(places.len(), 0);
        let values = &values[..slices.len()];
        if let (true, Some(table)) = (self.is_fine, self.slices.first_chunk::<BUCKETS>()) {
            for (entry, &place) in list.iter_mut().zip(places) {
                let place = place as usize;
                let Slice { before, next } = table[usize::from(slices[place]) % BUCKETS];
                *entry = (before + u32::from(next < values[place])) as u16;
            }
            return;
        }
        for (entry, &place) in list.iter_mut().zip(places) {
            *entry = self.below_in(slices[place as usize], values[place as usize]) as u16;
        }
    }

    /// The thresholds, ascending.
    pub(crate) fn thresholds(&self) -> &[f32] {
        &self.thresholds
    }

    /// Finds slices.
    pub(crate) fn slicer(&self) -> Slicer {
        self.slicer
    }

    /// Number of thresholds.
    pub(crate) fn len(&self) -> usize {
        self.thresholds.len()
    }

    /// The largest threshold.
    pub(crate) fn last(&self) -> Option<f32> {
        self.thresholds.last().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::stream;
    use crate::testing::unit;

    fn check(thresholds: &[f32]) {
        let table = StepTable::new(thresholds.to_vec());
        let mut rng = stream(1, "values", &[]);
        let near = thresholds.iter().flat_map(|&t| [t.next_down(), t, t.next_up()]);
        let around = (0..5000).map(|_| unit(&mut rng) * 4.0 - 2.0);
        for value in near.chain(around).chain([f32::MIN, f32::MAX, 0.0, -0.0]) {
            let expected = thresholds.iter().filter(|&&threshold| threshold < value).count();
            assert_eq!(table.below(value), expected, "{value}");
        }
    }

    #[test]
    fn thresholds_are_counted_as_by_hand() {
        check(&[]);
        check(&[0.3]);
        check(&[0.3, 0.3, 0.3]);
        check(&[-1.0, 1.0]);
        check(&[1e-9, 2e-9, 0.5, 0.500_000_06, 1.5]);
        let mut rng = stream(1, "thresholds", &[]);
        let mut many: Vec<f32> = (0..9000).map(|_| unit(&mut rng) * unit(&mut rng) - 0.2).collect();
        many.sort_by(f32::total_cmp);
        check(&many);
    }
}
