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
        Domain { low: 7, step: 5, count: 4 },
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

/// Shape (0) or colour (1) of a cloud under one value of its gene.
fn of_value(cell: &Cell, cloud: &CellSignatures, channel: usize, value: usize) -> Signature {
    let [centroid, deviation] = cloud.of_value(channel, &cell.bins[channel][value]).map(<[f32]>::to_vec);
    Signature { centroid, deviation }
}

/// Each is what [`Binning::signature`] has for its descriptor alone.
fn assert_each_descriptors(cell: &Cell, signatures: &[CellSignatures], clouds: &[QuantisedCloud]) {
    for (cloud, of_cell) in clouds.iter().zip(signatures) {
        for (channel, binnings) in [&cell.shape, &cell.colour].into_iter().enumerate() {
            for (value, binning) in binnings.iter().enumerate() {
                assert_eq!(of_value(cell, of_cell, channel, value), binning.signature(cloud)[channel]);
            }
        }
    }
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
                [(0, n), (1, m)].map(|(channel, value)| {
                    let all: Vec<Signature> =
                        clouds.iter().map(|cloud| of_value(cell, cloud, channel, value)).collect();
                    all.iter().collect()
                })
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
            assert_eq!(cell.join(&disks, &rings), signatures, "of another cell with the same disks");
            let parts = signatures[0].parts.iter();
            let values: usize = parts.map(|both| both.centroid.len() + both.deviation.len()).sum();
            assert_eq!(disks[0].bytes(), size_of::<RegionSignatures>() + 4 * values / 2);
            assert_each_descriptors(&cell, &signatures, &clouds);
            let (queries, database) = signatures.split_at(25);
            let (query_labels, labels) = labels.split_at(25);
            let counts = cell.object_correct(None, queries, query_labels, database, labels).unwrap();
            let other = other.signatures(&clouds);
            let (other_queries, other_database) = other.split_at(25);
            let disks = DiskDistances::new(&cell, other_queries, other_database);
            let sums: usize = disks.of_query.iter().flatten().map(|sums| size_of_val(&sums[..])).sum();
            let bytes = sums + size_of_val(&disks.of_query[..]);
            assert_eq!(bytes, DiskDistances::bytes(&cell, queries.len(), database.len()));
            let with_disks =
                cell.object_correct(Some(&disks), queries, query_labels, database, labels).unwrap();
            assert_eq!(with_disks, counts, "with the disk distances of another cell");
            assert_eq!(counts.len(), cell.descriptors());
            assert_eq!(counts, plainly(&cell, [queries, database], [query_labels, labels]));
            assert!(counts.iter().any(|count| *count != counts[0]), "descriptors that differ in nothing");
        }
        assert!(Cell::new(&quantiser, 9_000, 30_000).is_err());
    }
}

/// A signature of so many bins, of which one is not empty, whose distance to the empty one is a given number of halves.
fn signature(halves: u32, bin: usize, bins: usize) -> Signature {
    let mut centroid = vec![0.0; bins];
    centroid[bin] = halves as f32;
    Signature { centroid, deviation: vec![0.0; bins] }
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
        let mut draw = |channel: usize, spread: u32| -> Signature {
            let mut all = Signature::default();
            for bins in &cell.bins[channel] {
                let halves = if spread == 0 { 0 } else { rng.random_range(0..=spread) };
                let one = signature(halves, rng.random_range(0..2 * bins.len()), 2 * bins.len());
                all.centroid.extend(one.centroid);
                all.deviation.extend(one.deviation);
            }
            all
        };
        let mut cloud = |spread| CellSignatures { parts: [0, 1].map(|channel| draw(channel, spread)) };
        let queries: Vec<CellSignatures> = (0..3).map(|_| cloud(0)).collect();
        let database: Vec<CellSignatures> = (0..database).map(|_| cloud(spread)).collect();
        let (query_labels, labels) = (labels(3, 3), labels(database.len(), 4));
        let disks = DiskDistances::new(&cell, &queries, &database);
        let [counts, with_disks] = [None, Some(&disks)]
            .map(|disks| cell.object_correct(disks, &queries, &query_labels, &database, &labels).unwrap());
        prop_assert_eq!(&with_disks, &counts);
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
    assert_each_descriptors(&cell, &cell.signatures(&clouds), &clouds);
}

#[test]
fn an_empty_database_is_an_error_and_no_queries_are_none() {
    let quantiser = Quantiser::new(&table(true, Domain { low: 0, step: 500_000, count: 3 })).unwrap();
    let cell = Cell::new(&quantiser, 8_000, 21_000).unwrap();
    let signatures = cell.signatures(&clouds(0..1, true, &quantiser));
    let label = labels(1, 1);
    for (queries, database) in [(&signatures[..], &[][..]), (&[], &signatures)] {
        let disks = DiskDistances::new(&cell, queries, database);
        let labels = |clouds: &[CellSignatures]| labels(clouds.len(), 1);
        let found = cell.object_correct(Some(&disks), queries, &labels(queries), database, &labels(database));
        assert_eq!(found.is_err(), database.is_empty());
    }
    assert!(cell.object_correct(None, &signatures, &label, &[], &[]).is_err());
    assert_eq!(
        cell.object_correct(None, &[], &[], &signatures, &label).unwrap(),
        vec![0; cell.descriptors()]
    );
}
