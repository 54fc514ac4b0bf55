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

    /// Little endian: u32 points, u32 points before, f32 centre (x, y, z), f32 metres per unit, i16 x, y, z of each point
    /// in these units from the centre, u8 red, green, blue of each.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut low = [f32::INFINITY; 3];
        let mut high = [f32::NEG_INFINITY; 3];
        for point in &self.points {
            for axis in 0..3 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        if self.points.is_empty() {
            (low, high) = ([0.0; 3], [0.0; 3]);
        }
        let centre: [f32; 3] = std::array::from_fn(|axis| low[axis] + (high[axis] - low[axis]) / 2.0);
        let half = (0..3).map(|axis| (high[axis] - low[axis]) / 2.0).fold(0.0f32, f32::max);
        let unit = if half > 0.0 { half / f32::from(i16::MAX) } else { 1.0 };
        let mut bytes = Vec::with_capacity(24 + 9 * self.points.len());
        bytes.extend((self.points.len() as u32).to_le_bytes());
        bytes.extend((self.before as u32).to_le_bytes());
        for value in centre.into_iter().chain([unit]) {
            bytes.extend(value.to_le_bytes());
        }
        for point in &self.points {
            for axis in 0..3 {
                bytes.extend((((point[axis] - centre[axis]) / unit).round() as i16).to_le_bytes());
            }
        }
        bytes.extend(self.colours.iter().flatten());
        bytes
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

    #[test]
    fn bytes_have_every_point_to_within_their_unit() {
        let few = DecimatedCloud::new(&plane(20), 1000);
        let bytes = few.to_bytes();
        let count = few.points.len();
        assert_eq!(bytes.len(), 24 + 9 * count);
        let float = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        assert_eq!(u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize, count);
        let unit = float(20);
        for (place, point) in few.points.iter().enumerate() {
            for (axis, coordinate) in point.iter().enumerate() {
                let at = 24 + 6 * place + 2 * axis;
                let units = i16::from_le_bytes(bytes[at..at + 2].try_into().unwrap());
                let there = float(8 + 4 * axis) + f32::from(units) * unit;
                assert!((there - coordinate).abs() <= unit, "{there} for {coordinate}");
            }
        }
        let nothing = Cloud { points: Vec::new(), colours: None, viewpoint: [0.0; 3] };
        assert_eq!(DecimatedCloud::new(&nothing, 5).to_bytes().len(), 24);
    }
}
