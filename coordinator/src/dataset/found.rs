//! What lies below a data root in which a layout finds no cloud, and how to make clouds of it.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use super::error::DatasetError;

/// Files that are counted at most: a message needs no more.
const MAX_FILES: u64 = 100_000;

/// Folders below folders that are looked into.
const MAX_DEPTH: usize = 8;

/// Endings that a message names; the others are only counted.
const NAMED: usize = 6;

/// How to make clouds, by the endings of the files that they are made of; the first that is there is told.
const ADVICE: [(&[&str], &str); 7] = [
    (&[".pcd", ".ply"], "move them there, or describe where they are by layout \"pattern\" or a manifest"),
    (
        &[".xyz", ".xyzn", ".xyzrgb", ".pts"],
        "python3 -c 'import open3d as o, sys; o.io.write_point_cloud(sys.argv[2], o.io.read_point_cloud(sys.argv[1]))' IN.xyz OUT.ply",
    ),
    (
        &[".obj", ".stl", ".off", ".glb", ".gltf"],
        "these are models, of which Open3D makes one view: python3 -c 'import open3d as o, sys; \
         m = o.io.read_triangle_mesh(sys.argv[1]); p = o.geometry.PointCloud(m.vertices); p.colors = m.vertex_colors; \
         _, seen = p.hidden_point_removal([0, 0, 1], 1000); o.io.write_point_cloud(sys.argv[2], p.select_by_index(seen))' IN.obj OUT.ply",
    ),
    (
        &[".npy"],
        "of columns x, y, z, red, green and blue: python3 -c 'import numpy, open3d as o, sys; a = numpy.load(sys.argv[1]); v = o.utility.Vector3dVector; \
         p = o.geometry.PointCloud(v(a[:, :3])); p.colors = v(a[:, 3:6] / 255); o.io.write_point_cloud(sys.argv[2], p)' IN.npy OUT.ply",
    ),
    (
        &[".las", ".laz"],
        "with colours: python3 -c 'import laspy, numpy, open3d as o, sys; a = laspy.read(sys.argv[1]); v = o.utility.Vector3dVector; \
         p = o.geometry.PointCloud(v(a.xyz)); p.colors = v(numpy.stack([a.red, a.green, a.blue], 1) / 65535); \
         o.io.write_point_cloud(sys.argv[2], p)' IN.las OUT.ply",
    ),
    (&[".bag"], "rosrun pcl_ros bag_to_pcd IN.bag TOPIC FOLDER, and then segment the object"),
    (
        &[".png", ".jpg", ".jpeg", ".tif", ".tiff"],
        "of images, those of layouts \"uw\" (_crop.png, _depthcrop.png, _maskcrop.png, _loc.txt) and \"bop\"; of others Open3D makes clouds \
         with geometry.PointCloud.create_from_rgbd_image, and io.write_point_cloud writes them",
    ),
];

/// The error of a root without clouds, which are `expected` at paths of some form.
pub(super) fn no_clouds(root: &Path, expected: &str) -> DatasetError {
    let mut counts = BTreeMap::new();
    let mut left = MAX_FILES;
    count(root, MAX_DEPTH, &mut left, &mut counts);
    let has = |ending: &&str| counts.contains_key(*ending);
    let known = ADVICE.iter().find(|(endings, _)| endings.iter().any(&has));
    let advice = known
        .map_or("put them there, for example as Open3D's io.write_point_cloud writes them", |(_, advice)| {
            advice
        });
    let (root, expected) = (root.to_owned(), expected.to_owned());
    DatasetError::NoClouds { root, expected, found: told(counts), advice }
}

/// The counts in words, the largest first.
fn told(counts: BTreeMap<String, u64>) -> String {
    let mut counts: Vec<(String, u64)> = counts.into_iter().collect();
    counts.sort_by(|(a, left), (b, right)| right.cmp(left).then_with(|| a.cmp(b)));
    let others: u64 = counts.iter().skip(NAMED).map(|(_, count)| count).sum();
    let mut words: Vec<String> =
        counts.into_iter().take(NAMED).map(|(ending, count)| format!("{count} {ending}")).collect();
    if others > 0 {
        words.push(format!("{others} others"));
    }
    if words.is_empty() { "no files".to_owned() } else { words.join(", ") }
}

/// Counts files by ending; what cannot be listed counts for nothing, and symbolic links are not followed.
fn count(folder: &Path, depth: usize, left: &mut u64, counts: &mut BTreeMap<String, u64>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.filter_map(Result::ok) {
        let (Ok(kind), name) = (entry.file_type(), entry.file_name()) else { continue };
        let name = name.to_string_lossy();
        if name.starts_with('.') {
            continue;
        }
        if kind.is_dir() && depth > 0 {
            count(&entry.path(), depth - 1, left, counts);
        } else if kind.is_file() {
            if *left == 0 {
                return;
            }
            *left -= 1;
            let ending = match name.rsplit_once('.') {
                // Longer ones are no endings but names with points in them.
                Some((_, ending)) if ending.len() <= 8 && ending.chars().all(char::is_alphanumeric) => {
                    format!(".{}", ending.to_lowercase())
                }
                _ => "without ending".to_owned(),
            };
            *counts.entry(ending).or_default() += 1;
        }
    }
}
