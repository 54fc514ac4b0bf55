//! Distances of queries to a database under every shape_bins and every m of a cell.

use std::ops::Range;

use rayon::prelude::*;

use super::{Cell, CellSignatures};
use crate::transposed::{LANES, Sums, Transposed};

/// Queries whose distances are held at once by a thread: the database, transposed, is gone through once for all of them.
pub(super) const TILE: usize = 16;

/// What distances begin with: χ² terms are added in the order of the bins, the disk's first, so that all cells with the
/// same R1 have the same sums up to the ring's first bin.
#[derive(Clone, Debug)]
pub struct DiskDistances {
    /// R1, micrometres.
    disk_um: u32,
    /// As in the cell that they were computed with.
    bins: [Vec<Range<usize>>; 2],
    /// Clouds of the database.
    columns: usize,
    pub(super) of_query: Vec<QuerySums>,
}

/// Of shape and of colour, one value of their gene after the other: sums over the pairs of bins that lie in the disk.
type QuerySums = [Vec<Sums>; 2];

impl DiskDistances {
    /// Those of queries to a database under the descriptors of a cell, computed by the current rayon pool.
    pub fn new(cell: &Cell, queries: &[CellSignatures], database: &[CellSignatures]) -> Self {
        let transposed = cell.transposed(database);
        let blocks = database.len().div_ceil(LANES);
        let of_tile = |queries: &[CellSignatures]| -> Vec<QuerySums> {
            let zeros = || transposed.each_ref().map(|all| vec![Sums::default(); all.len() * blocks]);
            let mut of_query: Vec<QuerySums> = queries.iter().map(|_| zeros()).collect();
            for (channel, all) in transposed.iter().enumerate() {
                for (value, (database, bins)) in all.iter().zip(&cell.bins[channel]).enumerate() {
                    for (query, sums) in queries.iter().zip(&mut of_query) {
                        let sums = &mut sums[channel][value * blocks..][..blocks];
                        database.first_sums(disk_pairs(bins), query.of_value(channel, bins), sums);
                    }
                }
            }
            of_query
        };
        Self {
            disk_um: cell.disk_um(),
            bins: cell.bins.clone(),
            columns: database.len(),
            of_query: queries.par_chunks(TILE).flat_map_iter(of_tile).collect(),
        }
    }

    /// Memory that those of so many queries and clouds take, bytes.
    pub fn bytes(cell: &Cell, queries: usize, database: usize) -> usize {
        let values = cell.shape.len() + cell.colour.len();
        let of_query = (values * size_of::<Sums>()).saturating_mul(database.div_ceil(LANES));
        of_query.saturating_add(size_of::<QuerySums>()).saturating_mul(queries)
    }

    /// Whether they are those of so many queries and clouds under a cell: one with the same R1 and the same values.
    pub(super) fn are_of(&self, cell: &Cell, queries: usize, database: usize) -> bool {
        self.disk_um == cell.disk_um()
            && self.bins == cell.bins
            && [self.of_query.len(), self.columns] == [queries, database]
    }

    /// Those of some queries.
    pub(super) fn of(&self, queries: Range<usize>) -> &[QuerySums] {
        &self.of_query[queries]
    }
}

impl Cell {
    /// The database under every value of shape_bins, and under every m.
    pub(super) fn transposed(&self, database: &[CellSignatures]) -> [Vec<Transposed>; 2] {
        [0, 1].map(|channel| {
            let of_value = |bins: &Range<usize>| {
                Transposed::of(2 * bins.len(), database.iter().map(|cloud| cloud.of_value(channel, bins)))
            };
            self.bins[channel].par_iter().map(of_value).collect()
        })
    }
}

/// Pairs of bins that lie in the disk, which has as many bins as the ring and comes first. With an odd number of them, the
/// last is paired with the ring's first.
fn disk_pairs(bins: &Range<usize>) -> usize {
    bins.len() / 2
}

/// Distances of a tile's queries under every value of one gene.
pub(super) struct DistanceRows {
    /// Values of the gene.
    pub(super) count: usize,
    /// Blocks of one query's row, whose last is filled up with infinities: distances are finite.
    pub(super) blocks: usize,
    values: Vec<[f32; LANES]>,
}

impl DistanceRows {
    /// The rows of shape (`channel` 0) or colour (1); with what the disk contributes, it is not computed again.
    pub(super) fn new(
        cell: &Cell,
        channel: usize,
        database: &[Transposed],
        disks: Option<&[QuerySums]>,
        queries: &[CellSignatures],
        columns: usize,
    ) -> Self {
        let (count, blocks) = (database.len(), columns.div_ceil(LANES));
        let mut values = vec![[0.0; LANES]; count * TILE * blocks];
        for (value, (database, bins)) in database.iter().zip(&cell.bins[channel]).enumerate() {
            let rows = values[value * TILE * blocks..].chunks_exact_mut(blocks);
            for (place, (query, row)) in queries.iter().zip(rows).enumerate() {
                let query = query.of_value(channel, bins);
                match disks {
                    Some(disks) => {
                        let sums = &disks[place][channel][value * blocks..][..blocks];
                        database.distances_after(disk_pairs(bins), sums, query, row);
                    }
                    None => database.distances(query, row),
                }
                row.as_flattened_mut()[columns..].fill(f32::INFINITY);
            }
        }
        Self { count, blocks, values }
    }

    pub(super) fn row(&self, value: usize, query: usize) -> &[[f32; LANES]] {
        &self.values[(value * TILE + query) * self.blocks..][..self.blocks]
    }
}
