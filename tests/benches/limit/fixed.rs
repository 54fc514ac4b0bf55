//! The descriptors without genes, on a few clouds whose keypoints and normals are there.

use std::hint::black_box;
use std::time::Instant;

use descriptor::{FixedDescriptor, FixedKind};

use crate::cold::Prepared;
use crate::count::Field;
use crate::stage::Stage;
use crate::work::{Element, Work};

/// Clouds that are described, taken evenly from all.
const CLOUDS: usize = 20;

/// The clouds, and the stages.
pub struct Fixed {
    clouds: Vec<Prepared>,
    pub stages: [Stage; 2],
}

const KINDS: [(&str, FixedKind); 2] =
    [("describe, SHOTCOLOR 5 cm", FixedKind::ShotColor), ("describe, PFHRGB 5 cm", FixedKind::PfhRgb)];

fn descriptor(kind: FixedKind) -> FixedDescriptor {
    FixedDescriptor::new(kind, FixedDescriptor::DEFAULT_RADIUS_UM).unwrap()
}

impl Fixed {
    /// Takes some of all clouds.
    pub fn new(all: Vec<Prepared>) -> Self {
        let step = all.len() / CLOUDS;
        let clouds: Vec<Prepared> = all.into_iter().step_by(step).take(CLOUDS).collect();
        let stages = KINDS.map(|(name, kind)| Stage::new(name, work(kind, &clouds)));
        Self { clouds, stages }
    }

    /// Times both once more.
    pub fn sample(&mut self) {
        for (stage, (_, kind)) in self.stages.iter_mut().zip(KINDS) {
            let descriptor = descriptor(kind);
            let clock = Instant::now();
            for Prepared { cloud, keypoints, normals, .. } in &self.clouds {
                black_box(descriptor.describe(cloud, keypoints, normals).unwrap().signature());
            }
            stage.times.push(clock.elapsed().as_secs_f64());
        }
    }
}

fn work(kind: FixedKind, clouds: &[Prepared]) -> Work {
    let [mut rows, mut neighbours, mut counted, mut pairs, mut width] = [0; 5];
    for Prepared { cloud, keypoints, normals, .. } in clouds {
        let points = Field::with_normals(cloud, normals);
        for &keypoint in &keypoints.points {
            let near = points.within(keypoint, FixedDescriptor::DEFAULT_RADIUS_UM);
            neighbours += near;
            counted += near * near.saturating_sub(1) / 2;
        }
        if kind == FixedKind::PfhRgb {
            pairs += points.pairs_within(&keypoints.points, FixedDescriptor::DEFAULT_RADIUS_UM);
        }
        let histograms = descriptor(kind).describe(cloud, keypoints, normals).unwrap();
        rows += histograms.rows().len() as u64;
        width = histograms.signature().centroid.len() as u64;
    }
    let given = [(clouds.len() as u64, "clouds"), (rows, "keypoints")];
    match kind {
        // A frame; where a neighbour is in it and its angle to it; volume, sector, angle and colour; five votes in each
        // of two histograms.
        FixedKind::ShotColor => Work::given([given[0], given[1], (neighbours, "neighbours")])
            .and(neighbours, Element::Neighbour)
            .and(4 * neighbours, Element::DotProduct)
            .and(5 * neighbours, Element::Feature)
            .and(10 * neighbours, Element::ManyBins),
        // Of each pair of points that share a region, the products that the angles of both orders are made of, six bins of
        // angles and three of colour ratios, which in the other order are the same mirrored. In each region, two
        // histograms of its pairs, in which both orders are counted as one.
        FixedKind::PfhRgb => Work::given([given[0], given[1], (counted, "unordered pairs in regions")])
            .and(neighbours + pairs, Element::Distance)
            .and(4 * pairs, Element::DotProduct)
            .and(9 * pairs, Element::Feature)
            .and(2 * counted, Element::ManyBins),
    }
    .and_rows(rows, width)
}
