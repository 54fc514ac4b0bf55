//! Grid cells on real clouds: every count is the evaluator's own, bit for bit, next to breakpoints of w too.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::sync::LazyLock;

use descriptor::disk_ring::weighted;
use descriptor::grid::Cell;
use descriptor::recognise::recognise_from;
use descriptor::{
    Correct, DistanceMatrix, GeneKind, GeneTable, Label, Parameters, Preprocess, QuantisedCloud, Quantiser,
    pcd, random,
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
/// Parts of descriptors that are drawn from the whole grid and compared with all clouds, …
const PARTS: usize = 500;
/// … and values of w that are drawn for each: describing and comparing clouds takes as long for all as for one.
const WEIGHTS: usize = 4;

/// A drawn part: its shape_bins and m, and the places of the values of w.
type Part = (u32, u32, [usize; WEIGHTS]);

/// A split's clouds, ready for every descriptor of the grid.
struct Prepared {
    clouds: Vec<QuantisedCloud>,
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
    clouds: Vec<&'a QuantisedCloud>,
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
        QuantisedCloud::new(&cloud, &Preprocess::default(), quantiser).unwrap()
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

impl Compared {
    /// Adds all up and says what they are.
    fn conclude(all: &[Self], cells: usize) {
        let points: usize = all.iter().map(|some| some.points).sum();
        let at_breakpoints: usize = all.iter().map(|some| some.at_breakpoints).sum();
        println!(
            "{points} points of {cells} cells compared, {at_breakpoints} of them within one ulp of a breakpoint"
        );
        assert!(points >= 2000 && at_breakpoints > 0);
    }
}

/// Descriptors of one R1 and one R2: all with these values, in ticks.
struct Block<'a> {
    quantiser: &'a Quantiser,
    radii: [u32; 2],
    shape_bins: &'a [u32],
    colour_bins: &'a [u32],
    weights: &'a [u32],
}

impl Block<'_> {
    /// Compares the counts of these points (places of shape_bins and m, and those of w) with the evaluator.
    fn compare(
        &self,
        points: impl Iterator<Item = ([usize; 2], impl IntoIterator<Item = usize>)>,
        [queries, database]: [&Picked; 2],
    ) -> Compared {
        let Self { quantiser, radii, shape_bins, colour_bins, weights } = *self;
        let cell = Cell::part(quantiser, radii, shape_bins, colour_bins).unwrap();
        let signatures = |split: &Picked| cell.signatures(&split.clouds);
        let counts = cell
            .object_correct(
                None,
                &signatures(queries),
                &queries.labels,
                &signatures(database),
                &database.labels,
            )
            .unwrap();
        assert_eq!(counts.len(), shape_bins.len() * colour_bins.len() * weights.len());

        let mut compared = Compared::default();
        for ([n, m], places) in points {
            let ticks = [shape_bins[n], colour_bins[m], radii[0], radii[1], 0];
            let binning = quantiser.binning(&Parameters::from_ticks(ticks)).unwrap();
            let [of_queries, of_database] =
                [queries, database].map(|split| binning.signatures(&split.clouds));
            let [shape, colour] =
                [0, 1].map(|half| DistanceMatrix::new(&of_queries[half], &of_database[half]));
            for w in places {
                let weight = GeneKind::ShapeWeight.spec().value(weights[w]);
                let found = recognise_from(
                    queries.clouds.len(),
                    &[(&shape, weight), (&colour, 1.0 - weight)],
                    &database.labels,
                )
                .unwrap();
                let correct = Correct::count(&found, &queries.labels, &database.labels).object as u32;
                let counted = counts[(n * colour_bins.len() + m) * weights.len() + w];
                assert_eq!(counted, correct, "{ticks:?}, {weight}");
                compared.points += 1;
                let labels = [&queries.labels, &database.labels];
                compared.at_breakpoints +=
                    usize::from(is_at_a_breakpoint(&shape, &colour, labels[0], labels[1], weight));
            }
        }
        compared
    }
}

/// The training clouds of the household data, ready for the paper's table.
struct Household {
    table: GeneTable,
    quantiser: Quantiser,
    queries: Prepared,
    database: Prepared,
}

/// Prepared once for all tests; `None` without the data.
static HOUSEHOLD: LazyLock<Option<Household>> = LazyLock::new(|| {
    let table = GeneTable::paper();
    let quantiser = Quantiser::new(&table).unwrap();
    let mut objects = Vec::new();
    let queries = prepare("train1.txt", &quantiser, &mut objects)?;
    let database = prepare("train2.txt", &quantiser, &mut objects)?;
    Some(Household { table, quantiser, queries, database })
});

impl Household {
    /// The values of every gene, in ticks.
    fn values(&self) -> [Vec<u32>; 5] {
        GeneKind::ALL.map(|kind| self.table.domain(kind).unwrap().values().collect())
    }
}

#[test]
fn points_drawn_from_the_whole_household_grid_are_the_evaluator() {
    let Some(household) = HOUSEHOLD.as_ref() else { return };
    let [shape_bins, colour_bins, disks, rings, weights] = &household.values();
    let mut rng = random::stream(1, "compared points of the whole grid", &[]);
    let mut draw = |values: &[u32]| rng.random_range(0..values.len() as u64) as usize;
    let mut by_radii: BTreeMap<[u32; 2], Vec<Part>> = BTreeMap::new();
    for _ in 0..PARTS {
        let (n, m) = (shape_bins[draw(shape_bins)], colour_bins[draw(colour_bins)]);
        let radii = [disks[draw(disks)], rings[draw(rings)]];
        let drawn = [(); WEIGHTS].map(|()| draw(weights));
        by_radii.entry(radii).or_default().push((n, m, drawn));
    }
    let all = [&household.queries, &household.database].map(|all| all.pick(0..all.clouds.len()));
    let compare = |(&radii, points): (&[u32; 2], &Vec<Part>)| {
        // A cell of the values that were drawn alone: whole ones take ten times as long.
        let distinct = |values: BTreeSet<u32>| Vec::from_iter(values);
        let shape_bins = &distinct(points.iter().map(|point| point.0).collect());
        let colour_bins = &distinct(points.iter().map(|point| point.1).collect());
        let place = |values: &[u32], value| values.binary_search(&value).unwrap();
        let places =
            points.iter().map(|&(n, m, drawn)| ([place(shape_bins, n), place(colour_bins, m)], drawn));
        let block = Block { quantiser: &household.quantiser, radii, shape_bins, colour_bins, weights };
        block.compare(places, all.each_ref())
    };
    let compared: Vec<Compared> = by_radii.par_iter().map(compare).collect();
    Compared::conclude(&compared, by_radii.len());
}

#[test]
fn grid_cells_are_the_evaluator_on_the_household_clouds() {
    let Some(household) = HOUSEHOLD.as_ref() else { return };
    let Household { quantiser, queries, database, .. } = household;
    let [shape_bins, colour_bins, disks, rings, weights] = &household.values();

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
        let picked = [queries, database].map(|all| all.pick(places(all).into_iter()));
        let block = Block { quantiser, radii, shape_bins, colour_bins, weights };
        block.compare(pairs.into_iter().map(|pair| (pair, 0..weights.len())), picked.each_ref())
    };
    let cells: Vec<[u32; 2]> =
        disks.iter().flat_map(|&disk| rings.iter().map(move |&ring| [disk, ring])).collect();
    let some = cells.par_iter().enumerate().map(|(index, &radii)| compare(index, radii, Some(SOME)));
    let mut rng = random::stream(1, "compared whole cells", &[]);
    let whole = (0..WHOLE_CELLS).map(|_| rng.random_range(0..cells.len() as u64) as usize);
    let whole: Vec<usize> = whole.collect();
    let whole = whole.par_iter().map(|&index| compare(index, cells[index], None));

    let compared: Vec<Compared> = some.chain(whole).collect();
    Compared::conclude(&compared, cells.len());
}
