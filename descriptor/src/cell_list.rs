//! A cell list: the points of a cloud sorted into a grid, so that what lies near a cell is a few runs of points.
//!
//! Serves the fit of normals, where every point asks for its neighbours within the same small radius: the queries of a
//! row of cells are answered together, and a vector loop goes through their few hundred common candidates. A k-d tree
//! ([`crate::neighbours`], kiddo) is slower: for ten clouds of `household-rgbd` (18 741 points, AMD EPYC, one thread) its
//! search alone takes 8 times as long as the whole fit of normals here.

use std::ops::Range;

use crate::prepare_error::PrepareError;

/// Cells are this much wider than the radius they serve, so that no rounding moves a neighbour beyond the next cell.
const MARGIN: f64 = 1.001;

/// Points that may be read beyond the last one.
pub(crate) const BEYOND: usize = 16;

/// A table of all cells has so many entries at most, or [`CELLS_A_POINT`] for each point, if that is more: filling it must
/// cost less than a sort.
const FEW_CELLS: usize = 1 << 14;
const CELLS_A_POINT: usize = 8;

/// The number of a cell: z, y, x.
pub(crate) type Cell = u64;

/// The points of one cloud by cell: z, y, x, and in a cell by index.
pub(crate) struct CellList {
    corner: [f64; 3],
    per_metre: f64,
    /// Highest cell along each axis.
    last: [u64; 3],
    /// Bits of a number that hold the cell along x, y, z.
    bits: [u32; 3],
    /// The cell of each point.
    cells: Vec<Cell>,
    /// Indices of the points, in the order of their cells.
    order: Vec<u32>,
    /// x, y, z of the points, in this order, and then of [`BEYOND`] more that are nowhere.
    position: [Vec<f32>; 3],
    starts: Starts,
}

/// Where the points of each cell begin in the order.
pub(crate) enum Starts {
    /// Of every cell there can be, and the number of points.
    Table(Vec<u32>),
    /// Of the cells that have points, by cell; ends with the number of points.
    Occupied(Vec<(Cell, u32)>),
}

/// What [`CellList::batches`] goes through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Queries {
    /// The points of the list, and others.
    All,
    /// Others only.
    Others,
}

impl Starts {
    /// Positions in the order of the cells from `first` to `last`, which are few.
    fn run(&self, first: Cell, last: Cell) -> Range<usize> {
        match self {
            Self::Table(starts) => starts[first as usize] as usize..starts[last as usize + 1] as usize,
            Self::Occupied(starts) => {
                let begin = starts.partition_point(|&(cell, _)| cell < first);
                let length = starts[begin..].iter().take_while(|&&(cell, _)| cell <= last).count();
                // The end of the list is beyond every cell.
                starts[begin].1 as usize..starts[begin + length].1 as usize
            }
        }
    }
}

impl Default for Starts {
    fn default() -> Self {
        Self::Table(Vec::new())
    }
}

impl CellList {
    /// Sorts points into cells at least as wide as `radius` metres, with room for the indices of `others` queries.
    ///
    /// # Errors
    /// [`PrepareError::TooManyPoints`] if points and other queries cannot be counted in 32 bits.
    pub(crate) fn new(points: &[[f32; 3]], radius: f64, others: usize) -> Result<Self, PrepareError> {
        let all = points.len() + others;
        let all = u32::try_from(all).map_err(|_| PrepareError::TooManyPoints { points: all })?;
        // Of how many cells a side there can be at most depends where the cells of very wide clouds are, and by it the order
        // in which their points are summed up.
        let axis_bits = (u64::BITS - (u32::BITS - all.leading_zeros())) / 3;
        let side = (1u64 << axis_bits) as f64;
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for point in points {
            for axis in 0..3 {
                low[axis] = if point[axis] < low[axis] { point[axis] } else { low[axis] };
                high[axis] = if point[axis] > high[axis] { point[axis] } else { high[axis] };
            }
        }
        let corner = low.map(f64::from);
        let extent = [0, 1, 2].map(|axis| f64::from(high[axis]) - corner[axis]);
        // Wide clouds get wider cells: neighbours lie in adjacent cells all the same.
        let widest = extent.iter().fold(0.0, |widest, &extent| f64::max(widest, extent));
        let per_metre = 1.0 / (radius * MARGIN).max(widest / (side - 1.0));
        let last = extent.map(|extent| (extent * per_metre).min(side - 1.0) as u64);
        let bits = last.map(|last| u64::BITS - last.leading_zeros());
        let (cells, order, position, starts) = Default::default();
        let mut list = Self { corner, per_metre, last, bits, cells, order, position, starts };
        list.cells = points.iter().map(|&point| list.pack(list.coordinates(point))).collect();
        (list.order, list.starts) = sort(&list.cells, list.pack(list.last));
        let nowhere = [f32::NAN; BEYOND];
        list.position = [0, 1, 2].map(|axis| {
            let sorted = list.order.iter().map(|&index| points[index as usize][axis]);
            sorted.chain(nowhere).collect()
        });
        Ok(list)
    }

    /// Indices of the points, cell by cell: neighbours in the list are neighbours in space.
    pub(crate) fn order(&self) -> impl Iterator<Item = u32> {
        self.order.iter().copied()
    }

    /// x, y, z of the points, in this order, and then of [`BEYOND`] more that are nowhere.
    pub(crate) fn position(&self) -> &[Vec<f32>; 3] {
        &self.position
    }

    /// Number of points in each occupied cell.
    pub(crate) fn occupancy(&self) -> impl Iterator<Item = u32> {
        let cell = |index: &u32| self.cells[*index as usize];
        self.order.chunk_by(move |a, b| cell(a) == cell(b)).map(|points| points.len() as u32)
    }

    /// Goes through the wanted ones of the points and `others`, up to `most` at a time that follow one another in a row
    /// of cells along x. They are given by index, that of the others after the points'; those outside the cloud's bounds
    /// count to the cells at its edge.
    pub(crate) fn batches(
        &self,
        wanted: Queries,
        others: &[[f32; 3]],
        most: usize,
        mut take: impl FnMut(&[u32]),
    ) {
        let points = match wanted {
            Queries::All => self.cells.as_slice(),
            Queries::Others => &[],
        };
        let cells = others.iter().map(|&point| self.pack(self.coordinates(point)));
        let cells: Vec<Cell> = points.iter().copied().chain(cells).collect();
        let (mut order, _) = sort(&cells, self.pack(self.last));
        let first = (self.cells.len() - points.len()) as u32;
        let row = |query: u32| cells[query as usize] >> self.bits[0];
        for queries in order.chunk_by_mut(|&a, &b| row(a) == row(b)) {
            queries.iter_mut().for_each(|query| *query += first);
            queries.chunks(most).for_each(&mut take);
        }
    }

    /// Positions in this order of all that can lie within the radius of a query of a batch that begins with `first` and
    /// ends with `last`, and of some more; ascending.
    pub(crate) fn near(&self, first: [f32; 3], last: [f32; 3]) -> [Range<usize>; 9] {
        let ([first, y, z], [last, ..]) = (self.coordinates(first), self.coordinates(last));
        let (first, last) = (first.saturating_sub(1), (last + 1).min(self.last[0]));
        let mut runs = [const { 0..0 }; 9];
        for (place, run) in (0u64..).zip(&mut runs) {
            // One less in y and z, as much, and one more.
            let (y, z) = (y + place % 3, z + place / 3);
            if (1..=self.last[1] + 1).contains(&y) && (1..=self.last[2] + 1).contains(&z) {
                *run = self.starts.run(self.pack([first, y - 1, z - 1]), self.pack([last, y - 1, z - 1]));
            }
        }
        runs
    }

    /// Indices of a point's cell. They never decrease with a coordinate, so what is nearer than a cell's width in
    /// space is at most one cell apart.
    #[inline(always)]
    fn coordinates(&self, point: [f32; 3]) -> [u64; 3] {
        let cell = |axis: usize| {
            let cell = (f64::from(point[axis]) - self.corner[axis]) * self.per_metre;
            (cell as i64).clamp(0, self.last[axis] as i64) as u64
        };
        [cell(0), cell(1), cell(2)]
    }

    #[inline(always)]
    fn pack(&self, [x, y, z]: [u64; 3]) -> Cell {
        (z << self.bits[1] | y) << self.bits[0] | x
    }
}

/// Whether a table of so many cells is worth its memory for so many points.
pub(crate) fn are_few(cells: u64, points: usize) -> bool {
    cells <= FEW_CELLS.max(CELLS_A_POINT * points) as u64
}

/// Indices by cell, equal cells by index, and where each cell begins; `last` is the highest cell that there can be.
pub(crate) fn sort(cells: &[Cell], last: Cell) -> (Vec<u32>, Starts) {
    if !are_few(last.saturating_add(1), cells.len()) {
        return sort_by_comparing(cells);
    }
    // A counting sort. Counts lie two places on: once they are summed up, the place after a cell's has its start, and once
    // its indices are placed, its end.
    let mut starts = vec![0u32; last as usize + 3];
    for &cell in cells {
        starts[cell as usize + 2] += 1;
    }
    let mut sum = 0;
    for start in &mut starts {
        sum += *start;
        *start = sum;
    }
    let mut order = vec![0; cells.len()];
    for (&cell, index) in cells.iter().zip(0u32..) {
        let place = &mut starts[cell as usize + 1];
        order[*place as usize] = index;
        *place += 1;
    }
    (order, Starts::Table(starts))
}

/// As a counting sort does it, where there are many more cells than points.
fn sort_by_comparing(cells: &[Cell]) -> (Vec<u32>, Starts) {
    let mut order: Vec<u32> = (0..cells.len() as u32).collect();
    order.sort_unstable_by_key(|&index| (cells[index as usize], index));
    let mut starts: Vec<(Cell, u32)> = Vec::new();
    for (&index, position) in order.iter().zip(0u32..) {
        let cell = cells[index as usize];
        if starts.last().is_none_or(|&(last, _)| last != cell) {
            starts.push((cell, position));
        }
    }
    starts.push((Cell::MAX, cells.len() as u32));
    (order, Starts::Occupied(starts))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn both_sorts_give_the_order_and_the_starts_by_definition(
            cells in prop::collection::vec(0u64..200, 0..300),
            first in 0u64..200,
            length in 0u64..50,
        ) {
            let mut expected: Vec<u32> = (0..cells.len() as u32).collect();
            expected.sort_by_key(|&index| cells[index as usize]);
            let last = (first + length).min(199);
            let position = |cell: u64| expected.partition_point(|&index| cells[index as usize] < cell);
            let run = position(first)..position(last + 1);
            for (order, starts) in [sort(&cells, 199), sort_by_comparing(&cells)] {
                prop_assert_eq!(&order, &expected);
                prop_assert_eq!(starts.run(first, last), run.clone());
            }
        }
    }

    #[test]
    fn cells_are_counted_only_where_they_are_few() {
        let is_table = |last| matches!(sort(&[last, 0], last).1, Starts::Table(_));
        assert_eq!(
            [FEW_CELLS as u64 - 1, FEW_CELLS as u64, u64::MAX >> 1].map(is_table),
            [true, false, false]
        );
    }
}
