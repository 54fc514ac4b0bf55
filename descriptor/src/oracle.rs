//! The descriptor written straight from its definition (DESIGN 5), slow and without any of the shortcuts.

use std::collections::BTreeMap;

use crate::colour::HueSaturation;
use crate::keypoints::Keypoints;
use crate::normals::Normal;
use crate::{Cloud, Parameters};

/// Neighbours within a radius, nearest first, ties by index: every point is looked at.
pub(crate) fn within(points: &[[f32; 3]], query: [f32; 3], radius: f64) -> Vec<(f32, u32)> {
    let mut found: Vec<(f32, u32)> = Vec::new();
    for (index, point) in points.iter().enumerate() {
        let [dx, dy, dz] = [point[0] - query[0], point[1] - query[1], point[2] - query[2]];
        let d2 = dx * dx + dy * dy + dz * dz;
        if f64::from(d2) <= radius * radius {
            found.push((d2, index as u32));
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found
}

/// Members of every occupied voxel in the order z, y, x.
pub(crate) fn voxels(points: &[[f32; 3]], leaf: f32) -> Vec<Vec<usize>> {
    let mut voxels: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
    for (index, point) in points.iter().enumerate() {
        let [x, y, z] = point.map(|coordinate| (coordinate * (1.0 / leaf)).floor() as i64);
        voxels.entry([z, y, x]).or_default().push(index);
    }
    voxels.into_values().collect()
}

/// The normal of the plane fitted to all points within a radius, by nalgebra's eigenvectors.
pub(crate) fn normal(
    points: &[[f32; 3]],
    query: [f32; 3],
    radius: f64,
    viewpoint: [f32; 3],
) -> Option<[f64; 3]> {
    use nalgebra::{Matrix3, SymmetricEigen, Vector3};
    let vector = |point: [f32; 3]| Vector3::from(point.map(f64::from));
    let near: Vec<Vector3<f64>> =
        within(points, query, radius).iter().map(|&(_, index)| vector(points[index as usize])).collect();
    if near.len() < 3 {
        return None;
    }
    let mean = near.iter().sum::<Vector3<f64>>() / near.len() as f64;
    let covariance: Matrix3<f64> = near.iter().map(|point| (point - mean) * (point - mean).transpose()).sum();
    let eigen = SymmetricEigen::new(covariance / near.len() as f64);
    let mut normal: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into();
    if (vector(viewpoint) - vector(query)).dot(&normal) < 0.0 {
        normal = -normal;
    }
    Some(normal.into())
}

/// Bin of an angle by the paper's equation 2, from the arc cosine in f64.
pub(crate) fn shape_bin(cosine: f32, shape_bins: u32) -> usize {
    let degrees = libm::acos(f64::from(cosine).clamp(-1.0, 1.0)).to_degrees();
    let bin = degrees * f64::from(shape_bins - 1) / 360.0;
    // Opposite normals are 180 degrees apart exactly, whatever the arc cosine rounds to.
    if cosine == -1.0 {
        return (shape_bins as usize - 1) / 2;
    }
    assert!(
        bin < 0.5 || (bin - bin.round()).abs() > 1e-9,
        "cosine {cosine} lies on an edge of {shape_bins} bins"
    );
    bin.floor() as usize
}

/// Bin of a colour.
pub(crate) fn colour_bin(colour: [u8; 3], m: u32) -> usize {
    let HueSaturation { hue, saturation } = HueSaturation::new(colour);
    let hue = ((hue * m as f32 / 360.0).floor() as usize).min(m as usize - 1);
    let saturation = ((saturation * m as f32 / 100.0).floor() as usize).min(m as usize - 1);
    m as usize * hue + saturation
}

/// Shape rows and colour rows of the keypoints that have a normal, as `histogram` makes them.
pub(crate) fn rows(
    cloud: &Cloud,
    keypoints: &Keypoints,
    cloud_normals: &[Normal],
    keypoint_normals: &[Normal],
    parameters: &Parameters,
) -> (Vec<f32>, Vec<f32>) {
    let (bins, m) = (parameters.shape_bins as usize, parameters.colour_bins as usize);
    let (mut shape_rows, mut colour_rows) = (Vec::new(), Vec::new());
    for (&keypoint, axis) in keypoints.points.iter().zip(keypoint_normals) {
        let Some(axis) = axis else { continue };
        let mut shape = [vec![0.0f32; bins], vec![0.0f32; bins]];
        let mut colour = [vec![0.0f32; m * m], vec![0.0f32; m * m]];
        let mut points = [0.0f32; 2];
        for (d2, index) in within(&cloud.points, keypoint, parameters.ring_radius()) {
            let index = index as usize;
            let Some(normal) = cloud_normals[index] else { continue };
            let in_disk = f64::from(d2) <= parameters.disk_radius() * parameters.disk_radius();
            let region = if in_disk { 0 } else { 1 };
            let cosine = axis[0] * normal[0] + axis[1] * normal[1] + axis[2] * normal[2];
            shape[region][shape_bin(cosine, parameters.shape_bins)] += 1.0;
            if let (Some(colours), 1..) = (&cloud.colours, m) {
                colour[region][colour_bin(colours[index], parameters.colour_bins)] += 1.0;
            }
            points[region] += 1.0;
        }
        for (rows, histograms) in [(&mut shape_rows, shape), (&mut colour_rows, colour)] {
            for (histogram, points) in histograms.into_iter().zip(points) {
                rows.extend(
                    histogram.into_iter().map(|count| if points > 0.0 { count / points } else { 0.0 }),
                );
            }
        }
    }
    (shape_rows, colour_rows)
}

/// Hue in degrees, from the definition of the hexcone in f64.
pub(crate) fn hue([r, g, b]: [u8; 3]) -> f64 {
    let [r, g, b] = [r, g, b].map(f64::from);
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    let range = most - least;
    if range == 0.0 {
        return 0.0;
    }
    let sextant = if r == most {
        (g - b) / range
    } else if g == most {
        (b - r) / range + 2.0
    } else {
        (r - g) / range + 4.0
    };
    (60.0 * sextant).rem_euclid(360.0)
}
