//! Radius search, voxel grid, eigenvectors and normals against brute force, nalgebra and their symmetries.

use nalgebra::{Matrix3, Rotation3, SymmetricEigen, Unit, Vector3};
use proptest::prelude::*;
use rand::RngExt;

use crate::eigen::smallest_eigenvector;
use crate::keypoints::Keypoints;
use crate::neighbours::{RadiusSearch, floor_f32};
use crate::normals::{Normal, normals};
use crate::prepare_error::PrepareError;
use crate::random::stream;
use crate::testing::{in_cube, sheet, unit};
use crate::{Cloud, oracle};

/// Normals of a cloud's own points.
fn fit(points: &[[f32; 3]], radius: f64, viewpoint: [f32; 3]) -> Vec<Normal> {
    let [normals, _] = normals(points, &[], radius, viewpoint).unwrap();
    normals
}

/// Compares the search with brute force for every point and some others as queries.
fn check_search(points: &[[f32; 3]], radius: f64) {
    let search = RadiusSearch::new(points).unwrap();
    let mut rng = stream(1, "queries", &[]);
    let others = (0..20).map(|_| in_cube(&mut rng, 1.0));
    for query in points.iter().copied().step_by(points.len() / 50 + 1).chain(others) {
        let found: Vec<(f32, u32)> =
            search.within(query, radius).iter().map(|neighbour| (neighbour.d2, neighbour.index)).collect();
        let expected = oracle::within(points, query, radius);
        assert_eq!(found, expected, "query {query:?}, radius {radius}");
        for enough in [0, 3, usize::MAX] {
            assert_eq!(search.count_within(query, radius, enough), expected.len().min(enough));
        }
    }
}

#[test]
fn search_finds_what_brute_force_finds() {
    let mut rng = stream(1, "points", &[]);
    let mut random =
        |count: usize, side: f32| (0..count).map(|_| in_cube(&mut rng, side)).collect::<Vec<_>>();

    for count in [0, 1, 3, 31, 32, 33, 700] {
        let points = random(count, 1.0);
        for radius in [0.0, 0.01, 0.3, 2.0] {
            check_search(&points, radius);
        }
    }
    // Dense clusters far apart.
    let centres = random(5, 1000.0);
    let clusters: Vec<[f32; 3]> = random(1500, 0.02)
        .iter()
        .zip(centres.iter().cycle())
        .map(|(offset, centre)| [0, 1, 2].map(|axis| centre[axis] + offset[axis]))
        .collect();
    check_search(&clusters, 0.01);
}

#[test]
fn search_decides_ties_and_the_edge_exactly() {
    // A grid of step 1/8: many equal distances, many exactly at the radius, all exact in f32.
    let lattice: Vec<[f32; 3]> =
        (0..9 * 9 * 9).map(|i| [i % 9, i / 9 % 9, i / 81].map(|steps: i32| steps as f32 / 8.0)).collect();
    for radius in [0.125, 0.25, 0.375] {
        check_search(&lattice, radius);
    }
    let search = RadiusSearch::new(&lattice).unwrap();
    let centre = [0.5; 3];
    assert_eq!(search.within(centre, 0.125).len(), 7, "the edge belongs to the ball");
    assert_eq!(search.within(centre, 0.125f64.next_down()).len(), 1);
}

#[test]
fn search_survives_equal_points_and_extreme_coordinates() {
    let equal = vec![[0.25f32, 0.5, -0.75]; 5000];
    check_search(&equal, 0.1);
    let plane: Vec<[f32; 3]> =
        (0..3000).map(|i| [(i % 7) as f32 / 64.0, 0.5, (i % 11) as f32 / 64.0]).collect();
    check_search(&plane, 0.05);
    let mut rng = stream(1, "wide", &[]);
    let wide: Vec<[f32; 3]> = (0..600)
        .map(|i| {
            let scale = [1e-6, 1e-3, 1.0, 1e6, 3e38][i % 5];
            [0, 1, 2].map(|_| (unit(&mut rng) - 0.5) * scale)
        })
        .collect();
    for radius in [1e-6, 1e-3, 1.0, 4000.0, 1e30] {
        check_search(&wide, radius);
    }
}

#[test]
fn comparing_in_f32_is_comparing_in_f64() {
    let mut rng = stream(1, "floor", &[]);
    for _ in 0..10_000 {
        let value = f64::from(unit(&mut rng)) / f64::from(unit(&mut rng) + 0.1);
        let floor = floor_f32(value);
        assert!(f64::from(floor) <= value && f64::from(floor.next_up()) > value);
    }
}

fn check_voxels(cloud: &Cloud, leaf: f32) {
    let keypoints = Keypoints::new(cloud, leaf).unwrap();
    let voxels = oracle::voxels(&cloud.points, leaf);
    assert_eq!(keypoints.len(), voxels.len());
    let colours = cloud.colours.as_ref().unwrap();
    let means = keypoints.points.iter().zip(keypoints.colours.as_ref().unwrap());
    for (members, (point, colour)) in voxels.iter().zip(means) {
        let count = members.len();
        for (axis, &mean) in point.iter().enumerate() {
            let sum: f64 = members.iter().map(|&member| f64::from(cloud.points[member][axis])).sum();
            assert_eq!(mean, (sum / count as f64) as f32);
        }
        for (channel, &mean) in colour.iter().enumerate() {
            let sum: usize = members.iter().map(|&member| usize::from(colours[member][channel])).sum();
            assert_eq!(usize::from(mean), sum / count);
        }
    }
}

#[test]
fn voxel_grid_is_brute_forces() {
    for (seed, points) in [(1, 0), (2, 1), (3, 400), (4, 3000)] {
        let cloud = sheet(seed, points);
        for leaf in [0.02, 0.005, 0.5] {
            check_voxels(&cloud, leaf);
        }
    }
    // So far apart that the numbers of all voxels between them do not fit 64 bits.
    let mut cloud = sheet(5, 300);
    for (point, far) in cloud.points.iter_mut().zip([-4e7f32, 4e7, -3e7, 4e7].into_iter().cycle().take(100)) {
        *point = point.map(|coordinate| coordinate + far);
    }
    check_voxels(&cloud, 0.02);
}

#[test]
fn a_cell_that_does_not_fit_is_an_error() {
    for coordinate in [1e9f32, -1e9, 3e38] {
        let mut cloud = sheet(1, 20);
        cloud.points[7][1] = coordinate;
        let error = Keypoints::new(&cloud, 0.02).unwrap_err();
        assert!(matches!(error, PrepareError::CellRange { coordinate: got, .. } if got == coordinate));
    }
    let mut cloud = sheet(1, 20);
    cloud.points[7][1] = 4e7;
    assert!(Keypoints::new(&cloud, 0.02).is_ok());
}

/// A cloud on a grid of 2⁻¹² m, so that sums are exact in any order and translations by leaves of 2⁻⁶ m are exact.
fn gridded(seed: u64) -> Cloud {
    let mut cloud = sheet(seed, 500);
    for coordinate in cloud.points.iter_mut().flatten() {
        *coordinate = (*coordinate * 4096.0).floor() / 4096.0;
    }
    cloud
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn voxel_grid_ignores_the_order_of_the_points(seed in 0u64..1000) {
        let cloud = gridded(seed);
        let mut order: Vec<usize> = (0..cloud.len()).collect();
        let mut rng = stream(seed, "order", &[]);
        for last in (1..order.len()).rev() {
            order.swap(last, rng.random::<u32>() as usize % (last + 1));
        }
        let shuffled = Cloud {
            points: order.iter().map(|&index| cloud.points[index]).collect(),
            colours: cloud.colours.as_ref().map(|all| order.iter().map(|&index| all[index]).collect()),
            viewpoint: cloud.viewpoint,
        };
        prop_assert_eq!(Keypoints::new(&shuffled, 0.015_625).unwrap(), Keypoints::new(&cloud, 0.015_625).unwrap());
    }

    #[test]
    fn voxel_grid_moves_by_whole_leaves(seed in 0u64..1000, steps in prop::array::uniform3(-40i32..40)) {
        let cloud = gridded(seed);
        let leaf = 0.015_625f32;
        let moved = |point: [f32; 3]| [0, 1, 2].map(|axis| point[axis] + steps[axis] as f32 * leaf);
        let mut translated = cloud.clone();
        translated.points.iter_mut().for_each(|point| *point = moved(*point));
        let keypoints = Keypoints::new(&cloud, leaf).unwrap();
        let after = Keypoints::new(&translated, leaf).unwrap();
        prop_assert_eq!(&after.colours, &keypoints.colours);
        prop_assert_eq!(after.len(), keypoints.len());
        for (after, before) in after.points.iter().zip(&keypoints.points) {
            for (after, before) in after.iter().zip(moved(*before)) {
                prop_assert!((after - before).abs() < 2e-7, "{} {}", after, before);
            }
        }
    }

    #[test]
    fn normals_turn_with_the_cloud_and_its_viewpoint(
        seed in 0u64..1000,
        axis in prop::array::uniform3(-1.0f64..1.0),
        angle in 0.0f64..6.0,
        shift in prop::array::uniform3(-1.0f64..1.0),
    ) {
        prop_assume!(Vector3::from(axis).norm() > 0.1);
        let rotation = Rotation3::from_axis_angle(&Unit::new_normalize(Vector3::from(axis)), angle);
        let place = |point: [f32; 3]| -> [f32; 3] {
            (rotation * Vector3::from(point.map(f64::from)) + Vector3::from(shift)).cast::<f32>().into()
        };
        let cloud = sheet(seed, 600);
        let moved: Vec<[f32; 3]> = cloud.points.iter().copied().map(place).collect();
        // The sheet is rough by 0.8 mm: a 2 cm neighbourhood is flat against f32's rounding of the moved points.
        let radius = 0.02;
        let before = fit(&cloud.points, radius, cloud.viewpoint);
        let after = fit(&moved, radius, place(cloud.viewpoint));
        let mut compared = 0;
        for (index, (before, after)) in before.iter().zip(&after).enumerate() {
            // A neighbour on the very edge may be lost to rounding; then the two planes are of different points.
            let near = |points: &[[f32; 3]]| oracle::within(points, points[index], radius).len();
            if near(&cloud.points) != near(&moved) || near(&moved) < 6 {
                continue;
            }
            let (before, after) = (before.unwrap(), after.unwrap());
            let turned = rotation * Vector3::from(before.map(f64::from));
            let cosine = turned.dot(&Vector3::from(after.map(f64::from)));
            prop_assert!(cosine > 1.0 - 1e-6, "point {}: {}", index, cosine);
            compared += 1;
        }
        prop_assert!(compared > 300, "compared only {}", compared);
    }

    #[test]
    fn eigenvector_is_nalgebras(values in prop::array::uniform3(0.0f64..1.0), entries in prop::array::uniform9(-1.0f64..1.0)) {
        // A matrix with known eigenvalues, the smallest well apart.
        let basis = nalgebra::QR::new(Matrix3::from_row_slice(&entries)).q();
        let mut values = values;
        values.sort_by(f64::total_cmp);
        prop_assume!(values[1] - values[0] > 1e-3);
        let matrix = basis * Matrix3::from_diagonal(&Vector3::from(values)) * basis.transpose();
        let found = Vector3::from(smallest_eigenvector([
            matrix[(0, 0)], matrix[(0, 1)], matrix[(0, 2)], matrix[(1, 1)], matrix[(1, 2)], matrix[(2, 2)],
        ]));
        let eigen = SymmetricEigen::new((matrix + matrix.transpose()) * 0.5);
        let expected = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        prop_assert!((found.norm() - 1.0).abs() < 1e-14);
        prop_assert!(found.cross(&expected).norm() < 1e-10, "{} {}", found, expected);
    }
}

#[test]
fn eigenvector_of_degenerate_matrices_is_a_unit_eigenvector() {
    for matrix in [
        [0.0; 6],
        [1.0, 0.0, 0.0, 1.0, 0.0, 1.0],
        [1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
        [2.0, 0.0, 0.0, 3.0, 0.0, 1.0],
        [1e-30, 1e-31, 0.0, 1e-30, 0.0, 1e-29],
        [1e100, 1e99, 1e98, 1e100, 1e97, 1e100],
        [4.0, 2.0, 0.0, 1.0, 0.0, 0.0],
    ] {
        let [xx, xy, xz, yy, yz, zz] = matrix;
        let v = Vector3::from(smallest_eigenvector(matrix));
        let a = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        let smallest = SymmetricEigen::new(a).eigenvalues.min();
        assert!((v.norm() - 1.0).abs() < 1e-14, "{matrix:?}: {v}");
        assert!((a * v - v * smallest).norm() <= 1e-12 * a.norm(), "{matrix:?}: {v}");
    }
}

#[test]
fn normals_are_brute_forces() {
    for (seed, radius) in [(1, 0.005), (2, 0.02), (3, 0.05)] {
        let cloud = sheet(seed, 500);
        let keypoints = Keypoints::new(&cloud, 0.02).unwrap();
        let mut missing = 0;
        let queries = [cloud.points.as_slice(), &keypoints.points];
        let found = normals(&cloud.points, &keypoints.points, radius, cloud.viewpoint).unwrap();
        for (queries, found) in queries.into_iter().zip(found) {
            for (query, found) in queries.iter().zip(found) {
                let expected = oracle::normal(&cloud.points, *query, radius, cloud.viewpoint);
                assert_eq!(found.is_some(), expected.is_some());
                let (Some(found), Some(expected)) = (found, expected) else {
                    missing += 1;
                    continue;
                };
                let cosine: f64 = found.iter().zip(expected).map(|(&a, b)| f64::from(a) * b).sum();
                // Few points nearly in a line leave the plane open: there any two methods differ.
                let few = oracle::within(&cloud.points, *query, radius).len() < 6;
                assert!(cosine > 1.0 - 1e-7 || few, "{query:?}: {found:?}, expected {expected:?}");
            }
        }
        assert_eq!(missing > 0, seed == 1, "some points of the sparse case have no normal: {missing}");
    }
}

#[test]
fn normals_of_a_plane_face_the_viewpoint() {
    let mut points: Vec<[f32; 3]> =
        (0..400).map(|i| [(i % 20) as f32 / 256.0, (i / 20) as f32 / 256.0, 0.5]).collect();
    points.push([9.0, 9.0, 9.0]); // alone
    points.extend([[7.0, 7.0, 7.0], [7.0, 7.0, 7.0]]); // two
    points.extend([[5.0, 5.0, 5.0]; 3]); // three equal points: any plane, but a normal
    for (viewpoint, z) in [([0.0, 0.0, 0.0], -1.0), ([0.0, 0.0, 1.0], 1.0)] {
        let found = fit(&points, 0.01, viewpoint);
        assert!(found[..400].iter().all(|normal| *normal == Some([0.0, 0.0, z])), "{:?}", found[0]);
        assert_eq!(found[400..403], [None; 3]);
        let length: f32 = found[403].unwrap().iter().map(|component| component * component).sum();
        assert!((length - 1.0).abs() < 1e-6);
    }
}

/// Points on a line, exactly or nearly: the normal may be any, but not along the line.
#[test]
fn normals_of_a_line_are_across_it() {
    let mut rng = stream(1, "lines", &[]);
    for case in 0..400 {
        let direction = Vector3::from(in_cube(&mut rng, 2.0).map(f64::from)) - Vector3::new(1.0, 1.0, 1.0);
        if direction.norm() < 0.1 {
            continue;
        }
        let direction = direction.normalize();
        let rough = [0.0, 1e-7, 1e-6][case % 3];
        let count = 3 + case % 28;
        let points: Vec<[f32; 3]> = (0..count)
            .map(|_| {
                let along = direction * (f64::from(unit(&mut rng)) - 0.5) * 0.009;
                let off = Vector3::from(in_cube(&mut rng, 1.0).map(f64::from)) * rough;
                (along + off + Vector3::new(0.1, -0.2, 0.8)).cast::<f32>().into()
            })
            .collect();
        for normal in fit(&points, 0.01, [0.0; 3]).into_iter().flatten() {
            let along: f64 = normal.iter().zip(direction.iter()).map(|(&n, d)| f64::from(n) * d).sum();
            assert!(along.abs() < 0.05, "case {case}: {normal:?} along {direction:?}: {along}");
        }
    }
}

/// A small patch beside the query, which is none of its points.
#[test]
fn normals_of_a_patch_far_from_the_query_are_brute_forces() {
    let mut rng = stream(1, "patches", &[]);
    for size in [0.002, 0.0002, 0.00005] {
        let points: Vec<[f32; 3]> = (0..12)
            .map(|_| {
                let [x, y, z] = in_cube(&mut rng, size);
                [0.1 + x, -0.2 + y, 0.8 + 0.1 * z]
            })
            .collect();
        let query = [0.1, -0.2, 0.8 - 0.0095];
        let [_, found] = normals(&points, &[query], 0.01, [0.0; 3]).unwrap();
        let expected = oracle::normal(&points, query, 0.01, [0.0; 3]).unwrap();
        let is_close = |(&found, expected): (&f32, f64)| (f64::from(found) - expected).abs() < 3e-5;
        let found = found[0].unwrap();
        assert!(
            found.iter().zip(expected).all(is_close),
            "patch of {size} m: {found:?}, expected {expected:?}"
        );
    }
}

#[test]
fn one_stray_point_far_away_changes_no_normal() {
    let cloud = sheet(4, 500);
    let before = fit(&cloud.points, 0.01, cloud.viewpoint);
    for far in [3.0f32, 300.0, 1e6] {
        let mut points = cloud.points.clone();
        points.push([far, -far, far]);
        let after = fit(&points, 0.01, cloud.viewpoint);
        assert_eq!(after.last(), Some(&None));
        for (before, after) in before.iter().zip(&after) {
            assert_eq!(before.is_some(), after.is_some());
            let cosine = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
            // Other cubes, another order of the sums.
            assert!(before.zip(*after).is_none_or(|(a, b)| cosine(a, b) > 1.0 - 1e-6));
        }
    }
}
