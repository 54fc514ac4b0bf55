//! Grid cells on real clouds: every count is the evaluator's own, bit for bit, next to breakpoints of w too.

use std::fs;

use descriptor::grid::{Cell, CellParts};
use descriptor::recognise::recognise_from;
use descriptor::summary::weighted;
use descriptor::{
    Binning, Correct, DistanceMatrix, GENES, GeneKind, GeneTable, Label, Parameters, Parts, PreparedCloud,
    Preprocess, Quantiser, pcd, random,
};
use rand::RngExt as _;
use rayon::prelude::*;

use crate::experiments::shared;

/// Pairs of shape_bins and m that are drawn in each cell; each is compared at every w.
const PAIRS: usize = 5;
/// Clouds that are drawn as queries and as database of each cell, so that all cells of the grid can take part.
const SOME: usize = 24;
/// Cells that are compared with all clouds, too.
const WHOLE_CELLS: usize = 2;

/// A split's clouds, ready for every descriptor of the grid.
struct Prepared {
    clouds: Vec<PreparedCloud>,
    labels: Vec<Label>,
}

impl Prepared {
    /// The clouds at these places, which may repeat.
    fn pick(&self, places: impl Iterator<Item = usize>) -> Picked<'_> {
        let (clouds, labels) = places.map(|place| (&self.clouds[place], self.labels[place])).unzip();
        Picked { clouds, labels }
    }
}

struct Picked<'a> {
    clouds: Vec<&'a PreparedCloud>,
    labels: Vec<Label>,
}

fn prepare(name: &str, quantiser: &Quantiser, objects: &mut Vec<String>) -> Option<Prepared> {
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
    Some(Prepared { clouds: paths.par_iter().map(prepared).collect(), labels })
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

/// What was compared.
#[derive(Default)]
struct Compared {
    points: usize,
    at_breakpoints: usize,
}

/// The values of every gene in a grid, in ticks.
struct Axes<'a> {
    quantiser: &'a Quantiser,
    values: [Vec<u32>; 5],
}

impl Axes<'_> {
    /// Compares the counts of the cell of `radii` with the evaluator, for these pairs of shape_bins and m (as
    /// positions among their values) at every w.
    fn compare<'a>(
        &self,
        radii: [u32; 2],
        pairs: &[[usize; 2]],
        queries: &Picked<'a>,
        database: &Picked<'a>,
    ) -> Compared {
        let [disk_um, ring_um] = radii;
        let [shape_bins, colour_bins, _, _, weights] = &self.values;
        let cell = Cell::new(self.quantiser, disk_um, ring_um).unwrap();
        let parts = |split: &Picked| -> Vec<CellParts> {
            split.clouds.iter().map(|cloud| cell.parts(cloud)).collect()
        };
        let counts = cell
            .object_correct(&parts(queries), &queries.labels, &parts(database), &database.labels)
            .unwrap();
        assert_eq!(counts.len(), shape_bins.len() * colour_bins.len() * weights.len());

        let mut compared = Compared::default();
        for &[n, m] in pairs {
            let ticks = [shape_bins[n], colour_bins[m], disk_um, ring_um, 0];
            let binning = self.quantiser.binning(&Parameters::from_ticks(ticks)).unwrap();
            let matrix = |half: fn(&[&'a PreparedCloud], &Binning) -> Parts| {
                DistanceMatrix::new(&half(&queries.clouds, &binning), &half(&database.clouds, &binning))
            };
            let (shape, colour) = (matrix(Parts::shape), matrix(Parts::colour));
            for (w, &ppm) in weights.iter().enumerate() {
                let weight = GENES[GeneKind::ShapeWeight as usize].value(ppm);
                let found =
                    recognise_from(queries.clouds.len(), &shape, &colour, &database.labels, weight).unwrap();
                let correct = Correct::count(&found, &queries.labels, &database.labels).object as u32;
                let counted = counts[(n * colour_bins.len() + m) * weights.len() + w];
                assert_eq!(counted, correct, "{ticks:?}, {weight}");
                compared.points += 1;
                let labels = (&queries.labels, &database.labels);
                let is_close = is_at_a_breakpoint(&shape, &colour, labels.0, labels.1, weight);
                compared.at_breakpoints += usize::from(is_close);
            }
        }
        compared
    }
}

#[test]
fn grid_cells_are_the_evaluator_on_the_household_clouds() {
    let table = GeneTable::paper();
    let quantiser = Quantiser::new(&table).unwrap();
    let mut objects = Vec::new();
    let Some(queries) = prepare("train1.txt", &quantiser, &mut objects) else { return };
    let database = prepare("train2.txt", &quantiser, &mut objects).unwrap();
    let values = GENES.each_ref().map(|spec| table.domain(spec.kind).unwrap().values().collect::<Vec<u32>>());
    let axes = Axes { quantiser: &quantiser, values };
    let [shape_bins, colour_bins, disks, rings, _] = &axes.values;

    let compare = |index: usize, radii: [u32; 2], some: Option<usize>| {
        let key = [index as u64, u64::from(some.is_some())];
        let mut rng = random::stream(1, "compared grid points", &key);
        let mut draw = |count: usize| rng.random_range(0..count as u64) as usize;
        let pairs: Vec<[usize; 2]> =
            (0..PAIRS).map(|_| [draw(shape_bins.len()), draw(colour_bins.len())]).collect();
        let mut places = |all: &Prepared| -> Vec<usize> {
            let count = all.clouds.len();
            some.map_or_else(|| (0..count).collect(), |some| (0..some).map(|_| draw(count)).collect())
        };
        let picked = [&queries, &database].map(|all| all.pick(places(all).into_iter()));
        axes.compare(radii, &pairs, &picked[0], &picked[1])
    };
    let cells: Vec<[u32; 2]> =
        disks.iter().flat_map(|&disk| rings.iter().map(move |&ring| [disk, ring])).collect();
    let some = cells.par_iter().enumerate().map(|(index, &radii)| compare(index, radii, Some(SOME)));
    let mut rng = random::stream(1, "compared whole cells", &[]);
    let whole = (0..WHOLE_CELLS).map(|_| rng.random_range(0..cells.len() as u64) as usize);
    let whole: Vec<usize> = whole.collect();
    let whole = whole.par_iter().map(|&index| compare(index, cells[index], None));

    let compared: Vec<Compared> = some.chain(whole).collect();
    let points: usize = compared.iter().map(|cell| cell.points).sum();
    let at_breakpoints: usize = compared.iter().map(|cell| cell.at_breakpoints).sum();
    println!(
        "{points} grid points of {} cells compared, {at_breakpoints} of them within one ulp of a breakpoint",
        cells.len()
    );
    assert!(points >= 2000 && at_breakpoints > 0);
}
