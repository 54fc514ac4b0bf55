//! Numbers of pairs by code, and what they are by bin.

use super::codes::{BINS, CODES, SIZE, bins};

/// Tables that pairs in turn are counted in: a count that was just stored takes time until it can be loaded again.
const TABLES: usize = 2;

/// Codes that are looked at together, as most have no pair.
const SCANNED: usize = 16;

/// Entries of a table: a power of two, so that no index needs a check, and some more, as equal places of tables a
/// multiple of 4096 bytes apart pass for the same address until late.
const TABLE: usize = 16_384;

/// Pairs by code.
type Table = [u32; TABLE + 16];

/// The counts of one region.
pub(super) struct Counts {
    angles: Box<[Table; TABLES]>,
    colours: Box<[Table; TABLES]>,
}

impl Default for Counts {
    fn default() -> Self {
        let tables = || Box::new([[0; TABLE + 16]; TABLES]);
        Self { angles: tables(), colours: tables() }
    }
}

impl Counts {
    /// Counts the pairs of one point with others, by the codes of its row and their places there.
    ///
    /// No table overflows before 2³² pairs; a block has a few million, or those of one point.
    #[inline]
    pub(super) fn add(&mut self, row: &[u32], others: &[u32]) {
        let (groups, rest) = others.as_chunks::<TABLES>();
        for group in groups {
            for (table, &other) in group.iter().enumerate() {
                self.count(table, row[other as usize]);
            }
        }
        for &other in rest {
            self.count(0, row[other as usize]);
        }
    }

    /// Counts pairs by their codes. To look each up by its place, as [`Counts::add`] does, takes longer.
    #[inline]
    pub(super) fn add_all(&mut self, codes: &[u32]) {
        let (groups, rest) = codes.as_chunks::<TABLES>();
        for group in groups {
            for (table, &code) in group.iter().enumerate() {
                self.count(table, code);
            }
        }
        for &code in rest {
            self.count(0, code);
        }
    }

    #[inline(always)]
    fn count(&mut self, table: usize, code: u32) {
        self.angles[table][code as usize % TABLE] += 1;
        self.colours[table][(code >> 16) as usize % TABLE] += 1;
    }

    /// Adds what was counted to ordered pairs by bin; empties the tables.
    pub(super) fn move_to(&mut self, totals: &mut [u64; SIZE]) {
        for (tables, totals) in
            [&mut self.angles, &mut self.colours].into_iter().zip(totals.chunks_exact_mut(BINS))
        {
            // Up to the code of pairs that do not count, whose counts have to be emptied, too.
            let [one, other] = tables.each_mut().map(|table| table.as_chunks_mut::<SCANNED>().0);
            for (first, (one, other)) in (0..=CODES).step_by(SCANNED).zip(one.iter_mut().zip(other)) {
                let mut counts = [0; SCANNED];
                for ((count, one), other) in counts.iter_mut().zip(&*one).zip(&*other) {
                    *count = one + other;
                }
                if counts.iter().fold(0, |any, count| any | count) == 0 {
                    continue;
                }
                (*one, *other) = ([0; SCANNED], [0; SCANNED]);
                for (code, count) in (first..CODES).zip(counts).filter(|(_, count)| *count > 0) {
                    for bin in bins(code) {
                        totals[bin] += u64::from(count);
                    }
                }
            }
        }
    }
}
