//! Keypoints: the centroid of every occupied voxel, cells and order as PCL's VoxelGrid (DESIGN 5.2).

use crate::Cloud;
use crate::cell_list;
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
        let cells = Cells::new(cloud, 1.0 / leaf)?;
        let mut keypoints = Self { points: Vec::new(), colours: cloud.colours.as_ref().map(|_| Vec::new()) };
        for voxel in cells.order.chunk_by(|&a, &b| cells.of_point[a as usize] == cells.of_point[b as usize]) {
            let count = voxel.len() as f64;
            let members = || voxel.iter().map(|&index| index as usize);
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

/// The points of a cloud by voxel: z, y, x, and in a voxel by index.
struct Cells {
    /// x, y, z of each point's voxel, counted from the lowest that there can be.
    of_point: Vec<[u32; 3]>,
    /// Indices of the points.
    order: Vec<u32>,
}

impl Cells {
    fn new(cloud: &Cloud, per_metre: f32) -> Result<Self, PrepareError> {
        let (mut low, mut high) = ([u32::MAX; 3], [0; 3]);
        let mut of_point = Vec::with_capacity(cloud.len());
        for &[x, y, z] in &cloud.points {
            let voxel = [cell(x, per_metre)?, cell(y, per_metre)?, cell(z, per_metre)?];
            for axis in 0..3 {
                low[axis] = low[axis].min(voxel[axis]);
                high[axis] = high[axis].max(voxel[axis]);
            }
            of_point.push(voxel);
        }
        let bits = [0, 1, 2].map(|axis| u32::BITS - high[axis].saturating_sub(low[axis]).leading_zeros());
        let order = if bits.iter().sum::<u32>() < u64::BITS {
            let pack = |voxel: &[u32; 3]| {
                let [x, y, z] = [0, 1, 2].map(|axis| u64::from(voxel[axis].saturating_sub(low[axis])));
                (z << bits[1] | y) << bits[0] | x
            };
            cell_list::sort(&of_point.iter().map(pack).collect::<Vec<_>>(), pack(&high)).0
        } else {
            let mut order: Vec<u32> = (0u32..).take(cloud.len()).collect();
            order.sort_unstable_by_key(|&index| {
                let [x, y, z] = of_point[index as usize];
                [z, y, x, index]
            });
            order
        };
        Ok(Self { of_point, order })
    }
}

/// Index of the voxel along one axis, counted from the lowest that there can be.
fn cell(coordinate: f32, per_metre: f32) -> Result<u32, PrepareError> {
    let scaled = coordinate * per_metre;
    // Both bounds are exact in f32; NaN and infinities fail the test as well.
    if (-2_147_483_648.0..2_147_483_648.0).contains(&scaled) {
        // ⌊scaled⌋, for which not every processor has an instruction.
        let towards_zero = scaled as i32;
        let cell = towards_zero.wrapping_sub(i32::from(scaled < towards_zero as f32));
        Ok(cell.wrapping_sub(i32::MIN) as u32)
    } else {
        Err(PrepareError::CellRange { coordinate, leaf: 1.0 / per_metre })
    }
}
