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

/// A cell and the index of a point in it, in one number to sort by: z, y, x, index.
type Key = u64;

/// The number of a cell: z, y, x.
type Cell = u64;

/// The points of one cloud by cell: z, y, x, and in a cell by index.
pub(crate) struct CellList {
    corner: [f64; 3],
    per_metre: f64,
    /// The cell and index of each point, ascending.
    keys: Vec<Key>,
    /// The points, in this order.
    points: Vec<[f32; 3]>,
    /// Where each occupied cell begins in `points`, by cell; ends with the number of points.
    starts: Vec<(Cell, u32)>,
    /// Bits of a key that hold the index, and those that hold the cell along one axis.
    index_bits: u32,
    axis_bits: u32,
}

/// What [`CellList::batches`] goes through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Queries {
    /// The points of the list, and others.
    All,
    /// Others only.
    Others,
}

impl CellList {
    /// Sorts points into cells at least as wide as `radius` metres, with room for the indices of `others` queries.
    ///
    /// # Errors
    /// [`PrepareError::TooManyPoints`] if points and other queries cannot be counted in 32 bits.
    pub(crate) fn new(points: &[[f32; 3]], radius: f64, others: usize) -> Result<Self, PrepareError> {
        let all = points.len() + others;
        let all = u32::try_from(all).map_err(|_| PrepareError::TooManyPoints { points: all })?;
        let index_bits = u32::BITS - all.leading_zeros();
        let axis_bits = (Key::BITS - index_bits) / 3;
        let mut corner = [f64::INFINITY; 3];
        let mut extent = 0.0f64;
        for axis in 0..3 {
            let coordinates = || points.iter().map(|point| f64::from(point[axis]));
            corner[axis] = coordinates().fold(f64::INFINITY, f64::min);
            extent = extent.max(coordinates().fold(f64::NEG_INFINITY, f64::max) - corner[axis]);
        }
        // Wide clouds get wider cells: neighbours lie in adjacent cells all the same.
        let per_metre = 1.0 / (radius * MARGIN).max(extent / (side(axis_bits) - 1.0));
        let (keys, sorted, starts) = (Vec::new(), Vec::new(), Vec::new());
        let mut cells = Self { corner, per_metre, keys, points: sorted, starts, index_bits, axis_bits };
        cells.keys = cells.keys_of(points, 0);
        cells.keys.sort_unstable();
        cells.points = cells.order().map(|index| points[index as usize]).collect();
        for (&key, position) in cells.keys.iter().zip(0u32..) {
            let cell = cells.cell_of(key);
            if cells.starts.last().is_none_or(|&(last, _)| last != cell) {
                cells.starts.push((cell, position));
            }
        }
        cells.starts.push((Cell::MAX, cells.keys.len() as u32));
        Ok(cells)
    }

    /// Indices of the points, cell by cell: neighbours in the list are neighbours in space.
    pub(crate) fn order(&self) -> impl Iterator<Item = u32> {
        self.keys.iter().map(|&key| self.index(key))
    }

    /// The points, in this order.
    pub(crate) fn points(&self) -> &[[f32; 3]] {
        &self.points
    }

    /// Number of points in each occupied cell.
    pub(crate) fn occupancy(&self) -> impl Iterator<Item = u32> {
        self.starts.windows(2).map(|cells| cells[1].1 - cells[0].1)
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
        let mut keys = match wanted {
            Queries::All => self.keys.clone(),
            Queries::Others => Vec::new(),
        };
        keys.extend(self.keys_of(others, self.keys.len() as u32));
        keys.sort(); // which makes use of what is sorted already
        let mut batch = Vec::with_capacity(most);
        for row in keys.chunk_by(|&a, &b| self.row(a) == self.row(b)) {
            for keys in row.chunks(most) {
                batch.clear();
                batch.extend(keys.iter().map(|&key| self.index(key)));
                take(&batch);
            }
        }
    }

    /// Positions in `points` of all that can lie within the radius of a query of a batch that begins with `first` and
    /// ends with `last`, and of some more; ascending.
    pub(crate) fn near(&self, first: [f32; 3], last: [f32; 3]) -> [Range<usize>; 9] {
        let ([first, y, z], [last, ..]) = (self.coordinates(first), self.coordinates(last));
        let last_cell = side(self.axis_bits) as u64 - 1;
        let adjacent = |cell: u64| cell.saturating_sub(1)..=(cell + 1).min(last_cell);
        let (first, last) = (*adjacent(first).start(), *adjacent(last).end());
        let rows = adjacent(z).flat_map(|z| adjacent(y).map(move |y| (y, z)));
        let mut runs = [const { 0..0 }; 9];
        for (run, (y, z)) in runs.iter_mut().zip(rows) {
            *run = self.run(self.pack([first, y, z]), self.pack([last, y, z]));
        }
        runs
    }

    /// Positions in `points` of the cells from `first` to `last`, which are few.
    fn run(&self, first: Cell, last: Cell) -> Range<usize> {
        let begin = self.starts.partition_point(|&(cell, _)| cell < first);
        let length = self.starts[begin..].iter().take_while(|&&(cell, _)| cell <= last).count();
        // The end of the list is beyond every cell.
        self.starts[begin].1 as usize..self.starts[begin + length].1 as usize
    }

    /// Keys of these points, whose indices begin with `first`.
    fn keys_of(&self, points: &[[f32; 3]], first: u32) -> Vec<Key> {
        let key = |(point, index): (&[f32; 3], u32)| {
            self.pack(self.coordinates(*point)) << self.index_bits | Key::from(index)
        };
        points.iter().zip(first..).map(key).collect()
    }

    /// Indices of a point's cell. They never decrease with a coordinate, so what is nearer than a cell's width in
    /// space is at most one cell apart.
    fn coordinates(&self, point: [f32; 3]) -> [u64; 3] {
        let last = side(self.axis_bits) - 1.0;
        let cell = |axis: usize| {
            let cell = (f64::from(point[axis]) - self.corner[axis]) * self.per_metre;
            cell.min(last) as u64 // what is negative becomes 0
        };
        [cell(0), cell(1), cell(2)]
    }

    fn pack(&self, [x, y, z]: [u64; 3]) -> Cell {
        (z << self.axis_bits | y) << self.axis_bits | x
    }

    /// The row of cells along x, that is z and y.
    fn row(&self, key: Key) -> Cell {
        self.cell_of(key) >> self.axis_bits
    }

    fn cell_of(&self, key: Key) -> Cell {
        key >> self.index_bits
    }

    fn index(&self, key: Key) -> u32 {
        (key & ((1 << self.index_bits) - 1)) as u32
    }
}

/// Number of cells along one axis.
fn side(axis_bits: u32) -> f64 {
    (1u64 << axis_bits) as f64
}
