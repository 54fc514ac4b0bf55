//! Points value by value and in blocks, so that loops over them become vector loops.

use std::borrow::Cow;

use crate::prepare_error::PrepareError;
use crate::structure::block::{BLOCK, LANES};
use crate::structure::channel::StructureChannel;
use crate::structure::cloud::Points;
use crate::structure::colours::values;
use crate::structure::plan::{Column, StructurePlan};

/// Values of a point that are moved together.
const QUAD: usize = 4;

/// Most values of a point: position, normal and columns.
const MAX_VALUES: usize = 6 + StructureChannel::MAX_AXES;

/// Values of points, one in each lane, in the order of [`StructurePlan::values`]. No distance to a lane whose x is NaN
/// counts.
pub(super) struct Group {
    pub(super) values: [[f32; LANES]; MAX_VALUES],
}

impl Group {
    pub(super) const EMPTY: Self = Self { values: [[f32::NAN; LANES]; MAX_VALUES] };

    /// Takes over one point in all lanes.
    #[inline(always)]
    pub(super) fn repeat(&mut self, points: &Table, point: usize) {
        for (lanes, value) in self.values.iter_mut().zip(points.values_of(point)) {
            *lanes = [value; LANES];
        }
    }

    /// Takes over a block of points as one of the group's own blocks.
    #[inline(always)]
    pub(super) fn copy_block(&mut self, place: usize, points: &Table, block: usize) {
        for (lanes, column) in self.values.iter_mut().zip(points.columns.chunks_exact(points.stride)) {
            lanes[place * BLOCK..][..BLOCK].copy_from_slice(&column[block * BLOCK..][..BLOCK]);
        }
    }

    /// The normal in a lane, of a plan with angles.
    #[inline(always)]
    pub(super) fn normal(&self, lane: usize) -> [f32; 3] {
        [self.values[3][lane], self.values[4][lane], self.values[5][lane]]
    }

    /// Empties a lane.
    #[inline(always)]
    pub(super) fn clear(&mut self, lane: usize) {
        self.values[0][lane] = f32::NAN;
    }

    /// Takes over the first values of some points, lane by lane.
    #[inline(always)]
    pub(super) fn gather(&mut self, values: usize, points: &Table, indices: &[u32; LANES]) {
        let quads = points.quads.chunks_exact(points.points.max(1)).take(values.div_ceil(QUAD));
        for (quads, lanes) in quads.zip(self.values.chunks_mut(QUAD)) {
            let mut gathered = [[0.0; QUAD]; LANES];
            for (gathered, &index) in gathered.iter_mut().zip(indices) {
                *gathered = quads[index as usize];
            }
            for (value, lanes) in lanes.iter_mut().enumerate() {
                for (lane, gathered) in lanes.iter_mut().zip(&gathered) {
                    *lane = gathered[value];
                }
            }
        }
    }
}

/// The points that a channel can use, in their order.
#[derive(Default)]
pub(super) struct Table {
    /// Number of points.
    pub(super) points: usize,
    /// Value after value; each has as many as whole blocks hold, of which those after the last point are NaN.
    columns: Vec<f32>,
    /// Length of a column.
    stride: usize,
    /// Lowest x, y, z and highest x, y, z of each block, like columns; infinite where there is no block.
    boxes: [Vec<f32>; 6],
    /// The same values point after point, four at a time: of all points the first four, then the next. Empty unless pairs
    /// are drawn.
    quads: Vec<[f32; QUAD]>,
}

impl Table {
    /// Takes the points in their order, without those that lack a normal where the channel needs one.
    ///
    /// # Errors
    /// [`PrepareError::NoColours`] if the channel needs colours and there are none.
    pub(super) fn new(plan: &StructurePlan, points: &Points, mean: [i32; 2]) -> Result<Self, PrepareError> {
        let needs_normals = plan.channel.needs_normals();
        let colours = match &points.colours {
            Some(colours) => colours.as_slice(),
            None if plan.channel.needs_colour() => return Err(PrepareError::NoColours),
            None => &[],
        };
        let is_used = |index: &usize| !needs_normals || points.normals[*index].is_some();
        let used: Vec<usize> = (0..points.positions.len()).filter(is_used).collect();
        let mut table = Self::of_size(plan, used.len());
        for axis in 0..3 {
            table.column(axis).zip(&used).for_each(|(value, &index)| *value = points.positions[index][axis]);
            if plan.has_angles {
                let normal = |index: usize| points.normals[index].unwrap_or_default()[axis];
                table.column(3 + axis).zip(&used).for_each(|(value, &index)| *value = normal(index));
            }
        }
        let colours: Cow<[[u8; 3]]> = if used.len() == points.positions.len() {
            Cow::Borrowed(colours)
        } else {
            used.iter().filter_map(|&index| colours.get(index).copied()).collect()
        };
        for (number, column) in plan.columns.iter().enumerate() {
            let values = column.values(&colours, mean);
            table.column(plan.place_of_column(number)).zip(values).for_each(|(place, value)| *place = value);
        }
        table.finish(plan);
        Ok(table)
    }

    /// Some of the points.
    #[inline(always)]
    pub(super) fn gather(&self, plan: &StructurePlan, points: &[u32]) -> Self {
        let mut gathered = Self::of_size(plan, points.len());
        for (value, column) in self.columns.chunks_exact(self.stride).enumerate() {
            gathered.column(value).zip(points).for_each(|(value, &point)| *value = column[point as usize]);
        }
        gathered.find_boxes();
        gathered
    }

    fn of_size(plan: &StructurePlan, points: usize) -> Self {
        // Never 0: a chunk has a length.
        let stride = points.next_multiple_of(BLOCK).max(BLOCK);
        Self { points, stride, columns: vec![f32::NAN; plan.values * stride], ..Self::default() }
    }

    /// A value of all points.
    fn column(&mut self, value: usize) -> impl Iterator<Item = &mut f32> {
        self.columns[value * self.stride..][..self.points].iter_mut()
    }

    /// The values of a point.
    fn values_of(&self, point: usize) -> impl Iterator<Item = f32> {
        self.columns.chunks_exact(self.stride).map(move |column| column[point])
    }

    /// Makes what points are found by.
    fn finish(&mut self, plan: &StructurePlan) {
        self.find_boxes();
        if plan.draws(self.points) {
            let zeros = vec![0.0; self.stride];
            self.quads.reserve_exact(plan.values.div_ceil(QUAD) * self.points);
            for columns in self.columns.chunks(QUAD * self.stride) {
                let column = |number: usize| columns.chunks_exact(self.stride).nth(number).unwrap_or(&zeros);
                let [a, b, c, d] = [0, 1, 2, 3].map(column);
                let quads = a.iter().zip(b).zip(c).zip(d).map(|(((&a, &b), &c), &d)| [a, b, c, d]);
                self.quads.extend(quads.take(self.points));
            }
        }
    }

    fn find_boxes(&mut self) {
        let blocks = self.points.div_ceil(BLOCK);
        let boxes = blocks.next_multiple_of(BLOCK);
        for (axis, column) in self.columns.chunks_exact(self.stride).take(3).enumerate() {
            let used = column[..self.points].chunks(BLOCK);
            // A NaN is neither: nothing is near it.
            let extremes = used.map(|block| {
                block.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], &value| {
                    [if value < low { value } else { low }, if value > high { value } else { high }]
                })
            });
            let (mut low, mut high): (Vec<f32>, Vec<f32>) = extremes.map(|[low, high]| (low, high)).unzip();
            low.resize(boxes, f32::INFINITY);
            high.resize(boxes, f32::INFINITY);
            [self.boxes[axis], self.boxes[3 + axis]] = [low, high];
        }
    }

    /// Finds the blocks that may have a point that near, in their order.
    #[inline(always)]
    pub(super) fn blocks_within(&self, [x, y, z]: [f32; 3], reach2: f32, found: &mut Vec<u32>) {
        found.clear();
        let columns = self.boxes.each_ref().map(|values| values.as_chunks::<BLOCK>().0);
        let [low_x, low_y, low_z, high_x, high_y, high_z] = columns;
        // Rounds like the distances of points: differences and squares never decrease with the distance along an axis.
        let outside = |low: f32, at: f32, high: f32| {
            let (below, above) = (low - at, at - high);
            let most = if below > above { below } else { above };
            if most > 0.0 { most * most } else { 0.0 }
        };
        for place in 0..low_x.len() {
            let mut d2 = [0.0; BLOCK];
            for (lane, d2) in d2.iter_mut().enumerate() {
                let dx = outside(low_x[place][lane], x, high_x[place][lane]);
                let dy = outside(low_y[place][lane], y, high_y[place][lane]);
                let dz = outside(low_z[place][lane], z, high_z[place][lane]);
                *d2 = dx + dy + dz;
            }
            keep(place * BLOCK, &d2, reach2, found);
        }
    }

    /// Finds the points within reach of a place among these blocks, in their order.
    #[inline(always)]
    pub(super) fn points_within(&self, centre: [f32; 3], reach2: f32, blocks: &[u32], found: &mut Vec<u32>) {
        found.clear();
        let (x, rest) = self.columns.split_at(self.stride);
        let (y, z) = rest.split_at(self.stride);
        let [x, y, z] = [x, y, z].map(|column| column.as_chunks::<BLOCK>().0);
        for &block in blocks {
            let place = block as usize;
            let mut d2 = [0.0; BLOCK];
            for (lane, d2) in d2.iter_mut().enumerate() {
                let [dx, dy, dz] =
                    [x[place][lane] - centre[0], y[place][lane] - centre[1], z[place][lane] - centre[2]];
                *d2 = dx * dx + dy * dy + dz * dz;
            }
            keep(place * BLOCK, &d2, reach2, found);
        }
    }

    /// A point's position, metres.
    #[inline(always)]
    pub(super) fn position(&self, point: usize) -> [f32; 3] {
        [0, 1, 2].map(|axis| self.columns[axis * self.stride + point])
    }
}

/// Appends the numbers of those whose squared distance is within the limit.
#[inline(always)]
fn keep(first: usize, d2: &[f32; BLOCK], limit2: f32, found: &mut Vec<u32>) {
    let before = found.len();
    found.resize(before + BLOCK, 0);
    let Some(kept) = found.last_chunk_mut::<BLOCK>() else { return };
    // Free of branches: some are within reach, in no pattern a processor could predict.
    let mut count = 0;
    for (lane, &d2) in d2.iter().enumerate() {
        kept[count % BLOCK] = (first + lane) as u32;
        count += usize::from(d2 <= limit2);
    }
    found.truncate(before + count);
}

impl Column {
    /// The values of points of these colours.
    fn values(&self, colours: &[[u8; 3]], mean: [i32; 2]) -> Vec<f32> {
        let axes = match self {
            Self::Value(feature) => return values(*feature, colours, mean),
            Self::Code(axes) => axes,
        };
        let mut codes = vec![0u32; colours.len()];
        for axis in axes {
            let values = values(axis.feature, colours, mean);
            for &edge in &axis.edges {
                for (code, &value) in codes.iter_mut().zip(&values) {
                    *code += if value >= edge { axis.stride } else { 0 };
                }
            }
        }
        codes.into_iter().map(f32::from_bits).collect()
    }
}
