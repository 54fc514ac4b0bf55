//! The bins of pairs of points, as many pairs at once as a vector has lanes.
//!
//! For a point p with unit normal m and another, q with n, at the offset d = q − p, the Darboux frame is u = m,
//! v = d × u/|d × u|, w = u × v, and its angles are f₁ = atan2(w·n, u·n), f₂ = v·n and f₃ = u·d/|d| (PCL:
//! `computePairFeatures`, without its choice between the two points). With a = m·d, b = n·d, c = m·n and x = d × m:
//!
//! ```text
//! f₁ = atan2(b − c·a, c·|x|)    f₂ = x·n/|x|    f₃ = a/|d|
//! ```

use std::hint::black_box;

use pulp::Simd;

use crate::structure::block::BLOCK;
use crate::structure::counts::Counts;
use crate::structure::edges::Turns;
use crate::structure::group::Group;
use crate::structure::plan::{Measure, PairBins, StructurePlan};
use crate::structure::table::Table;
use crate::structure::vector::{Floats, dot, increment};

/// The values of some pairs, one in each lane.
pub(super) trait PairValues<S: Simd> {
    /// Those of the first points.
    fn first(&self, simd: S, value: usize) -> Floats<S>;

    /// Those of the second points.
    fn second(&self, simd: S, value: usize) -> Floats<S>;

    /// The second minus the first; of x, NaN in lanes that have no pair.
    fn difference(&self, simd: S, value: usize) -> Floats<S>;
}

/// Pairs of one point with others of a block.
pub(super) struct WithBlock<'a> {
    /// The values of the one.
    pub(super) first: &'a [f32],
    pub(super) points: &'a Table,
    pub(super) block: usize,
    /// Those of x, NaN of points that make no pair.
    pub(super) x: &'a [f32; BLOCK],
    /// Which of the vectors that a block takes.
    pub(super) vector: usize,
}

impl<S: Simd> PairValues<S> for WithBlock<'_> {
    #[inline(always)]
    fn first(&self, simd: S, value: usize) -> Floats<S> {
        Floats::all(simd, self.first[value])
    }

    #[inline(always)]
    fn second(&self, simd: S, value: usize) -> Floats<S> {
        let lanes = if value == 0 { self.x } else { self.points.block(value, self.block) };
        Floats::of(simd, lanes, self.vector)
    }

    #[inline(always)]
    fn difference(&self, simd: S, value: usize) -> Floats<S> {
        self.second(simd, value) - self.first(simd, value)
    }
}

/// Some of the pairs of the points in equal lanes of two groups.
pub(super) struct OfGroups<'a> {
    pub(super) first: &'a Group,
    pub(super) second: &'a Group,
    /// The second minus the first.
    pub(super) apart: &'a Group,
    /// Which of the vectors that a group takes.
    pub(super) vector: usize,
}

impl<S: Simd> PairValues<S> for OfGroups<'_> {
    #[inline(always)]
    fn first(&self, simd: S, value: usize) -> Floats<S> {
        Floats::of(simd, &self.first.values[value], self.vector)
    }

    #[inline(always)]
    fn second(&self, simd: S, value: usize) -> Floats<S> {
        Floats::of(simd, &self.second.values[value], self.vector)
    }

    #[inline(always)]
    fn difference(&self, simd: S, value: usize) -> Floats<S> {
        Floats::of(simd, &self.apart.values[value], self.vector)
    }
}

/// Counts some pairs.
#[inline(always)]
pub(super) fn count<S: Simd>(
    simd: S,
    plan: &StructurePlan,
    values: &impl PairValues<S>,
    counts: &mut Counts,
) {
    let pairs = Pairs::new(simd, plan, values);
    let (shells, are_counted) = pairs.shells(plan);
    for histogram in &plan.histograms {
        let mut codes = simd.add_u32s(shells, simd.splat_u32s(histogram.first));
        if let Some(column) = histogram.code {
            codes = simd.add_u32s(codes, values.second(simd, plan.order.place(column)).bits());
        }
        for axis in &histogram.axes {
            let bins = match &axis.bins {
                PairBins::Distance { per_metre, last } => pairs.distances(*per_metre, *last),
                PairBins::Turn(turns) => pairs.turns(turns),
                PairBins::Edges(measure, edges) => pairs.values(plan, *measure, values).edges_reached(edges),
            };
            codes = simd.add_u32s(codes, simd.mul_u32s(bins, simd.splat_u32s(axis.stride)));
        }
        counts.add(simd, codes, are_counted);
    }
}

/// What features are made of; zeros where no feature of the plan is.
struct Pairs<S: Simd> {
    simd: S,
    /// |d|²
    d2: Floats<S>,
    /// c
    cosine: Floats<S>,
    /// a and b
    along: [Floats<S>; 2],
    /// |x|²
    across2: Floats<S>,
    /// x·n
    across: Floats<S>,
}

impl<S: Simd> Pairs<S> {
    #[inline(always)]
    fn new(simd: S, plan: &StructurePlan, values: &impl PairValues<S>) -> Self {
        let zeros = Floats::all(simd, 0.0);
        let d = [values.difference(simd, 0), values.difference(simd, 1), values.difference(simd, 2)];
        let mut pairs =
            Self { simd, d2: dot(d, d), cosine: zeros, along: [zeros; 2], across2: zeros, across: zeros };
        if plan.has_angles {
            let [x, y, z] = [0, 1, 2].map(|axis| plan.order.normal() + axis);
            let m = [values.first(simd, x), values.first(simd, y), values.first(simd, z)];
            let n = [values.second(simd, x), values.second(simd, y), values.second(simd, z)];
            pairs.cosine = dot(m, n);
            if plan.has_frame {
                let [x, y, z] = d;
                pairs.along = [dot(m, d), dot(n, d)];
                let cross = [y * m[2] - z * m[1], z * m[0] - x * m[2], x * m[1] - y * m[0]];
                pairs.across2 = dot(cross, cross);
                pairs.across = dot(cross, n);
            }
        }
        pairs
    }

    /// First bins of the pairs' shells, and which pairs count: none that are too far, too close, or without a frame where
    /// one is needed.
    #[inline(always)]
    fn shells(&self, plan: &StructurePlan) -> (S::u32s, S::m32s) {
        let Self { simd, d2, .. } = *self;
        let (none, bins) = (simd.splat_u32s(0), simd.splat_u32s(plan.shell_bins));
        let mut shells = none;
        for &bound in &plan.shells2 {
            shells = simd.add_u32s(shells, simd.select_u32s(d2.is_above(bound), bins, none));
        }
        let mut are_counted = simd.and_m32s(d2.is_at_least(plan.least2), d2.is_at_most(plan.most2));
        if plan.has_frame {
            are_counted = simd.and_m32s(are_counted, self.across2.is_above(0.0));
        }
        (shells, are_counted)
    }

    /// Bins of the distance.
    #[inline(always)]
    fn distances(&self, per_metre: f32, last: f32) -> S::u32s {
        let Self { simd, d2, .. } = *self;
        let at = root(d2) * Floats::all(simd, per_metre);
        let last = Floats::all(simd, last);
        let lanes = simd.select_f32s(simd.less_than_f32s(at.lanes, last.lanes), at.lanes, last.lanes);
        floor(simd, Floats::new(simd, lanes))
    }

    /// Bins of f₁.
    #[inline(always)]
    fn turns(&self, turns: &Turns) -> S::u32s {
        let Self { simd, cosine, along, .. } = *self;
        let y = along[1] - cosine * along[0];
        let x = cosine * root(self.across2);
        let is_below = y.is_below(0.0);
        // Below 0 degrees bins are mirrored, but edges still belong to the bins above them.
        let least = Floats::all(simd, 0.0).with(is_below, f32::from_bits(1));
        // No direction is one of 0 degrees.
        let x = x.with(simd.and_m32s(x.equals(0.0), y.equals(0.0)), 1.0);
        let (size, mut reached) = (y.abs(), simd.splat_u32s(0));
        for &[cosine, sine] in &turns.edges {
            let beyond = Floats::all(simd, cosine) * size - Floats::all(simd, sine) * x;
            reached = increment(simd, reached, simd.greater_than_or_equal_f32s(beyond.lanes, least.lanes));
        }
        let above = simd.add_u32s(simd.splat_u32s(turns.of_zero), reached);
        let below = simd.sub_u32s(simd.splat_u32s(turns.below_zero), reached);
        simd.select_u32s(is_below, below, above)
    }

    /// Values that edges are compared with.
    #[inline(always)]
    fn values(&self, plan: &StructurePlan, measure: Measure, values: &impl PairValues<S>) -> Floats<S> {
        let simd = self.simd;
        match measure {
            Measure::Angle => -self.cosine,
            Measure::F2 => self.across / root(self.across2),
            Measure::A2 => -(self.across / root(self.across2)),
            Measure::F3 => self.along[0] / root(self.d2),
            Measure::A3 => -(self.along[0] / root(self.d2)),
            Measure::Difference(column) => values.difference(simd, plan.order.place(column)),
            Measure::Ratio(column) => {
                let column = plan.order.place(column);
                ratio(simd, values.first(simd, column), values.second(simd, column))
            }
        }
    }
}

/// The square root, which compilers would otherwise take before they know whether it is wanted.
#[inline(always)]
fn root<S: Simd>(square: Floats<S>) -> Floats<S> {
    black_box(square).sqrt()
}

/// ⌊x⌋ of a number from 0 to below 2²², as a cast has it, which pulp does not have.
#[inline(always)]
fn floor<S: Simd>(simd: S, x: Floats<S>) -> S::u32s {
    // From here to twice as far, floats are whole numbers, and the last bits of theirs are their offset.
    const WHOLE: f32 = (1u32 << 23) as f32;
    let whole = Floats::all(simd, WHOLE);
    let nearest = x + whole;
    let offset = simd.sub_u32s(nearest.bits(), simd.splat_u32s(WHOLE.to_bits()));
    let is_above = simd.greater_than_f32s((nearest - whole).lanes, x.lanes);
    simd.sub_u32s(offset, increment(simd, simd.splat_u32s(0), is_above))
}

/// [`crate::fixed::ratio::ratio`] without branches. Divided only where it is wanted, as [`root`] is.
#[inline(always)]
fn ratio<S: Simd>(simd: S, one: Floats<S>, other: Floats<S>) -> Floats<S> {
    let quotient = (black_box(one) / other).with(other.equals(0.0), 1.0);
    let inverse = Floats::all(simd, -1.0) / quotient;
    Floats::new(simd, simd.select_f32s(quotient.is_above(1.0), inverse.lanes, quotient.lanes))
}

#[cfg(test)]
mod tests {
    use pulp::Scalar;

    use super::*;

    fn scalar(value: f32) -> Floats<Scalar> {
        Floats::all(Scalar::new(), value)
    }

    #[test]
    fn floors_are_those_of_casts() {
        let near = |whole: u32| [(whole as f32).next_down().max(0.0), whole as f32, (whole as f32).next_up()];
        let halves = (0..8_000u32).map(|half| half as f32 / 2.0);
        let large = [1 << 21, (1 << 22) - 1].into_iter().flat_map(near);
        for x in (0..4_000).flat_map(near).chain(halves).chain(large) {
            assert_eq!(floor(Scalar::new(), scalar(x)), x as u32, "{x}");
        }
    }

    #[test]
    fn ratios_are_pcls() {
        for (one, other) in (0..=255u8).flat_map(|one| (0..=255u8).map(move |other| (one, other))) {
            let expected = crate::fixed::ratio::ratio(one, other);
            let [first, second] = [one, other].map(|value| scalar(f32::from(value)));
            assert_eq!(ratio(Scalar::new(), first, second).lanes, expected, "{one} : {other}");
        }
    }
}
