//! Grid cells on real clouds: every count is the evaluator's own, bit for bit, next to breakpoints of w too.

use std::fs;

use descriptor::grid::{Cell, CellParts};
use descriptor::recognise::recognise_from;
use descriptor::summary::weighted;
use descriptor::{
    Correct, DistanceMatrix, GENES, GeneKind, GeneTable, Label, Parameters, Parts, PreparedCloud, Preprocess,
    Quantiser, pcd, random,
};
use rand::RngExt as _;
use rayon::prelude::*;

use crate::experiments::shared;

/// Cells that are compared, each with every w of some pairs of shape_bins and m.
const CELLS: usize = 10;
const SHAPES: usize = 2;
const COLOURS: usize = 3;

struct Split {
    clouds: Vec<PreparedCloud>,
    labels: Vec<Label>,
}

fn split(name: &str, quantiser: &Quantiser, objects: &mut Vec<String>) -> Option<Split> {
    let root = shared()?.join("data/household-rgbd");
    let list = fs::read_to_string(root.join(name)).unwrap();
    let paths: Vec<&str> = list.lines().collect();
    let mut number = |path: &&str| {
        let object = path.rsplit_once('/').unwrap().0;
        let known = objects.iter().position(|other| other == object);
        let instance = known.unwrap_or_else(|| {
            objects.push(object.to_owned());
            objects.len() - 1
        });
        Label { category: 0, instance: instance as u32 }
    };
    let labels = paths.iter().map(&mut number).collect();
    let prepared = |path: &&str| {
        let cloud = pcd::read(&fs::read(root.join(path)).unwrap()).unwrap();
        PreparedCloud::new(&cloud, &Preprocess::default(), quantiser).unwrap()
    };
    Some(Split { clouds: paths.par_iter().map(prepared).collect(), labels })
}

/// Whether, for some query, the nearest cloud of its object and the nearest of the others are at most one unit in the
/// last place apart.
fn is_at_a_breakpoint(
    shape: &DistanceMatrix,
    colour: &DistanceMatrix,
    queries: &[Label],
    database: &[Label],
    weight: f64,
) -> bool {
    (0..queries.len()).any(|query| {
        let mut nearest = [f64::INFINITY; 2];
        for ((&s, &c), label) in shape.row(query).iter().zip(colour.row(query)).zip(database) {
            let side = usize::from(label.instance == queries[query].instance);
            nearest[side] = nearest[side].min(weighted(s, c, weight));
        }
        nearest[0].to_bits().abs_diff(nearest[1].to_bits()) <= 1
    })
}

#[test]
fn grid_cells_are_the_evaluator_on_the_household_clouds() {
    let table = GeneTable::paper();
    let quantiser = Quantiser::new(&table).unwrap();
    let mut objects = Vec::new();
    let Some(queries) = split("train1.txt", &quantiser, &mut objects) else { return };
    let database = split("train2.txt", &quantiser, &mut objects).unwrap();
    let axis = |kind| table.domain(kind).unwrap().values().collect::<Vec<u32>>();
    let [shape_bins, colour_bins, disks, rings, weights] = GENES.each_ref().map(|spec| axis(spec.kind));
    let mut rng = random::stream(1, "compared grid points", &[]);
    let mut draw = |values: &[u32]| rng.random_range(0..values.len() as u64) as usize;

    let (mut points, mut at_breakpoints) = (0, 0);
    for _ in 0..CELLS {
        let (disk_um, ring_um) = (disks[draw(&disks)], rings[draw(&rings)]);
        let cell = Cell::new(&quantiser, disk_um, ring_um).unwrap();
        let parts = |split: &Split| -> Vec<CellParts> {
            split.clouds.par_iter().map(|cloud| cell.parts(cloud)).collect()
        };
        let (query_parts, database_parts) = (parts(&queries), parts(&database));
        let counts =
            cell.object_correct(&query_parts, &queries.labels, &database_parts, &database.labels).unwrap();
        assert_eq!(counts.len(), shape_bins.len() * colour_bins.len() * weights.len());

        let matrix = |n: usize, m: usize, half: fn(&[PreparedCloud], &descriptor::Binning) -> Parts| {
            let ticks = [shape_bins[n], colour_bins[m], disk_um, ring_um, 0];
            let binning = quantiser.binning(&Parameters::from_ticks(ticks)).unwrap();
            DistanceMatrix::new(&half(&queries.clouds, &binning), &half(&database.clouds, &binning))
        };
        let colours: Vec<(usize, DistanceMatrix)> =
            (0..COLOURS).map(|_| draw(&colour_bins)).map(|m| (m, matrix(0, m, Parts::colour))).collect();
        for n in (0..SHAPES).map(|_| draw(&shape_bins)).collect::<Vec<_>>() {
            let shape = matrix(n, 0, Parts::shape);
            for (m, colour) in &colours {
                for (w, &ppm) in weights.iter().enumerate() {
                    let weight = GENES[GeneKind::ShapeWeight as usize].value(ppm);
                    let found =
                        recognise_from(queries.clouds.len(), &shape, colour, &database.labels, weight)
                            .unwrap();
                    let correct = Correct::count(&found, &queries.labels, &database.labels).object as u32;
                    let counted = counts[(n * colour_bins.len() + m) * weights.len() + w];
                    assert_eq!(counted, correct, "{n}, {m}, {disk_um}, {ring_um}, {weight}");
                    points += 1;
                    let labels = (&queries.labels, &database.labels);
                    at_breakpoints +=
                        usize::from(is_at_a_breakpoint(&shape, colour, labels.0, labels.1, weight));
                }
            }
        }
    }
    println!("{points} grid points compared, {at_breakpoints} of them within one ulp of a breakpoint");
    assert!(points >= 2000 && at_breakpoints > 0);
}
