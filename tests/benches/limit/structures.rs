//! A channel of each kind of a structure, on prepared test clouds.

use std::hint::black_box;
use std::time::Instant;

use descriptor::structure::{
    Axis, Feature, Pairs, Structure, StructureChannel, StructureCloud, StructurePlan, Weighted,
};
use descriptor::{Preprocess, SetDistance};
use rayon::prelude::*;

use crate::cold::Prepared;
use crate::count::Field;
use crate::stage::Stage;
use crate::work::{Element, Work};

/// The clouds, and the channels as stages.
pub struct Structures {
    clouds: Vec<StructureCloud>,
    plans: Vec<StructurePlan>,
    pub stages: Vec<Stage>,
}

/// One channel of each kind; those with drawn pairs are the default structure's.
fn channels() -> Vec<(&'static str, StructureChannel)> {
    let axis = |feature, bins| Axis { feature, bins, full_turn: false };
    let channel = |pairs, axes, radius_um| StructureChannel {
        pairs,
        axes,
        is_joint: true,
        squash_milli: 300,
        radius_um,
        shells_um: vec![radius_um],
        least_um: 0,
        grid_um: Preprocess::default().leaf_um,
        samples: 0,
        oriented: false,
        all_keypoints: false,
        metric: SetDistance::ChiSquared,
        value_weights: Vec::new(),
    };
    let mut drawn = Structure::default().channels.into_iter().map(|Weighted { channel, .. }| channel);
    let angle_and_hue = vec![axis(Feature::Angle, 8), axis(Feature::Hue, 8)];
    let colours = vec![axis(Feature::Distance, 4), axis(Feature::C1, 4), axis(Feature::C2, 4)];
    vec![
        ("channel `keypoint-neighbour`", channel(Pairs::KeypointNeighbour, angle_and_hue, 50_000)),
        ("channel `neighbours`", drawn.next().unwrap()),
        ("channel `keypoints`", channel(Pairs::Keypoints, colours, 120_000)),
        ("channel `cloud`", drawn.next().unwrap()),
    ]
}

/// Rows of a cloud, neighbours of its keypoints, and pairs that are binned.
fn counts(channel: &StructureChannel, prepared: &Prepared) -> [u64; 3] {
    let Prepared { cloud, keypoints, normals, .. } = prepared;
    let needs_normals = channel.needs_normals();
    let both = keypoints.points.iter().zip(&normals.keypoints);
    let used = both.filter(|(_, normal)| !needs_normals || normal.is_some());
    let rows: Vec<[f32; 3]> = used.map(|(&point, _)| point).collect();
    let points = match channel.pairs {
        Pairs::Keypoints => rows.iter().copied().collect(),
        _ if needs_normals => Field::with_normals(cloud, normals),
        _ => Field::of(cloud),
    };
    let near: Vec<u64> = rows.iter().map(|&row| points.within(row, channel.radius_um)).collect();
    let [all, neighbours] = [near.len() as u64, near.iter().sum()];
    let drawn = |points: u64| (points * points.saturating_sub(1)).min(channel.samples.into());
    match channel.pairs {
        Pairs::KeypointNeighbour => [all, neighbours, neighbours],
        Pairs::Neighbours => [all, neighbours, near.into_iter().map(drawn).sum()],
        Pairs::Keypoints => [all, neighbours - all, neighbours - all], // none is its own neighbour
        Pairs::Cloud => [1, 0, drawn(cloud.len() as u64)],
    }
}

/// What a channel has to do.
fn work(channel: &StructureChannel, clouds: &[Prepared]) -> Work {
    let is_of_cloud = channel.pairs == Pairs::Cloud;
    assert!(is_of_cloud || channel.grid_um == Preprocess::default().leaf_um, "other keypoints");
    let counted = clouds.par_iter().map(|cloud| counts(channel, cloud));
    let [rows, neighbours, pairs] = counted.reduce(|| [0; 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
    let points = match channel.pairs {
        Pairs::Keypoints => rows,
        _ => clouds.iter().map(|cloud| cloud.counts.points).sum(),
    };
    let of = |is_wanted: fn(&Feature) -> bool| {
        channel.axes.iter().map(|axis| axis.feature).filter(is_wanted).count() as u64
    };
    let of_points = of(|feature| feature.needs_colour());
    let angles = of(|feature| *feature == Feature::Angle);
    let of_pairs =
        of(|feature| matches!(feature, Feature::Distance | Feature::Angle | Feature::O1 | Feature::O2));
    let is_drawn = channel.samples > 0;
    let work = Work::given([(clouds.len() as u64, "clouds"), (rows, "rows"), (pairs, "pairs")])
        .and(if is_drawn { neighbours + pairs } else { pairs }, Element::Distance)
        .and(angles * pairs, Element::DotProduct)
        .and(of_points * points + of_pairs * pairs, Element::Feature)
        .and(if is_drawn { 2 * pairs } else { 0 }, Element::Fetch)
        .and_increments(pairs, channel.bins());
    if is_of_cloud {
        work.and(channel.bins() * rows, Element::Share)
    } else {
        work.and_rows(rows, channel.bins())
    }
}

impl Structures {
    /// Prepares clouds on the current pool.
    pub fn new(clouds: &[Prepared]) -> Self {
        let channels = channels();
        let stage =
            |(name, channel): &(&'static str, StructureChannel)| Stage::new(name, work(channel, clouds));
        let stages = channels.iter().map(stage).collect();
        let plans = channels.iter().map(|(_, channel)| StructurePlan::new(channel)).collect();
        let prepare = |one: &Prepared| StructureCloud::new(&one.cloud, &Preprocess::default()).unwrap();
        Self { clouds: clouds.par_iter().map(prepare).collect(), plans, stages }
    }

    /// Times every channel once more.
    pub fn sample(&mut self) {
        for (stage, plan) in self.stages.iter_mut().zip(&self.plans) {
            let clock = Instant::now();
            for cloud in &self.clouds {
                black_box(plan.signature(cloud).unwrap());
            }
            stage.times.push(clock.elapsed().as_secs_f64());
        }
    }
}
