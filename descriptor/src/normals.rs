//! Surface normals: a plane fitted to the neighbourhood, turned towards the viewpoint (DESIGN 5.3).

use crate::eigen::smallest_eigenvector;
use crate::neighbours::{Candidates, RadiusSearch, floor_f32};

/// Neighbours without which no plane is fitted.
pub const MIN_NEIGHBOURS: usize = 3;

/// A unit normal; `None` for a query with fewer than [`MIN_NEIGHBOURS`] neighbours.
pub type Normal = Option<[f32; 3]>;

/// The normal of every query, fitted to all points of `search` within `radius` metres of it.
///
/// The normal is the eigenvector of the smallest eigenvalue of the neighbours' covariance, computed in f64 from
/// offsets to the query summed in ascending order of the points' indices, and turned so that it does not point away
/// from `viewpoint` (PCL: `NormalEstimation`, `flipNormalTowardsViewpoint`).
pub fn normals(
    search: &RadiusSearch<'_>,
    queries: &[[f32; 3]],
    radius: f64,
    viewpoint: [f32; 3],
) -> Vec<Normal> {
    let mut normals = vec![None; queries.len()];
    let mut candidates = Candidates::default();
    let mut patch = Patch::default();
    for group in groups(queries, radius).chunk_by(|a, b| a.0 == b.0) {
        let members = || group.iter().map(|&(_, index)| index as usize);
        let (centre, reach) = enclosing_ball(members().map(|member| queries[member]));
        search.candidates(centre, radius + reach, &mut candidates);
        patch.gather(search.points(), &candidates.indices);
        for member in members() {
            let query = queries[member];
            patch.select(query, radius);
            if patch.selected.len() >= MIN_NEIGHBOURS {
                let normal = smallest_eigenvector(patch.covariance(query));
                normals[member] = Some(towards(normal, query, viewpoint));
            }
        }
    }
    normals
}

/// Queries sorted by cube of edge `edge`, as (cube, index): close queries share one search.
///
/// Which queries share a search changes no result, only time; so cubes far from the first corner may be merged.
fn groups(queries: &[[f32; 3]], edge: f64) -> Vec<(u64, u32)> {
    const SIDE: f64 = (1u32 << 21) as f64;
    let mut corner = [f64::INFINITY; 3];
    for query in queries {
        for (corner, &coordinate) in corner.iter_mut().zip(query) {
            *corner = corner.min(f64::from(coordinate));
        }
    }
    let cube = |query: &[f32; 3]| {
        query.iter().zip(corner).fold(0u64, |cube, (&coordinate, corner)| {
            cube << 21 | ((f64::from(coordinate) - corner) / edge).min(SIDE - 1.0) as u64
        })
    };
    let mut groups: Vec<(u64, u32)> = queries.iter().map(cube).zip(0u32..).collect();
    groups.sort_unstable();
    groups
}

/// Centre of the bounding box of some points, and the largest distance of a point from it.
fn enclosing_ball(points: impl Iterator<Item = [f32; 3]> + Clone) -> ([f32; 3], f64) {
    let mut low = [f32::INFINITY; 3];
    let mut high = [f32::NEG_INFINITY; 3];
    for point in points.clone() {
        for axis in 0..3 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    let centre = [0, 1, 2].map(|axis| 0.5 * low[axis] + 0.5 * high[axis]);
    let mut reach2 = 0.0f64;
    for point in points {
        let [dx, dy, dz] = [0, 1, 2].map(|axis| f64::from(point[axis]) - f64::from(centre[axis]));
        reach2 = reach2.max(dx * dx + dy * dy + dz * dz);
    }
    (centre, reach2.sqrt())
}

/// The candidates of one group of queries, coordinate by coordinate.
#[derive(Default)]
struct Patch {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    d2: Vec<f32>,
    /// Positions in the patch of the current query's neighbours, ascending.
    selected: Vec<u32>,
}

impl Patch {
    fn gather(&mut self, points: &[[f32; 3]], indices: &[u32]) {
        let column = |axis: usize| indices.iter().map(move |&index| points[index as usize][axis]);
        self.x.clear();
        self.x.extend(column(0));
        self.y.clear();
        self.y.extend(column(1));
        self.z.clear();
        self.z.extend(column(2));
    }

    /// Selects the neighbours of a query. Both loops are free of branches: about half of the candidates are
    /// neighbours, in no pattern that a processor could predict.
    fn select(&mut self, query: [f32; 3], radius: f64) {
        let limit = floor_f32(radius * radius);
        self.d2.clear();
        self.d2.extend(self.x.iter().zip(&self.y).zip(&self.z).map(|((&x, &y), &z)| {
            let [dx, dy, dz] = [x - query[0], y - query[1], z - query[2]];
            dx * dx + dy * dy + dz * dz
        }));
        self.selected.resize(self.d2.len(), 0);
        let mut count = 0;
        for (&d2, position) in self.d2.iter().zip(0u32..) {
            self.selected[count] = position;
            count += usize::from(d2 <= limit);
        }
        self.selected.truncate(count);
    }

    /// Covariance of the selected points times their number squared, as [`smallest_eigenvector`] takes it.
    fn covariance(&self, query: [f32; 3]) -> [f64; 6] {
        let [qx, qy, qz] = query.map(f64::from);
        let [mut sx, mut sy, mut sz] = [0.0f64; 3];
        let [mut xx, mut xy, mut xz, mut yy, mut yz, mut zz] = [0.0f64; 6];
        for &position in &self.selected {
            let position = position as usize;
            let x = f64::from(self.x[position]) - qx;
            let y = f64::from(self.y[position]) - qy;
            let z = f64::from(self.z[position]) - qz;
            sx += x;
            sy += y;
            sz += z;
            xx += x * x;
            xy += x * y;
            xz += x * z;
            yy += y * y;
            yz += y * z;
            zz += z * z;
        }
        let n = self.selected.len() as f64;
        [
            n * xx - sx * sx,
            n * xy - sx * sy,
            n * xz - sx * sz,
            n * yy - sy * sy,
            n * yz - sy * sz,
            n * zz - sz * sz,
        ]
    }
}

/// The normal or its opposite, whichever does not point away from the viewpoint.
fn towards(normal: [f64; 3], point: [f32; 3], viewpoint: [f32; 3]) -> [f32; 3] {
    let [dx, dy, dz] = [0, 1, 2].map(|axis| f64::from(viewpoint[axis]) - f64::from(point[axis]));
    let away = dx * normal[0] + dy * normal[1] + dz * normal[2] < 0.0;
    normal.map(|component| (if away { -component } else { component }) as f32)
}
