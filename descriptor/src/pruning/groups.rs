//! Which values of a signature are merged: those that differ in the same direction between clouds, so that merging them
//! loses least of the distance.

use std::marker::PhantomData;

use pulp::NullaryFnOnce;
use rand::RngExt;

use crate::random::stream;
use crate::set_distance::{ChiSquared, Hellinger, L1, SetDistance, Terms};
use crate::signature::Signatures;
use crate::transposed::LANES;
use crate::wide::widest;

/// Pairs of clouds on which losses are measured, a multiple of [`LANES`].
const PAIRS: usize = 32;
/// More values than this are first merged with their neighbours: losses are those of every two of them.
const CELLS: usize = 1024;
/// Groups of the two levels, even numbers, because terms come in twos.
pub(super) const LEVELS: [usize; 2] = [32, 8];

/// Values of a sample of pairs: one cloud's, and the other's.
type Sample = [[f32; PAIRS]; 2];

/// Some of the database in each channel, how it is compared, and the factor of its values.
pub(super) type Channel<'a> = (&'a Signatures, SetDistance, f64);

/// Groups of values, and groups of these groups. Groups lie in the order of their metrics.
#[derive(Debug)]
pub(super) struct Groups {
    /// Of each channel's values the number of its group.
    pub(super) of_values: Vec<Vec<u32>>,
    /// Of each group the number of the group of the second level that it is merged into.
    pub(super) of_groups: Vec<u32>,
    /// Of each group of a level its metric.
    pub(super) metrics: [Vec<SetDistance>; 2],
    /// Terms that finding them took.
    pub(super) terms: u64,
}

/// Values that are merged, on the sample.
struct Cell {
    metric: SetDistance,
    values: Sample,
    /// Its terms.
    terms: [f32; PAIRS],
    /// `None` once it is merged into another.
    best: Option<Best>,
    is_there: bool,
}

/// What merging two cells loses: the bits of a float ≥ 0, which are in its order and are compared in vectors.
type Loss = u32;

/// Of two cells that cannot be merged.
const IMPOSSIBLE: Loss = f32::INFINITY.to_bits();

/// The least loss by merging a cell with a later one.
#[derive(Clone, Copy)]
struct Best {
    loss: Loss,
    other: usize,
}

impl Groups {
    /// Of the values of a database, at least one cloud.
    ///
    /// Greedily from the bottom: again and again those two are merged whose merging loses least, added up over pairs of
    /// clouds that are drawn at random, each of them counting alike. What is drawn changes how much is pruned, no result.
    pub(super) fn new(channels: &[Channel<'_>]) -> Self {
        let values: usize = channels.iter().map(|(signatures, ..)| signatures.width).sum();
        let together = values.div_ceil(CELLS).max(1);
        let pairs = Pair::sample(channels);
        let mut cells: Vec<Cell> = Vec::new();
        let mut of_values = Vec::new();
        for (channel, (signatures, metric, factor)) in channels.iter().enumerate() {
            let first = cells.len();
            of_values.push((0..signatures.width).map(|value| (first + value / together) as u32).collect());
            for start in (0..signatures.width).step_by(together) {
                let end = (start + together).min(signatures.width);
                cells.push(Cell::new(*metric, &pairs, |cloud| {
                    let values = &channels[channel].0.values[cloud * signatures.width..];
                    factor * values[start..end].iter().copied().map(f64::from).sum::<f64>()
                }));
            }
        }
        let mut merging = Merging::new(cells);
        let levels = LEVELS.map(|groups| merging.down_to(groups));
        Self::of_levels(of_values, levels, &merging)
    }

    /// From the cells that stand for each cell on the two levels.
    fn of_levels(cells: Vec<Vec<u32>>, [fine, coarse]: [Vec<usize>; 2], merging: &Merging) -> Self {
        let metric = |cell: usize| merging.cells[cell].metric;
        // The groups of a level by metric, then by the cell that stands for them.
        let groups = |level: &[usize]| -> Vec<usize> {
            let mut groups: Vec<usize> =
                level.iter().enumerate().filter(|&(cell, &of)| cell == of).map(|(cell, _)| cell).collect();
            groups.sort_by_key(|&cell| (metric(cell), cell));
            groups
        };
        let (of_fine, of_coarse) = (groups(&fine), groups(&coarse));
        let place = |groups: &[usize], of: usize| {
            groups.iter().position(|&cell| cell == of).expect("each cell has a group") as u32
        };
        let places: Vec<u32> = fine.iter().map(|&of| place(&of_fine, of)).collect();
        Self {
            of_values: cells
                .into_iter()
                .map(|cells| cells.into_iter().map(|cell| places[cell as usize]).collect())
                .collect(),
            of_groups: of_fine.iter().map(|&cell| place(&of_coarse, coarse[cell])).collect(),
            metrics: [&of_fine, &of_coarse].map(|groups| groups.iter().map(|&cell| metric(cell)).collect()),
            terms: merging.terms,
        }
    }
}

/// Two clouds, and what makes their distance 1 or so.
struct Pair {
    clouds: [usize; 2],
    factor: f64,
}

impl Pair {
    /// Drawn at random.
    fn sample(channels: &[Channel<'_>]) -> Vec<Self> {
        let clouds = channels.first().map_or(1, |(signatures, ..)| signatures.clouds()) as u64;
        let mut rng = stream(0, "pruning", &[]);
        let mut draw = || (rng.random::<u64>() % clouds) as usize;
        let pair = |_| {
            let clouds = [draw(), draw()];
            let apart: f64 = channels.iter().map(|channel| distance(*channel, clouds)).sum();
            Self { clouds, factor: if apart > 0.0 { 1.0 / apart } else { 0.0 } }
        };
        (0..PAIRS).map(pair).collect()
    }
}

/// L1 distance, which tells well enough how far apart two clouds are.
fn distance((signatures, _, factor): Channel<'_>, [one, other]: [usize; 2]) -> f64 {
    let [one, other] = [one, other].map(|cloud| &signatures.values[cloud * signatures.width..]);
    let differences = one.iter().zip(other).take(signatures.width).map(|(a, b)| f64::from((a - b).abs()));
    factor * differences.sum::<f64>()
}

impl Cell {
    fn new(metric: SetDistance, pairs: &[Pair], value: impl Fn(usize) -> f64) -> Self {
        let mut values = [[0.0; PAIRS]; 2];
        for (lane, pair) in pairs.iter().enumerate() {
            for (side, &cloud) in values.iter_mut().zip(&pair.clouds) {
                side[lane] = (pair.factor * value(cloud)) as f32;
            }
        }
        let mut cell = Self { metric, values, terms: [0.0; PAIRS], best: None, is_there: true };
        cell.count_terms();
        cell
    }

    fn count_terms(&mut self) {
        let [a, b] = &self.values;
        for (term, (a, b)) in self.terms.iter_mut().zip(a.iter().zip(b)) {
            *term = match self.metric {
                SetDistance::ChiSquared => term_of::<ChiSquared>(*a, *b),
                SetDistance::L1 => term_of::<L1>(*a, *b),
                SetDistance::Hellinger => term_of::<Hellinger>(*a, *b),
            };
        }
    }

    fn losses(&self, others: &[Self], losses: &mut [Loss]) {
        match self.metric {
            SetDistance::ChiSquared => {
                widest(Losses { cell: self, others, losses, terms: PhantomData::<ChiSquared> })
            }
            SetDistance::L1 => widest(Losses { cell: self, others, losses, terms: PhantomData::<L1> }),
            SetDistance::Hellinger => {
                widest(Losses { cell: self, others, losses, terms: PhantomData::<Hellinger> })
            }
        }
    }
}

#[inline(always)]
fn term_of<T: Terms>(a: f32, b: f32) -> f32 {
    T::FACTOR * T::of_two([a, 0.0], [b, 0.0])
}

/// What merging a cell with each of others loses.
struct Losses<'a, T> {
    cell: &'a Cell,
    others: &'a [Cell],
    losses: &'a mut [Loss],
    terms: PhantomData<T>,
}

impl<T: Terms> NullaryFnOnce for Losses<'_, T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { cell, others, losses, terms: _ } = self;
        for (other, loss) in others.iter().zip(losses) {
            if !other.is_there || other.metric != cell.metric {
                *loss = IMPOSSIBLE;
                continue;
            }
            let mut sums = [0.0; LANES];
            for start in (0..PAIRS).step_by(LANES) {
                for (lane, sum) in sums.iter_mut().enumerate() {
                    let pair = start + lane;
                    let merged = [0, 1].map(|side| cell.values[side][pair] + other.values[side][pair]);
                    *sum += cell.terms[pair] + other.terms[pair] - term_of::<T>(merged[0], merged[1]);
                }
            }
            for half in [8, 4, 2, 1] {
                let (sums, others) = sums.split_at_mut(half);
                sums.iter_mut().zip(others).for_each(|(sum, other)| *sum += *other);
            }
            // Rounding can make nothing of it, or less.
            *loss = if sums[0] > 0.0 { sums[0].to_bits() } else { 0 };
        }
    }
}

/// Cells on their way to groups.
struct Merging {
    cells: Vec<Cell>,
    /// Of each cell the one that it has been merged into, or itself.
    into: Vec<usize>,
    /// Loss by merging a cell with a later one: all of the first cell's, then all of the second's.
    losses: Vec<Loss>,
    left: usize,
    terms: u64,
}

impl Merging {
    fn new(cells: Vec<Cell>) -> Self {
        let count = cells.len();
        let (into, losses) = ((0..count).collect(), vec![IMPOSSIBLE; count * count]);
        let mut merging = Self { cells, into, losses, left: count, terms: 0 };
        for cell in 0..count {
            let later = cell + 1..count;
            merging.cells[cell]
                .losses(&merging.cells[later.clone()], &mut merging.losses[cell * count..][later.clone()]);
            merging.terms += (later.len() * PAIRS) as u64;
            merging.find_best(cell);
        }
        merging
    }

    fn find_best(&mut self, cell: usize) {
        let losses = &self.losses[cell * self.cells.len()..][cell + 1..self.cells.len()];
        let loss = losses.iter().fold(IMPOSSIBLE, |least, &loss| least.min(loss));
        let place = losses.iter().position(|&other| other == loss).filter(|_| loss < IMPOSSIBLE);
        self.cells[cell].best = place.map(|place| Best { loss, other: cell + 1 + place });
    }

    /// Merges until so many are left, or one of each metric: of each cell the one that stands for its group.
    fn down_to(&mut self, groups: usize) -> Vec<usize> {
        while self.left > groups {
            let cells = self.cells.iter().enumerate().filter(|(_, cell)| cell.is_there);
            let best = cells.filter_map(|(index, cell)| cell.best.map(|best| (index, best)));
            let Some((one, Best { other, .. })) = best.min_by_key(|(_, best)| best.loss) else {
                break;
            };
            self.merge(one, other);
        }
        (0..self.cells.len())
            .map(|mut cell| {
                while self.into[cell] != cell {
                    cell = self.into[cell];
                }
                cell
            })
            .collect()
    }

    /// Merges a cell with a later one.
    fn merge(&mut self, one: usize, other: usize) {
        let count = self.cells.len();
        let merged = self.cells[other].values;
        for (side, merged) in self.cells[one].values.iter_mut().zip(&merged) {
            for (value, merged) in side.iter_mut().zip(merged) {
                *value += merged;
            }
        }
        self.cells[one].count_terms();
        self.cells[other].is_there = false;
        self.into[other] = one;
        self.left -= 1;

        let mut losses = vec![0; count];
        self.cells[one].losses(&self.cells, &mut losses);
        self.terms += (self.left * PAIRS) as u64;
        losses[one] = IMPOSSIBLE;
        for (cell, &loss) in losses.iter().enumerate() {
            self.losses[cell.min(one) * count + cell.max(one)] = loss;
            self.losses[cell.min(other) * count + cell.max(other)] = IMPOSSIBLE;
        }
        for cell in (0..count).filter(|&cell| cell != one) {
            if !self.cells[cell].is_there {
                continue;
            }
            match self.cells[cell].best {
                Some(best) if best.other == one || best.other == other => self.find_best(cell),
                Some(best) if cell < one && losses[cell] < best.loss => {
                    self.cells[cell].best = Some(Best { loss: losses[cell], other: one });
                }
                _ => {}
            }
        }
        self.find_best(one);
    }
}
