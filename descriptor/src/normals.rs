//! Surface normals: a plane fitted to the neighbourhood, turned towards the viewpoint (DESIGN 5.3).

use std::array;
use std::ops::Range;

use pulp::{Simd, WithSimd};

use crate::cell_list::{BEYOND, CellList, Queries};
use crate::eigen::{LANES, smallest_eigenvector, smallest_eigenvectors};
use crate::neighbours::{floor_f32, squared_distance};
use crate::prepare_error::PrepareError;
use crate::select::{BELOW_ALL, select};
use crate::wide::widest;

/// Neighbours without which no plane is fitted.
pub const MIN_NEIGHBOURS: usize = 3;

/// What must be left of the sum of squared offsets when their mean is taken off: with less, the sums' rounding counts.
const LEAST_SPREAD: f64 = 0.01;

/// A unit normal; `None` for a query with fewer than [`MIN_NEIGHBOURS`] neighbours.
pub type Normal = Option<[f32; 3]>;

/// The normals of a cloud's points and of other queries (its keypoints), each fitted to all points within `radius`
/// metres.
///
/// The normal is the eigenvector of the smallest eigenvalue of the neighbours' covariance, turned so that it does not
/// point away from `viewpoint` (PCL: `NormalEstimation`, `flipNormalTowardsViewpoint`). The covariance comes from
/// offsets to the query and their products, summed in the order of [`CellList`] in f32, as PCL's
/// (`computeMeanAndCovarianceMatrix`); where the rounding of these sums would turn the plane, because neighbours lie
/// nearly in a line or close together and far from the query, once more in f64. What follows is f64.
///
/// # Errors
/// [`PrepareError::TooManyPoints`] if points and other queries cannot be counted in 32 bits.
pub fn normals(
    points: &[[f32; 3]],
    others: &[[f32; 3]],
    radius: f64,
    viewpoint: [f32; 3],
) -> Result<[Vec<Normal>; 2], PrepareError> {
    let mut of_points = vec![None; points.len()];
    let mut of_others = vec![None; others.len()];
    // All at once: lanes that the points leave empty are filled with other queries.
    fit(points, others, radius, viewpoint, Queries::All, |index, normal| match of_points.get_mut(index) {
        Some(place) => *place = Some(normal),
        None => of_others[index - points.len()] = Some(normal),
    })?;
    Ok([of_points, of_others])
}

/// The normals of queries other than a cloud's points: those that [`normals`] gives them.
///
/// # Errors
/// As [`normals`].
pub fn normals_at(
    queries: &[[f32; 3]],
    points: &[[f32; 3]],
    radius: f64,
    viewpoint: [f32; 3],
) -> Result<Vec<Normal>, PrepareError> {
    let mut found = vec![None; queries.len()];
    fit(points, queries, radius, viewpoint, Queries::Others, |index, normal| {
        found[index - points.len()] = Some(normal);
    })?;
    Ok(found)
}

/// Fits planes at queries and hands on their normals; the others are numbered after the points.
fn fit(
    points: &[[f32; 3]],
    others: &[[f32; 3]],
    radius: f64,
    viewpoint: [f32; 3],
    wanted: Queries,
    mut found: impl FnMut(usize, [f32; 3]),
) -> Result<(), PrepareError> {
    let cells = CellList::new(points, radius, others.len())?;
    let position = cells.position().each_ref().map(Vec::as_slice);
    let limit = floor_f32(radius * radius);
    let mut places = Vec::new();
    cells.batches(wanted, others, LANES, |batch| {
        let query = |index: u32| {
            let index = index as usize;
            points.get(index).copied().unwrap_or_else(|| others[index - points.len()])
        };
        let (Some(&first), Some(&last)) = (batch.first(), batch.last()) else { return };
        let runs = cells.near(query(first), query(last));
        // Lanes without a query repeat the first one.
        let lanes: [[f32; 3]; LANES] = array::from_fn(|lane| query(*batch.get(lane).unwrap_or(&first)));
        let queries = [0, 1, 2].map(|axis| lanes.map(|query| query[axis]));
        let places = &mut places;
        let (candidates, planes) =
            widest(Fit { queries: &queries, viewpoint, position, runs: &runs, limit, places });
        let near = Near { position, places: &places[..candidates], limit };
        for (lane, &index) in batch.iter().enumerate() {
            if (planes.count[lane] as usize) < MIN_NEIGHBOURS {
                continue;
            }
            let normal = planes.normals.map(|values| values[lane]);
            let normal = if normal[0].is_nan() { near.fit_exactly(lanes[lane], viewpoint) } else { normal };
            found(index as usize, normal);
        }
    });
    Ok(())
}

/// Where the neighbours of some queries are.
#[derive(Clone, Copy)]
struct Near<'a> {
    /// x, y, z of the points.
    position: [&'a [f32]; 3],
    /// Which of them; neighbours are not elsewhere.
    places: &'a [u32],
    /// Largest d² of a neighbour.
    limit: f32,
}

impl Near<'_> {
    /// Every point that may be a neighbour.
    #[inline(always)]
    fn candidates(&self) -> impl Iterator<Item = [f32; 3]> {
        let [x, y, z] = self.position;
        self.places.iter().map(move |&place| [x[place as usize], y[place as usize], z[place as usize]])
    }

    /// The normal of one query, from sums in f64.
    fn fit_exactly(&self, query: [f32; 3], viewpoint: [f32; 3]) -> [f32; 3] {
        let mut n = 0.0f64;
        let [mut sx, mut sy, mut sz] = [0.0f64; 3];
        let [mut sxx, mut sxy, mut sxz, mut syy, mut syz, mut szz] = [0.0f64; 6];
        for point in self.candidates().filter(|&point| squared_distance(point, query) <= self.limit) {
            let [x, y, z] = [0, 1, 2].map(|axis| f64::from(point[axis]) - f64::from(query[axis]));
            n += 1.0;
            (sx, sy, sz) = (sx + x, sy + y, sz + z);
            (sxx, sxy, sxz) = (sxx + x * x, sxy + x * y, sxz + x * z);
            (syy, syz, szz) = (syy + y * y, syz + y * z, szz + z * z);
        }
        let normal = smallest_eigenvector([
            n * sxx - sx * sx,
            n * sxy - sx * sy,
            n * sxz - sx * sz,
            n * syy - sy * sy,
            n * syz - sy * sz,
            n * szz - sz * sz,
        ]);
        towards(normal, query, viewpoint)
    }
}

/// What is fitted in each lane.
struct Planes {
    /// Number of neighbours.
    count: [u32; LANES],
    /// x, y, z; NaN where f32 sums are not good enough.
    normals: [[f32; LANES]; 3],
}

/// The kernel of [`normals`].
struct Fit<'a> {
    /// x, y, z.
    queries: &'a [[f32; LANES]; 3],
    viewpoint: [f32; 3],
    /// x, y, z of the points.
    position: [&'a [f32]; 3],
    /// Which of them may be neighbours.
    runs: &'a [Range<usize>],
    /// Largest d² of a neighbour.
    limit: f32,
    /// Filled with the points that are near to any query, and some more.
    places: &'a mut Vec<u32>,
}

impl Fit<'_> {
    /// Fills `places` with the points that are near to the box around all queries, in their order; how many they are.
    ///
    /// Rounds like the distances of points, so that no neighbour is left out: differences and squares never decrease with
    /// the distance along an axis, however they round.
    #[inline(always)]
    fn select<S: Simd>(&mut self, simd: S) -> usize {
        let (mut low, mut high) = ([0.0f32; 3], [0.0f32; 3]);
        for axis in 0..3 {
            let values = &self.queries[axis];
            (low[axis], high[axis]) = (values[0], values[0]);
            for &value in values {
                low[axis] = if value < low[axis] { value } else { low[axis] };
                high[axis] = if value > high[axis] { value } else { high[axis] };
            }
        }
        let candidates: usize = self.runs.iter().map(|run| run.len() + BEYOND).sum();
        self.places.resize(self.places.len().max(candidates), 0);
        let mut count = 0;
        for run in self.runs {
            for start in run.clone().step_by(BEYOND) {
                let mut d2 = [0.0; BEYOND];
                let [x, y, z] =
                    self.position.map(|values| &values[start..start + BEYOND].as_chunks::<BEYOND>().0[0]);
                let left = (run.end - start) as u32;
                for (i, d2) in (0u32..).zip(&mut d2) {
                    let outside = |axis: usize, value: f32| {
                        let nearest = if value < low[axis] { low[axis] } else { value };
                        let nearest = if nearest > high[axis] { high[axis] } else { nearest };
                        value - nearest
                    };
                    let place = i as usize;
                    let (x, y, z) = (outside(0, x[place]), outside(1, y[place]), outside(2, z[place]));
                    *d2 = if i < left { x * x + y * y + z * z } else { f32::INFINITY };
                }
                count = select(simd, &d2, [BELOW_ALL, self.limit], start as u32, self.places, count);
            }
        }
        count
    }
}

impl WithSimd for Fit<'_> {
    type Output = (usize, Planes);

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) -> (usize, Planes) {
        let candidates = self.select(simd);
        let [qx, qy, qz] = self.queries;
        let mut count = [0u32; LANES];
        let [mut sx, mut sy, mut sz] = [[0.0f32; LANES]; 3];
        let [mut sxx, mut sxy, mut sxz, mut syy, mut syz, mut szz] = [[0.0f32; LANES]; 6];
        let limit = self.limit;
        let [px, py, pz] = self.position;
        for &place in &self.places[..candidates] {
            let place = place as usize;
            let (px, py, pz) = (px[place], py[place], pz[place]);
            for lane in 0..LANES {
                let (x, y, z) = (px - qx[lane], py - qy[lane], pz - qz[lane]);
                let d2 = x * x + y * y + z * z;
                // Adding zero leaves a sum as it is: a candidate that is no neighbour might as well not be there.
                // By bits, as a select of floats would be taken for a branch.
                let mask = if d2 <= limit { u32::MAX } else { 0 };
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
        let [x, y, z] = smallest_eigenvectors(&covariance);
        let mut normals = [[0.0f32; LANES]; 3];
        for lane in 0..LANES {
            let normal = if is_spread[lane] { [x[lane], y[lane], z[lane]] } else { [f64::NAN; 3] };
            let normal = towards(normal, [qx[lane], qy[lane], qz[lane]], self.viewpoint);
            (normals[0][lane], normals[1][lane], normals[2][lane]) = (normal[0], normal[1], normal[2]);
        }
        (candidates, Planes { count, normals })
    }
}

/// The normal or its opposite, whichever does not point away from the viewpoint.
#[inline(always)]
fn towards([x, y, z]: [f64; 3], point: [f32; 3], viewpoint: [f32; 3]) -> [f32; 3] {
    let to_viewpoint = |axis: usize| f64::from(viewpoint[axis]) - f64::from(point[axis]);
    let away = to_viewpoint(0) * x + to_viewpoint(1) * y + to_viewpoint(2) * z < 0.0;
    let turned = |component: f64| (if away { -component } else { component }) as f32;
    [turned(x), turned(y), turned(z)]
}
