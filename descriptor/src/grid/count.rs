//! How many queries each descriptor of a cell recognises.

use pulp::NullaryFnOnce;
use rayon::prelude::*;

use super::{Cell, CellParts};
use crate::distance::{LANES, Turned};
use crate::recognise::{Label, RecogniseError};
use crate::summary::{Part, Parts, weighted};
use crate::wide::widest;

/// Queries whose distances are held at once by a thread: the database, turned, is gone through once for all of them.
const TILE: usize = 16;

impl Cell {
    /// How many queries every descriptor of the cell recognises (object), in the order shape_bins, m, w, w fastest;
    /// computed by the current rayon pool.
    ///
    /// # Errors
    /// [`RecogniseError::EmptyDatabase`] if there are queries but no cloud to match with.
    ///
    /// # Panics
    /// If there is not one label for each cloud: a programming error.
    pub fn object_correct(
        &self,
        queries: &[CellParts],
        query_labels: &[Label],
        database: &[CellParts],
        database_labels: &[Label],
    ) -> Result<Vec<u32>, RecogniseError> {
        assert_eq!(queries.len(), query_labels.len(), "one label for each query");
        assert_eq!(database.len(), database_labels.len(), "one label for each cloud of the database");
        if database.is_empty() && !queries.is_empty() {
            return Err(RecogniseError::EmptyDatabase);
        }
        let turned = |parts: fn(&CellParts) -> &[Part], count: usize| -> Vec<Turned> {
            let of = |value: usize| database.iter().map(|cloud| &parts(cloud)[value]).collect::<Parts>();
            (0..count).into_par_iter().map(|value| Turned::new(&of(value))).collect()
        };
        let shape = turned(|cloud| &cloud.shape, self.shape.len());
        let colour = turned(|cloud| &cloud.colour, self.colour.len());
        let tiles = queries.par_chunks(TILE).zip(query_labels.par_chunks(TILE));
        let counts = tiles.fold(
            || vec![0u32; self.descriptors()],
            |mut counts, (queries, labels)| {
                let shape = Rows::new(&shape, queries, database.len(), |cloud| &cloud.shape);
                let colour = Rows::new(&colour, queries, database.len(), |cloud| &cloud.colour);
                for (query, label) in labels.iter().enumerate() {
                    let same: Vec<bool> =
                        database_labels.iter().map(|other| other.instance == label.instance).collect();
                    self.count(&shape, &colour, query, &same, &mut counts);
                }
                counts
            },
        );
        let add = |mut all: Vec<u32>, counts: Vec<u32>| {
            all.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
            all
        };
        Ok(counts.reduce(|| vec![0; self.descriptors()], add))
    }

    /// Adds one query to the counts of every descriptor.
    fn count(&self, shape: &Rows, colour: &Rows, query: usize, same: &[bool], counts: &mut [u32]) {
        let mut race = Race::default();
        let nearest_in_colour: Vec<usize> =
            (0..self.colour.len()).map(|m| lowest(colour.row(m, query))).collect();
        for (n, counts) in counts.chunks_exact_mut(self.colour.len() * self.weights.len()).enumerate() {
            let shapes = shape.row(n, query);
            let nearest_in_shape = lowest(shapes);
            for (m, counts) in counts.chunks_exact_mut(self.weights.len()).enumerate() {
                let colours = colour.row(m, query);
                let rivals =
                    [nearest_in_shape, nearest_in_colour[m]].map(|cloud| (shapes[cloud], colours[cloud]));
                race.enter(shapes, colours, same, &rivals);
                race.run(&self.weights, counts);
            }
        }
    }
}

/// Distances of a tile's queries under every value of one gene.
struct Rows {
    columns: usize,
    /// Room of one query's row, a whole number of blocks.
    stride: usize,
    values: Vec<f32>,
}

impl Rows {
    fn new(
        database: &[Turned],
        queries: &[CellParts],
        columns: usize,
        parts: fn(&CellParts) -> &[Part],
    ) -> Self {
        let blocks = columns.div_ceil(LANES);
        let mut rows = vec![[0.0; LANES]; database.len() * TILE * blocks];
        for (value, database) in database.iter().enumerate() {
            for (query, row) in queries.iter().zip(rows[value * TILE * blocks..].chunks_exact_mut(blocks)) {
                let Part { centroid, deviation } = &parts(query)[value];
                database.distances([centroid, deviation], row);
            }
        }
        Self { columns, stride: blocks * LANES, values: rows.into_flattened() }
    }

    fn row(&self, value: usize, query: usize) -> &[f32] {
        &self.values[(value * TILE + query) * self.stride..][..self.columns]
    }
}

/// Position of the lowest value, the first of equal ones.
fn lowest(values: &[f32]) -> usize {
    let lowest = values.iter().copied().fold(f32::INFINITY, f32::min);
    values.iter().position(|&value| value == lowest).unwrap_or(0)
}

/// A cloud of the database that can be the nearest for some w.
#[derive(Clone, Copy, Debug)]
struct Entrant {
    shape: f32,
    colour: f32,
    /// Shows the query's object.
    same: bool,
}

/// Who is nearest to one query under one shape_bins and one m, for every w.
///
/// A cloud that is farther than another one in both shape and colour is farther for every w in [0, 1], as w·s and
/// (1 − w)·c and their sum never decrease with s and c, however they round, and the difference of two f32 values is
/// far above the rounding of an f64 sum of them. So only clouds not strictly behind any of some `rivals` enter; the
/// set distance of those is computed as the evaluator does, for every w of the grid.
#[derive(Default)]
struct Race {
    entrants: Vec<Entrant>,
    nearest_same: Vec<f64>,
    nearest_other: Vec<f64>,
}

impl Race {
    fn enter(&mut self, shapes: &[f32], colours: &[f32], same: &[bool], rivals: &[(f32, f32)]) {
        self.entrants.clear();
        widest(Enter { shapes, colours, same, rivals, entrants: &mut self.entrants });
    }

    /// Adds one to the count of every w whose nearest cloud is of the same object.
    fn run(&mut self, weights: &[f64], counts: &mut [u32]) {
        let of_same = self.entrants.iter().filter(|entrant| entrant.same).count();
        if of_same == 0 {
            return;
        }
        if of_same == self.entrants.len() {
            counts.iter_mut().for_each(|count| *count += 1);
            return;
        }
        for (nearest, same) in [(&mut self.nearest_same, true), (&mut self.nearest_other, false)] {
            nearest.clear();
            nearest.resize(weights.len(), f64::INFINITY);
            for entrant in self.entrants.iter().filter(|entrant| entrant.same == same) {
                widest(Pace { weights, entrant: *entrant, nearest });
            }
        }
        for (w, count) in counts.iter_mut().enumerate() {
            let (same, other) = (self.nearest_same[w], self.nearest_other[w]);
            let wins = if same == other { self.first_at(weights[w], same) } else { same < other };
            *count += u32::from(wins);
        }
    }

    /// Whether the first of the clouds at this distance shows the query's object.
    fn first_at(&self, weight: f64, distance: f64) -> bool {
        let mut at = self.entrants.iter().filter(|e| weighted(e.shape, e.colour, weight) == distance);
        at.next().is_some_and(|first| first.same)
    }
}

/// The kernel of [`Race::enter`].
struct Enter<'a> {
    shapes: &'a [f32],
    colours: &'a [f32],
    same: &'a [bool],
    rivals: &'a [(f32, f32)],
    entrants: &'a mut Vec<Entrant>,
}

impl NullaryFnOnce for Enter<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        const BLOCK: usize = 32;
        for (block, (shapes, colours)) in
            self.shapes.chunks(BLOCK).zip(self.colours.chunks(BLOCK)).enumerate()
        {
            let mut ahead = [1u8; BLOCK];
            for &(shape, colour) in self.rivals {
                for ((ahead, &s), &c) in ahead.iter_mut().zip(shapes).zip(colours) {
                    *ahead &= u8::from((s <= shape) | (c <= colour));
                }
            }
            for (place, (&shape, &colour)) in shapes.iter().zip(colours).enumerate() {
                if ahead[place] != 0 {
                    let index = block * BLOCK + place;
                    self.entrants.push(Entrant { shape, colour, same: self.same[index] });
                }
            }
        }
    }
}

/// The set distance of one cloud for every w, and the least so far.
struct Pace<'a> {
    weights: &'a [f64],
    entrant: Entrant,
    nearest: &'a mut [f64],
}

impl NullaryFnOnce for Pace<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Entrant { shape, colour, .. } = self.entrant;
        for (nearest, &weight) in self.nearest.iter_mut().zip(self.weights) {
            let distance = weighted(shape, colour, weight);
            *nearest = if distance < *nearest { distance } else { *nearest };
        }
    }
}
