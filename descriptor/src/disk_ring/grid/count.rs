//! How many queries each descriptor of a cell recognises.

use pulp::NullaryFnOnce;
use rayon::prelude::*;

use super::{Cell, CellSignatures};
use crate::disk_ring::signature::weighted;
use crate::distance::{LANES, Transposed};
use crate::recognise::{Label, RecogniseError};
use crate::signature::{Signature, Signatures};
use crate::wide::widest;

/// Queries whose distances are held at once by a thread: the database, transposed, is gone through once for all of them.
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
        queries: &[CellSignatures],
        query_labels: &[Label],
        database: &[CellSignatures],
        database_labels: &[Label],
    ) -> Result<Vec<u32>, RecogniseError> {
        assert_eq!(queries.len(), query_labels.len(), "one label for each query");
        assert_eq!(database.len(), database_labels.len(), "one label for each cloud of the database");
        if database.is_empty() && !queries.is_empty() {
            return Err(RecogniseError::EmptyDatabase);
        }
        let transposed = |of: fn(&CellSignatures) -> &[Signature], count: usize| -> Vec<Transposed> {
            let all = |value: usize| database.iter().map(|cloud| &of(cloud)[value]).collect::<Signatures>();
            (0..count).into_par_iter().map(|value| Transposed::new(&all(value))).collect()
        };
        let shape = transposed(|cloud| &cloud.shape, self.shape.len());
        let colour = transposed(|cloud| &cloud.colour, self.colour.len());
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
        let mut filter = CandidateFilter::default();
        let nearest_in_colour: Vec<usize> =
            (0..self.colour.len()).map(|m| lowest(colour.row(m, query))).collect();
        for (n, counts) in counts.chunks_exact_mut(self.colour.len() * self.weights.len()).enumerate() {
            let shapes = shape.row(n, query);
            let nearest_in_shape = lowest(shapes);
            for (m, counts) in counts.chunks_exact_mut(self.weights.len()).enumerate() {
                let colours = colour.row(m, query);
                let leaders =
                    [nearest_in_shape, nearest_in_colour[m]].map(|cloud| (shapes[cloud], colours[cloud]));
                filter.select(shapes, colours, same, &leaders);
                filter.count(&self.weights, counts);
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
        database: &[Transposed],
        queries: &[CellSignatures],
        columns: usize,
        of: fn(&CellSignatures) -> &[Signature],
    ) -> Self {
        let blocks = columns.div_ceil(LANES);
        let mut rows = vec![[0.0; LANES]; database.len() * TILE * blocks];
        for (value, database) in database.iter().enumerate() {
            for (query, row) in queries.iter().zip(rows[value * TILE * blocks..].chunks_exact_mut(blocks)) {
                let Signature { centroid, deviation } = &of(query)[value];
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
    let lowest = widest(Least { values });
    values.iter().position(|&value| value == lowest).unwrap_or(0)
}

/// The kernel of [`lowest`]: the least of values that are never NaN.
struct Least<'a> {
    values: &'a [f32],
}

impl NullaryFnOnce for Least<'_> {
    type Output = f32;

    #[inline(always)]
    fn call(self) -> f32 {
        let (blocks, rest) = self.values.as_chunks::<LANES>();
        let mut lanes = [f32::INFINITY; LANES];
        for block in blocks {
            for (least, &value) in lanes.iter_mut().zip(block) {
                *least = if value < *least { value } else { *least };
            }
        }
        lanes.iter().chain(rest).copied().fold(f32::INFINITY, f32::min)
    }
}

/// A cloud of the database that can be the nearest for some w.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    shape: f32,
    colour: f32,
    /// Shows the query's object.
    same: bool,
}

/// Which clouds can be nearest to one query under one shape_bins and one m, for every w.
///
/// A cloud that is farther than another one in both shape and colour is farther for every w in [0, 1], as w·s and
/// (1 − w)·c and their sum never decrease with s and c, however they round, and the difference of two f32 values is
/// far above the rounding of an f64 sum of them. So only clouds that none of some `leaders` dominates are candidates; the
/// set distance of those is computed as the evaluator does, for every w of the grid.
#[derive(Default)]
struct CandidateFilter {
    candidates: Vec<Candidate>,
    /// Those that show the query's object, or those that do not.
    alike: Vec<Candidate>,
    nearest_same: Vec<f64>,
    nearest_other: Vec<f64>,
}

impl CandidateFilter {
    fn select(&mut self, shapes: &[f32], colours: &[f32], same: &[bool], leaders: &[(f32, f32)]) {
        self.candidates.clear();
        widest(Select { shapes, colours, same, leaders, candidates: &mut self.candidates });
    }

    /// Adds one to the count of every w whose nearest cloud is of the same object.
    fn count(&mut self, weights: &[f64], counts: &mut [u32]) {
        let of_same = self.candidates.iter().filter(|candidate| candidate.same).count();
        if of_same == 0 {
            return;
        }
        if of_same == self.candidates.len() {
            counts.iter_mut().for_each(|count| *count += 1);
            return;
        }
        for (nearest, same) in [(&mut self.nearest_same, true), (&mut self.nearest_other, false)] {
            self.alike.clear();
            self.alike.extend(self.candidates.iter().filter(|candidate| candidate.same == same));
            nearest.resize(weights.len(), f64::INFINITY);
            widest(LeastDistances { weights, candidates: &self.alike, nearest });
        }
        for (w, count) in counts.iter_mut().enumerate() {
            let (same, other) = (self.nearest_same[w], self.nearest_other[w]);
            let wins = if same == other { self.first_at(weights[w], same) } else { same < other };
            *count += u32::from(wins);
        }
    }

    /// Whether the first of the clouds at this distance shows the query's object.
    fn first_at(&self, weight: f64, distance: f64) -> bool {
        let mut at = self.candidates.iter().filter(|it| weighted(it.shape, it.colour, weight) == distance);
        at.next().is_some_and(|first| first.same)
    }
}

/// The kernel of [`CandidateFilter::select`].
struct Select<'a> {
    shapes: &'a [f32],
    colours: &'a [f32],
    same: &'a [bool],
    leaders: &'a [(f32, f32)],
    candidates: &'a mut Vec<Candidate>,
}

impl NullaryFnOnce for Select<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        const BLOCK: usize = 32;
        for (block, (shapes, colours)) in
            self.shapes.chunks(BLOCK).zip(self.colours.chunks(BLOCK)).enumerate()
        {
            let mut is_candidate = [1u8; BLOCK];
            for &(shape, colour) in self.leaders {
                for ((is_candidate, &s), &c) in is_candidate.iter_mut().zip(shapes).zip(colours) {
                    *is_candidate &= u8::from((s <= shape) | (c <= colour));
                }
            }
            // Few are: eight places are passed over at once.
            for (group, flags) in is_candidate.as_chunks::<8>().0.iter().enumerate() {
                if u64::from_ne_bytes(*flags) == 0 {
                    continue;
                }
                for place in
                    (group * 8..shapes.len().min(group * 8 + 8)).filter(|place| is_candidate[*place] != 0)
                {
                    let same = self.same[block * BLOCK + place];
                    self.candidates.push(Candidate { shape: shapes[place], colour: colours[place], same });
                }
            }
        }
    }
}

/// The kernel that finds the least set distance of some clouds for every w.
struct LeastDistances<'a> {
    weights: &'a [f64],
    candidates: &'a [Candidate],
    nearest: &'a mut [f64],
}

impl NullaryFnOnce for LeastDistances<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        const AT_ONCE: usize = 32;
        for (weights, nearest) in self.weights.chunks(AT_ONCE).zip(self.nearest.chunks_mut(AT_ONCE)) {
            let (mut lanes, mut least) = ([0.0; AT_ONCE], [f64::INFINITY; AT_ONCE]);
            lanes[..weights.len()].copy_from_slice(weights);
            for &Candidate { shape, colour, .. } in self.candidates {
                for (least, &weight) in least.iter_mut().zip(&lanes) {
                    let distance = weighted(shape, colour, weight);
                    *least = if distance < *least { distance } else { *least };
                }
            }
            nearest.copy_from_slice(&least[..weights.len()]);
        }
    }
}
