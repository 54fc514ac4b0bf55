//! How many queries each descriptor of a cell recognises.

use pulp::bytemuck::cast_slice;
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::distances::{DiskDistances, DistanceRows, TILE};
use super::{Cell, CellSignatures};
use crate::disk_ring::signature::weighted;
use crate::recognise::{Label, RecogniseError};
use crate::select::{NUMBERS, pack};
use crate::transposed::LANES;
use crate::wide::widest;

impl Cell {
    /// How many queries every descriptor of the cell recognises (object), in the order shape_bins, m, w, w fastest;
    /// computed by the current rayon pool. With the disk distances of these clouds under a cell with the same R1 and the same
    /// values, about half of the terms are left to add up.
    ///
    /// # Errors
    /// [`RecogniseError::EmptyDatabase`] if there are queries but no cloud to match with.
    ///
    /// # Panics
    /// If there is not one label for each cloud, or the disk distances are of other cells or of fewer or more clouds: a
    /// programming error.
    pub fn object_correct(
        &self,
        disks: Option<&DiskDistances>,
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
        if let Some(disks) = disks {
            assert!(disks.are_of(self, queries.len(), database.len()), "disk distances of another cell");
        }
        let transposed = self.transposed(database);
        let weights = Weights::new(&self.weights);
        let tiles = queries.par_chunks(TILE).zip(query_labels.par_chunks(TILE)).enumerate();
        let counts = tiles.fold(
            || vec![0u32; self.descriptors()],
            |mut counts, (tile, (queries, labels))| {
                let disks = disks.map(|disks| disks.of(tile * TILE..tile * TILE + queries.len()));
                let [shape, colour] = [0, 1].map(|channel| {
                    DistanceRows::new(self, channel, &transposed[channel], disks, queries, database.len())
                });
                for (query, label) in labels.iter().enumerate() {
                    let shows_object: Vec<bool> =
                        database_labels.iter().map(|other| other.instance == label.instance).collect();
                    let (shape, colour, weights, counts) = (&shape, &colour, &weights, &mut counts[..]);
                    widest(Count { shape, colour, query, shows_object: &shows_object, weights, counts });
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
}

/// Values of w for which distances are computed at once.
const WEIGHTS: usize = 40;

/// Vectors of them.
const VECTORS: usize = WEIGHTS / 8;

/// Places in the list of all w, as fractions of its length, at which the nearest cloud is one of the leaders.
const LEADS: [f64; 3] = [0.25, 0.5, 0.75];

/// Leaders of one query under one shape_bins and one m: the nearest in shape, the nearest in colour, and those at [`LEADS`].
const LEADERS: usize = 2 + LEADS.len();

/// All values of w, each with 1 - w, in blocks whose last is filled up with its last value.
struct Weights {
    blocks: Vec<[[f64; WEIGHTS]; 2]>,
    count: usize,
    /// Those at [`LEADS`].
    leads: [f32; LEADS.len()],
}

impl Weights {
    fn new(weights: &[f64]) -> Self {
        let block = |weights: &[f64]| {
            let weight = |lane: usize| weights[lane.min(weights.len() - 1)];
            [std::array::from_fn(weight), std::array::from_fn(|lane| 1.0 - weight(lane))]
        };
        let lead = |part: f64| weights[((weights.len() - 1) as f64 * part) as usize] as f32;
        Self {
            blocks: weights.chunks(WEIGHTS).map(block).collect(),
            count: weights.len(),
            leads: LEADS.map(lead),
        }
    }
}

/// A cloud of the database that can be the nearest for some w.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    shape: f32,
    colour: f32,
    place: u32,
}

/// The kernel that adds one query to the counts of every descriptor of a cell.
///
/// A cloud that is farther than another one in both shape and colour is farther for every w in [0, 1], as w·s and
/// (1 − w)·c and their sum never decrease with s and c, however they round, and the difference of two f32 values is
/// far above the rounding of an f64 sum of them. So only clouds that none of some leaders dominates are candidates; the
/// set distance of those is computed as the evaluator does, for every w of the grid. Any cloud may lead: the nearest in
/// shape, the nearest in colour, and, so that few candidates are left, those that were the nearest for some w in between
/// under an earlier shape_bins.
struct Count<'a> {
    shape: &'a DistanceRows,
    colour: &'a DistanceRows,
    query: usize,
    /// Whether each cloud of the database shows the query's object.
    shows_object: &'a [bool],
    weights: &'a Weights,
    counts: &'a mut [u32],
}

impl WithSimd for Count<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { shape, colour, query, shows_object, weights, counts } = self;
        let mut leading = vec![[0; LEADERS]; colour.count];
        for (m, leading) in leading.iter_mut().enumerate() {
            leading.fill(lowest(colour.row(m, query)));
        }
        let mut places = vec![0; shape.blocks * LANES];
        let (mut of_same, mut of_others) = (Vec::new(), Vec::new());
        for (n, counts) in counts.chunks_exact_mut(colour.count * weights.count).enumerate() {
            let shapes = shape.row(n, query);
            let nearest_in_shape = lowest(shapes);
            for ((m, counts), leading) in counts.chunks_exact_mut(weights.count).enumerate().zip(&mut leading)
            {
                let colours = colour.row(m, query);
                leading[0] = nearest_in_shape;
                let kept = undominated(simd, [shapes, colours], leading, &mut places);
                of_same.clear();
                of_others.clear();
                for &place in &places[..kept] {
                    let [shape, colour] = at([shapes, colours], place);
                    let these = if shows_object[place as usize] { &mut of_same } else { &mut of_others };
                    these.push(Candidate { shape, colour, place });
                }
                if of_same.is_empty() {
                    continue;
                }
                if of_others.is_empty() {
                    counts.iter_mut().for_each(|count| *count += 1);
                    continue;
                }
                for (block, counts) in weights.blocks.iter().zip(counts.chunks_mut(WEIGHTS)) {
                    let (same, others) = (least(simd, block, &of_same), least(simd, block, &of_others));
                    let (same, others) = (cast_slice::<_, f64>(&same), cast_slice::<_, f64>(&others));
                    let mut ties = false;
                    for ((count, same), other) in counts.iter_mut().zip(same).zip(others) {
                        *count += u32::from(same < other);
                        ties |= same == other;
                    }
                    if ties {
                        let wins = |w: usize| is_first(&of_same, &of_others, block[0][w], same[w]);
                        for (w, count) in counts.iter_mut().enumerate() {
                            *count += u32::from(same[w] == others[w] && wins(w));
                        }
                    }
                }
                let mut least = [f32::INFINITY; LEADS.len()];
                for &Candidate { shape, colour, place } in of_same.iter().chain(&of_others) {
                    for ((weight, least), leading) in
                        weights.leads.iter().zip(&mut least).zip(&mut leading[2..])
                    {
                        let distance = weight * shape + (1.0 - weight) * colour;
                        let is_less = distance < *least;
                        *least = if is_less { distance } else { *least };
                        *leading = if is_less { place } else { *leading };
                    }
                }
            }
        }
    }
}

/// A cloud's distances.
#[inline(always)]
fn at(rows: [&[[f32; LANES]]; 2], place: u32) -> [f32; 2] {
    let [shapes, colours] = rows;
    [shapes.as_flattened()[place as usize], colours.as_flattened()[place as usize]]
}

/// Place of the lowest value, the first of equal ones.
#[inline(always)]
fn lowest(values: &[[f32; LANES]]) -> u32 {
    let mut lanes = [f32::INFINITY; LANES];
    for block in values {
        for (least, &value) in lanes.iter_mut().zip(block) {
            *least = if value < *least { value } else { *least };
        }
    }
    let lowest = lanes.into_iter().fold(f32::INFINITY, f32::min);
    values.as_flattened().iter().position(|&value| value == lowest).unwrap_or(0) as u32
}

/// Writes the places of the clouds that no leader dominates to the first of `places`; how many they are.
#[inline(always)]
fn undominated<S: Simd>(
    simd: S,
    rows: [&[[f32; LANES]]; 2],
    leading: &[u32; LEADERS],
    places: &mut [u32],
) -> usize {
    let mut leaders = [[simd.splat_f32s(0.0); 2]; LEADERS];
    for (leader, &place) in leaders.iter_mut().zip(leading) {
        let [shape, colour] = at(rows, place);
        *leader = [simd.splat_f32s(shape), simd.splat_f32s(colour)];
    }
    let [shapes, colours] = rows;
    let mut numbers = S::as_simd_u32s(&NUMBERS).0[0];
    let mut count = 0;
    let vectors =
        S::as_simd_f32s(shapes.as_flattened()).0.iter().zip(S::as_simd_f32s(colours.as_flattened()).0);
    for (&shapes, &colours) in vectors {
        let mut are_kept = simd.less_than_or_equal_f32s(shapes, shapes); // all
        for [shape, colour] in leaders {
            let are_nearer =
                [simd.less_than_or_equal_f32s(shapes, shape), simd.less_than_or_equal_f32s(colours, colour)];
            are_kept = simd.and_m32s(are_kept, simd.or_m32s(are_nearer[0], are_nearer[1]));
        }
        count += pack(simd, numbers, are_kept, &mut places[count..count + S::F32_LANES]);
        numbers = simd.add_u32s(numbers, simd.splat_u32s(S::F32_LANES as u32));
    }
    count
}

/// The least set distance of some clouds for each of some w.
#[inline(always)]
fn least<S: Simd>(
    simd: S,
    [weights, rests]: &[[f64; WEIGHTS]; 2],
    candidates: &[Candidate],
) -> [S::f64s; VECTORS] {
    const { assert!(S::F64_LANES * VECTORS == WEIGHTS) }
    let (weights, rests) = (S::as_simd_f64s(weights).0, S::as_simd_f64s(rests).0);
    let mut least = [simd.splat_f64s(f64::INFINITY); VECTORS];
    for &Candidate { shape, colour, .. } in candidates {
        let (shape, colour) = (simd.splat_f64s(shape.into()), simd.splat_f64s(colour.into()));
        for ((least, &weight), &rest) in least.iter_mut().zip(weights).zip(rests) {
            // As `weighted` has it.
            let distance = simd.add_f64s(simd.mul_f64s(weight, shape), simd.mul_f64s(rest, colour));
            *least = simd.min_f64s(distance, *least);
        }
    }
    least
}

/// Whether the first of the clouds at this distance is one of the first list.
fn is_first(these: &[Candidate], others: &[Candidate], weight: f64, distance: f64) -> bool {
    let first = |candidates: &[Candidate]| {
        let at = candidates.iter().find(|it| weighted(it.shape, it.colour, weight) == distance);
        at.map(|first| first.place)
    };
    first(these) < first(others)
}
