//! Surface normals: a plane fitted to the neighbourhood, turned towards the viewpoint (DESIGN 5.3).

use pulp::NullaryFnOnce;

use crate::cubes::Cubes;
use crate::eigen::{LANES, smallest_eigenvector, smallest_eigenvectors};
use crate::neighbours::{floor_f32, squared_distance};
use crate::prepare::PrepareError;
use crate::wide::widest;

/// Neighbours without which no plane is fitted.
pub const MIN_NEIGHBOURS: usize = 3;

/// What must be left of the sum of squared offsets when their mean is taken off: with less, the sums' rounding counts.
const LEAST_SPREAD: f64 = 0.01;

/// A unit normal; `None` for a query with fewer than [`MIN_NEIGHBOURS`] neighbours.
pub type Normal = Option<[f32; 3]>;

/// The normals of a cloud's points and of other places (its keypoints), each fitted to all points within `radius`
/// metres.
///
/// The normal is the eigenvector of the smallest eigenvalue of the neighbours' covariance, turned so that it does not
/// point away from `viewpoint` (PCL: `NormalEstimation`, `flipNormalTowardsViewpoint`). The covariance comes from
/// offsets to the query and their products, summed in the order of [`Cubes`] in f32, as PCL's
/// (`computeMeanAndCovarianceMatrix`); where the rounding of these sums would turn the plane, because neighbours lie
/// nearly in a line or close together and far from the query, once more in f64. What follows is f64.
///
/// # Errors
/// [`PrepareError::TooManyPoints`] if the points cannot be counted in 32 bits.
pub fn normals<const N: usize>(
    points: &[[f32; 3]],
    queries: [&[[f32; 3]]; N],
    radius: f64,
    viewpoint: [f32; 3],
) -> Result<[Vec<Normal>; N], PrepareError> {
    let most_queries = queries.iter().map(|queries| queries.len()).max().unwrap_or(0);
    let cubes = Cubes::new(points, radius, most_queries)?;
    Ok(queries.map(|queries| fit(&cubes, queries, floor_f32(radius * radius), viewpoint)))
}

/// `limit` is the largest d² of a neighbour.
fn fit(cubes: &Cubes, queries: &[[f32; 3]], limit: f32, viewpoint: [f32; 3]) -> Vec<Normal> {
    let mut normals = vec![None; queries.len()];
    let mut candidates: Vec<[f32; 3]> = Vec::new();
    for group in cubes.groups(queries) {
        let Some(&first) = group.first() else { continue };
        candidates.clear();
        cubes.near(queries[first as usize], &mut candidates);
        for members in group.chunks(LANES) {
            // Lanes without a query repeat the first one.
            let mut lanes = [[0.0f32; LANES]; 3];
            for lane in 0..LANES {
                let query = queries[*members.get(lane).unwrap_or(&members[0]) as usize];
                for axis in 0..3 {
                    lanes[axis][lane] = query[axis];
                }
            }
            let planes = widest(Fit { queries: &lanes, candidates: &candidates, limit });
            for (lane, &member) in members.iter().enumerate() {
                if (planes.count[lane] as usize) < MIN_NEIGHBOURS {
                    continue;
                }
                let query = queries[member as usize];
                let normal = planes.normals.map(|values| values[lane]);
                let normal = if normal[0].is_nan() { fit_exactly(&candidates, query, limit) } else { normal };
                normals[member as usize] = Some(towards(normal, query, viewpoint));
            }
        }
    }
    normals
}

/// The normal of one query, from sums in f64.
fn fit_exactly(candidates: &[[f32; 3]], query: [f32; 3], limit: f32) -> [f64; 3] {
    let mut n = 0.0f64;
    let [mut sx, mut sy, mut sz] = [0.0f64; 3];
    let [mut sxx, mut sxy, mut sxz, mut syy, mut syz, mut szz] = [0.0f64; 6];
    for &point in candidates.iter().filter(|&&point| squared_distance(point, query) <= limit) {
        let [x, y, z] = [0, 1, 2].map(|axis| f64::from(point[axis]) - f64::from(query[axis]));
        n += 1.0;
        (sx, sy, sz) = (sx + x, sy + y, sz + z);
        (sxx, sxy, sxz) = (sxx + x * x, sxy + x * y, sxz + x * z);
        (syy, syz, szz) = (syy + y * y, syz + y * z, szz + z * z);
    }
    smallest_eigenvector([
        n * sxx - sx * sx,
        n * sxy - sx * sy,
        n * sxz - sx * sz,
        n * syy - sy * sy,
        n * syz - sy * sz,
        n * szz - sz * sz,
    ])
}

/// What is fitted in each lane.
struct Planes {
    /// Number of neighbours.
    count: [u32; LANES],
    /// x, y, z; see [`smallest_eigenvectors`].
    normals: [[f64; LANES]; 3],
}

/// The kernel of [`fit`].
struct Fit<'a> {
    /// x, y, z.
    queries: &'a [[f32; LANES]; 3],
    candidates: &'a [[f32; 3]],
    /// Largest d² of a neighbour.
    limit: f32,
}

impl NullaryFnOnce for Fit<'_> {
    type Output = Planes;

    #[inline(always)]
    fn call(self) -> Planes {
        let [qx, qy, qz] = self.queries;
        let mut count = [0u32; LANES];
        let [mut sx, mut sy, mut sz] = [[0.0f32; LANES]; 3];
        let [mut sxx, mut sxy, mut sxz, mut syy, mut syz, mut szz] = [[0.0f32; LANES]; 6];
        for &[px, py, pz] in self.candidates {
            for lane in 0..LANES {
                let (x, y, z) = (px - qx[lane], py - qy[lane], pz - qz[lane]);
                let d2 = x * x + y * y + z * z;
                // Adding zero leaves a sum as it is: a candidate that is no neighbour might as well not be there.
                // By bits, as a select of floats would be taken for a branch.
                let mask = if d2 <= self.limit { u32::MAX } else { 0 };
                let only = |value: f32| f32::from_bits(value.to_bits() & mask);
                let (x, y, z) = (only(x), only(y), only(z));
                count[lane] += mask & 1;
                sx[lane] += x;
                sy[lane] += y;
                sz[lane] += z;
                sxx[lane] += x * x;
                sxy[lane] += x * y;
                sxz[lane] += x * z;
                syy[lane] += y * y;
                syz[lane] += y * z;
                szz[lane] += z * z;
            }
        }
        let mut covariance = [[0.0f64; LANES]; 6];
        let mut is_spread = [false; LANES];
        for lane in 0..LANES {
            let n = f64::from(count[lane]);
            let [x, y, z] = [sx[lane], sy[lane], sz[lane]].map(f64::from);
            let [xx, yy, zz] = [sxx[lane], syy[lane], szz[lane]].map(|sum| n * f64::from(sum));
            covariance[0][lane] = xx - x * x;
            covariance[1][lane] = n * f64::from(sxy[lane]) - x * y;
            covariance[2][lane] = n * f64::from(sxz[lane]) - x * z;
            covariance[3][lane] = yy - y * y;
            covariance[4][lane] = n * f64::from(syz[lane]) - y * z;
            covariance[5][lane] = zz - z * z;
            let trace = covariance[0][lane] + covariance[3][lane] + covariance[5][lane];
            is_spread[lane] = trace > LEAST_SPREAD * (xx + yy + zz);
        }
        let mut normals = smallest_eigenvectors(&covariance);
        for lane in 0..LANES {
            normals[0][lane] = if is_spread[lane] { normals[0][lane] } else { f64::NAN };
        }
        Planes { count, normals }
    }
}

/// The normal or its opposite, whichever does not point away from the viewpoint.
fn towards(normal: [f64; 3], point: [f32; 3], viewpoint: [f32; 3]) -> [f32; 3] {
    let [dx, dy, dz] = [0, 1, 2].map(|axis| f64::from(viewpoint[axis]) - f64::from(point[axis]));
    let away = dx * normal[0] + dy * normal[1] + dz * normal[2] < 0.0;
    normal.map(|component| (if away { -component } else { component }) as f32)
}
