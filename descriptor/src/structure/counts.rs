//! How many pairs of a row fall into each bin.

use pulp::Simd;

use crate::select::pack;
use crate::structure::block::{BLOCK, LANES};

/// Tables that codes are counted in by turns: a count that was just changed takes time until it can be changed again.
const TABLES: usize = 4;

/// The counts of one row.
pub(super) struct Counts {
    /// Bins of a row, which are followed by a place for what fills the last round up.
    bins: usize,
    /// Table after table.
    tables: Vec<u32>,
    /// Codes that the tables do not have yet, and how many they are.
    codes: [u32; LANES + BLOCK],
    waiting: usize,
    /// Codes that have been counted in the tables, and how many fit.
    counted: u64,
    room: u64,
    /// Sums over the tables.
    merged: Vec<u32>,
    /// What no longer fitted the tables; empty as long as everything does.
    totals: Vec<u64>,
}

impl Counts {
    /// For rows of so many bins.
    pub(super) fn new(bins: usize) -> Self {
        Self::with_room(bins, u64::from(u32::MAX))
    }

    fn with_room(bins: usize, room: u64) -> Self {
        Self {
            bins,
            tables: vec![0; TABLES * (bins + 1)],
            codes: [0; LANES + BLOCK],
            waiting: 0,
            counted: 0,
            room,
            merged: vec![0; bins],
            totals: Vec::new(),
        }
    }

    /// Counts the lanes that `are_counted`; their codes are bins.
    #[inline(always)]
    pub(super) fn add<S: Simd>(&mut self, simd: S, codes: S::u32s, are_counted: S::m32s) {
        let places = &mut self.codes[self.waiting..self.waiting + S::U32_LANES];
        self.waiting += pack(simd, codes, are_counted, places);
        if self.waiting >= LANES {
            self.count_waiting(LANES);
            self.codes.copy_within(LANES.., 0);
            self.waiting -= LANES;
        }
    }

    /// Counts the first codes that wait, a multiple of [`TABLES`].
    #[inline(always)]
    fn count_waiting(&mut self, codes: usize) {
        if self.counted + codes as u64 > self.room {
            self.empty_tables();
        }
        self.counted += codes as u64;
        count(&mut self.tables, &self.codes[..codes]);
    }

    /// Moves what the tables hold to the totals.
    #[cold]
    fn empty_tables(&mut self) {
        self.totals.resize(self.bins, 0);
        self.merge();
        for (total, &count) in self.totals.iter_mut().zip(&self.merged) {
            *total += u64::from(count);
        }
    }

    /// Counts what waits.
    #[inline(always)]
    fn count_rest(&mut self) {
        let rounds = self.waiting.next_multiple_of(TABLES);
        self.codes[self.waiting..rounds].fill(self.bins as u32);
        self.count_waiting(rounds);
        self.waiting = 0;
    }

    /// Sums the tables up and empties them.
    #[inline(always)]
    fn merge(&mut self) {
        self.merged.fill(0);
        for table in self.tables.chunks_exact_mut(self.bins + 1) {
            for (sum, count) in self.merged.iter_mut().zip(table) {
                *sum += std::mem::take(count);
            }
        }
        self.counted = 0;
    }

    /// Ends a row: appends the share of each bin in the pairs of its shell, zeros in an empty one. A shell has
    /// `shell_bins` bins, of which the first `histogram_bins` count each pair once.
    #[inline(always)]
    pub(super) fn take_shares(&mut self, shell_bins: usize, histogram_bins: usize, rows: &mut Vec<f32>) {
        self.count_rest();
        if self.totals.is_empty() {
            self.merge();
            shares(&self.merged, shell_bins, histogram_bins, rows);
        } else {
            let counts = self.take();
            shares(&counts, shell_bins, histogram_bins, rows);
        }
    }

    /// Ends a row with its counts.
    pub(super) fn take(&mut self) -> Vec<u64> {
        self.count_rest();
        self.empty_tables();
        std::mem::take(&mut self.totals)
    }
}

/// Counts codes in the tables by turns. A function of its own, in which all addresses fit the registers.
#[inline(never)]
fn count(tables: &mut [u32], codes: &[u32]) {
    let length = tables.len() / TABLES;
    let (a, tables) = tables.split_at_mut(length);
    let (b, tables) = tables.split_at_mut(length);
    let (c, tables) = tables.split_at_mut(length);
    let d = &mut tables[..length];
    for &codes in codes.as_chunks::<TABLES>().0 {
        let codes = codes.map(|code| code as usize);
        a[codes[0]] += 1;
        b[codes[1]] += 1;
        c[codes[2]] += 1;
        d[codes[3]] += 1;
    }
}

#[inline(always)]
fn shares<C: Copy + Into<u64>>(counts: &[C], shell_bins: usize, histogram_bins: usize, rows: &mut Vec<f32>) {
    let start = rows.len();
    rows.resize(start + counts.len(), 0.0);
    let shells = counts.chunks_exact(shell_bins).zip(rows[start..].chunks_exact_mut(shell_bins));
    for (counts, shares) in shells {
        let pairs: u64 = counts[..histogram_bins].iter().map(|&count| count.into()).sum();
        let divisor = pairs.max(1) as f32;
        for (share, &count) in shares.iter_mut().zip(counts) {
            *share = count.into() as f32 / divisor;
        }
    }
}

#[cfg(test)]
mod tests {
    use pulp::Scalar512b;

    use super::*;

    #[test]
    fn counts_that_do_not_fit_the_tables_are_kept() {
        let simd = Scalar512b;
        let (mut wide, mut narrow) = (Counts::new(6), Counts::with_room(6, 2 * LANES as u64));
        let mut expected = vec![0; 6];
        for row in 1..4u32 {
            // A vector keeps 12 or 13 of its 16 lanes, so that codes are left over where a group is counted.
            for vector in 0..20 * row {
                let pair: [u32; BLOCK] = std::array::from_fn(|lane| vector * BLOCK as u32 + lane as u32);
                let (codes, is_counted) =
                    (pair.map(|pair| pair % 67 % 6), pair.map(|pair| u32::from(pair % 5 != 3)));
                for (code, is_counted) in codes.into_iter().zip(is_counted) {
                    expected[code as usize] += u64::from(is_counted);
                }
                let mask = simd.equal_u32s(pulp::cast(is_counted), simd.splat_u32s(1));
                for counts in [&mut wide, &mut narrow] {
                    counts.add(simd, pulp::cast(codes), mask);
                }
            }
            assert!(wide.totals.is_empty() && !narrow.totals.is_empty());
            let [mut all, mut parts] = [Vec::new(), Vec::new()];
            if row == 2 {
                assert_eq!([wide.take(), narrow.take()], [expected.clone(), expected.clone()]);
            } else {
                wide.take_shares(3, 2, &mut all);
                narrow.take_shares(3, 2, &mut parts);
                assert_eq!(all, parts);
                let pairs = |shell: usize| (expected[shell] + expected[shell + 1]) as f32;
                let of_shell = |bin: usize| expected[bin] as f32 / pairs(bin / 3 * 3);
                assert_eq!(all, (0..6).map(of_shell).collect::<Vec<f32>>());
            }
            expected.fill(0);
        }
        wide.take_shares(3, 3, &mut Vec::new());
        let mut empty = Vec::new();
        wide.take_shares(3, 3, &mut empty);
        assert_eq!(empty, [0.0; 6]);
    }
}
