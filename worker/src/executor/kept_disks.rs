//! What grid cells leave for the next one with the same R1, no IO: the disks of clouds, and what they contribute to distances.

use std::collections::HashMap;
use std::sync::Arc;

use descriptor::grid::{DiskDistances, RegionSignatures};
use proto::Digest;

/// The disks of a split's clouds, in their order, under all descriptors with one R1.
pub type SplitDisks = Arc<Vec<RegionSignatures>>;

/// The splits of queries and of the database.
pub type Splits = [Vec<Digest>; 2];

/// Of the R1 of the last cell, admitted until it fills its share. Cells go through all splits in turn.
pub struct KeptDisks {
    capacity: usize,
    bytes: usize,
    /// R1, micrometres.
    disk_um: u32,
    of_split: HashMap<Digest, SplitDisks>,
    distances: HashMap<Splits, Arc<DiskDistances>>,
}

impl KeptDisks {
    /// Empty; takes up to `capacity` bytes.
    pub fn new(capacity: usize) -> Self {
        Self { capacity, bytes: 0, disk_um: 0, of_split: HashMap::new(), distances: HashMap::new() }
    }

    /// Forgets all of another R1 than this, micrometres.
    pub fn retain(&mut self, disk_um: u32) {
        if self.disk_um != disk_um {
            *self = Self { disk_um, ..Self::new(self.capacity) };
        }
    }

    /// The disks of a split with this R1, micrometres, if they are kept.
    pub fn of_split(&self, disk_um: u32, split: Digest) -> Option<SplitDisks> {
        self.of_split.get(&split).filter(|_| self.disk_um == disk_um).cloned()
    }

    /// Keeps the disks of a split with this R1, micrometres, if there is room for them.
    pub fn keep_split(&mut self, disk_um: u32, split: Digest, disks: &SplitDisks) {
        let bytes = disks.iter().map(RegionSignatures::bytes).sum();
        if self.admits(disk_um, bytes) && !self.of_split.contains_key(&split) {
            self.bytes += bytes;
            self.of_split.insert(split, Arc::clone(disks));
        }
    }

    /// What disks with this R1, micrometres, contribute to the distances of these splits, if it is kept.
    pub fn distances(&self, disk_um: u32, splits: &Splits) -> Option<Arc<DiskDistances>> {
        self.distances.get(splits).filter(|_| self.disk_um == disk_um).cloned()
    }

    /// Keeps what disks with this R1, micrometres, contribute to the distances of these splits, if there is room for
    /// so many bytes.
    pub fn keep_distances(
        &mut self,
        disk_um: u32,
        splits: Splits,
        distances: &Arc<DiskDistances>,
        bytes: usize,
    ) {
        if self.admits(disk_um, bytes) && !self.distances.contains_key(&splits) {
            self.bytes += bytes;
            self.distances.insert(splits, Arc::clone(distances));
        }
    }

    /// Whether there is room for so many bytes of this R1, micrometres; none if another cell has gone on to another R1.
    pub fn admits(&self, disk_um: u32, bytes: usize) -> bool {
        self.disk_um == disk_um && self.bytes.saturating_add(bytes) <= self.capacity
    }
}

#[cfg(test)]
mod tests {
    use descriptor::grid::Cell;
    use descriptor::{GeneTable, Quantiser};

    use super::*;

    fn split(number: u8) -> Digest {
        Digest([number; 32])
    }

    /// Disk distances of no clouds: of how many bytes they are is said when they are kept.
    fn distances() -> Arc<DiskDistances> {
        let quantiser = Quantiser::new(&GeneTable::paper()).unwrap();
        Arc::new(DiskDistances::new(&Cell::new(&quantiser, 5_000, 21_000).unwrap(), &[], &[]))
    }

    #[test]
    fn what_is_kept_is_of_one_radius() {
        let mut kept = KeptDisks::new(100);
        kept.retain(5_000);
        kept.keep_split(5_000, split(1), &SplitDisks::default());
        kept.retain(5_000);
        assert!(kept.of_split(5_000, split(1)).is_some());
        assert!(kept.of_split(6_000, split(1)).is_none() && kept.of_split(5_000, split(2)).is_none());
        kept.retain(6_000);
        assert!(kept.of_split(5_000, split(1)).is_none() && kept.of_split(6_000, split(1)).is_none());
        // A cell that began before the other radius keeps nothing.
        kept.keep_split(5_000, split(1), &SplitDisks::default());
        let splits = || [vec![split(1)], vec![split(2)]];
        kept.keep_distances(5_000, splits(), &distances(), 1);
        assert!(kept.of_split(5_000, split(1)).is_none() && kept.of_split(6_000, split(1)).is_none());
        assert!(kept.distances(5_000, &splits()).is_none() && kept.distances(6_000, &splits()).is_none());
        assert!(!kept.admits(5_000, 1) && kept.admits(6_000, 100));
    }

    #[test]
    fn distances_are_of_their_queries_and_their_database_and_fill_a_share() {
        let mut kept = KeptDisks::new(100);
        kept.retain(5_000);
        let (splits, exchanged) = ([vec![split(1)], vec![split(2)]], [vec![split(2)], vec![split(1)]]);
        for _ in 0..2 {
            kept.keep_distances(5_000, splits.clone(), &distances(), 60);
        }
        assert!(kept.distances(5_000, &splits).is_some() && kept.distances(5_000, &exchanged).is_none());
        assert!(kept.admits(5_000, 40) && !kept.admits(5_000, 41), "counted once");
        kept.keep_distances(5_000, exchanged.clone(), &distances(), 41);
        assert!(kept.distances(5_000, &exchanged).is_none());
        kept.retain(6_000);
        assert!(kept.admits(6_000, 100) && !kept.admits(6_000, usize::MAX));
    }
}
