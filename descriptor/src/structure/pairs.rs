//! The bins of pairs of points, a group of pairs at once.
//!
//! For a point p with unit normal m and another, q with n, at the offset d = q − p, the Darboux frame is u = m,
//! v = d × u/|d × u|, w = u × v, and its angles are f₁ = atan2(w·n, u·n), f₂ = v·n and f₃ = u·d/|d| (PCL:
//! `computePairFeatures`, without its choice between the two points). With a = m·d, b = n·d, c = m·n and x = d × m:
//!
//! ```text
//! f₁ = atan2(b − c·a, c·|x|)    f₂ = x·n/|x|    f₃ = a/|d|
//! ```

use std::hint::black_box;

use crate::structure::block::LANES;
use crate::structure::counts::Counts;
use crate::structure::edges::{Turns, reached};
use crate::structure::group::Group;
use crate::structure::plan::{Measure, PairBins, StructurePlan};

/// A number of each pair.
type Lanes = [f32; LANES];

/// Counts the pairs of the points in equal lanes of two groups, whose differences are `apart`.
#[inline(always)]
pub(super) fn count(plan: &StructurePlan, [first, second]: [&Group; 2], apart: &Group, counts: &mut Counts) {
    let pairs = Pairs::new(plan, [first, second], apart);
    let shells = pairs.shells(plan);
    for histogram in &plan.histograms {
        let mut codes = [histogram.first; LANES];
        if let Some(column) = histogram.code {
            for (code, of_point) in codes.iter_mut().zip(&second.values[plan.order.place(column)]) {
                *code += of_point.to_bits();
            }
        }
        for axis in &histogram.axes {
            // Compilers would compute roots and quotients of all features before this loop, although one is wanted.
            let pairs = black_box(&pairs);
            let bins = match &axis.bins {
                PairBins::Distance { per_metre, last } => pairs.distances(*per_metre, *last),
                PairBins::Turn(turns) => pairs.turns(turns),
                PairBins::Edges(measure, edges) => {
                    reached(&pairs.values(plan, *measure, [first, second], apart), edges)
                }
            };
            for (code, bin) in codes.iter_mut().zip(bins) {
                *code += axis.stride * bin;
            }
        }
        for (lane, code) in codes.iter_mut().enumerate() {
            *code = if shells[lane] == NO_SHELL { counts.none(lane) } else { shells[lane] + *code };
        }
        counts.add(&codes);
    }
}

/// In place of the first bin of a pair's shell: the pair does not count.
const NO_SHELL: u32 = u32::MAX;

/// What features are made of; zeros where no feature of the plan is. Aligned as groups are.
#[repr(align(64))]
struct Pairs {
    /// |d|²
    d2: Lanes,
    /// c
    cosine: Lanes,
    /// a and b
    along: [Lanes; 2],
    /// |x|²
    across2: Lanes,
    /// x·n
    across: Lanes,
}

impl Pairs {
    #[inline(always)]
    fn new(plan: &StructurePlan, [first, second]: [&Group; 2], apart: &Group) -> Self {
        const ZEROS: Lanes = [0.0; LANES];
        let mut pairs = Self { d2: ZEROS, cosine: ZEROS, along: [ZEROS; 2], across2: ZEROS, across: ZEROS };
        let [x, y, z, ..] = &apart.values;
        let d = [x, y, z];
        for (lane, d2) in pairs.d2.iter_mut().enumerate() {
            let [x, y, z] = at(d, lane);
            *d2 = x * x + y * y + z * z;
        }
        if plan.has_angles {
            for lane in 0..LANES {
                let (m, n) = (first.normal(plan, lane), second.normal(plan, lane));
                pairs.cosine[lane] = m[0] * n[0] + m[1] * n[1] + m[2] * n[2];
            }
        }
        if plan.has_frame {
            for lane in 0..LANES {
                let (m, n) = (first.normal(plan, lane), second.normal(plan, lane));
                let [x, y, z] = at(d, lane);
                pairs.along[0][lane] = m[0] * x + m[1] * y + m[2] * z;
                pairs.along[1][lane] = n[0] * x + n[1] * y + n[2] * z;
                let cross = [y * m[2] - z * m[1], z * m[0] - x * m[2], x * m[1] - y * m[0]];
                pairs.across2[lane] = cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2];
                pairs.across[lane] = cross[0] * n[0] + cross[1] * n[1] + cross[2] * n[2];
            }
        }
        pairs
    }

    /// First bins of the pairs' shells; none of pairs that are too far, too close, or without a frame where one is needed.
    #[inline(always)]
    fn shells(&self, plan: &StructurePlan) -> [u32; LANES] {
        let mut shells = [0; LANES];
        for &bound in &plan.shells2 {
            for (shell, &d2) in shells.iter_mut().zip(&self.d2) {
                *shell += if d2 > bound { plan.shell_bins } else { 0 };
            }
        }
        for (shell, &d2) in shells.iter_mut().zip(&self.d2) {
            *shell = if (d2 >= plan.least2) & (d2 <= plan.most2) { *shell } else { NO_SHELL };
        }
        if plan.has_frame {
            for (shell, &across2) in shells.iter_mut().zip(&self.across2) {
                *shell = if across2 > 0.0 { *shell } else { NO_SHELL };
            }
        }
        shells
    }

    /// Bins of the distance.
    #[inline(always)]
    fn distances(&self, per_metre: f32, last: f32) -> [u32; LANES] {
        let mut bins = [0; LANES];
        for (lane, bin) in bins.iter_mut().enumerate() {
            let at = self.d2[lane].sqrt() * per_metre;
            *bin = floor(if at < last { at } else { last });
        }
        bins
    }

    /// Bins of f₁.
    #[inline(always)]
    fn turns(&self, turns: &Turns) -> [u32; LANES] {
        let (mut x, mut y, mut least) = ([0.0f32; LANES], [0.0f32; LANES], [0.0f32; LANES]);
        for lane in 0..LANES {
            y[lane] = self.along[1][lane] - self.cosine[lane] * self.along[0][lane];
            x[lane] = self.cosine[lane] * self.across2[lane].sqrt();
            // Below 0 degrees bins are mirrored, but edges still belong to the bins above them.
            least[lane] = if y[lane] < 0.0 { f32::from_bits(1) } else { 0.0 };
            // No direction is one of 0 degrees.
            x[lane] = if (x[lane] == 0.0) & (y[lane] == 0.0) { 1.0 } else { x[lane] };
        }
        let mut reached = [0u32; LANES];
        for &[cosine, sine] in &turns.edges {
            for lane in 0..LANES {
                let beyond = cosine * y[lane].abs() - sine * x[lane];
                reached[lane] += u32::from(beyond >= least[lane]);
            }
        }
        for lane in 0..LANES {
            let [above, below] =
                [turns.of_zero + reached[lane], turns.below_zero.wrapping_sub(reached[lane])];
            reached[lane] = if y[lane] < 0.0 { below } else { above };
        }
        reached
    }

    /// Values that edges are compared with.
    #[inline(always)]
    fn values(&self, plan: &StructurePlan, measure: Measure, points: [&Group; 2], apart: &Group) -> Lanes {
        let mut values = [0.0; LANES];
        match measure {
            Measure::Angle => {
                for (lane, value) in values.iter_mut().enumerate() {
                    *value = -self.cosine[lane];
                }
            }
            Measure::F2 | Measure::A2 => {
                for (lane, value) in values.iter_mut().enumerate() {
                    *value = self.across[lane] / self.across2[lane].sqrt();
                }
            }
            Measure::F3 | Measure::A3 => {
                for (lane, value) in values.iter_mut().enumerate() {
                    *value = self.along[0][lane] / self.d2[lane].sqrt();
                }
            }
            Measure::Difference(column) => values = apart.values[plan.order.place(column)],
            Measure::Ratio(column) => {
                let [first, second] = points.map(|group| &group.values[plan.order.place(column)]);
                for (lane, value) in values.iter_mut().enumerate() {
                    *value = ratio(first[lane], second[lane]);
                }
            }
        }
        if matches!(measure, Measure::A2 | Measure::A3) {
            values.iter_mut().for_each(|value| *value = -*value);
        }
        values
    }
}

/// A lane of three. Not by `array::map`, which can stay a function of its own, and then the loop has no vectors.
#[inline(always)]
fn at(vectors: [&Lanes; 3], lane: usize) -> [f32; 3] {
    [vectors[0][lane], vectors[1][lane], vectors[2][lane]]
}

/// ⌊x⌋ of a number from 0 to below 2²², as a cast has it, which would keep a loop from becoming a vector loop.
#[inline(always)]
fn floor(x: f32) -> u32 {
    // From here to twice as far, floats are whole numbers, and the last bits of theirs are their offset.
    const WHOLE: f32 = (1u32 << 23) as f32;
    let nearest = x + WHOLE;
    (nearest.to_bits() - WHOLE.to_bits()) - u32::from(nearest - WHOLE > x)
}

/// [`crate::fixed::ratio::ratio`] without branches.
#[inline(always)]
fn ratio(one: f32, other: f32) -> f32 {
    let quotient = if other == 0.0 { 1.0 } else { one / other };
    let inverse = -1.0 / quotient;
    if quotient > 1.0 { inverse } else { quotient }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floors_are_those_of_casts() {
        let near = |whole: u32| [(whole as f32).next_down().max(0.0), whole as f32, (whole as f32).next_up()];
        let halves = (0..8_000u32).map(|half| half as f32 / 2.0);
        let large = [1 << 21, (1 << 22) - 1].into_iter().flat_map(near);
        for x in (0..4_000).flat_map(near).chain(halves).chain(large) {
            assert_eq!(floor(x), x as u32, "{x}");
        }
    }

    #[test]
    fn ratios_are_pcls() {
        for (one, other) in (0..=255u8).flat_map(|one| (0..=255u8).map(move |other| (one, other))) {
            let expected = crate::fixed::ratio::ratio(one, other);
            assert_eq!(ratio(f32::from(one), f32::from(other)), expected, "{one} : {other}");
        }
    }
}
