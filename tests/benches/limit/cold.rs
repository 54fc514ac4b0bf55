//! From files to matches: what `coordinator evaluate` does with the paper's best descriptor, test against all others.

use std::fs;
use std::path::Path;
use std::time::Instant;

use coordinator::dataset::{Layout, ListedCloud, Listing};
use descriptor::keypoints::Keypoints;
use descriptor::prepare::{Normals, keypoints};
use descriptor::recognise::recognise_from;
use descriptor::{
    Cloud, Describer, Descriptor, Label, Parameters, Preprocess, SetDistance, Signature, Signatures, pcd,
};
use rayon::prelude::*;

use crate::count::Counts;
use crate::stage::Stage;
use crate::work::{Element, Work};

/// Lists of queries, and of the database.
const LISTS: [&[&str]; 2] = [&["test.txt"], &["train1.txt", "train2.txt", "validation.txt"]];

/// Bytes of a point's position and colour.
const POINT: u64 = 15;

/// A cloud with what is found before it is described.
pub struct Prepared {
    pub cloud: Cloud,
    pub keypoints: Keypoints,
    pub normals: Normals,
    pub counts: Counts,
    pub path: String,
}

/// All clouds of a set, and the stages of their way.
pub struct Cold {
    listing: Listing,
    labels: Vec<Label>,
    descriptor: Descriptor,
    describer: Describer,
    pub stages: [Stage; 5],
}

/// Reads and prepares a cloud.
fn prepare(listed: &ListedCloud) -> Prepared {
    let preprocess = Preprocess::default();
    let bytes = fs::read(&listed.file).unwrap();
    let cloud = pcd::read(&bytes).unwrap();
    let keypoints = keypoints(&cloud, &preprocess).unwrap();
    let normals = Normals::new(&cloud, &keypoints, &preprocess).unwrap();
    let counts = Counts::of(bytes.len(), &cloud, &keypoints, &normals, &preprocess);
    Prepared { cloud, keypoints, normals, counts, path: listed.path.clone() }
}

/// Values of a cloud's means in each channel of a descriptor, and of all that is compared.
pub fn values(descriptor: &Descriptor, prepared: &Prepared) -> (Vec<u64>, u64) {
    let Prepared { cloud, keypoints, normals, .. } = prepared;
    let describer = Describer::new(descriptor).unwrap();
    let described = describer.describe(cloud, keypoints, normals, &Preprocess::default()).unwrap();
    let means = described.signatures.iter().map(|signature| signature.centroid.len() as u64);
    let deviations: u64 = described.signatures.iter().map(|one| one.deviation.len() as u64).sum();
    (means.clone().collect(), means.sum::<u64>() + deviations)
}

impl Cold {
    /// The clouds of a set, prepared on the current pool.
    pub fn new(root: &Path) -> (Self, Vec<Prepared>) {
        let lists = LISTS.map(|lists| lists.iter().map(|list| root.join(list)).collect::<Vec<_>>());
        let listing = Listing::load(root, &Layout::Folders, &lists[0], &lists[1]).unwrap();
        let prepared: Vec<Prepared> = listing.clouds.par_iter().map(prepare).collect();
        let database = &listing.clouds[listing.queries..];
        let label = |cloud: &ListedCloud| Label { category: cloud.category, instance: cloud.instance };
        let labels: Vec<Label> = database.iter().map(label).collect();

        let descriptor = Descriptor::DiskRing(Parameters::PAPER_BEST);
        let (means, values) = values(&descriptor, &prepared[0]);
        let counts: Counts = prepared.iter().map(|cloud| cloud.counts).sum();
        let Counts { clouds, bytes, points, keypoints, near, described, .. } = counts;
        let neighbours = counts.within(Parameters::PAPER_BEST.ring_um);
        let read = Work::given([(clouds, "files"), (points, "points")])
            .and(clouds, Element::File)
            .and(bytes, Element::FileByte)
            .and(points * POINT, Element::CopiedByte);
        // The three indices of its voxel, and two sums that it is added to, of places and of colours.
        let grid = Work::given([(points, "points"), (keypoints, "keypoints")])
            .and(3 * points, Element::Feature)
            .and(2 * points, Element::ManyBins)
            .and(keypoints, Element::Key);
        // Three steps of Laguerre's method and a unit vector.
        let normals = Work::given([(points + keypoints, "fits"), (near, "neighbours")])
            .and(near, Element::Neighbour)
            .and(4 * (points + keypoints), Element::Root);
        let describe = Work::given([(described, "keypoints"), (neighbours, "neighbours")])
            .and(neighbours, Element::Distance)
            .and(neighbours, Element::DotProduct)
            .and_increments(2 * neighbours, means.iter().max().copied().unwrap_or_default() / 2)
            .and_rows(described, means.iter().sum());
        let queries = listing.queries as u64;
        let entries = clouds - queries;
        let matching = Work::given([(queries, "queries"), (entries, "clouds"), (values, "values")])
            .and(queries * entries * values, Element::Term);
        let stages = [
            Stage::new("read", read),
            Stage::new("keypoints", grid),
            Stage::new("normals", normals),
            Stage::new("describe, paper's best", describe),
            Stage::new("match, paper's best", matching),
        ];
        let describer = Describer::new(&descriptor).unwrap();
        (Self { listing, labels, descriptor, describer, stages }, prepared)
    }

    /// How many clouds are queries: the first.
    pub fn queries(&self) -> usize {
        self.listing.queries
    }

    /// Times every stage once more, on the current pool.
    pub fn sample(&mut self) {
        let preprocess = Preprocess::default();
        let mut seconds = [0.0; 5];
        let mut described: Vec<Vec<Signature>> = Vec::new();
        for listed in &self.listing.clouds {
            let mut start = Instant::now();
            let mut lap = |stage: usize| {
                seconds[stage] += start.elapsed().as_secs_f64();
                start = Instant::now();
            };
            let cloud = pcd::read(&fs::read(&listed.file).unwrap()).unwrap();
            lap(0);
            let keypoints = keypoints(&cloud, &preprocess).unwrap();
            lap(1);
            let normals = Normals::new(&cloud, &keypoints, &preprocess).unwrap();
            lap(2);
            let one = self.describer.describe(&cloud, &keypoints, &normals, &preprocess).unwrap();
            lap(3);
            described.push(one.signatures);
        }
        let start = Instant::now();
        let (queries, database) = described.split_at(self.listing.queries);
        let of_channel = |side: &[Vec<Signature>], channel: usize| -> Signatures {
            side.iter().map(|cloud| &cloud[channel]).collect()
        };
        let channels = 0..self.descriptor.channels().len();
        let signatures: Vec<[Signatures; 2]> =
            channels.map(|channel| [queries, database].map(|side| of_channel(side, channel))).collect();
        let distances = self.descriptor.distances(SetDistance::ChiSquared, &signatures, database.len());
        recognise_from(queries.len(), &distances, &self.labels).unwrap();
        seconds[4] = start.elapsed().as_secs_f64();
        self.stages.iter_mut().zip(seconds).for_each(|(stage, seconds)| stage.times.push(seconds));
    }
}
