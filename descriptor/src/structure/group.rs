//! The values of a group of points or pairs, one in each lane, and how they get there.

use std::ops::Range;

use crate::structure::block::LANES;
use crate::structure::channel::StructureChannel;
use crate::structure::quads::{QUAD, Quads};
use crate::structure::value_order::ValueOrder;

/// No point has more values, position, normal, gap and columns, in whole quads.
pub(super) const MAX_VALUES: usize = (6 + QUAD - 1 + StructureChannel::MAX_AXES).next_multiple_of(QUAD);

/// Values of points or their differences, one in each lane, in the order of [`ValueOrder`]. No distance to a
/// lane whose x is NaN counts. Aligned to the lines of the cache, of which most vectors of 64 bytes would take two.
#[repr(align(64))]
pub(super) struct Group {
    pub(super) values: [[f32; LANES]; MAX_VALUES],
}

impl Group {
    pub(super) const EMPTY: Self = Self { values: [[f32::NAN; LANES]; MAX_VALUES] };

    /// Takes over some values of some points, lane by lane, and maybe those beside them.
    #[inline(always)]
    pub(super) fn gather(&mut self, values: Range<usize>, points: &Quads, indices: &[u32; LANES]) {
        if values.is_empty() {
            return;
        }
        for quad in values.start / QUAD..values.end.div_ceil(QUAD) {
            let quads = points.quads(quad);
            let mut gathered = [[0.0; QUAD]; LANES];
            for (gathered, &index) in gathered.iter_mut().zip(indices) {
                *gathered = quads[index as usize];
            }
            turn(&gathered, self.quad(quad).each_mut());
        }
    }

    /// Takes over the values of the second points minus those of the first, lane by lane, and into `second` the codes of
    /// the second points that are fetched with them.
    #[inline(always)]
    pub(super) fn gather_differences(
        &mut self,
        second: &mut Self,
        order: &ValueOrder,
        points: &Quads,
        drawn: &[[u32; LANES]; 2],
    ) {
        for quad in 0..order.differences.div_ceil(QUAD) {
            let quads = points.quads(quad);
            let are_differences = order.are_differences(quad);
            let mut gathered = [[0.0; QUAD]; LANES];
            for (lane, gathered) in gathered.iter_mut().enumerate() {
                let [first, second] = [0, 1].map(|side| quads[drawn[side][lane] as usize]);
                for value in 0..QUAD {
                    let difference = second[value] - first[value];
                    gathered[value] = if are_differences[value] { difference } else { second[value] };
                }
            }
            // Codes are turned with the differences, into lanes of the other group.
            let mut lanes = self.quad(quad).each_mut();
            for ((lanes, codes), is_difference) in
                lanes.iter_mut().zip(second.quad(quad)).zip(are_differences)
            {
                if !is_difference {
                    *lanes = codes;
                }
            }
            turn(&gathered, lanes);
        }
    }

    /// The lanes of four values.
    #[inline(always)]
    fn quad(&mut self, quad: usize) -> &mut [[f32; LANES]; QUAD] {
        &mut self.values.as_chunks_mut::<QUAD>().0[quad]
    }
}

/// Turns values of one lane after the other into lanes of one value after the other.
#[inline(always)]
fn turn(gathered: &[[f32; QUAD]; LANES], [a, b, c, d]: [&mut [f32; LANES]; QUAD]) {
    // All four at once: of one value alone, the last lanes would be left to a loop without vectors.
    for (lane, gathered) in gathered.iter().enumerate() {
        [a[lane], b[lane], c[lane], d[lane]] = *gathered;
    }
}
