//! Structures of `experiments/descriptors` that are histograms of a whole cloud, against their definition.

use rand::RngExt;

use crate::oracle::hue;
use crate::random::stream;
use crate::structure::{StructureChannel, StructureCloud, StructureFile, StructurePlan};
use crate::testing::sheet;
use crate::{Cloud, Preprocess};

/// Where a colour lies on the two axes, in bins.
type Places = [f64; 2];

fn channel(text: &str) -> StructureChannel {
    let structure = toml::from_str::<StructureFile>(text).unwrap().structure().unwrap();
    let [one] = structure.channels.as_slice() else { panic!("{structure}") };
    one.channel.clone()
}

/// Whether rounding does not decide in which bin a value lies.
fn is_clear(place: f64) -> bool {
    place == 0.0 || (place - place.round()).abs() > 1e-3
}

/// Clouds on either side of the axes, so that they have several keypoints, with colours whose bins are clear.
fn clouds(place: fn([u8; 3]) -> Places) -> Vec<Cloud> {
    let cloud = |seed: u64| {
        let Cloud { points, viewpoint, .. } = sheet(seed, 600);
        let mut rng = stream(seed, "test colours", &[]);
        let apart = points.into_iter().enumerate().map(|(index, [x, y, z])| {
            let side = if index % 2 == 0 { 0.2 } else { -0.2 };
            ([x + side, y - side, z], rng.random::<[u8; 3]>())
        });
        let (points, colours): (Vec<_>, Vec<_>) =
            apart.filter(|&(_, colour)| place(colour).into_iter().all(is_clear)).unzip();
        assert!(points.len() > 300, "{} points", points.len());
        Cloud { points, colours: Some(colours), viewpoint }
    };
    (1..=5).map(cloud).collect()
}

/// The share of the points in each bin, one point after the other.
fn shares(cloud: &Cloud, bins: usize, place: fn([u8; 3]) -> Places) -> Vec<f32> {
    let mut counts = vec![0u32; bins * bins];
    for &colour in cloud.colours.as_ref().unwrap() {
        let [first, second] = place(colour).map(|place| (place.floor() as usize).min(bins - 1));
        counts[bins * first + second] += 1;
    }
    counts.iter().map(|&count| count as f32 / cloud.len() as f32).collect()
}

fn is_global(text: &str, bins: usize, place: fn([u8; 3]) -> Places) {
    let channel = channel(text);
    assert_eq!(channel.bins(), (bins * bins) as u64);
    for cloud in clouds(place) {
        let ready = StructureCloud::new(&cloud, &Preprocess::default()).unwrap();
        let keypoints = ready.keypoints(&StructurePlan::new(&channel)).unwrap().positions.len();
        assert!(keypoints > 1, "one keypoint shows nothing of the others");
        let found = channel.signature(&ready).unwrap();
        assert_eq!(found.centroid, shares(&cloud, bins, place));
        assert!(found.deviation.iter().all(|&deviation| deviation == 0.0), "{:?}", found.deviation);
    }
}

#[test]
fn chroma_is_a_histogram_of_all_points() {
    is_global(include_str!("../../../experiments/descriptors/chroma.toml"), 12, |colour| {
        let [red, green, blue] = colour.map(|value| libm::log(f64::from(value) + 2.0));
        [red - green, blue - (red + green) / 2.0].map(|x| 12.0 * (0.5 + 0.5 * x / (x.abs() + 0.3)))
    });
}

#[test]
fn hue_saturation_is_a_histogram_of_all_points() {
    is_global(include_str!("../../../experiments/descriptors/hue-saturation.toml"), 16, |colour| {
        let [least, most] =
            [colour.iter().min(), colour.iter().max()].map(|value| f64::from(*value.unwrap()));
        let saturation = if most == 0.0 { 0.0 } else { (most - least) / most };
        [hue(colour) / 360.0, saturation].map(|share| 16.0 * share)
    });
}
