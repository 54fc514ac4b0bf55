//! A cloud sorted into cubes: what lies near a cube is a few runs of points that follow one another.
//!
//! Serves the fit of normals, where every point asks for its neighbours within the same small radius: the points of a
//! row of cubes ask together, and some hundred candidates are gone through with vectors faster than a tree answers.

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
    /// Where each point is, ascending.
    places: Vec<Place>,
    /// The points, in this order.
    points: Vec<[f32; 3]>,
    /// Where each occupied cube begins in `points`, by cube; ends with the number of points.
    starts: Vec<(Cube, u32)>,
    /// Bits of a place that hold the index, and those that hold the cube along one axis.
    index_bits: u32,
    axis_bits: u32,
}

impl Cubes {
    /// Sorts points into cubes at least as wide as `radius` metres, with room for the indices of `others` places.
    ///
    /// # Errors
    /// [`PrepareError::TooManyPoints`] if points and other places cannot be counted in 32 bits.
    pub(crate) fn new(points: &[[f32; 3]], radius: f64, others: usize) -> Result<Self, PrepareError> {
        let all = points.len() + others;
        let all = u32::try_from(all).map_err(|_| PrepareError::TooManyPoints { points: all })?;
        let index_bits = u32::BITS - all.leading_zeros();
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
        let (places, sorted, starts) = (Vec::new(), Vec::new(), Vec::new());
        let mut cubes = Self { corner, per_metre, places, points: sorted, starts, index_bits, axis_bits };
        cubes.places = cubes.places_of(points, 0);
        cubes.places.sort_unstable();
        cubes.points = cubes.order().map(|index| points[index as usize]).collect();
        for (&place, position) in cubes.places.iter().zip(0u32..) {
            let cube = cubes.cube(place);
            if cubes.starts.last().is_none_or(|&(last, _)| last != cube) {
                cubes.starts.push((cube, position));
            }
        }
        cubes.starts.push((Cube::MAX, cubes.places.len() as u32));
        Ok(cubes)
    }

    /// Indices of the points, cube by cube: neighbours in the list are neighbours in space.
    pub(crate) fn order(&self) -> impl Iterator<Item = u32> {
        self.places.iter().map(|&place| self.index(place))
    }

    /// The points, in this order.
    pub(crate) fn points(&self) -> &[[f32; 3]] {
        &self.points
    }

    /// Goes through the points and `others`, up to `most` at a time that follow one another in a row of cubes along x.
    /// They are given by index, that of the others after the points'; those outside the cloud's bounds count to the
    /// cubes at its edge.
    pub(crate) fn batches(&self, others: &[[f32; 3]], most: usize, mut take: impl FnMut(&[u32])) {
        let mut places = self.places.clone();
        places.extend(self.places_of(others, self.places.len() as u32));
        places.sort(); // which makes use of what is sorted already
        let mut batch = Vec::with_capacity(most);
        for row in places.chunk_by(|&a, &b| self.row(a) == self.row(b)) {
            for places in row.chunks(most) {
                batch.clear();
                batch.extend(places.iter().map(|&place| self.index(place)));
                take(&batch);
            }
        }
    }

    /// Positions in `points` of all that can lie within the radius of a query of a batch that begins with `first` and
    /// ends with `last`, and of some more; ascending.
    pub(crate) fn near(&self, first: [f32; 3], last: [f32; 3]) -> [Range<usize>; 9] {
        let ([first, y, z], [last, ..]) = (self.cell(first), self.cell(last));
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

    /// Positions in `points` of the cubes from `first` to `last`, which are few.
    fn run(&self, first: Cube, last: Cube) -> Range<usize> {
        let begin = self.starts.partition_point(|&(cube, _)| cube < first);
        let length = self.starts[begin..].iter().take_while(|&&(cube, _)| cube <= last).count();
        // The end of the list is beyond every cube.
        self.starts[begin].1 as usize..self.starts[begin + length].1 as usize
    }

    /// Where these points are, whose indices begin with `first`.
    fn places_of(&self, points: &[[f32; 3]], first: u32) -> Vec<Place> {
        let place = |(point, index): (&[f32; 3], u32)| {
            self.pack(self.cell(*point)) << self.index_bits | Place::from(index)
        };
        points.iter().zip(first..).map(place).collect()
    }

    /// Indices of a point's cube. They never decrease with a coordinate, so what is nearer than a cube's width in
    /// space is at most one cube apart.
    fn cell(&self, point: [f32; 3]) -> [u64; 3] {
        let last = side(self.axis_bits) - 1.0;
        let cell = |axis: usize| {
            let cell = (f64::from(point[axis]) - self.corner[axis]) * self.per_metre;
            cell.min(last) as u64 // what is negative becomes 0
        };
        [cell(0), cell(1), cell(2)]
    }

    fn pack(&self, [x, y, z]: [u64; 3]) -> Cube {
        (z << self.axis_bits | y) << self.axis_bits | x
    }

    /// The row of cubes along x, that is z and y.
    fn row(&self, place: Place) -> Cube {
        self.cube(place) >> self.axis_bits
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
