//! Clouds with more points: copies of each, a little off, as a camera of a higher resolution would see them.

use std::fs;
use std::path::Path;

use descriptor::{Cloud, pcd, random};
use rand::RngExt as _;

/// How far copies are off along each axis at most, metres: about the distance of neighbouring points.
const OFF: f32 = 0.002;

/// Gives each cloud of a set that many times its points; how many a cloud has then, on average.
pub fn fill(data: &Path, times: u32) -> f64 {
    let lists = ["train1.txt", "train2.txt", "validation.txt", "test.txt"];
    let lists = lists.map(|list| fs::read_to_string(data.join(list)).unwrap());
    let paths: Vec<&str> = lists.iter().flat_map(|list| list.lines()).collect();
    let mut points = 0;
    for (number, path) in paths.iter().enumerate() {
        let path = data.join(path);
        let cloud = pcd::read(&fs::read(&path).unwrap()).unwrap();
        let cloud = denser(cloud, times, number as u64);
        points += cloud.len();
        fs::write(&path, pcd::write(&cloud, pcd::DataEncoding::BinaryCompressed)).unwrap();
    }
    points as f64 / paths.len() as f64
}

fn denser(cloud: Cloud, times: u32, number: u64) -> Cloud {
    let mut rng = random::stream(1, "denser clouds", &[number]);
    let Cloud { points, colours, viewpoint } = cloud;
    let mut more = points.clone();
    for _ in 1..times {
        more.extend(points.iter().map(|point| point.map(|value| value + rng.random_range(-OFF..OFF))));
    }
    let colours = colours.map(|colours| colours.repeat(times as usize));
    Cloud { points: more, colours, viewpoint }
}
