//! Cells against the evaluator: every count of every descriptor, ties and edges included.

use proptest::prelude::*;
use rand::RngExt;

use super::*;
use crate::Domain;
use crate::random::stream;
use crate::signature::{Signature, Signatures};
use crate::testing::sheet;
use crate::{Correct, GeneTable, Label, Preprocess, QuantisedCloud, recognise};

fn table(colour: bool, weights: Domain) -> GeneTable {
    let domains = [
        Domain { low: 7, step: 6, count: 4 },
        Domain { low: 2, step: 3, count: 3 },
        Domain { low: 8_000, step: 5_000, count: 2 },
        Domain { low: 21_000, step: 9_000, count: 2 },
        weights,
    ];
    GeneTable::new(domains, colour).unwrap()
}

fn clouds(seeds: std::ops::Range<u64>, colour: bool, quantiser: &Quantiser) -> Vec<QuantisedCloud> {
    let preprocess = Preprocess { colour, ..Preprocess::default() };
    seeds.map(|seed| QuantisedCloud::new(&sheet(seed, 250), &preprocess, quantiser).unwrap()).collect()
}

fn labels(count: usize, objects: u32) -> Vec<Label> {
    (0..count as u32).map(|cloud| Label { category: 0, instance: cloud % objects }).collect()
}

/// What the evaluator counts for every descriptor of a cell, one after the other.
fn plainly(
    cell: &Cell,
    [queries, database]: [&[CellSignatures]; 2],
    [query_labels, labels]: [&[Label]; 2],
) -> Vec<u32> {
    let mut counts = Vec::new();
    for n in 0..cell.shape.len() {
        for m in 0..cell.colour.len() {
            let signatures = |clouds: &[CellSignatures]| -> [Signatures; 2] {
                [
                    clouds.iter().map(|cloud| &cloud.shape[n]).collect(),
                    clouds.iter().map(|cloud| &cloud.colour[m]).collect(),
                ]
            };
            let (queries, database) = (signatures(queries), signatures(database));
            for &weight in &cell.weights {
                let found = recognise(&queries, &database, &[weight, 1.0 - weight], labels).unwrap();
                counts.push(Correct::count(&found, query_labels, labels).object as u32);
            }
        }
    }
    counts
}

#[test]
fn a_cell_is_the_evaluator_for_every_descriptor() {
    for colour in [true, false] {
        let quantiser = Quantiser::new(&table(colour, Domain { low: 0, step: 50_000, count: 21 })).unwrap();
        let clouds = clouds(0..60, colour, &quantiser);
        let labels = labels(clouds.len(), 7);
        for (disk_um, ring_um) in [(8_000, 21_000), (13_000, 30_000)] {
            let cell = Cell::new(&quantiser, disk_um, ring_um).unwrap();
            let signatures = cell.signatures(&clouds);
            let other = Cell::new(&quantiser, disk_um, 51_000 - ring_um).unwrap();
            let (disks, rings) =
                (other.describe(Region::Disk, &clouds), cell.describe(Region::Ring, &clouds));
            assert_eq!(
                CellSignatures::join(&disks, &rings),
                signatures,
                "of another cell with the same disks"
            );
            let all = || signatures[0].shape.iter().chain(&signatures[0].colour);
            let values: usize = all().map(|both| both.centroid.len() + both.deviation.len()).sum();
            let bytes =
                size_of::<RegionSignatures>() + all().count() * size_of::<Signature>() + 4 * values / 2;
            assert_eq!(disks[0].bytes(), bytes);
            for (cloud, of_cell) in clouds.iter().zip(&signatures) {
                for (binning, signature) in cell.shape.iter().zip(&of_cell.shape) {
                    assert_eq!(*signature, binning.signature(cloud)[0]);
                }
                for (binning, signature) in cell.colour.iter().zip(&of_cell.colour) {
                    assert_eq!(*signature, binning.signature(cloud)[1]);
                }
            }
            let (queries, database) = signatures.split_at(25);
            let (query_labels, labels) = labels.split_at(25);
            let counts = cell.object_correct(queries, query_labels, database, labels).unwrap();
            assert_eq!(counts.len(), cell.descriptors());
            assert_eq!(counts, plainly(&cell, [queries, database], [query_labels, labels]));
            assert!(counts.iter().any(|count| *count != counts[0]), "descriptors that differ in nothing");
        }
        assert!(Cell::new(&quantiser, 9_000, 30_000).is_err());
    }
}

/// A signature whose distance to the empty one is a given number of halves.
fn signature(halves: u32) -> Signature {
    Signature { centroid: vec![halves as f32, 0.0], deviation: vec![0.0; 2] }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Distances on a coarse grid of numbers, so that many are equal, for some w and for all.
    #[test]
    fn ties_go_to_the_lowest_index(
        seed in any::<u64>(),
        spread in 1u32..6,
        database in 1usize..40,
        weights in prop::sample::select(vec![(0, 500_000, 3), (0, 250_000, 5), (0, 10_000, 101), (1, 7, 50), (500_000, 1, 1), (0, 25_000, 40)]),
    ) {
        let (low, step, count) = weights;
        let quantiser = Quantiser::new(&table(true, Domain { low, step, count })).unwrap();
        let cell = Cell::new(&quantiser, 8_000, 21_000).unwrap();
        let mut rng = stream(seed, "tied distances", &[]);
        let mut draw = |values: usize, spread: u32| -> Vec<Signature> {
            (0..values).map(|_| signature(if spread == 0 { 0 } else { rng.random_range(0..=spread) })).collect()
        };
        let mut cloud = |spread| CellSignatures { shape: draw(4, spread), colour: draw(3, spread) };
        let queries: Vec<CellSignatures> = (0..3).map(|_| cloud(0)).collect();
        let database: Vec<CellSignatures> = (0..database).map(|_| cloud(spread)).collect();
        let (query_labels, labels) = (labels(3, 3), labels(database.len(), 4));
        let counts = cell.object_correct(&queries, &query_labels, &database, &labels).unwrap();
        prop_assert_eq!(counts, plainly(&cell, [&queries, &database], [&query_labels, &labels]));
    }
}

/// Of a table with more angle classes than fit a byte.
#[test]
fn signatures_are_those_of_each_descriptor_with_many_classes_too() {
    let domains = [
        Domain { low: 8, step: 1, count: 57 },
        Domain { low: 3, step: 1, count: 4 },
        Domain { low: 8_000, step: 1, count: 1 },
        Domain { low: 21_000, step: 1, count: 1 },
        Domain { low: 0, step: 500_000, count: 3 },
    ];
    let quantiser = Quantiser::new(&GeneTable::new(domains, true).unwrap()).unwrap();
    assert!(quantiser.classes()[0] > 256);
    let clouds = clouds(0..6, true, &quantiser);
    let cell = Cell::new(&quantiser, 8_000, 21_000).unwrap();
    for (cloud, of_cell) in clouds.iter().zip(&cell.signatures(&clouds)) {
        for (binning, signature) in cell.shape.iter().zip(&of_cell.shape) {
            assert_eq!(*signature, binning.signature(cloud)[0]);
        }
        for (binning, signature) in cell.colour.iter().zip(&of_cell.colour) {
            assert_eq!(*signature, binning.signature(cloud)[1]);
        }
    }
}

#[test]
fn an_empty_database_is_an_error_and_no_queries_are_none() {
    let quantiser = Quantiser::new(&table(true, Domain { low: 0, step: 500_000, count: 3 })).unwrap();
    let cell = Cell::new(&quantiser, 8_000, 21_000).unwrap();
    let signatures = cell.signatures(&clouds(0..1, true, &quantiser));
    let label = labels(1, 1);
    assert!(cell.object_correct(&signatures, &label, &[], &[]).is_err());
    assert_eq!(cell.object_correct(&[], &[], &signatures, &label).unwrap(), vec![0; cell.descriptors()]);
}
