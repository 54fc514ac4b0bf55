//! Shells: how a channel divides pairs by distance, and whether there can be any.

use crate::structure::StructureChannel;

impl StructureChannel {
    /// Outer bounds of so many shells of equal width up to the longest distance, rounded to micrometres.
    pub(super) fn equal_shells(&self, shells: u32) -> Vec<u32> {
        let (longest, shells) = (u64::from(self.longest_um()), u64::from(shells));
        (1..=shells).map(|shell| ((2 * longest * shell + shells) / (2 * shells)) as u32).collect()
    }

    /// Whether its shells are of equal width and reach the longest distance.
    pub(super) fn has_equal_shells(&self) -> bool {
        self.shells_um == self.equal_shells(self.shells_um.len() as u32)
    }

    /// Whether a pair can be far enough apart to be kept and near enough to be in a shell.
    pub(super) fn has_pairs(&self) -> bool {
        self.shells_um.last().is_some_and(|&last| self.least_um < last)
    }
}
