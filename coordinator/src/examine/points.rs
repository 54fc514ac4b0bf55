//! Fewer points of a cloud, as pages draw them.

use descriptor::Cloud;

/// Colour of points without one.
const GREY: [u8; 3] = [150, 150, 150];

/// A cloud of not too many points.
#[derive(Clone, Debug, PartialEq)]
pub struct DecimatedCloud {
    /// How many points there were.
    pub before: usize,
    /// Positions in the camera's frame, metres.
    pub points: Vec<[f32; 3]>,
    /// Red, green, blue of each.
    pub colours: Vec<[u8; 3]>,
}

impl DecimatedCloud {
    /// At most `most` points of a cloud, spread evenly over it: of each voxel of a grid the first, where the grid is the
    /// finest of some that leaves few enough.
    pub fn new(cloud: &Cloud, most: usize) -> Self {
        let usable: Vec<usize> = (0..cloud.points.len())
            .filter(|&point| cloud.points[point].iter().all(|x| x.is_finite()))
            .collect();
        let before = usable.len();
        let mut kept = usable.clone();
        let mut edge = 0.0005f32;
        while kept.len() > most.max(1) {
            kept = first_of_voxels(cloud, &usable, edge);
            edge *= 1.15;
        }
        let colour = |point: &usize| cloud.colours.as_ref().map_or(GREY, |colours| colours[*point]);
        Self {
            before,
            points: kept.iter().map(|&point| cloud.points[point]).collect(),
            colours: kept.iter().map(colour).collect(),
        }
    }

    /// As [`results::cloud_bytes`] has it.
    pub fn to_bytes(&self) -> Vec<u8> {
        let before = u32::try_from(self.before).unwrap_or(u32::MAX);
        results::cloud_bytes(&self.points, &self.colours, before)
    }
}

/// The first point in each voxel of a grid, in the order of the cloud.
fn first_of_voxels(cloud: &Cloud, points: &[usize], edge: f32) -> Vec<usize> {
    let mut met = std::collections::HashSet::new();
    let voxel = |point: usize| cloud.points[point].map(|x| (x / edge).floor() as i64);
    points.iter().copied().filter(|&point| met.insert(voxel(point))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(side: u16) -> Cloud {
        let points =
            (0..side).flat_map(|x| (0..side).map(move |y| [f32::from(x) * 1e-3, f32::from(y) * 1e-3, 1.0]));
        let mut points: Vec<[f32; 3]> = points.collect();
        points.push([f32::NAN, 0.0, 0.0]);
        let colours = (0..points.len()).map(|point| [point as u8, (point >> 8) as u8, 7]).collect();
        Cloud { points, colours: Some(colours), viewpoint: [0.0; 3] }
    }

    #[test]
    fn a_large_cloud_keeps_its_extent_and_its_colours() {
        let cloud = plane(100);
        let few = DecimatedCloud::new(&cloud, 500);
        assert_eq!(few.before, 10_000);
        assert!((200..=500).contains(&few.points.len()), "{}", few.points.len());
        for (point, colour) in few.points.iter().zip(&few.colours) {
            let place = cloud.points.iter().position(|other| other == point).unwrap();
            assert_eq!(*colour, cloud.colours.as_ref().unwrap()[place]);
        }
        for axis in 0..2 {
            let most = few.points.iter().map(|point| point[axis]).fold(0.0, f32::max);
            assert!(most > 0.09, "{most}");
        }
        assert_eq!(DecimatedCloud::new(&cloud, 10_000).points.len(), 10_000);
    }
}
