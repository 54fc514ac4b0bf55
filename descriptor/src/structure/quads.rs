//! Values of points in fours, point after point: what is drawn is moved in few steps.

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
    /// Of so many points, from their values in columns as long as `stride`, one after the other.
    pub(super) fn new(points: usize, columns: &[f32], stride: usize) -> Self {
        let zeros = vec![0.0; stride];
        let mut values = Vec::with_capacity((columns.len() / stride).div_ceil(QUAD) * points);
        for columns in columns.chunks(QUAD * stride) {
            let column = |number: usize| columns.chunks_exact(stride).nth(number).unwrap_or(&zeros);
            let [a, b, c, d] = [0, 1, 2, 3].map(column);
            let quads = a.iter().zip(b).zip(c).zip(d).map(|(((&a, &b), &c), &d)| [a, b, c, d]);
            values.extend(quads.take(points));
        }
        Self { points, values }
    }

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
