//! Radius search: every point of a cloud within a distance, decided exactly and in a fixed order.
//!
//! Serves few queries on a cloud, such as whether any keypoint has enough neighbours. Where many points ask at once,
//! [`crate::cell_list`] and [`crate::surface`] are faster.

use std::cmp::Ordering;

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use crate::prepare_error::PrepareError;

/// A point found by a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    /// Squared distance as [`squared_distance`] computes it, square metres.
    pub d2: f32,
    /// Index of the point in the cloud.
    pub index: u32,
}

impl Neighbour {
    /// Nearest first, ties to the lowest index.
    pub fn order(&self, other: &Self) -> Ordering {
        self.d2.total_cmp(&other.d2).then(self.index.cmp(&other.index))
    }
}

/// Squared distance of two points in f32, evaluated in this order on every target.
pub fn squared_distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    let [dx, dy, dz] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    dx * dx + dy * dy + dz * dz
}

/// The largest f32 not above `value`: `d2 <= floor_f32(r²)` in f32 is `d2 <= r²` in f64, bit for bit.
pub(crate) fn floor_f32(value: f64) -> f32 {
    let nearest = value as f32;
    if f64::from(nearest) > value { nearest.next_down() } else { nearest }
}

/// An index over the points of one cloud.
///
/// The k-d tree only proposes candidates, for a slightly larger radius; who is a neighbour is decided here, so that
/// results do not depend on how the tree rounds or in which order it walks.
pub struct RadiusSearch<'a> {
    points: &'a [[f32; 3]],
    tree: ImmutableKdTree<f32, 3>,
}

impl<'a> RadiusSearch<'a> {
    /// Builds the index; any number of points, equal ones included.
    ///
    /// # Errors
    /// [`PrepareError::TooManyPoints`] if the points cannot be counted in 32 bits.
    pub fn new(points: &'a [[f32; 3]]) -> Result<Self, PrepareError> {
        let too_many = || PrepareError::TooManyPoints { points: points.len() };
        u32::try_from(points.len()).map_err(|_| too_many())?;
        // The immutable tree's leaves grow as needed: a mutable one cannot split a full bucket of points that are
        // equal in its split axis.
        let tree = ImmutableKdTree::new_from_slice(points).map_err(|_| too_many())?;
        Ok(Self { points, tree })
    }

    /// The indexed points.
    pub fn points(&self) -> &'a [[f32; 3]] {
        self.points
    }

    /// All points with d² ≤ radius² (compared in f64), nearest first, ties by index.
    pub fn within(&self, query: [f32; 3], radius: f64) -> Vec<Neighbour> {
        let mut candidates = Vec::new();
        self.candidates(query, radius, &mut candidates);
        let limit = floor_f32(radius * radius);
        let mut found: Vec<Neighbour> = candidates
            .iter()
            .map(|&index| Neighbour { d2: squared_distance(self.points[index as usize], query), index })
            .filter(|neighbour| neighbour.d2 <= limit)
            .collect();
        found.sort_unstable_by(Neighbour::order);
        found
    }

    /// Number of points with d² ≤ radius², counted up to `enough`.
    pub fn count_within(&self, query: [f32; 3], radius: f64, enough: usize) -> usize {
        let mut candidates = Vec::new();
        self.candidates(query, radius, &mut candidates);
        let limit = floor_f32(radius * radius);
        let is_near = |&&index: &&u32| squared_distance(self.points[index as usize], query) <= limit;
        candidates.iter().filter(is_near).take(enough).count()
    }

    /// Every point that could be within `radius` of `centre`, and some more, in any order.
    fn candidates(&self, centre: [f32; 3], radius: f64, found: &mut Vec<u32>) {
        // The tree's own rounding is below one part in a million of d².
        let limit = (radius * radius * 1.000_1) as f32;
        if limit.is_finite() {
            let query = self.tree.query(&centre).within::<SquaredEuclidean<f32>>(limit);
            query.unsorted().visit(|candidate| found.push(candidate.item));
        } else {
            found.extend((0u32..).take(self.points.len()));
        }
    }
}
