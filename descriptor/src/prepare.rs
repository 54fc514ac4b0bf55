//! The stages that descriptors have in common: keypoints and normals, and whether a cloud takes part.

use crate::cell_list::CellList;
use crate::keypoints::Keypoints;
use crate::neighbours::{RadiusSearch, floor_f32, squared_distance};
use crate::normals::{MIN_NEIGHBOURS, Normal, normals};
use crate::prepare_error::{PrepareError, Skip};
use crate::{Cloud, Preprocess};

/// Ordered pairs of points in the same cells above which a cloud is refused; a point makes a pair with itself. The search
/// for neighbours looks at as many candidates at least and at 27 times as many at most, some 10^9 of them a second. A
/// cloud of a depth camera, 100 000 points 2 mm apart, has less than a thousandth.
pub const MOST_PAIRS: u64 = 1 << 32;

/// The stage `keypoints`: checks the cloud (in metres) and places its keypoints.
///
/// # Errors
/// [`Skip::TooFewPoints`], missing colours, coordinates out of range, or points that are too dense.
pub fn keypoints(cloud: &Cloud, preprocess: &Preprocess) -> Result<Keypoints, PrepareError> {
    match &cloud.colours {
        None if preprocess.colour => return Err(PrepareError::NoColours),
        Some(colours) if colours.len() != cloud.len() => {
            return Err(PrepareError::ColourCount { points: cloud.len(), colours: colours.len() });
        }
        _ => {}
    }
    if cloud.len() < preprocess.min_points as usize {
        return Err(Skip::TooFewPoints { least: preprocess.min_points, points: cloud.len() }.into());
    }
    let keypoints = Keypoints::new(cloud, preprocess.leaf())?;
    check_density(&cloud.points, preprocess.normal_radius())?;
    Ok(keypoints)
}

/// Unordered pairs of points in all regions of a cloud above which descriptors that count every pair refuse it: a minute
/// or a few. A cloud of a depth camera, 100 000 points 2 mm apart, has a sixteenth in regions of 5 cm.
pub(crate) const MOST_REGION_PAIRS: u64 = 1 << 35;

/// Refuses regions with too many pairs: `in_region` counts the points of the region about a keypoint, which is asked only
/// where that many could be.
pub(crate) fn check_regions(
    points: usize,
    keypoints: usize,
    mut in_region: impl FnMut(usize) -> usize,
) -> Result<(), PrepareError> {
    let pairs = |points: usize| points as u64 * (points as u64).saturating_sub(1) / 2;
    if pairs(points).saturating_mul(keypoints as u64) <= MOST_REGION_PAIRS {
        return Ok(());
    }
    let pairs = (0..keypoints).fold(0, |sum: u64, keypoint| sum.saturating_add(pairs(in_region(keypoint))));
    if pairs <= MOST_REGION_PAIRS {
        return Ok(());
    }
    Err(PrepareError::TooManyPairs { most: MOST_REGION_PAIRS, pairs, keypoints })
}

/// Neighbours of all keypoints together above which descriptors that count every neighbour refuse a cloud: some seconds,
/// and a gigabyte where they are kept. A cloud of a depth camera, 100 000 points 2 mm apart, has a hundredth in regions of
/// 5 cm.
pub(crate) const MOST_NEIGHBOURS: u64 = 1 << 28;

/// Tests of a block of points against a keypoint above which a cloud is refused: half a minute.
const MOST_BLOCK_TESTS: u64 = 1 << 34;

/// The neighbours of all keypoints, counted as they are found.
pub(crate) struct NeighbourCount {
    found: u64,
    points: usize,
    keypoints: usize,
}

impl NeighbourCount {
    /// Of so many points in blocks, each of which is tested against each keypoint.
    ///
    /// # Errors
    /// [`PrepareError::TooManyNeighbours`] if the tests alone would take too long.
    pub(crate) fn new(points: usize, blocks: usize, keypoints: usize) -> Result<Self, PrepareError> {
        let count = Self { found: 0, points, keypoints };
        let tests = (blocks as u64).saturating_mul(keypoints as u64);
        if tests > MOST_BLOCK_TESTS { Err(count.too_many()) } else { Ok(count) }
    }

    /// Adds those of one keypoint.
    ///
    /// # Errors
    /// [`PrepareError::TooManyNeighbours`].
    pub(crate) fn add(&mut self, neighbours: usize) -> Result<(), PrepareError> {
        self.found += neighbours as u64;
        if self.found > MOST_NEIGHBOURS { Err(self.too_many()) } else { Ok(()) }
    }

    fn too_many(&self) -> PrepareError {
        let Self { points, keypoints, .. } = *self;
        PrepareError::TooManyNeighbours { most: MOST_NEIGHBOURS, points, keypoints }
    }
}

/// Refuses points whose neighbours within `radius` metres would take too long to find, by counting alone.
fn check_density(points: &[[f32; 3]], radius: f64) -> Result<(), PrepareError> {
    // All in one cell would be as many: of most clouds nothing is to be counted.
    if points.len() as u128 * points.len() as u128 <= u128::from(MOST_PAIRS) {
        return Ok(());
    }
    let cells = CellList::new(points, radius, 0)?;
    let pairs = cells.occupancy().map(|points| u64::from(points) * u64::from(points)).sum();
    if pairs <= MOST_PAIRS {
        return Ok(());
    }
    let points = cells.occupancy().max().unwrap_or(0);
    Err(PrepareError::TooDense { most: MOST_PAIRS, radius, pairs, points })
}

/// Normals of a cloud and of its keypoints.
#[derive(Clone, Debug, PartialEq)]
pub struct Normals {
    /// One for each point of the cloud.
    pub cloud: Vec<Normal>,
    /// One for each keypoint: at least one is there, or no normal was fitted at all.
    pub keypoints: Vec<Normal>,
}

impl Normals {
    /// The stage `normals`: fits normals to a cloud in metres and to its keypoints.
    ///
    /// # Errors
    /// [`Skip::NoKeypointWithNormal`], or too many points.
    pub fn new(cloud: &Cloud, keypoints: &Keypoints, preprocess: &Preprocess) -> Result<Self, PrepareError> {
        let [cloud, of_keypoints] =
            normals(&cloud.points, &keypoints.points, preprocess.normal_radius(), cloud.viewpoint)?;
        if of_keypoints.iter().all(Option::is_none) {
            return Err(Skip::NoKeypointWithNormal { keypoints: keypoints.len() }.into());
        }
        Ok(Self { cloud, keypoints: of_keypoints })
    }

    /// The same for descriptors that look at no normals: none is fitted, and no point has one.
    ///
    /// # Errors
    /// Exactly those of [`Normals::new`], so that the same clouds take part.
    pub(crate) fn none(
        cloud: &Cloud,
        keypoints: &Keypoints,
        preprocess: &Preprocess,
    ) -> Result<Self, PrepareError> {
        check_keypoints(cloud, keypoints, preprocess)?;
        Ok(Self { cloud: vec![None; cloud.len()], keypoints: vec![None; keypoints.len()] })
    }
}

/// Refuses a cloud, as stored, that takes no part: the same for all descriptors, and decided without fitting normals.
///
/// # Errors
/// Exactly those of [`keypoints`] and [`Normals::new`].
pub fn usable(cloud: &Cloud, preprocess: &Preprocess) -> Result<(), PrepareError> {
    let cloud = preprocess.in_metres(cloud);
    let keypoints = keypoints(&cloud, preprocess)?;
    check_keypoints(&cloud, &keypoints, preprocess)
}

/// Keypoints that are looked at before an index of the points is made: of nearly all clouds the first one has a normal.
const SCANNED: usize = 4;

/// Refuses a cloud in metres none of whose keypoints would get a normal.
fn check_keypoints(
    cloud: &Cloud,
    keypoints: &Keypoints,
    preprocess: &Preprocess,
) -> Result<(), PrepareError> {
    let radius = preprocess.normal_radius();
    let limit = floor_f32(radius * radius);
    let is_surrounded = |&keypoint: &[f32; 3]| {
        let near = cloud.points.iter().filter(|&&point| squared_distance(point, keypoint) <= limit);
        near.take(MIN_NEIGHBOURS).count() == MIN_NEIGHBOURS
    };
    if keypoints.points.iter().take(SCANNED).any(is_surrounded) {
        return Ok(());
    }
    let search = RadiusSearch::new(&cloud.points)?;
    let has_normal =
        |&keypoint: &[f32; 3]| search.count_within(keypoint, radius, MIN_NEIGHBOURS) == MIN_NEIGHBOURS;
    if keypoints.points.iter().skip(SCANNED).any(has_normal) {
        Ok(())
    } else {
        Err(Skip::NoKeypointWithNormal { keypoints: keypoints.len() }.into())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;
    use crate::disk_ring::QuantisedCloud;
    use crate::fixed::OrientedCloud;
    use crate::keypoints::MOST_KEYPOINTS;
    use crate::random::stream;
    use crate::structure::StructureCloud;
    use crate::testing::in_cube;
    use crate::{FixedDescriptor, FixedKind, GeneTable, Quantiser};

    fn cloud(points: Vec<[f32; 3]>) -> Cloud {
        let colours = Some(vec![[90, 60, 30]; points.len()]);
        Cloud { points, colours, ..Cloud::default() }
    }

    /// A flat patch of points so far apart, in rows of 320.
    fn patch(points: u32, apart: f32) -> Vec<[f32; 3]> {
        (0..points).map(|index| [(index % 320) as f32 * apart, (index / 320) as f32 * apart, 1.0]).collect()
    }

    #[test]
    fn pairs_are_those_that_share_a_cell_and_bound_those_that_are_near() {
        let radius = 0.01;
        for (seed, side) in [(1, 0.03f32), (2, 0.1), (3, 0.011)] {
            let mut rng = stream(seed, "density", &[]);
            let points: Vec<[f32; 3]> = (0..600).map(|_| in_cube(&mut rng, side)).collect();
            let pairs: u64 = CellList::new(&points, radius, 0)
                .unwrap()
                .occupancy()
                .map(|points| u64::from(points) * u64::from(points))
                .sum();
            // By definition, in cells of 1.001 radii from the lowest corner.
            let low: [f32; 3] =
                std::array::from_fn(|axis| points.iter().map(|point| point[axis]).fold(f32::MAX, f32::min));
            let cell = |point: &[f32; 3]| {
                std::array::from_fn::<_, 3, _>(|axis| {
                    ((f64::from(point[axis]) - f64::from(low[axis])) * (1.0 / (radius * 1.001))) as u64
                })
            };
            let mut cells: BTreeMap<[u64; 3], u64> = BTreeMap::new();
            points.iter().for_each(|point| *cells.entry(cell(point)).or_default() += 1);
            assert_eq!(pairs, cells.values().map(|points| points * points).sum::<u64>());
            let near = |a: &[f32; 3], b: &[f32; 3]| {
                let [x, y, z] = std::array::from_fn(|axis| f64::from(a[axis]) - f64::from(b[axis]));
                x * x + y * y + z * z <= radius * radius
            };
            let found: usize = points.iter().map(|a| points.iter().filter(|b| near(a, b)).count()).sum();
            assert!((found as u64) <= 27 * pairs, "{found} neighbours, {pairs} pairs");
        }
    }

    proptest! {
        /// Points on a lattice of half a radius, so that many are exactly as far apart as neighbours may be, some of them in
        /// voxels of their own.
        #[test]
        fn a_cloud_takes_part_whether_normals_are_fitted_or_not(
            points in prop::collection::vec((0u8..5, 0u8..5, 0u8..2), 0..7),
            leaf_um in prop::sample::select(vec![5_000, 20_000]),
        ) {
            let preprocess = Preprocess { leaf_um, normal_radius_um: 15_625, min_points: 0, ..Preprocess::default() };
            let lattice = |&(x, y, z): &(u8, u8, u8)| [x, y, z].map(|place| f32::from(place) * 0.007_812_5);
            let cloud = cloud(points.iter().map(lattice).collect());
            let keypoints = keypoints(&cloud, &preprocess).unwrap();
            let fitted = Normals::new(&cloud, &keypoints, &preprocess);
            let none = Normals::none(&cloud, &keypoints, &preprocess);
            prop_assert_eq!(none.as_ref().err(), fitted.as_ref().err());
            prop_assert_eq!(usable(&cloud, &preprocess).err(), fitted.err());
            if let Ok(none) = none {
                prop_assert_eq!((none.cloud, none.keypoints), (vec![None; cloud.len()], vec![None; keypoints.len()]));
            }
        }
    }

    #[test]
    fn points_that_are_all_alike_are_refused_by_everything_that_prepares_clouds() {
        let quantiser = Quantiser::new(&GeneTable::paper()).unwrap();
        let preprocess = Preprocess::default();
        let alike = cloud(vec![[0.1, 0.2, 1.0]; 65_537]);
        let expected =
            PrepareError::TooDense { most: MOST_PAIRS, radius: 0.01, pairs: 65_537 * 65_537, points: 65_537 };
        assert_eq!(usable(&alike, &preprocess), Err(expected.clone()));
        assert_eq!(keypoints(&alike, &preprocess), Err(expected.clone()));
        assert_eq!(QuantisedCloud::new(&alike, &preprocess, &quantiser).err(), Some(expected.clone()));
        assert_eq!(StructureCloud::new(&alike, &preprocess).err(), Some(expected));
        // As many points as make no more pairs wherever they are.
        assert_eq!(usable(&cloud(vec![[0.1, 0.2, 1.0]; 65_536]), &preprocess), Ok(()));
    }

    #[test]
    fn neighbours_are_counted_until_they_are_too_many() {
        let mut count = NeighbourCount::new(100_000, 1_563, 1_000).unwrap();
        assert_eq!(count.add(MOST_NEIGHBOURS as usize), Ok(()));
        let expected =
            PrepareError::TooManyNeighbours { most: MOST_NEIGHBOURS, points: 100_000, keypoints: 1_000 };
        assert_eq!(count.add(1), Err(expected));
        // Blocks and keypoints of which each pair is looked at.
        assert!(NeighbourCount::new(64 << 16, 1 << 16, 1 << 18).is_ok());
        let tests = NeighbourCount::new(64 << 17, 1 << 17, 1 << 18).err();
        assert!(matches!(tests, Some(PrepareError::TooManyNeighbours { .. })));
        assert!(NeighbourCount::new(usize::MAX, usize::MAX, 2).is_err());
    }

    #[test]
    fn a_cloud_with_too_many_keypoints_is_refused() {
        // A keypoint a point: a line of points, each in a voxel of its own.
        let line = |points: usize| cloud((0..points).map(|place| [0.0, 0.0, place as f32 * 0.025]).collect());
        let preprocess = Preprocess { leaf_um: 20_000, ..Preprocess::default() };
        let (most, leaf) = (MOST_KEYPOINTS, preprocess.leaf());
        let refused = keypoints(&line(MOST_KEYPOINTS + 1), &preprocess);
        let keypoints_there = MOST_KEYPOINTS + 1;
        let expected = PrepareError::TooManyKeypoints { most, keypoints: keypoints_there, leaf };
        assert_eq!(refused, Err(expected));
        assert_eq!(keypoints(&line(MOST_KEYPOINTS), &preprocess).map(|found| found.len()), Ok(most));
    }

    #[test]
    fn regions_are_counted_only_where_they_could_have_too_many_pairs() {
        let never = |_| panic!("nothing is to be counted");
        assert_eq!(check_regions(1_900, 60, never), Ok(()));
        assert_eq!(check_regions(0, 0, never), Ok(()));
        // 1000 regions of 2000 points: 2 · 10⁹ pairs.
        assert_eq!(check_regions(100_000, 1_000, |_| 2_000), Ok(()));
        let expected = PrepareError::TooManyPairs {
            most: MOST_REGION_PAIRS,
            pairs: 1_000 * (10_000 * 9_999 / 2),
            keypoints: 1_000,
        };
        assert_eq!(check_regions(100_000, 1_000, |_| 10_000), Err(expected));
        let enormous = check_regions(4_000_000_000, 3, |_| 4_000_000_000).unwrap_err();
        assert!(matches!(enormous, PrepareError::TooManyPairs { pairs: u64::MAX, .. }));
    }

    #[test]
    fn descriptors_that_count_all_pairs_refuse_what_would_take_minutes_and_those_that_sample_do_not() {
        // Within the limit of normals: a sheet whose regions of 5 cm have tens of thousands of points.
        let preprocess = Preprocess::default();
        let dense = cloud(patch(120_000, 0.000_3));
        assert_eq!(usable(&dense, &preprocess), Ok(()));
        let oriented = OrientedCloud::new(&dense, &preprocess).unwrap();
        let fixed = |kind| FixedDescriptor::new(kind, 50_000).unwrap().signature_or_zeros(&oriented);
        assert!(matches!(fixed(FixedKind::PfhRgb), Err(PrepareError::TooManyPairs { .. })));
        assert!(fixed(FixedKind::ShotColor).is_ok());
    }

    #[test]
    fn clouds_of_sensors_are_far_from_the_limit() {
        let preprocess = Preprocess::default();
        let pairs = |points: &[[f32; 3]]| -> u64 {
            let cells = CellList::new(points, preprocess.normal_radius(), 0).unwrap();
            cells.occupancy().map(|points| u64::from(points) * u64::from(points)).sum()
        };
        // A depth camera, and a desktop scanner.
        let camera = patch(100_000, 0.002);
        assert!(pairs(&camera) < MOST_PAIRS / 1000);
        assert_eq!(usable(&cloud(camera.clone()), &preprocess), Ok(()));
        assert_eq!(usable(&cloud(patch(300_000, 0.000_2)), &preprocess), Ok(()));
        // A point so far away that cells have to be as wide as the rest of the cloud.
        let mut outlier = camera;
        outlier.push([1e6, 0.0, 1.0]);
        let refused = usable(&cloud(outlier), &preprocess);
        assert!(matches!(refused, Err(PrepareError::TooDense { points: 100_000, .. })), "{refused:?}");
    }
}
