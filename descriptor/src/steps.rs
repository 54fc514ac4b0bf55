//! A fast step function: how many sorted thresholds a value exceeds.

/// Entries of the table; a power of two small enough for the first-level cache.
const BUCKETS: usize = 4096;

/// Sorted thresholds with a table over equal slices of their range.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Steps {
    thresholds: Vec<f32>,
    /// For every slice the number of thresholds in the slices before it.
    before: Vec<u32>,
    low: f32,
    slices_per_unit: f32,
}

impl Steps {
    /// `thresholds` must be ascending and finite.
    pub(crate) fn new(thresholds: Vec<f32>) -> Self {
        let (low, high) = match (thresholds.first(), thresholds.last()) {
            (Some(&low), Some(&high)) => (low, high),
            _ => (0.0, 0.0),
        };
        let slices_per_unit = if high > low { BUCKETS as f32 / (high - low) } else { 0.0 };
        let mut steps = Self { thresholds, before: vec![0; BUCKETS], low, slices_per_unit };
        let mut position = 0;
        for slice in 0..BUCKETS {
            while position < steps.thresholds.len() && steps.slice(steps.thresholds[position]) < slice {
                position += 1;
            }
            steps.before[slice] = position as u32;
        }
        steps
    }

    /// Number of thresholds below `value`.
    ///
    /// Exact for every value: [`Steps::slice`] never decreases with its argument, however it rounds, so thresholds of
    /// earlier slices are below the value and those of later slices are not; the rest is compared.
    #[inline]
    pub(crate) fn below(&self, value: f32) -> usize {
        let mut count = self.before[self.slice(value)] as usize;
        while self.thresholds.get(count).is_some_and(|&threshold| threshold < value) {
            count += 1;
        }
        count
    }

    /// Number of thresholds.
    pub(crate) fn len(&self) -> usize {
        self.thresholds.len()
    }

    /// The largest threshold.
    pub(crate) fn last(&self) -> Option<f32> {
        self.thresholds.last().copied()
    }

    #[inline]
    fn slice(&self, value: f32) -> usize {
        // The cast maps what is below the range to 0; above it, the last slice takes all.
        (((value - self.low) * self.slices_per_unit) as i32).clamp(0, BUCKETS as i32 - 1) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::stream;
    use crate::testing::unit;

    fn check(thresholds: &[f32]) {
        let steps = Steps::new(thresholds.to_vec());
        let mut rng = stream(1, "values", &[]);
        let near = thresholds.iter().flat_map(|&t| [t.next_down(), t, t.next_up()]);
        let around = (0..5000).map(|_| unit(&mut rng) * 4.0 - 2.0);
        for value in near.chain(around).chain([f32::MIN, f32::MAX, 0.0, -0.0]) {
            let expected = thresholds.iter().filter(|&&threshold| threshold < value).count();
            assert_eq!(steps.below(value), expected, "{value}");
        }
    }

    #[test]
    fn steps_are_counted_as_by_hand() {
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
