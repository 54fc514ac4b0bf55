//! The local reference frame of SHOT: axes that turn with the surface about a keypoint.

use std::cmp::Ordering;

use pulp::NullaryFnOnce;

use super::neighbourhood::{GROUP, Neighbourhood, group};
use crate::eigen::extreme_eigenvectors;
use crate::neighbours::{Neighbour, squared_distance};
use crate::wide::widest;

/// Neighbours without which there is no frame.
const MIN_NEIGHBOURS: usize = 5;

/// Neighbours summed at once, each in a lane of its own.
const LANES: usize = 8;

/// Unit vectors at right angles: x along the surface, z off it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frame {
    pub(super) x: [f32; 3],
    pub(super) y: [f32; 3],
    pub(super) z: [f32; 3],
}

impl Frame {
    /// The frame of a keypoint, or `None` with fewer than [`MIN_NEIGHBOURS`] neighbours; none of them may be at the
    /// keypoint itself, and all lie within `radius` metres.
    ///
    /// As in PCL (`SHOTLocalReferenceFrameEstimation`): eigenvectors of the covariance about the keypoint, in which a
    /// neighbour at the distance d weighs radius − d; x, of the largest eigenvalue, and z, of the smallest, point to where
    /// most neighbours are.
    pub(super) fn new(near: &Neighbourhood, keypoint: [f32; 3], radius: f64) -> Option<Self> {
        if near.len() < MIN_NEIGHBOURS {
            return None;
        }
        let offsets = Offsets { near, keypoint };
        let [z, x] = extreme_eigenvectors(widest(Covariance { offsets, radius }));
        let [x, z] = [x, z].map(|axis| offsets.towards_most(axis).map(|component| component as f32));
        let y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]];
        Some(Self { x, y, z })
    }
}

/// Neighbours as seen from the keypoint.
#[derive(Clone, Copy)]
struct Offsets<'a> {
    near: &'a Neighbourhood,
    keypoint: [f32; 3],
}

impl Offsets<'_> {
    /// Offset of a neighbour, exact but for the subtraction in f32.
    fn get(&self, index: usize) -> [f32; 3] {
        [0, 1, 2].map(|axis| self.near.position[axis][index] - self.keypoint[axis])
    }

    /// Offsets of the group of neighbours that begins at `start`, axis by axis; what lies beyond the last one is no
    /// neighbour.
    #[inline(always)]
    fn group(&self, start: usize) -> [[f32; GROUP]; 3] {
        let mut offsets = [[0.0; GROUP]; 3];
        for ((offsets, list), at) in offsets.iter_mut().zip(&self.near.position).zip(self.keypoint) {
            for (offset, value) in offsets.iter_mut().zip(group(list, start)) {
                *offset = value - at;
            }
        }
        offsets
    }

    /// The axis or its opposite, whichever has more neighbours ahead of it (those at right angles count as ahead); if none
    /// has, that which most of the five neighbours of middle distance lie ahead of.
    fn towards_most(&self, axis: [f64; 3]) -> [f64; 3] {
        let behind = widest(Behind { offsets: *self, axis }) as usize;
        let is_opposite = match (2 * behind).cmp(&self.near.len()) {
            Ordering::Less => false,
            Ordering::Greater => true,
            Ordering::Equal => {
                let ahead = self.middle_five().map(|offset| dot(offset, axis) > 0.0);
                ahead.into_iter().filter(|&is_ahead| is_ahead).count() < 3
            }
        };
        if is_opposite { axis.map(|component| -component) } else { axis }
    }

    /// The neighbours whose distances are the middle ones, at least [`MIN_NEIGHBOURS`] being there.
    fn middle_five(&self) -> [[f32; 3]; 5] {
        let distance =
            |index: u32| Neighbour { d2: squared_distance(self.get(index as usize), [0.0; 3]), index };
        let mut sorted: Vec<Neighbour> = (0u32..).take(self.near.len()).map(distance).collect();
        sorted.sort_unstable_by(Neighbour::order);
        let first = sorted.len() / 2 - 2;
        [0, 1, 2, 3, 4].map(|next| self.get(sorted[first + next].index as usize))
    }
}

#[inline(always)]
fn dot(offset: [f32; 3], axis: [f64; 3]) -> f64 {
    let [x, y, z] = offset.map(f64::from);
    x * axis[0] + y * axis[1] + z * axis[2]
}

/// The weighted covariance about the keypoint but for a factor: xx, xy, xz, yy, yz, zz.
struct Covariance<'a> {
    offsets: Offsets<'a>,
    radius: f64,
}

impl NullaryFnOnce for Covariance<'_> {
    type Output = [f64; 6];

    #[inline(always)]
    fn call(self) -> [f64; 6] {
        let neighbours = self.offsets.near.len();
        let mut sums = [[0.0f64; LANES]; 6];
        for start in (0..neighbours).step_by(GROUP) {
            let [x, y, z] = self.offsets.group(start);
            let mut weights = [0.0; GROUP];
            for (lane, weight) in weights.iter_mut().enumerate() {
                let distance = f64::from((x[lane] * x[lane] + y[lane] * y[lane] + z[lane] * z[lane]).sqrt());
                *weight = if start + lane < neighbours { self.radius - distance } else { 0.0 };
            }
            let [x, y, z] = [&x, &y, &z].map(|list| list.as_chunks::<LANES>().0);
            for (((weights, x), y), z) in weights.as_chunks::<LANES>().0.iter().zip(x).zip(y).zip(z) {
                for lane in 0..LANES {
                    let (weight, x, y, z) =
                        (weights[lane], f64::from(x[lane]), f64::from(y[lane]), f64::from(z[lane]));
                    let (wx, wy, wz) = (weight * x, weight * y, weight * z);
                    sums[0][lane] += wx * x;
                    sums[1][lane] += wx * y;
                    sums[2][lane] += wx * z;
                    sums[3][lane] += wy * y;
                    sums[4][lane] += wy * z;
                    sums[5][lane] += wz * z;
                }
            }
        }
        sums.map(|lanes| lanes.iter().sum())
    }
}

/// The number of neighbours behind a plane through the keypoint.
struct Behind<'a> {
    offsets: Offsets<'a>,
    axis: [f64; 3],
}

impl NullaryFnOnce for Behind<'_> {
    type Output = u32;

    #[inline(always)]
    fn call(self) -> u32 {
        let neighbours = self.offsets.near.len();
        let mut behind = [0; GROUP];
        for start in (0..neighbours).step_by(GROUP) {
            let [x, y, z] = self.offsets.group(start);
            for (lane, behind) in behind.iter_mut().enumerate() {
                let is_behind = dot([x[lane], y[lane], z[lane]], self.axis) < 0.0;
                *behind += u32::from(is_behind & (start + lane < neighbours));
            }
        }
        behind.iter().sum()
    }
}
