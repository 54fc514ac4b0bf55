//! Values of points in fours, point after point: what is drawn is moved in few steps.

use pulp::NullaryFnOnce;

/// Values of a point that are moved together.
pub(super) const QUAD: usize = 4;

/// Values of points, point after point, four at a time: of all points the first four, then the next.
#[derive(Default)]
pub(super) struct Quads {
    /// Number of points.
    points: usize,
    values: Vec<[f32; QUAD]>,
}

impl Quads {
    /// Four values of all points.
    #[inline(always)]
    pub(super) fn quads(&self, quad: usize) -> &[[f32; QUAD]] {
        &self.values[quad * self.points..][..self.points]
    }

    /// Takes over some points of others.
    #[inline(always)]
    pub(super) fn take(&mut self, values: usize, points: &Self, indices: &[u32]) {
        self.points = indices.len();
        self.values.clear();
        for quad in 0..values.div_ceil(QUAD) {
            let quads = points.quads(quad);
            self.values.extend(indices.iter().map(|&index| quads[index as usize]));
        }
    }
}

/// Makes quads of so many points, at least one, from their values in columns as long as `stride`, one after the other.
pub(super) struct Interleave<'a> {
    pub(super) points: usize,
    pub(super) columns: &'a [f32],
    pub(super) stride: usize,
}

impl NullaryFnOnce for Interleave<'_> {
    type Output = Quads;

    #[inline(always)]
    fn call(self) -> Quads {
        let Self { points, columns, stride } = self;
        let zeros = vec![0.0; stride];
        let mut values = vec![[0.0; QUAD]; (columns.len() / stride).div_ceil(QUAD) * points];
        for (quads, columns) in values.chunks_exact_mut(points).zip(columns.chunks(QUAD * stride)) {
            let column = |number: usize| columns.chunks_exact(stride).nth(number).unwrap_or(&zeros);
            let [a, b, c, d] = [column(0), column(1), column(2), column(3)];
            for ((((quad, a), b), c), d) in quads.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                *quad = [*a, *b, *c, *d];
            }
        }
        Quads { points, values }
    }
}
