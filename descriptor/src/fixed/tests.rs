//! Descriptors without genes against their definitions, at the edges, and their digests.

use blake3::Hasher;

use super::frame::Frame;
use super::neighbourhood::Neighbourhood;
use super::oracle::{self, Point};
use super::*;
use crate::neighbours::RadiusSearch;
use crate::testing::sheet;

/// A cloud with what is found on it.
struct Scene {
    cloud: Cloud,
    keypoints: Keypoints,
    normals: Normals,
}

impl Scene {
    fn new(cloud: Cloud) -> Self {
        let preprocess = Preprocess::default();
        let keypoints = keypoints(&cloud, &preprocess).unwrap();
        let normals = Normals::new(&cloud, &keypoints, &preprocess).unwrap();
        Self { cloud, keypoints, normals }
    }

    fn describe(&self, kind: FixedKind, radius_um: u32) -> Result<Histograms, DescribeError> {
        FixedDescriptor { kind, radius_um }.describe(&self.cloud, &self.keypoints, &self.normals)
    }

    /// The points with a normal about a keypoint, nearest first.
    fn near(&self, keypoint: [f32; 3], radius: f64) -> Vec<Point> {
        let search = RadiusSearch::new(&self.cloud.points).unwrap();
        let colours = self.cloud.colours.as_ref().unwrap();
        let point = |index: usize| {
            let normal = self.normals.cloud[index]?;
            Some(Point { position: self.cloud.points[index], normal, colour: colours[index] })
        };
        search.within(keypoint, radius).iter().filter_map(|near| point(near.index as usize)).collect()
    }
}

#[test]
fn pfhrgb_is_its_definition() {
    for seed in 0..4 {
        let scene = Scene::new(sheet(seed, 500));
        let regions: Vec<Vec<Point>> =
            scene.keypoints.points.iter().map(|&keypoint| scene.near(keypoint, 0.03)).collect();
        let expected: Vec<_> = regions.iter().filter(|near| near.len() >= 3).collect();
        let found = scene.describe(FixedKind::PfhRgb, 30_000).unwrap();
        assert_eq!(found.rows().len(), expected.len());
        let mut moved = 0.0;
        for (row, near) in found.rows().zip(&expected) {
            let ordered_pairs = (near.len() * (near.len() - 1)) as f64;
            let expected = oracle::pfhrgb(near);
            let differences = row.iter().zip(&expected).map(|(&a, b)| (f64::from(a) - b).abs());
            // A pair that moves to another bin leaves one and comes to one.
            moved += differences.sum::<f64>() * ordered_pairs / 400.0;
        }
        assert!(moved < 5.0, "{moved} pairs in another bin");
    }
}

#[test]
fn shotcolor_is_its_definition() {
    let radius = 0.05;
    for seed in 0..4 {
        let scene = Scene::new(sheet(seed, 900));
        let surface = Surface::new(&scene.cloud, &scene.normals, radius, SORTED_ABOVE).unwrap();
        let found = scene.describe(FixedKind::ShotColor, 50_000).unwrap();
        let mut rows = found.rows();
        let colours = scene.keypoints.colours.as_ref().unwrap();
        for (&keypoint, &colour) in scene.keypoints.points.iter().zip(colours) {
            let mut neighbourhood = Neighbourhood::default();
            neighbourhood.fill(&surface, keypoint, [0.0, floor_f32(radius * radius)]);
            let Some(frame) = Frame::new(&neighbourhood, keypoint, radius) else { continue };
            let near: Vec<Point> =
                scene.near(keypoint, radius).into_iter().filter(|point| point.position != keypoint).collect();
            let expected = oracle::shotcolor(&near, keypoint, colour, frame, radius);
            for (bin, (&found, expected)) in rows.next().unwrap().iter().zip(expected).enumerate() {
                assert!(
                    (f64::from(found) - expected).abs() < 1e-4,
                    "seed {seed}, bin {bin}: {found}, {expected}"
                );
            }
        }
        assert_eq!(rows.len(), 0);
    }
}

#[test]
fn a_frame_turns_with_the_cloud() {
    let scene = Scene::new(sheet(3, 900));
    let turned = Cloud {
        // A quarter turn about x: what was up is ahead.
        points: scene.cloud.points.iter().map(|&[x, y, z]| [x, -z, y]).collect(),
        ..scene.cloud.clone()
    };
    let turned_normals = Normals {
        cloud: scene.normals.cloud.iter().map(|normal| normal.map(|[x, y, z]| [x, -z, y])).collect(),
        keypoints: Vec::new(),
    };
    let radius = 0.05;
    let limits = [0.0, floor_f32(radius * radius)];
    let frame = |cloud: &Cloud, normals: &Normals, centre: [f32; 3]| {
        let mut near = Neighbourhood::default();
        near.fill(&Surface::new(cloud, normals, radius, SORTED_ABOVE).unwrap(), centre, limits);
        Frame::new(&near, centre, radius).unwrap()
    };
    for &[x, y, z] in &scene.keypoints.points {
        let before = frame(&scene.cloud, &scene.normals, [x, y, z]);
        let after = frame(&turned, &turned_normals, [x, -z, y]);
        for ([x, y, z], after) in [before.x, before.y, before.z].into_iter().zip([after.x, after.y, after.z])
        {
            for (before, after) in [x, -z, y].into_iter().zip(after) {
                assert!((before - after).abs() < 1e-5, "{before}, {after}");
            }
        }
    }
}

#[test]
fn equal_points_are_no_pair() {
    // Ten points at one place and ten at another, each with one normal: all pairs that count are alike.
    let (here, there) = ([0.0, 0.0, 0.6], [0.01, 0.0, 0.6]);
    let points: Vec<[f32; 3]> = (0..20).map(|index| if index % 2 == 0 { here } else { there }).collect();
    let cloud = Cloud { colours: Some(vec![[10, 100, 200]; 20]), points, viewpoint: [0.0; 3] };
    let normals = Normals { cloud: vec![Some([0.0, 0.0, -1.0]); 20], keypoints: vec![None] };
    let keypoints = Keypoints { points: vec![here], colours: Some(vec![[0; 3]]) };
    let descriptor = FixedDescriptor { kind: FixedKind::PfhRgb, radius_um: 50_000 };
    let found = descriptor.describe(&cloud, &keypoints, &normals).unwrap();
    let row = found.rows().next().unwrap();
    let filled: Vec<(usize, f32)> =
        row.iter().copied().enumerate().filter(|&(_, value)| value > 0.0).collect();
    let share = 100.0 * 200.0 / 190.0;
    assert_eq!(filled, [(2 + 5 * 2 + 25 * 2, share), (125 + 4 + 5 * 4 + 25 * 4, share)]);
}

#[test]
fn a_keypoint_needs_neighbours() {
    let normal = Some([0.0, 0.0, -1.0]);
    let scene = |points: usize| Scene {
        cloud: Cloud {
            points: (0..points)
                .map(|index| [0.001 * (index * index) as f32, 0.001 * index as f32, 0.6])
                .collect(),
            colours: Some(vec![[1, 2, 3]; points]),
            viewpoint: [0.0; 3],
        },
        keypoints: Keypoints { points: vec![[0.0, 0.001, 0.6]], colours: Some(vec![[1, 2, 3]]) },
        normals: Normals { cloud: vec![normal; points], keypoints: vec![normal] },
    };
    for (kind, least) in [(FixedKind::PfhRgb, 3), (FixedKind::ShotColor, 5)] {
        assert_eq!(
            scene(least - 1).describe(kind, 50_000).unwrap_err(),
            DescribeError::NothingDescribed { kind, keypoints: 1 }
        );
        let found = scene(least).describe(kind, 50_000).unwrap();
        let row = found.rows().next().unwrap();
        assert_eq!(row.len(), kind.size());
        assert!(row.iter().all(|value| value.is_finite() && *value >= 0.0), "{kind}: {row:?}");
    }
    let colourless = Cloud { colours: None, ..scene(9).cloud };
    let found = FixedDescriptor { kind: FixedKind::PfhRgb, radius_um: 50_000 }.describe(
        &colourless,
        &scene(9).keypoints,
        &scene(9).normals,
    );
    assert_eq!(found.unwrap_err(), PrepareError::NoColours.into());
}

#[test]
fn a_large_cloud_is_described_like_a_small_one() {
    let scene = Scene::new(sheet(1, 700));
    let surface = |sorted_above| Surface::new(&scene.cloud, &scene.normals, 0.05, sorted_above).unwrap();
    let colours = scene.cloud.colours.as_ref().unwrap();
    let radius = Radius { metres: 0.05, squared: floor_f32(0.05 * 0.05) };
    let rows = |surface: &Surface| {
        let colours: Vec<[u8; 3]> = surface.indices.iter().map(|&index| colours[index as usize]).collect();
        let keypoints = scene.keypoints.points.iter().map(|&point| (point, [0; 3]));
        pfhrgb::rows(surface, &colours, keypoints, radius)
    };
    let (in_order, sorted) = (surface(SORTED_ABOVE), surface(0));
    assert_ne!(in_order.indices, sorted.indices);
    let (in_order, sorted) = (rows(&in_order), rows(&sorted));
    let moved = in_order.iter().zip(&sorted).filter(|(a, b)| a != b).count();
    // The first of two points is the other one: some edges are met from the other side.
    assert!(moved * 1000 < in_order.len(), "{moved} of {} values differ", in_order.len());
}

/// Which blocks and batches the pairs of a cloud are counted in must not show.
#[test]
fn regions_are_the_same_counted_at_once_or_in_parts() {
    for (seed, sorted_above) in [(1, SORTED_ABOVE), (2, 0)] {
        let scene = Scene::new(sheet(seed, 700));
        let surface = Surface::new(&scene.cloud, &scene.normals, 0.05, sorted_above).unwrap();
        let colours = scene.cloud.colours.as_ref().unwrap();
        let colours: Vec<[u8; 3]> = surface.indices.iter().map(|&index| colours[index as usize]).collect();
        // Regions of 3 cm share most of their points; those of 7 mm, about keypoints 2 cm apart, none.
        for metres in [0.03, 0.007] {
            let radius = Radius { metres, squared: floor_f32(metres * metres) };
            let keypoints = || scene.keypoints.points.iter().copied();
            let rows = |at_once| pfhrgb::rows_in_parts(&surface, &colours, keypoints(), radius, at_once);
            let whole = rows([usize::MAX, usize::MAX]);
            assert!(whole.len() > 5 * FixedKind::PfhRgb.size(), "{}", whole.len());
            // From one point and one keypoint at a time to a few.
            for at_once in [[0, 0], [10_000, 0], [0, usize::MAX], [70_000, 150], [200_000, usize::MAX]] {
                assert!(rows(at_once) == whole, "seed {seed}, {metres} m, {at_once:?}");
            }
        }
    }
}

#[test]
fn names_are_read_as_they_are_written() {
    for kind in FixedKind::ALL {
        assert_eq!(FixedKind::named(kind.name()), Some(kind));
    }
    assert_eq!(FixedKind::named("shot"), None);
}

/// Digests of rows and signatures; they change only together with [`crate::EVALUATION_VERSION`].
#[test]
fn outputs_are_those_of_the_evaluation_version() {
    for (kind, expected) in FixedKind::ALL.into_iter().zip(["d5e13aec042fef07", "d9768a2ce56dd4eb"]) {
        let mut hasher = Hasher::new();
        let mut add = |values: &[f32]| {
            for value in values {
                hasher.update(&value.to_bits().to_le_bytes());
            }
        };
        for seed in 0..6 {
            let scene = Scene::new(sheet(seed, 350 + 40 * seed as usize));
            let found = scene.describe(kind, 50_000).unwrap();
            found.rows().for_each(&mut add);
            let Signature { centroid, deviation } = found.signature();
            add(&centroid);
            add(&deviation);
        }
        assert_eq!(
            &hasher.finalize().to_hex()[..16],
            expected,
            "{kind}: raise EVALUATION_VERSION if that is meant"
        );
    }
}
