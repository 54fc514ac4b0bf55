//! Keypoints: the centroid of every occupied voxel, cells and order as PCL's VoxelGrid (DESIGN 5.2).

use crate::Cloud;
use crate::prepare_error::PrepareError;

/// Keypoints of one cloud, one a voxel, z slowest and x fastest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Keypoints {
    /// Centroids, metres.
    pub points: Vec<[f32; 3]>,
    /// Mean colours, rounded down, if the cloud has colours.
    pub colours: Option<Vec<[u8; 3]>>,
}

impl Keypoints {
    /// The voxel grid of a cloud with voxels of edge `leaf` metres, anchored at the origin.
    ///
    /// As in PCL (`filters/impl/voxel_grid.hpp`) the cell of a coordinate is ⌊x · (1/leaf)⌋ in f32 and colours are
    /// averaged by channel and truncated. Positions are summed in f64 in the order of the points, then rounded.
    ///
    /// # Errors
    /// [`PrepareError::CellRange`] if a cell's index does not fit 32 bits.
    pub fn new(cloud: &Cloud, leaf: f32) -> Result<Self, PrepareError> {
        let per_metre = 1.0 / leaf;
        let mut keys: Vec<Key> = Vec::with_capacity(cloud.len());
        for (&[x, y, z], index) in cloud.points.iter().zip(0u32..) {
            let [x, y, z] = [cell(x, per_metre)?, cell(y, per_metre)?, cell(z, per_metre)?];
            keys.push([z, y, x, index].into_iter().fold(0, |key, part| key << 32 | Key::from(part)));
        }
        keys.sort_unstable();

        let mut keypoints = Self { points: Vec::new(), colours: cloud.colours.as_ref().map(|_| Vec::new()) };
        for voxel in keys.chunk_by(|a, b| a >> 32 == b >> 32) {
            let count = voxel.len() as f64;
            let members = || voxel.iter().map(|&key| key as u32 as usize);
            let mut sum = [0.0f64; 3];
            for member in members() {
                for (sum, &coordinate) in sum.iter_mut().zip(&cloud.points[member]) {
                    *sum += f64::from(coordinate);
                }
            }
            keypoints.points.push(sum.map(|sum| (sum / count) as f32));
            if let (Some(means), Some(colours)) = (&mut keypoints.colours, &cloud.colours) {
                let mut sum = [0u64; 3];
                for member in members() {
                    for (sum, &channel) in sum.iter_mut().zip(&colours[member]) {
                        *sum += u64::from(channel);
                    }
                }
                means.push(sum.map(|sum| (sum / voxel.len() as u64) as u8));
            }
        }
        Ok(keypoints)
    }

    /// Number of keypoints.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no keypoint (the cloud is empty).
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }
}

/// A voxel and the index of a point in it, in one number to sort by: z, y, x, index.
type Key = u128;

/// Index of the voxel along one axis, counted from the lowest that there can be.
fn cell(coordinate: f32, per_metre: f32) -> Result<u32, PrepareError> {
    let cell = (coordinate * per_metre).floor();
    // Both bounds are exact in f32; NaN and infinities fail the test as well.
    if (-2_147_483_648.0..2_147_483_648.0).contains(&cell) {
        Ok((cell as i32).wrapping_sub(i32::MIN) as u32)
    } else {
        Err(PrepareError::CellRange { coordinate, leaf: 1.0 / per_metre })
    }
}
