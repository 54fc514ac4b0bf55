//! Exact matching with fewer terms: clouds that a lower bound shows to be too far away are never compared in full.
//!
//! - `groups`: which values are merged
//! - `bounds`: lower bounds from merged values, and how far rounding can carry them
//! - `scan`: what the bounds of all clouds give
//! - `gathered`: terms of clouds wherever they lie in the database
//! - `ranking`: the nearest objects so far

mod bounds;
mod gathered;
mod groups;
mod ranking;
mod scan;
#[cfg(test)]
mod tests;

use std::borrow::Cow;

use rayon::prelude::*;

use crate::distance::SetDistance;
use crate::pruning::bounds::{Bounds, Query};
use crate::pruning::gathered::{CHUNK, ROWS, add_gathered, factor};
use crate::pruning::ranking::Nearest;
use crate::recognise::{Hit, Label, Match, RecogniseError};
use crate::signature::Signatures;
use crate::transposed::LANES;

/// Reference clouds under one descriptor, with lower bounds of the distances to them.
///
/// What is found is what [`crate::recognise()`] finds, bit for bit: the same clouds at the same distances, of equal
/// distances the lowest index. A query is compared with all clouds by a few merged values, with those that this leaves by some
/// more, and with the rest value by value, nearest bound first, until what the terms add up to shows that a cloud is too far
/// away: sums of f32 in which no term is below 0 never fall. Values that are negative, not finite or above 10⁹, and weights that
/// are negative or not finite, have no bounds; such queries and databases are compared in full.
///
/// It takes no more memory than the signatures and 160 bytes a cloud, and nothing that grows with the number of queries.
pub struct PrunedDatabase<'a> {
    channels: Vec<(Cow<'a, Signatures>, SetDistance, f64)>,
    /// Of each cloud, filled up to whole blocks of lanes.
    objects: Vec<u32>,
    clouds: usize,
    /// `None` where all clouds are compared in full.
    bounds: Option<Bounds>,
}

/// The nearest objects to a query, and what it took to find them.
#[derive(Clone, Debug, PartialEq)]
pub struct Ranked {
    /// The nearest cloud of each of the nearest objects, nearest first.
    pub hits: Vec<Hit>,
    /// Terms that were computed: one for each value of the query, or merged value, and a value of a cloud that it is
    /// compared with. Those that are computed for nothing, to fill vectors, count, too.
    pub terms: u64,
}

/// What one query after the other needs.
#[derive(Debug, Default)]
pub struct Scratch {
    /// Bounds of all clouds.
    row: Vec<[f32; LANES]>,
    other: Vec<[f32; LANES]>,
    left: Vec<u32>,
    /// By their fine bounds.
    candidates: Vec<(f32, u32)>,
}

impl<'a> PrunedDatabase<'a> {
    /// Of clouds that show `labels`, with their signatures in each channel, how these are compared, and the channel's
    /// weight: of a structure its weight over its scale. On the calling thread.
    ///
    /// # Errors
    /// [`RecogniseError::EmptyDatabase`] if there is no cloud.
    ///
    /// # Panics
    /// If there is not one label and one signature a channel for each cloud: a programming error.
    pub fn new(
        channels: Vec<(Cow<'a, Signatures>, SetDistance, f64)>,
        labels: &[Label],
    ) -> Result<Self, RecogniseError> {
        let clouds = labels.len();
        for (signatures, ..) in &channels {
            assert_eq!(signatures.clouds(), clouds, "one label for each cloud");
        }
        let last = labels.last().ok_or(RecogniseError::EmptyDatabase)?;
        let mut objects: Vec<u32> = labels.iter().map(|label| label.instance).collect();
        objects.resize(clouds.next_multiple_of(LANES), last.instance);
        let given: Vec<_> =
            channels.iter().map(|(signatures, metric, weight)| (&**signatures, *metric, *weight)).collect();
        let bounds = Bounds::new(&given);
        Ok(Self { channels, objects, clouds, bounds })
    }

    /// Terms that it took to choose which values to merge.
    pub fn terms(&self) -> u64 {
        self.bounds.as_ref().map_or(0, Bounds::terms)
    }

    /// Terms that it would take to compare a query with all clouds.
    pub fn terms_in_full(&self) -> u64 {
        self.channels.iter().map(|(signatures, ..)| (signatures.width * self.clouds) as u64).sum()
    }

    /// What each query is recognised as, by the current rayon pool, and the number of terms. Queries are channel by channel.
    /// Without `runner_up` only the nearest clouds are looked for.
    ///
    /// # Panics
    /// If the queries are of another descriptor: a programming error.
    pub fn recognise(&self, queries: &[&Signatures], runner_up: bool) -> (Vec<Match>, u64) {
        assert_eq!(queries.len(), self.channels.len(), "queries of another descriptor");
        let count = queries.first().map_or(0, |channel| channel.clouds());
        let matched = |scratch: &mut Scratch, query: usize| {
            let query: Vec<[&[f32]; 2]> = queries.iter().map(|channel| channel.get(query)).collect();
            let Ranked { hits, terms } = self.ranking(&query, if runner_up { 2 } else { 1 }, scratch);
            (Match { nearest: hits[0], runner_up: hits.get(1).copied() }, terms)
        };
        let matched: Vec<(Match, u64)> =
            (0..count).into_par_iter().map_init(Scratch::default, matched).collect();
        let terms = matched.iter().map(|(_, terms)| terms).sum();
        (matched.into_iter().map(|(found, _)| found).collect(), terms)
    }

    /// The nearest cloud of each of the `most` nearest objects, nearest first; of equal distances the lowest index
    /// counts. The query is its centroid and deviation in each channel.
    ///
    /// # Panics
    /// If the query is of another descriptor: a programming error.
    pub fn ranking(&self, query: &[[&[f32]; 2]], most: usize, scratch: &mut Scratch) -> Ranked {
        assert_eq!(query.len(), self.channels.len(), "query of another descriptor");
        for ([centroid, deviation], (signatures, ..)) in query.iter().zip(&self.channels) {
            let lengths = [signatures.bins, signatures.width - signatures.bins];
            assert_eq!([centroid.len(), deviation.len()], lengths, "query of another descriptor");
        }
        let mut found = Nearest::new(most);
        let mut terms = 0;
        if most > 0 {
            let bounds = self.bounds.as_ref().and_then(|bounds| Some((bounds, bounds.query(query)?)));
            match bounds {
                Some((bounds, merged)) => {
                    self.prune(query, (bounds, &merged), &mut found, scratch, &mut terms);
                }
                None => {
                    let all: Vec<u32> = (0..self.clouds as u32).collect();
                    all.chunks(ROWS)
                        .for_each(|clouds| self.compare(query, clouds, false, &mut found, &mut terms));
                }
            }
        }
        Ranked { hits: found.into_hits(), terms }
    }

    fn prune(
        &self,
        query: &[[&[f32]; 2]],
        (bounds, merged): (&Bounds, &Query),
        found: &mut Nearest,
        Scratch { row, other, left, candidates }: &mut Scratch,
        terms: &mut u64,
    ) {
        row.resize(self.objects.len() / LANES, [0.0; LANES]);
        *terms += bounds.coarse(merged, row, other);
        row.as_flattened_mut()[self.clouds..].fill(f32::INFINITY);

        // As many objects as are asked for, those with the least bounds, so that there is something to prune by.
        let objects = self.objects.as_chunks::<LANES>().0;
        while !found.is_full() {
            let known: Vec<u32> = found.objects().map(|(object, _)| object).collect();
            let clouds = scan::least(row, objects, &known);
            if clouds.is_empty() {
                break;
            }
            clouds.chunks(ROWS).for_each(|clouds| self.compare(query, clouds, true, found, terms));
            clouds.iter().for_each(|&cloud| row.as_flattened_mut()[cloud as usize] = f32::INFINITY);
        }

        left.clear();
        let limits: Vec<(u32, f32)> =
            found.objects().map(|(object, distance)| (object, bounds.limit(merged, distance))).collect();
        scan::within(row, objects, bounds.limit(merged, found.limit()), &limits, left);

        candidates.clear();
        let limit =
            |found: &Nearest, cloud: u32| bounds.limit(merged, found.limit_of(self.objects[cloud as usize]));
        for clouds in left.chunks(ROWS) {
            let (of_clouds, computed) = bounds.fine(merged, &in_rows(clouds));
            *terms += computed;
            let candidate = |(&cloud, bound)| (bound <= limit(found, cloud)).then_some((bound, cloud));
            candidates.extend(clouds.iter().zip(of_clouds).filter_map(candidate));
        }
        candidates.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut rest = candidates.iter();
        loop {
            left.clear();
            let near = rest.by_ref().filter(|&&(bound, cloud)| bound <= limit(found, cloud));
            left.extend(near.take(ROWS).map(|&(_, cloud)| cloud));
            if left.is_empty() {
                break;
            }
            self.compare(query, left, true, found, terms);
        }
    }

    /// Compares a query with up to [`ROWS`] clouds in full or, if no term is below 0, until all are known to be too far
    /// away.
    fn compare(
        &self,
        query: &[[&[f32]; 2]],
        clouds: &[u32],
        is_bounded: bool,
        found: &mut Nearest,
        terms: &mut u64,
    ) {
        let rows = in_rows(clouds);
        let limits = rows.map(|cloud| found.limit_of(self.objects[cloud as usize]));
        let mut distances = [0.0f64; ROWS];
        for (index, ((signatures, metric, weight), query)) in self.channels.iter().zip(query).enumerate() {
            if is_bounded && *weight == 0.0 {
                continue; // adds nothing to finite distances
            }
            let signatures = rows.map(|cloud| signatures.get(cloud as usize));
            let mut sums = [[0.0f32; ROWS]; 2];
            let so_far = distances;
            let with_channel = |[centroids, deviations]: [[f32; ROWS]; 2], row: usize| {
                let distance = factor(*metric) * centroids[row] + factor(*metric) * deviations[row];
                let weighted = weight * f64::from(distance);
                if index == 0 { weighted } else { so_far[row] + weighted }
            };
            for part in 0..2 {
                for (chunk, values) in query[part].chunks(CHUNK).enumerate() {
                    let of_rows = signatures.map(|row| &row[part][chunk * CHUNK..][..values.len()]);
                    add_gathered(*metric, values, &of_rows, &mut sums[part]);
                    *terms += (ROWS * values.len()) as u64;
                    if is_bounded && (0..ROWS).all(|row| with_channel(sums, row) > limits[row]) {
                        return;
                    }
                }
            }
            distances = std::array::from_fn(|row| with_channel(sums, row));
        }
        for (&cloud, distance) in clouds.iter().zip(distances) {
            found.offer(self.objects[cloud as usize], Hit { index: cloud, distance });
        }
    }
}

/// Up to [`ROWS`] clouds, at least one, the last of them in all rows that are left.
fn in_rows(clouds: &[u32]) -> [u32; ROWS] {
    std::array::from_fn(|row| clouds[row.min(clouds.len() - 1)])
}
