//! The points of a cloud value by value and in blocks, so that loops over them become vector loops.

use std::borrow::Cow;

use aligned_vec::{AVec, avec};
use pulp::{NullaryFnOnce, Simd, WithSimd};

use crate::prepare_error::PrepareError;
use crate::select::{BELOW_ALL, select};
use crate::structure::block::BLOCK;
use crate::structure::cloud::Points;
use crate::structure::colours::write_values;
use crate::structure::plan::StructurePlan;
use crate::structure::quads::{Interleave, Quads};
use crate::structure::value_order::{Column, PointAxis};
use crate::structure::vector::Floats;
use crate::wide::widest;

/// The points that a channel can use, in their order.
pub(super) struct Table {
    /// Number of points.
    pub(super) points: usize,
    /// Value after value; each has as many as whole blocks hold, of which positions after the last point are NaN.
    columns: AVec<f32>,
    /// Length of a column.
    stride: usize,
    /// Columns of the lowest x, y, z and the highest x, y, z of each block; infinite where there is no block.
    boxes: AVec<f32>,
    /// The same values; empty unless pairs are drawn.
    pub(super) quads: Quads,
}

impl Default for Table {
    fn default() -> Self {
        Self { points: 0, columns: avec![], stride: 0, boxes: avec![], quads: Quads::default() }
    }
}

impl Table {
    /// Takes the points in their order, without those that lack a normal if every one must have one.
    ///
    /// # Errors
    /// [`PrepareError::NoColours`] if the channel needs colours and there are none.
    pub(super) fn new(
        plan: &StructurePlan,
        points: &Points,
        normals_only: bool,
        mean: [i32; 2],
    ) -> Result<Self, PrepareError> {
        let colours = match &points.colours {
            Some(colours) => colours.as_slice(),
            None if plan.channel.needs_colour() => return Err(PrepareError::NoColours),
            None => &[],
        };
        let lacks_normals = normals_only && points.normals.iter().any(Option::is_none);
        let used = lacks_normals.then(|| {
            let has_normal = |&index: &usize| points.normals[index].is_some();
            (0..points.positions.len()).filter(has_normal).collect::<Vec<usize>>()
        });
        let used = used.as_deref();
        let mut table = Self::of_size(plan, used.map_or(points.positions.len(), <[usize]>::len));
        let normal = plan.has_angles.then_some(plan.order.normal());
        let has_boxes = !plan.is_of_cloud();
        widest(Place { table: &mut table, points, used, normal, has_boxes });
        let colours: Cow<[[u8; 3]]> = match used {
            None => Cow::Borrowed(colours),
            Some(used) => used.iter().filter_map(|&index| colours.get(index).copied()).collect(),
        };
        for (number, column) in plan.columns.iter().enumerate() {
            let place = plan.order.place(number) * table.stride;
            column.write(&colours, mean, &mut table.columns[place..][..table.stride]);
        }
        if plan.draws(table.points) {
            table.quads =
                widest(Interleave { points: table.points, columns: &table.columns, stride: table.stride });
        }
        Ok(table)
    }

    /// Some of the points.
    #[inline(always)]
    pub(super) fn gather(&self, plan: &StructurePlan, points: &[u32]) -> Self {
        let mut gathered = Self::of_size(plan, points.len());
        for (value, column) in self.columns().enumerate() {
            gathered.column(value).zip(points).for_each(|(value, &point)| *value = column[point as usize]);
        }
        gathered.find_boxes();
        gathered
    }

    fn of_size(plan: &StructurePlan, points: usize) -> Self {
        // Never 0: a chunk has a length.
        let stride = points.next_multiple_of(BLOCK).max(BLOCK);
        Self { points, stride, columns: avec![f32::NAN; plan.order.values * stride], ..Self::default() }
    }

    /// A value of all points.
    fn column(&mut self, value: usize) -> impl Iterator<Item = &mut f32> {
        self.columns[value * self.stride..][..self.points].iter_mut()
    }

    /// Makes vectors of the points the values from `first` on.
    #[inline(always)]
    fn place(&mut self, first: usize, vectors: impl Iterator<Item = [f32; 3]>) {
        let (x, rest) = self.columns[first * self.stride..].split_at_mut(self.stride);
        let (y, z) = rest.split_at_mut(self.stride);
        for (((x, y), z), vector) in x.iter_mut().zip(y).zip(z).zip(vectors) {
            [*x, *y, *z] = vector;
        }
    }

    /// Value after value, as long as whole blocks.
    #[inline(always)]
    fn columns(&self) -> impl Iterator<Item = &[f32]> {
        self.columns.chunks_exact(self.stride)
    }

    /// A value of the points of a block; after the last point a position is NaN, and others may be anything.
    #[inline(always)]
    pub(super) fn block(&self, value: usize, block: usize) -> &[f32; BLOCK] {
        &self.columns[value * self.stride..][..self.stride].as_chunks().0[block]
    }

    /// The values of a point.
    #[inline(always)]
    pub(super) fn values_of(&self, point: usize) -> impl Iterator<Item = f32> {
        self.columns().map(move |column| column[point])
    }

    #[inline(always)]
    fn find_boxes(&mut self) {
        // Never 0: a chunk has a length.
        let boxes = self.points.div_ceil(BLOCK).next_multiple_of(BLOCK).max(BLOCK);
        self.boxes = avec![f32::INFINITY; 6 * boxes];
        let (low, high) = self.boxes.split_at_mut(3 * boxes);
        let corners = low.chunks_exact_mut(boxes).zip(high.chunks_exact_mut(boxes));
        for (column, (low, high)) in self.columns.chunks_exact(self.stride).zip(corners) {
            for ((block, low), high) in column.as_chunks::<BLOCK>().0.iter().zip(low).zip(high) {
                [*low, *high] = extremes(block);
            }
        }
    }

    /// Finds the blocks that may have a point that near, in their order.
    #[inline(always)]
    pub(super) fn blocks_within<S: Simd>(
        &self,
        simd: S,
        [x, y, z]: [f32; 3],
        reach2: f32,
        found: &mut Vec<u32>,
    ) {
        let boxes = self.boxes.as_chunks::<BLOCK>().0;
        let (low, high) = boxes.split_at(boxes.len() / 2);
        let [[low_x, low_y, low_z], [high_x, high_y, high_z]] = [low, high].map(thirds);
        // Rounds like the distances of points: differences and squares never decrease with the distance along an axis.
        let outside = |low: f32, at: f32, high: f32| {
            let (below, above) = (low - at, at - high);
            let most = if below > above { below } else { above };
            if most > 0.0 { most * most } else { 0.0 }
        };
        let mut count = 0;
        found.resize(low_x.len() * BLOCK, 0);
        for place in 0..low_x.len() {
            let mut d2 = [0.0; BLOCK];
            for (lane, d2) in d2.iter_mut().enumerate() {
                let dx = outside(low_x[place][lane], x, high_x[place][lane]);
                let dy = outside(low_y[place][lane], y, high_y[place][lane]);
                let dz = outside(low_z[place][lane], z, high_z[place][lane]);
                *d2 = dx + dy + dz;
            }
            count = select(simd, &d2, [BELOW_ALL, reach2], (place * BLOCK) as u32, found, count);
        }
        found.truncate(count);
    }

    /// Finds the points within reach of a place among these blocks, in their order.
    #[inline(always)]
    pub(super) fn points_within<S: Simd>(
        &self,
        simd: S,
        centre: [f32; 3],
        reach2: f32,
        blocks: &[u32],
        found: &mut Vec<u32>,
    ) {
        let [x, y, z] = thirds(self.columns[..3 * self.stride].as_chunks::<BLOCK>().0);
        let mut count = 0;
        found.resize(blocks.len() * BLOCK, 0);
        for &block in blocks {
            let place = block as usize;
            let mut d2 = [0.0; BLOCK];
            for (lane, d2) in d2.iter_mut().enumerate() {
                let [dx, dy, dz] =
                    [x[place][lane] - centre[0], y[place][lane] - centre[1], z[place][lane] - centre[2]];
                *d2 = dx * dx + dy * dy + dz * dz;
            }
            count = select(simd, &d2, [BELOW_ALL, reach2], block * BLOCK as u32, found, count);
        }
        found.truncate(count);
    }

    /// A point's position, metres.
    #[inline(always)]
    pub(super) fn position(&self, point: usize) -> [f32; 3] {
        [0, 1, 2].map(|axis| self.columns[axis * self.stride + point])
    }
}

/// Three columns of the same length.
#[inline(always)]
fn thirds<T>(columns: &[T]) -> [&[T]; 3] {
    let (x, rest) = columns.split_at(columns.len() / 3);
    let (y, z) = rest.split_at(rest.len() / 2);
    [x, y, z]
}

/// The lowest and the highest value; a NaN is neither: nothing is near it.
#[inline(always)]
fn extremes(block: &[f32; BLOCK]) -> [f32; 2] {
    let (mut low, mut high) = ([f32::INFINITY; BLOCK], [f32::NEG_INFINITY; BLOCK]);
    for lane in 0..BLOCK {
        low[lane] = if block[lane] < f32::INFINITY { block[lane] } else { f32::INFINITY };
        high[lane] = if block[lane] > f32::NEG_INFINITY { block[lane] } else { f32::NEG_INFINITY };
    }
    for half in [8, 4, 2, 1] {
        for lane in 0..half {
            low[lane] = if low[lane + half] < low[lane] { low[lane + half] } else { low[lane] };
            high[lane] = if high[lane + half] > high[lane] { high[lane + half] } else { high[lane] };
        }
    }
    [low[0], high[0]]
}

/// Fills a table's positions, its normals, and the boxes about its blocks.
struct Place<'a> {
    table: &'a mut Table,
    points: &'a Points,
    /// Indices of the points that are used; all are, without.
    used: Option<&'a [usize]>,
    /// Where the normal is among the values, if it is one.
    normal: Option<usize>,
    /// Whether points are looked for by place.
    has_boxes: bool,
}

impl NullaryFnOnce for Place<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { table, points, used, normal, has_boxes } = self;
        match used {
            None => table.place(0, points.positions.iter().copied()),
            Some(used) => table.place(0, used.iter().map(|&index| points.positions[index])),
        }
        if let Some(normal) = normal {
            match used {
                None => table.place(normal, points.normals.iter().map(|normal| normal.unwrap_or_default())),
                Some(used) => {
                    table.place(normal, used.iter().map(|&index| points.normals[index].unwrap_or_default()));
                }
            }
        }
        if has_boxes {
            table.find_boxes();
        }
    }
}

/// Adds the bins of some values to codes.
struct AddBins<'a> {
    codes: &'a mut [f32],
    values: &'a [f32],
    axis: &'a PointAxis,
}

impl WithSimd for AddBins<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let stride = simd.splat_u32s(self.axis.stride);
        let values = S::as_simd_f32s(self.values).0;
        for (codes, &values) in S::as_mut_simd_f32s(self.codes).0.iter_mut().zip(values) {
            let bins = Floats::new(simd, values).edges_reached(&self.axis.edges);
            let code = simd.add_u32s(simd.transmute_u32s_f32s(*codes), simd.mul_u32s(bins, stride));
            *codes = simd.transmute_f32s_u32s(code);
        }
    }
}

impl Column {
    /// Writes the values of points of these colours; of codes, something to the end of the last block, too.
    fn write(&self, colours: &[[u8; 3]], mean: [i32; 2], place: &mut [f32]) {
        let axes = match self {
            Self::Difference(feature) | Self::Ratio(feature) => {
                return write_values(*feature, colours, mean, place);
            }
            Self::Code(axes) => axes,
        };
        place.fill(f32::from_bits(0));
        let mut values = vec![0.0; place.len()];
        for axis in axes {
            write_values(axis.feature, colours, mean, &mut values);
            widest(AddBins { codes: place, values: &values, axis });
        }
    }
}
