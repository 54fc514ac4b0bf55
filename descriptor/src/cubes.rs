//! A cloud sorted into cubes: what lies near a cube is a few runs of points that follow one another.
//!
//! Serves the fit of normals, where every point asks for its neighbours within the same small radius: the points of a
//! cube ask together, and a list of some hundred candidates is gone through with vectors faster than a tree answers.

use std::ops::Range;

use crate::prepare::PrepareError;

/// Cubes are this much wider than the radius they serve, so that no rounding moves a neighbour beyond the next cube.
const MARGIN: f64 = 1.001;

/// A cube and the index of a point in it, in one number to sort by: z, y, x, index.
type Place = u64;

/// The cube of a place: z, y, x.
type Cube = u64;

/// The points of one cloud by cube: z, y, x, and in a cube by index.
pub(crate) struct Cubes {
    corner: [f64; 3],
    per_metre: f64,
    /// Indices of the points, in this order.
    order: Vec<u32>,
    /// The points, in this order.
    points: Vec<[f32; 3]>,
    /// Where each occupied cube begins in `points`, by cube; ends with the number of points.
    starts: Vec<(Cube, u32)>,
    /// Bits of a place that hold the index, and those that hold the cube along one axis.
    index_bits: u32,
    axis_bits: u32,
}

impl Cubes {
    /// Sorts points into cubes at least as wide as `radius` metres, for lists of up to `most_queries` queries.
    ///
    /// # Errors
    /// [`PrepareError::TooManyPoints`] if points or queries cannot be counted in 32 bits.
    pub(crate) fn new(points: &[[f32; 3]], radius: f64, most_queries: usize) -> Result<Self, PrepareError> {
        let too_many = |points| move |_| PrepareError::TooManyPoints { points };
        let count = u32::try_from(points.len()).map_err(too_many(points.len()))?;
        let most = count.max(u32::try_from(most_queries).map_err(too_many(most_queries))?);
        let index_bits = u32::BITS - most.leading_zeros();
        let axis_bits = (Place::BITS - index_bits) / 3;
        let mut corner = [f64::INFINITY; 3];
        let mut extent = 0.0f64;
        for axis in 0..3 {
            let coordinates = || points.iter().map(|point| f64::from(point[axis]));
            corner[axis] = coordinates().fold(f64::INFINITY, f64::min);
            extent = extent.max(coordinates().fold(f64::NEG_INFINITY, f64::max) - corner[axis]);
        }
        // Wide clouds get wider cubes: neighbours lie in adjacent cubes all the same.
        let per_metre = 1.0 / (radius * MARGIN).max(extent / (side(axis_bits) - 1.0));
        let (order, sorted, starts) = (Vec::new(), Vec::new(), Vec::new());
        let mut cubes = Self { corner, per_metre, order, points: sorted, starts, index_bits, axis_bits };
        let places = cubes.sort(points);
        cubes.order = places.iter().map(|&place| cubes.index(place)).collect();
        cubes.points = cubes.order.iter().map(|&index| points[index as usize]).collect();
        for (&place, position) in places.iter().zip(0u32..) {
            let cube = cubes.cube(place);
            if cubes.starts.last().is_none_or(|&(last, _)| last != cube) {
                cubes.starts.push((cube, position));
            }
        }
        cubes.starts.push((Cube::MAX, count));
        Ok(cubes)
    }

    /// Indices of the points, cube by cube: neighbours in the list are neighbours in space.
    pub(crate) fn order(&self) -> &[u32] {
        &self.order
    }

    /// Queries by pair of cubes along x, as indices of `queries`; those outside the cloud's bounds count to the cubes
    /// at its edge.
    pub(crate) fn groups(&self, queries: &[[f32; 3]]) -> Vec<Vec<u32>> {
        let places = self.sort(queries);
        let groups = places.chunk_by(|&a, &b| self.cube(a) >> 1 == self.cube(b) >> 1);
        groups.map(|group| group.iter().map(|&place| self.index(place)).collect()).collect()
    }

    /// Adds every point that can lie within the radius of a query of the same pair of cubes as `query`, and some more,
    /// in the order of the cubes.
    pub(crate) fn near(&self, query: [f32; 3], found: &mut Vec<[f32; 3]>) {
        let [x, y, z] = self.cell(query);
        let last_cell = side(self.axis_bits) as u64 - 1;
        let adjacent = |cell: u64| cell.saturating_sub(1)..=(cell + 1).min(last_cell);
        let (first, last) = (*adjacent(x & !1).start(), *adjacent(x | 1).end());
        for z in adjacent(z) {
            for y in adjacent(y) {
                found.extend_from_slice(
                    &self.points[self.run(self.pack([first, y, z]), self.pack([last, y, z]))],
                );
            }
        }
    }

    /// Positions in `points` of the cubes from `first` to `last`.
    fn run(&self, first: Cube, last: Cube) -> Range<usize> {
        let begin = self.starts.partition_point(|&(cube, _)| cube < first);
        let length = self.starts[begin..].partition_point(|&(cube, _)| cube <= last);
        self.starts[begin].1 as usize..self.starts[begin + length].1 as usize
    }

    fn sort(&self, points: &[[f32; 3]]) -> Vec<Place> {
        let place = |(point, index): (&[f32; 3], u32)| {
            self.pack(self.cell(*point)) << self.index_bits | Place::from(index)
        };
        let mut places: Vec<Place> = points.iter().zip(0u32..).map(place).collect();
        places.sort_unstable();
        places
    }

    /// Indices of a point's cube. They never decrease with a coordinate, so what is nearer than a cube's width in
    /// space is at most one cube apart.
    fn cell(&self, point: [f32; 3]) -> [u64; 3] {
        [0, 1, 2].map(|axis| {
            let cell = (f64::from(point[axis]) - self.corner[axis]) * self.per_metre;
            cell.min(side(self.axis_bits) - 1.0) as u64 // what is negative becomes 0
        })
    }

    fn pack(&self, [x, y, z]: [u64; 3]) -> Cube {
        (z << self.axis_bits | y) << self.axis_bits | x
    }

    fn cube(&self, place: Place) -> Cube {
        place >> self.index_bits
    }

    fn index(&self, place: Place) -> u32 {
        (place & ((1 << self.index_bits) - 1)) as u32
    }
}

/// Cubes along one axis.
fn side(axis_bits: u32) -> f64 {
    (1u64 << axis_bits) as f64
}
