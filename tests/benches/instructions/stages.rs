//! What is counted: each stage on synthetic clouds.

use std::hint::black_box;

use descriptor::prepare::{self, Normals};
use descriptor::structure::{Structure, StructureCloud, StructurePlan};
use descriptor::synth::{SynthSettings, catalogue, render};
use descriptor::{
    Cloud, Describer, Descriptor, DistanceMatrix, FixedDescriptor, FixedKind, GeneTable, Label, Parameters,
    Preprocess, QuantisedCloud, Quantiser, Signatures, grid, pcd,
};
use tests::benches::prepared::pool;

/// Carries a stage out so many times.
type Stage = fn(u32);

/// All stages, by name.
pub const STAGES: [(&str, Stage); 12] = [
    ("read", read),
    ("keypoints", keypoints),
    ("normals", normals),
    ("describe", describe),
    ("quantise", quantise),
    ("fitness describe", fitness_describe),
    ("fitness match", fitness_match),
    ("grid signatures", grid_signatures),
    ("grid count", grid_count),
    ("structure", structure),
    ("shotcolor", shotcolor),
    ("pfhrgb", pfhrgb),
];

/// How often stages that take few instructions are carried out instead of once: threads that wait for each other take some,
/// too.
const MANY: u32 = 16;

/// Radii of the grid's cell, micrometres.
const CELL_UM: [u32; 2] = [13_000, 36_000];

/// Views of this many objects.
fn clouds(objects: u32) -> Vec<Cloud> {
    let settings = SynthSettings::new(objects, 4, 1).unwrap();
    catalogue(&settings).iter().map(|object| render(&settings, object, 0)).collect()
}

fn cloud() -> Cloud {
    clouds(2).remove(0)
}

/// Has all that a stage does done on one thread.
fn repeat(times: u32, stage: impl Fn() + Sync) {
    pool(1).install(|| (0..times).for_each(|_| stage()));
}

fn read(times: u32) {
    let bytes = pcd::write(&cloud(), pcd::DataEncoding::BinaryCompressed);
    repeat(MANY * times, || drop(black_box(pcd::read(&bytes).unwrap())));
}

fn keypoints(times: u32) {
    let cloud = cloud();
    repeat(MANY * times, || drop(black_box(prepare::keypoints(&cloud, &Preprocess::default()).unwrap())));
}

fn normals(times: u32) {
    let (cloud, preprocess) = (cloud(), Preprocess::default());
    let keypoints = prepare::keypoints(&cloud, &preprocess).unwrap();
    repeat(MANY * times, || drop(black_box(Normals::new(&cloud, &keypoints, &preprocess).unwrap())));
}

fn describe(times: u32) {
    let (cloud, preprocess) = (cloud(), Preprocess::default());
    let keypoints = prepare::keypoints(&cloud, &preprocess).unwrap();
    let normals = Normals::new(&cloud, &keypoints, &preprocess).unwrap();
    let describer = Describer::new(&Descriptor::DiskRing(Parameters::PAPER_BEST)).unwrap();
    repeat(MANY * times, || {
        drop(black_box(describer.describe(&cloud, &keypoints, &normals, &preprocess).unwrap()));
    });
}

fn quantise(times: u32) {
    let (cloud, quantiser) = (cloud(), quantiser());
    repeat(times, || {
        drop(black_box(QuantisedCloud::new(&cloud, &Preprocess::default(), &quantiser).unwrap()));
    });
}

fn quantiser() -> Quantiser {
    Quantiser::new(&GeneTable::paper()).unwrap()
}

fn quantised(objects: u32, quantiser: &Quantiser) -> Vec<QuantisedCloud> {
    let quantised = |cloud| QuantisedCloud::new(cloud, &Preprocess::default(), quantiser).unwrap();
    clouds(objects).iter().map(quantised).collect()
}

fn fitness_describe(times: u32) {
    let quantiser = quantiser();
    let clouds = quantised(8, &quantiser);
    let binning = quantiser.binning(&Parameters::PAPER_BEST).unwrap();
    repeat(MANY * times, || drop(black_box(binning.signatures(&clouds))));
}

fn fitness_match(times: u32) {
    let quantiser = quantiser();
    let clouds = quantised(64, &quantiser);
    let [shape, _]: [Signatures; 2] = quantiser.binning(&Parameters::PAPER_BEST).unwrap().signatures(&clouds);
    repeat(MANY * times, || drop(black_box(DistanceMatrix::new(&shape, &shape))));
}

fn grid_signatures(times: u32) {
    let quantiser = quantiser();
    let clouds = quantised(2, &quantiser);
    let cell = grid::Cell::new(&quantiser, CELL_UM[0], CELL_UM[1]).unwrap();
    repeat(MANY * times, || drop(black_box(cell.signatures(&clouds[..1]))));
}

fn grid_count(times: u32) {
    let quantiser = quantiser();
    let cell = grid::Cell::new(&quantiser, CELL_UM[0], CELL_UM[1]).unwrap();
    let signatures = cell.signatures(&quantised(24, &quantiser));
    let labels: Vec<Label> = (0..24).map(|instance| Label { category: 0, instance }).collect();
    repeat(times, || {
        drop(black_box(cell.object_correct(None, &signatures, &labels, &signatures, &labels).unwrap()));
    });
}

fn structure(times: u32) {
    let cloud = StructureCloud::new(&cloud(), &Preprocess::default()).unwrap();
    let plans: Vec<StructurePlan> =
        Structure::default().channels.iter().map(|one| StructurePlan::new(&one.channel)).collect();
    repeat(MANY * times, || plans.iter().for_each(|plan| drop(black_box(plan.signature(&cloud).unwrap()))));
}

fn shotcolor(times: u32) {
    fixed(times, FixedKind::ShotColor, 50_000);
}

fn pfhrgb(times: u32) {
    fixed(times, FixedKind::PfhRgb, 20_000);
}

fn fixed(times: u32, kind: FixedKind, radius_um: u32) {
    let (cloud, preprocess) = (cloud(), Preprocess::default());
    let keypoints = prepare::keypoints(&cloud, &preprocess).unwrap();
    let normals = Normals::new(&cloud, &keypoints, &preprocess).unwrap();
    let descriptor = FixedDescriptor::new(kind, radius_um).unwrap();
    repeat(times, || drop(black_box(descriptor.describe(&cloud, &keypoints, &normals).unwrap())));
}
