//! How much there is to do, counted by looking at every pair of points.

use descriptor::wide::widest;
use std::iter::Sum;
use std::ops::AddAssign;

use descriptor::keypoints::Keypoints;
use descriptor::prepare::Normals;
use descriptor::{Cloud, Preprocess};
use pulp::NullaryFnOnce;

/// Largest f32 that is not above the square of a radius, square metres.
fn limit(radius_um: u32) -> f32 {
    let metres = f64::from(radius_um) / 1e6;
    let square = metres * metres;
    let nearest = square as f32;
    if f64::from(nearest) > square { nearest.next_down() } else { nearest }
}

/// Points among which neighbours are counted.
#[derive(Clone, Debug, Default)]
pub struct Field {
    columns: [Vec<f32>; 3],
}

impl FromIterator<[f32; 3]> for Field {
    fn from_iter<I: IntoIterator<Item = [f32; 3]>>(points: I) -> Self {
        let mut field = Self::default();
        for point in points {
            field.columns.iter_mut().zip(point).for_each(|(column, value)| column.push(value));
        }
        field
    }
}

impl Field {
    /// All points of a cloud.
    pub fn of(cloud: &Cloud) -> Self {
        cloud.points.iter().copied().collect()
    }

    /// Those that have a normal.
    pub fn with_normals(cloud: &Cloud, normals: &Normals) -> Self {
        let both = cloud.points.iter().zip(&normals.cloud);
        both.filter(|(_, normal)| normal.is_some()).map(|(&point, _)| point).collect()
    }

    /// Points within a radius of a centre.
    pub fn within(&self, centre: [f32; 3], radius_um: u32) -> u64 {
        widest(Within { columns: &self.columns, centre, limit: limit(radius_um) })
    }

    /// Unordered pairs of points that are both within a radius of one of these centres.
    pub fn pairs_within(&self, centres: &[[f32; 3]], radius_um: u32) -> u64 {
        let limit = limit(radius_um);
        let [x, y, z] = &self.columns;
        let region = |centre: &[f32; 3]| -> Vec<bool> {
            let points = x.iter().zip(y).zip(z);
            let distances2 = points.map(|((x, y), z)| {
                let (x, y, z) = (x - centre[0], y - centre[1], z - centre[2]);
                x * x + y * y + z * z
            });
            distances2.map(|distance2| distance2 <= limit).collect()
        };
        let regions: Vec<Vec<bool>> = centres.iter().map(region).collect();
        let partners = |one: usize| {
            let mut is_partner = vec![false; x.len() - one - 1];
            for region in regions.iter().filter(|region| region[one]) {
                is_partner.iter_mut().zip(&region[one + 1..]).for_each(|(is, &here)| *is |= here);
            }
            is_partner.into_iter().filter(|&is| is).count() as u64
        };
        (0..x.len()).map(partners).sum()
    }
}

struct Within<'a> {
    columns: &'a [Vec<f32>; 3],
    centre: [f32; 3],
    limit: f32,
}

impl NullaryFnOnce for Within<'_> {
    type Output = u64;

    #[inline(always)]
    fn call(self) -> u64 {
        let ([x, y, z], [qx, qy, qz]) = (self.columns, self.centre);
        let mut count = 0u32;
        for ((x, y), z) in x.iter().zip(y).zip(z) {
            let (x, y, z) = (x - qx, y - qy, z - qz);
            count += u32::from(x * x + y * y + z * z <= self.limit);
        }
        count.into()
    }
}

/// Radii of the paper's rings, millimetres, and the largest of them.
const RINGS_MM: std::ops::RangeInclusive<u32> = 21..=50;
const LARGEST_MM: usize = 50;

/// What there is in some clouds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counts {
    pub clouds: u64,
    /// Bytes of their files.
    pub bytes: u64,
    pub points: u64,
    pub keypoints: u64,
    /// Neighbours of all points and keypoints within the radius of normals.
    pub near: u64,
    /// Keypoints with a normal.
    pub described: u64,
    /// Their neighbours with a normal, by radius in millimetres, of [`RINGS_MM`] only.
    within_mm: [u64; LARGEST_MM + 1],
}

impl Default for Counts {
    fn default() -> Self {
        let within_mm = [0; LARGEST_MM + 1];
        Self { clouds: 0, bytes: 0, points: 0, keypoints: 0, near: 0, described: 0, within_mm }
    }
}

impl Counts {
    /// Of one cloud.
    pub fn of(
        bytes: usize,
        cloud: &Cloud,
        keypoints: &Keypoints,
        normals: &Normals,
        preprocess: &Preprocess,
    ) -> Self {
        let all = Field::of(cloud);
        let near = |&point: &[f32; 3]| all.within(point, preprocess.normal_radius_um);
        let oriented = Field::with_normals(cloud, normals);
        let both = keypoints.points.iter().zip(&normals.keypoints);
        let described: Vec<[f32; 3]> =
            both.filter(|(_, normal)| normal.is_some()).map(|(&point, _)| point).collect();
        let mut within_mm = [0; LARGEST_MM + 1];
        for mm in RINGS_MM {
            let within = |&keypoint: &[f32; 3]| oriented.within(keypoint, 1_000 * mm);
            within_mm[mm as usize] = described.iter().map(within).sum();
        }
        Self {
            clouds: 1,
            bytes: bytes as u64,
            points: cloud.len() as u64,
            keypoints: keypoints.len() as u64,
            near: cloud.points.iter().chain(&keypoints.points).map(near).sum(),
            described: described.len() as u64,
            within_mm,
        }
    }

    /// Neighbours with a normal of keypoints with a normal, within one of [`RINGS_MM`].
    pub fn within(&self, radius_um: u32) -> u64 {
        assert!(radius_um.is_multiple_of(1_000) && RINGS_MM.contains(&(radius_um / 1_000)), "{radius_um} um");
        self.within_mm[radius_um as usize / 1_000]
    }
}

impl AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        let Self { clouds, bytes, points, keypoints, near, described, within_mm } = other;
        self.clouds += clouds;
        self.bytes += bytes;
        self.points += points;
        self.keypoints += keypoints;
        self.near += near;
        self.described += described;
        self.within_mm.iter_mut().zip(within_mm).for_each(|(sum, count)| *sum += count);
    }
}

impl Sum for Counts {
    fn sum<I: Iterator<Item = Self>>(counts: I) -> Self {
        counts.fold(Self::default(), |mut sum, count| {
            sum += count;
            sum
        })
    }
}
