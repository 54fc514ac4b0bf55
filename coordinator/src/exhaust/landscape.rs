//! What the counts of all descriptors say together: the best, marginals, pairs of genes, histogram and digest.
//!
//! Cells come in any order and are not kept: everything here is a sum, a maximum or a set.

use std::cmp::Reverse;
use std::collections::BTreeSet;

use blake3::{Hash, Hasher};
use descriptor::{Descriptor, GENES, GeneKind, Parameters};
use results::{BestRow, CountRow, LandscapeRow, MarginalRow};

use super::grid::Grid;

/// How many of the best descriptors are listed.
const BEST: usize = 1000;

/// Counts of correct answers over a grid, aggregated cell by cell.
#[derive(Clone, Debug)]
pub struct Landscape<'a> {
    grid: &'a Grid,
    queries: u32,
    /// Descriptors by count, from 0 to `queries`.
    histogram: Histogram,
    /// For each gene, a histogram a value.
    marginals: [Vec<Histogram>; GENES.len()],
    pairs: Vec<Pair>,
    /// The best so far; descriptors are ordered by their genes in table order.
    best: BTreeSet<(Reverse<u32>, Parameters)>,
    /// Of each cell's counts, once they have come.
    digests: Vec<Option<Hash>>,
}

/// Two genes and, for each pair of their values, the second one's fastest, the highest and the sum of all counts.
#[derive(Clone, Debug)]
struct Pair {
    genes: [GeneKind; 2],
    best: Vec<u32>,
    sum: Vec<u64>,
}

impl<'a> Landscape<'a> {
    /// No cell yet.
    pub fn new(grid: &'a Grid, queries: u32) -> Self {
        let genes: Vec<GeneKind> = grid.table().kinds().collect();
        let values = |gene| grid.axis(gene).len();
        let mut pairs = Vec::new();
        for (index, &a) in genes.iter().enumerate() {
            for &b in &genes[index + 1..] {
                let size = values(a) * values(b);
                pairs.push(Pair { genes: [a, b], best: vec![0; size], sum: vec![0; size] });
            }
        }
        let histogram = Histogram::new(queries);
        Self {
            grid,
            queries,
            marginals: GeneKind::ALL.map(|gene| vec![histogram.clone(); values(gene)]),
            histogram,
            pairs,
            best: BTreeSet::new(),
            digests: vec![None; grid.cells()],
        }
    }

    /// Takes a cell's counts, in the order of [`Grid::places`].
    ///
    /// # Panics
    /// If the cell has come before, is not of the grid, or has other counts than a cell has: a programming error, as
    /// every answer and file is checked before.
    pub fn add(&mut self, cell: usize, counts: &[u32]) {
        assert_eq!(counts.len(), self.grid.cell_len(), "one count a descriptor");
        let bytes: Vec<u8> = counts.iter().flat_map(|count| count.to_le_bytes()).collect();
        assert!(self.digests[cell].replace(blake3::hash(&bytes)).is_none(), "each cell once");
        for (place, &count) in self.grid.places(cell).zip(counts) {
            self.histogram.add(count);
            for (values, index) in self.marginals.iter_mut().zip(place) {
                values[index].add(count);
            }
            for pair in &mut self.pairs {
                let [a, b] = pair.genes;
                let index = place[a as usize] * self.grid.axis(b).len() + place[b as usize];
                pair.best[index] = pair.best[index].max(count);
                pair.sum[index] += u64::from(count);
            }
            self.rank(count, place);
        }
    }

    fn rank(&mut self, count: u32, place: [usize; GENES.len()]) {
        let last = self.best.last().map(|(Reverse(count), _)| *count);
        if self.best.len() == BEST && last.is_some_and(|last| count < last) {
            return;
        }
        self.best.insert((Reverse(count), self.grid.descriptor(place)));
        if self.best.len() > BEST {
            self.best.pop_last();
        }
    }

    /// The best descriptor so far with its count; the first in gene order on ties.
    pub fn leader(&self) -> Option<(u32, Parameters)> {
        self.best.first().map(|&(Reverse(count), parameters)| (count, parameters))
    }

    /// BLAKE3 over the digests of all cells in their order; `None` as long as one is missing.
    pub fn digest(&self) -> Option<Hash> {
        let mut hasher = Hasher::new_derive_key("descry grid v1");
        hasher.update(&self.queries.to_le_bytes());
        for digest in &self.digests {
            hasher.update(digest.as_ref()?.as_bytes());
        }
        Some(hasher.finalize())
    }

    /// Number of descriptors that are as good as the best.
    pub fn optimal_descriptors(&self) -> u64 {
        self.leader().map_or(0, |(count, _)| self.histogram.counts[count as usize])
    }

    /// The best descriptors, best first: by count descending, then by their genes in table order, ascending.
    pub fn best(&self) -> Vec<BestRow> {
        let row = |(rank, &(Reverse(object_correct), ref parameters)): (u32, &(Reverse<u32>, Parameters))| {
            BestRow { rank, genes: Descriptor::DiskRing(*parameters).values(), object_correct }
        };
        (1..).zip(&self.best).map(row).collect()
    }

    /// For each gene and value, what its descriptors reach.
    pub fn marginals(&self) -> Vec<MarginalRow> {
        let mut rows = Vec::new();
        for gene in self.grid.table().kinds() {
            let (spec, histograms) = (gene.spec(), &self.marginals[gene as usize]);
            for (&ticks, histogram) in self.grid.axis(gene).iter().zip(histograms) {
                // A value without descriptors has no statistics; once all cells have come there is none.
                let Some((worst, best)) = histogram.range() else { continue };
                rows.push(MarginalRow {
                    gene: spec.name.to_owned(),
                    value: spec.value(ticks),
                    descriptors: histogram.total(),
                    best,
                    mean: histogram.sum() as f64 / histogram.total() as f64,
                    median: histogram.median(),
                    worst,
                });
            }
        }
        rows
    }

    /// For each pair of genes and their values, what their descriptors reach. Means hold for a complete grid only.
    pub fn landscapes(&self) -> Vec<LandscapeRow> {
        let mut rows = Vec::new();
        for pair in &self.pairs {
            let [a, b] = pair.genes.map(GeneKind::spec);
            let [axis_a, axis_b] = pair.genes.map(|gene| self.grid.axis(gene));
            let descriptors = self.grid.descriptors() / pair.best.len() as u64;
            let values =
                axis_a.iter().flat_map(|&value_a| axis_b.iter().map(move |&value_b| (value_a, value_b)));
            for (((value_a, value_b), &best), &sum) in values.zip(&pair.best).zip(&pair.sum) {
                rows.push(LandscapeRow {
                    gene_a: a.name.to_owned(),
                    value_a: a.value(value_a),
                    gene_b: b.name.to_owned(),
                    value_b: b.value(value_b),
                    descriptors,
                    best,
                    mean: sum as f64 / descriptors as f64,
                });
            }
        }
        rows
    }

    /// The counts that occur, ascending, with their descriptors.
    pub fn counts(&self) -> Vec<CountRow> {
        let occurring = (0..).zip(&self.histogram.counts).filter(|(_, descriptors)| **descriptors > 0);
        occurring.map(|(object_correct, &descriptors)| CountRow { object_correct, descriptors }).collect()
    }
}

/// How many descriptors have each count of correct answers.
#[derive(Clone, Debug)]
struct Histogram {
    counts: Vec<u64>,
}

impl Histogram {
    fn new(queries: u32) -> Self {
        Self { counts: vec![0; queries as usize + 1] }
    }

    fn add(&mut self, count: u32) {
        self.counts[count as usize] += 1;
    }

    fn total(&self) -> u64 {
        self.counts.iter().sum()
    }

    fn sum(&self) -> u64 {
        (0..).zip(&self.counts).map(|(count, descriptors): (u64, &u64)| count * descriptors).sum()
    }

    /// The lowest and the highest count that occur.
    fn range(&self) -> Option<(u32, u32)> {
        let occurs = |descriptors: &u64| *descriptors > 0;
        Some((self.counts.iter().position(occurs)? as u32, self.counts.iter().rposition(occurs)? as u32))
    }

    /// The median: the mean of both middle counts if their number is even.
    fn median(&self) -> f64 {
        let total = self.total();
        (self.nth(total.saturating_sub(1) / 2) + self.nth(total / 2)) as f64 / 2.0
    }

    /// The count at a place among all counts in ascending order.
    fn nth(&self, place: u64) -> u64 {
        let mut before = 0;
        let reached = |descriptors: &u64| {
            before += descriptors;
            before > place
        };
        self.counts.iter().position(reached).unwrap_or(0) as u64
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::grid::tests::grid;
    use super::*;

    /// Every descriptor of a grid with a count that depends on both and on nothing else.
    fn all(grid: &Grid, counts: &[u32]) -> Vec<(Parameters, u32)> {
        let places = (0..grid.cells()).flat_map(|cell| grid.places(cell));
        places.map(|place| grid.descriptor(place)).zip(counts.iter().copied()).collect()
    }

    fn landscape<'a>(grid: &'a Grid, counts: &[u32], order: &[usize]) -> Landscape<'a> {
        let mut landscape = Landscape::new(grid, 9);
        for &cell in order {
            assert_eq!(landscape.digest(), None);
            let len = grid.cell_len();
            landscape.add(cell, &counts[cell * len..][..len]);
        }
        landscape
    }

    fn mean(counts: &[u32]) -> f64 {
        counts.iter().map(|&count| u64::from(count)).sum::<u64>() as f64 / counts.len() as f64
    }

    fn median(counts: &mut [u32]) -> f64 {
        counts.sort();
        let half = counts.len() / 2;
        let lower = if counts.len().is_multiple_of(2) { half - 1 } else { half };
        f64::from(counts[lower] + counts[half]) / 2.0
    }

    proptest! {
        #[test]
        fn tables_are_what_brute_force_over_all_descriptors_gives(
            sizes in prop::array::uniform5(1u32..5),
            colour in any::<bool>(),
            numbers in prop::collection::vec(0u32..=9, 5usize.pow(5)),
            backwards in any::<bool>(),
        ) {
            let grid = grid(sizes, colour);
            let counts = &numbers[..grid.descriptors() as usize];
            let mut order: Vec<usize> = (0..grid.cells()).collect();
            if backwards {
                order.reverse();
            }
            let landscape = landscape(&grid, counts, &order);
            let mut all = all(&grid, counts);

            all.sort_by_key(|&(parameters, count)| (Reverse(count), parameters));
            let best: Vec<BestRow> = (1..).zip(all.iter().take(BEST)).map(|(rank, (parameters, count))| {
                BestRow { rank, genes: Descriptor::DiskRing(*parameters).values(), object_correct: *count }
            }).collect();
            prop_assert_eq!(landscape.best(), best);
            prop_assert_eq!(landscape.leader(), Some((all[0].1, all[0].0)));
            let optimal = all.iter().filter(|(_, count)| *count == all[0].1).count();
            prop_assert_eq!(landscape.optimal_descriptors(), optimal as u64);

            let mut histogram = Vec::new();
            for object_correct in 0..=9 {
                let descriptors = all.iter().filter(|(_, count)| *count == object_correct).count() as u64;
                if descriptors > 0 {
                    histogram.push(CountRow { object_correct, descriptors });
                }
            }
            prop_assert_eq!(landscape.counts(), histogram);

            let genes: Vec<GeneKind> = grid.table().kinds().collect();
            prop_assert_eq!(genes.len(), if colour { 5 } else { 4 });
            let mut marginals = Vec::new();
            let mut landscapes = Vec::new();
            for (index, &gene_a) in genes.iter().enumerate() {
                let a = gene_a.spec();
                for &ticks in grid.axis(gene_a) {
                    let with = all.iter().filter(|(parameters, _)| parameters.ticks(gene_a) == ticks);
                    let mut counts: Vec<u32> = with.map(|(_, count)| *count).collect();
                    marginals.push(MarginalRow {
                        gene: a.name.to_owned(),
                        value: a.value(ticks),
                        descriptors: counts.len() as u64,
                        best: *counts.iter().max().unwrap(),
                        mean: mean(&counts),
                        median: median(&mut counts),
                        worst: *counts.iter().min().unwrap(),
                    });
                }
                for &gene_b in &genes[index + 1..] {
                    let b = gene_b.spec();
                    for &value_a in grid.axis(gene_a) {
                        for &value_b in grid.axis(gene_b) {
                            let with = all.iter().filter(|(parameters, _)| {
                                parameters.ticks(gene_a) == value_a && parameters.ticks(gene_b) == value_b
                            });
                            let counts: Vec<u32> = with.map(|(_, count)| *count).collect();
                            landscapes.push(LandscapeRow {
                                gene_a: a.name.to_owned(),
                                value_a: a.value(value_a),
                                gene_b: b.name.to_owned(),
                                value_b: b.value(value_b),
                                descriptors: counts.len() as u64,
                                best: *counts.iter().max().unwrap(),
                                mean: mean(&counts),
                            });
                        }
                    }
                }
            }
            prop_assert_eq!(landscape.marginals(), marginals);
            prop_assert_eq!(landscape.landscapes(), landscapes);
        }

        #[test]
        fn the_digest_covers_every_count_and_its_place_and_not_the_order_of_arrival(
            numbers in prop::collection::vec(0u32..9, 24),
            changed in 0usize..24,
        ) {
            let grid = grid([2, 1, 2, 3, 2], true);
            let digest = |counts: &[u32], order: &[usize]| landscape(&grid, counts, order).digest().unwrap();
            let base = digest(&numbers, &[0, 1, 2, 3, 4, 5]);
            prop_assert_eq!(base, digest(&numbers, &[3, 5, 0, 4, 1, 2]));
            let mut other = numbers.clone();
            other[changed] += 1;
            prop_assert_ne!(base, digest(&other, &[0, 1, 2, 3, 4, 5]));
        }
    }

    #[test]
    fn the_list_of_the_best_is_bounded() {
        let grid = grid([10, 1, 2, 2, 60], true);
        let counts: Vec<u32> = (0..grid.descriptors() as u32).map(|number| number % 10).collect();
        let landscape = landscape(&grid, &counts, &[2, 0, 1, 3]);
        let best = landscape.best();
        assert_eq!(best.len(), BEST);
        // 240 of each count: four whole counts and the first 40 in gene order of the fifth.
        assert_eq!(best.iter().filter(|row| row.object_correct == 5).count(), 40);
    }
}
