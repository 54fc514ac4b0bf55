//! Lower bounds of set distances, from merged values.
//!
//! A term t(a, b) of each set distance is convex and homogeneous of degree 1, so that t(a + a', b + b') ≤ t(a, b) + t(a', b')
//! and w·t(a, b) = t(w·a, w·b): the distance of merged values, each times the weight of its channel, is at most the set
//! distance.
//!
//! # Rounding
//!
//! With u = 2⁻²⁴, n the most values of a channel, g the number of groups, and M what the values of both clouds add up to, each
//! times its weight; T is the set distance in exact arithmetic, D as it is computed, B the bound as it is computed.
//!
//! - A χ² term is made by at most 10 roundings of factors and sums of numbers ≥ 0, of which each changes the result by at
//!   most a share of u (the difference of two floats is rounded once, and squared); the sum of n of them by at most n more;
//!   the two L1 and Hellinger terms by fewer. The roots of a Hellinger term are rounded before they are subtracted: that
//!   changes the term by at most u|a − b| + O(u²)(a + b). Sums in f64 are nothing beside this. So D ≥ T·(1 − (n + 16)u) − 2uM.
//! - Merged values are added up in f64 and rounded once to f32. A change of a or b by a share of u changes a term by at most
//!   u(a + b) in each of the three metrics (by u|a − b|, and less than that beside it). With the roundings of the terms,
//!   B ≤ T·(1 + (g + 16)u) + 4uM.
//! - Sums below `LEAST` count as `LEAST` in χ², and x²·t or y²·s may lie below the normal numbers, where they are rounded to
//!   multiples of 2⁻¹⁴⁹. A term of two bins, x²/s + y²/t with |x| ≤ s and |y| ≤ t, is then off by at most 2⁻¹⁴⁹/(s·t) and by no
//!   more than s + t: less than 10⁻¹³.
//!
//! So a cloud is farther away than D if B > (D + 8uM + e)·(1 + 2(n + g + 32)u), where e is 10⁻¹³ a value of any channel times its
//! weight, and a group; the factor 2 covers products of shares for shares up to [`LARGEST_SHARE`].

use std::ops::Range;

use crate::distance::SetDistance;
use crate::pruning::gathered::{CHUNK, ROWS, add_gathered, factor};
use crate::pruning::groups::{Channel, Groups};
use crate::signature::Signatures;
use crate::transposed::{LANES, Transposed};

/// Unit of rounding of f32.
const UNIT: f64 = 1.0 / 16_777_216.0;
/// What underflow can change about a term.
const UNDERFLOW: f64 = 1e-13;
/// No bounds for signatures so long that rounding makes a larger share.
const LARGEST_SHARE: f64 = 0.1;
/// Values of signatures that are taken: products of three of them are finite.
const LARGEST_VALUE: f32 = 1e9;
/// The values of a query may add up to so many times what those of any cloud of the database do.
const LARGEST_QUERY: f64 = 1e6;

/// The database with merged values: of few groups for a first look at all clouds, of more for those that are left.
pub(super) struct Bounds {
    groups: Groups,
    /// Of each channel what its values are multiplied by: its weight in such a unit that M of no cloud is more than 1.
    factors: Vec<f64>,
    /// The unit: of each distance this is the bound's.
    unit: f64,
    /// The share and, but for the query's part, the sum by which rounding may change a bound.
    share: f64,
    underflow: f64,
    fine: Vec<Fine>,
    coarse: Vec<(SetDistance, Range<usize>, Transposed)>,
}

/// The groups of one metric.
struct Fine {
    metric: SetDistance,
    range: Range<usize>,
    merged: Signatures,
}

/// A query's merged values, and what rounding may change about its bounds.
pub(super) struct Query {
    fine: Vec<f32>,
    coarse: Vec<f32>,
    slack: f64,
}

impl Bounds {
    /// Of a database; `None` where what bounds rest on does not hold: values from 0 to [`LARGEST_VALUE`], weights ≥ 0, some
    /// of them above 0.
    pub(super) fn new(channels: &[Channel<'_>]) -> Option<Self> {
        let clouds = channels.first()?.0.clouds();
        let (mut longest, mut mass) = (0, vec![0.0; clouds]);
        for (signatures, _, weight) in channels {
            if !weight.is_finite() || weight.is_sign_negative() || !are_taken(&signatures.values) {
                return None;
            }
            longest = longest.max(signatures.width);
            for (cloud, mass) in mass.iter_mut().enumerate() {
                let values = &signatures.values[cloud * signatures.width..][..signatures.width];
                *mass += weight * values.iter().copied().map(f64::from).sum::<f64>();
            }
        }
        let unit = 1.0 / mass.into_iter().fold(0.0, f64::max);
        let factors: Vec<f64> = channels.iter().map(|(.., weight)| weight * unit).collect();
        if !unit.is_finite() || unit <= 0.0 || !factors.iter().all(|factor| factor.is_finite()) {
            return None;
        }
        let weighted: Vec<Channel<'_>> = channels
            .iter()
            .zip(&factors)
            .map(|(&(signatures, metric, _), &factor)| (signatures, metric, factor))
            .collect();
        let groups = Groups::new(&weighted);
        let merged = groups.metrics[0].len() + groups.metrics[1].len();
        let share = 2.0 * (longest + merged + 32) as f64 * UNIT;
        let values = weighted.iter().map(|(signatures, _, factor)| factor * signatures.width as f64);
        let underflow = UNDERFLOW * (values.sum::<f64>() + merged as f64);
        let mut bounds =
            Self { groups, factors, unit, share, underflow, fine: Vec::new(), coarse: Vec::new() };
        bounds.merge_all(channels, clouds);
        (share <= LARGEST_SHARE).then_some(bounds)
    }

    /// Merges the values of all clouds.
    fn merge_all(&mut self, channels: &[Channel<'_>], clouds: usize) {
        let mut rows = [Vec::new(), Vec::new()];
        for cloud in 0..clouds {
            let (merged, _) = self.merged(channels.iter().map(|(signatures, ..)| signatures.get(cloud)));
            rows.iter_mut().zip(merged).for_each(|(rows, merged)| rows.extend(merged));
        }
        let [fine, coarse] = rows;
        let signatures = |rows: &[f32], all: usize, range: &Range<usize>| {
            let values = rows.chunks_exact(all).flat_map(|row| &row[range.clone()]).copied().collect();
            Signatures { bins: range.len(), width: range.len(), clouds, values, keypoints: Vec::new() }
        };
        let [of_fine, of_coarse] = &self.groups.metrics;
        self.fine = ranges(of_fine)
            .map(|(metric, range)| Fine { metric, merged: signatures(&fine, of_fine.len(), &range), range })
            .collect();
        self.coarse = ranges(of_coarse)
            .map(|(metric, range)| {
                let merged = signatures(&coarse, of_coarse.len(), &range);
                (metric, range, Transposed::new(&merged))
            })
            .collect();
    }

    /// The merged values of a cloud on both levels, and what they add up to.
    fn merged<'a>(&self, channels: impl Iterator<Item = [&'a [f32]; 2]>) -> ([Vec<f32>; 2], f64) {
        // Four sums in turn: neighbours often share a group, and would wait for each other.
        let mut sums = vec![[0.0f64; 4]; self.groups.metrics[0].len()];
        let mut coarse = vec![0.0f64; self.groups.metrics[1].len()];
        for ((values, groups), factor) in channels.zip(&self.groups.of_values).zip(&self.factors) {
            for (index, (&value, &group)) in values.into_iter().flatten().zip(groups).enumerate() {
                sums[group as usize][index % 4] += factor * f64::from(value);
            }
        }
        let fine: Vec<f64> = sums.iter().map(|sums| sums.iter().sum()).collect();
        for (value, &group) in fine.iter().zip(&self.groups.of_groups) {
            coarse[group as usize] += value;
        }
        let mass = coarse.iter().sum();
        ([fine, coarse].map(|values| values.into_iter().map(|value| value as f32).collect()), mass)
    }

    /// A query with its merged values; `None` where what bounds rest on does not hold.
    pub(super) fn query(&self, query: &[[&[f32]; 2]]) -> Option<Query> {
        if !query.iter().flatten().all(|values| are_taken(values)) {
            return None;
        }
        let ([fine, coarse], mass) = self.merged(query.iter().copied());
        let slack = 8.0 * UNIT * (mass + 1.0) + self.underflow;
        (mass <= LARGEST_QUERY).then_some(Query { fine, coarse, slack })
    }

    /// Clouds whose bound is larger are farther away than this distance.
    pub(super) fn limit(&self, query: &Query, distance: f64) -> f32 {
        (((distance * self.unit + query.slack) * (1.0 + self.share)) as f32).next_up()
    }

    /// The query's coarse bounds of all clouds; `row` has room for whole blocks, `other` likewise. Returns the number of terms.
    pub(super) fn coarse(
        &self,
        query: &Query,
        row: &mut [[f32; LANES]],
        other: &mut Vec<[f32; LANES]>,
    ) -> u64 {
        let mut terms = 0;
        for (index, (metric, range, merged)) in self.coarse.iter().enumerate() {
            let values = [&query.coarse[range.clone()], &[]];
            terms += row.as_flattened().len() * range.len();
            if index == 0 {
                merged.by(*metric, values, row);
                continue;
            }
            other.resize(row.len(), [0.0; LANES]);
            merged.by(*metric, values, other);
            for (sum, more) in row.as_flattened_mut().iter_mut().zip(other.as_flattened()) {
                *sum += more;
            }
        }
        terms as u64
    }

    /// The query's fine bounds of some clouds. Returns the number of terms, too.
    pub(super) fn fine(&self, query: &Query, clouds: &[u32; ROWS]) -> ([f32; ROWS], u64) {
        let (mut bounds, mut terms) = ([0.0; ROWS], 0);
        for Fine { metric, range, merged } in &self.fine {
            let rows = clouds.map(|cloud| merged.get(cloud as usize)[0]);
            let mut sums = [0.0; ROWS];
            for (chunk, values) in query.fine[range.clone()].chunks(CHUNK).enumerate() {
                let rows = rows.map(|row| &row[chunk * CHUNK..][..values.len()]);
                add_gathered(*metric, values, &rows, &mut sums);
            }
            for (bound, sum) in bounds.iter_mut().zip(sums) {
                *bound += factor(*metric) * sum;
            }
            terms += ROWS * range.len();
        }
        (bounds, terms as u64)
    }

    /// Terms that finding groups took.
    pub(super) fn terms(&self) -> u64 {
        self.groups.terms
    }
}

/// Whether all values are such that terms are finite and ≥ 0.
fn are_taken(values: &[f32]) -> bool {
    // In whole, so that it is done in vectors.
    values.iter().fold(true, |all, value| all & (0.0..=LARGEST_VALUE).contains(value))
}

/// The metrics of groups that lie in their order, and where each has its groups.
fn ranges(metrics: &[SetDistance]) -> impl Iterator<Item = (SetDistance, Range<usize>)> {
    let mut first = 0;
    metrics.chunk_by(|a, b| a == b).map(move |same| {
        let range = first..first + same.len();
        first = range.end;
        (same[0], range)
    })
}
