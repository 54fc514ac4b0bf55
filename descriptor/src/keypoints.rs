//! Keypoints: the centroid of every occupied voxel, cells and order as PCL's VoxelGrid (DESIGN 5.2).

use std::borrow::Cow;

use crate::Cloud;
use crate::cell_list;
use crate::prepare_error::PrepareError;

/// Most keypoints of a cloud: each has a row of up to thousands of values. A hall of 100 m² of surface has as many, 2 cm
/// apart.
pub const MOST_KEYPOINTS: usize = 1 << 18;

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
    /// [`PrepareError::CellRange`] if a cell's index does not fit 32 bits, [`PrepareError::TooManyPoints`] if the points
    /// cannot be counted in as many, [`PrepareError::TooManyKeypoints`] above [`MOST_KEYPOINTS`].
    ///
    /// # Panics
    /// If there are not as many colours as points: a programming error.
    pub fn new(cloud: &Cloud, leaf: f32) -> Result<Self, PrepareError> {
        let voxels = Voxels::new(&cloud.points, 1.0 / leaf)?;
        let sums = if voxels.are_few() { voxels.sums_by_table(cloud) } else { voxels.sums_by_sorting(cloud) };
        if sums.len() > MOST_KEYPOINTS {
            return Err(PrepareError::TooManyKeypoints { most: MOST_KEYPOINTS, keypoints: sums.len(), leaf });
        }
        Ok(Self {
            points: sums.iter().map(Sums::centroid).collect(),
            colours: cloud.colours.as_ref().map(|_| sums.iter().map(Sums::mean_colour).collect()),
        })
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

/// Sums over the points of a voxel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sums {
    points: u64,
    position: [f64; 3],
    colour: [u64; 3],
}

impl Sums {
    #[inline(always)]
    fn add(&mut self, point: [f32; 3], colour: [u8; 3]) {
        self.points += 1;
        for axis in 0..3 {
            self.position[axis] += f64::from(point[axis]);
            self.colour[axis] += u64::from(colour[axis]);
        }
    }

    fn centroid(&self) -> [f32; 3] {
        self.position.map(|sum| (sum / self.points as f64) as f32)
    }

    fn mean_colour(&self) -> [u8; 3] {
        self.colour.map(|sum| (sum / self.points) as u8)
    }
}

/// The voxel of each point of a cloud.
struct Voxels {
    of_point: Vec<[i32; 3]>,
    lowest: [i32; 3],
    /// How many voxels there are along each axis, occupied or not.
    along: [u64; 3],
}

impl Voxels {
    fn new(points: &[[f32; 3]], per_metre: f32) -> Result<Self, PrepareError> {
        u32::try_from(points.len()).map_err(|_| PrepareError::TooManyPoints { points: points.len() })?;
        let mut of_point = vec![[0; 3]; points.len()];
        let coordinates = points.as_flattened();
        // No branch in the loop, so that it becomes one of vectors.
        let mut are_in_range = true;
        for (voxel, coordinate) in of_point.as_flattened_mut().iter_mut().zip(coordinates) {
            let scaled = coordinate * per_metre;
            are_in_range &= is_in_range(scaled);
            *voxel = floor(scaled);
        }
        if !are_in_range
            && let Some(&coordinate) = coordinates.iter().find(|&&one| !is_in_range(one * per_metre))
        {
            return Err(PrepareError::CellRange { coordinate, leaf: 1.0 / per_metre });
        }
        let (mut lowest, mut highest) = ([i32::MAX; 3], [i32::MIN; 3]);
        for voxel in &of_point {
            for axis in 0..3 {
                lowest[axis] = lowest[axis].min(voxel[axis]);
                highest[axis] = highest[axis].max(voxel[axis]);
            }
        }
        // Two each way where there is no point.
        let along = [0, 1, 2].map(|axis| u64::from(highest[axis].wrapping_sub(lowest[axis]) as u32) + 1);
        Ok(Self { of_point, lowest, along })
    }

    /// How many there are, occupied or not; `None`: 64 bits do not count them.
    fn count(&self) -> Option<u64> {
        self.along.iter().try_fold(1, |voxels: u64, &along| voxels.checked_mul(along))
    }

    /// Whether a table of all voxels is worth its memory.
    fn are_few(&self) -> bool {
        self.count().is_some_and(|voxels| cell_list::are_few(voxels, self.of_point.len()))
    }

    /// The number of a voxel, z slowest and x fastest, where 64 bits count them all.
    #[inline(always)]
    fn number(&self, voxel: &[i32; 3]) -> u64 {
        let [x, y, z] = [0, 1, 2].map(|axis| u64::from(voxel[axis].wrapping_sub(self.lowest[axis]) as u32));
        (z * self.along[1] + y) * self.along[0] + x
    }

    /// The sums of each occupied voxel, z, y, x; of few voxels.
    fn sums_by_table(&self, cloud: &Cloud) -> Vec<Sums> {
        // One more than the place of a voxel's sums; 0: it is empty.
        let mut places = vec![0u32; self.count().unwrap_or_default() as usize];
        let mut sums: Vec<Sums> = Vec::new();
        for ((voxel, &point), &colour) in self.of_point.iter().zip(&cloud.points).zip(&*colours(cloud)) {
            let place = &mut places[self.number(voxel) as usize];
            if *place == 0 {
                sums.push(Sums::default());
                *place = sums.len() as u32;
            }
            sums[*place as usize - 1].add(point, colour);
        }
        places.iter().filter(|&&place| place > 0).map(|&place| sums[place as usize - 1]).collect()
    }

    /// The same of any number of voxels.
    fn sums_by_sorting(&self, cloud: &Cloud) -> Vec<Sums> {
        let mut order: Vec<u32> = (0u32..).take(cloud.len()).collect();
        if self.count().is_some() {
            let numbers: Vec<u64> = self.of_point.iter().map(|voxel| self.number(voxel)).collect();
            order.sort_unstable_by_key(|&index| (numbers[index as usize], index));
        } else {
            order.sort_unstable_by_key(|&index| {
                let [x, y, z] = self.of_point[index as usize];
                ([z, y, x], index)
            });
        }
        let voxels = order.chunk_by(|&a, &b| self.of_point[a as usize] == self.of_point[b as usize]);
        let colours = colours(cloud);
        let sums = |voxel: &[u32]| {
            let mut sums = Sums::default();
            voxel.iter().for_each(|&index| sums.add(cloud.points[index as usize], colours[index as usize]));
            sums
        };
        voxels.map(sums).collect()
    }
}

/// Black where there are none.
fn colours(cloud: &Cloud) -> Cow<'_, [[u8; 3]]> {
    let colours = cloud.colours.as_deref().map_or_else(|| vec![[0; 3]; cloud.len()].into(), Cow::from);
    assert_eq!(colours.len(), cloud.len(), "one colour for each point");
    colours
}

/// Both bounds are exact in f32; NaN and infinities fail the test as well.
fn is_in_range(scaled: f32) -> bool {
    (-2_147_483_648.0..2_147_483_648.0).contains(&scaled)
}

/// ⌊scaled⌋, for which not every processor has an instruction.
fn floor(scaled: f32) -> i32 {
    let towards_zero = scaled as i32;
    towards_zero.wrapping_sub(i32::from(scaled < towards_zero as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::sheet;

    #[test]
    fn sums_by_a_table_are_those_by_sorting() {
        for (seed, points, per_metre) in [(1, 0, 50.0), (2, 1, 50.0), (3, 700, 50.0), (4, 700, 130.0)] {
            let cloud = sheet(seed, points);
            for cloud in [Cloud { colours: None, ..cloud.clone() }, cloud] {
                let voxels = Voxels::new(&cloud.points, per_metre).unwrap();
                let by_number = voxels.sums_by_sorting(&cloud);
                assert_eq!(voxels.sums_by_table(&cloud), by_number);
                // As if there were more voxels than can be numbered.
                let uncounted = Voxels { along: [u64::MAX; 3], ..voxels };
                assert_eq!(uncounted.count(), None);
                assert_eq!(uncounted.sums_by_sorting(&cloud), by_number);
            }
        }
    }

    #[test]
    fn a_table_is_made_of_few_voxels_only() {
        let mut cloud = sheet(1, 700);
        let are_few = |cloud: &Cloud| Voxels::new(&cloud.points, 50.0).unwrap().are_few();
        assert!(are_few(&cloud));
        cloud.points[3][2] = 1e4;
        assert!(!are_few(&cloud));
        // More than 64 bits count.
        (cloud.points[4], cloud.points[5]) = ([4e7; 3], [-4e7; 3]);
        assert!(!are_few(&cloud));
    }
}
