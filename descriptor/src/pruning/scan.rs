//! What a look at the bounds of all clouds gives: the least of them, and those within limits.

use pulp::NullaryFnOnce;

use crate::transposed::LANES;
use crate::wide::widest;

/// Of the clouds of objects other than these the one with the least bound in each lane, those with lesser bounds first; none
/// with an infinite one. Bounds and objects are block by block.
pub(super) fn least(bounds: &[[f32; LANES]], objects: &[[u32; LANES]], but: &[u32]) -> Vec<u32> {
    let [least, clouds] = widest(Least { bounds, objects, but });
    let mut found: Vec<(f32, u32)> = least.map(f32::from_bits).into_iter().zip(clouds).collect();
    found.retain(|(bound, _)| *bound < f32::INFINITY);
    found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found.into_iter().map(|(_, cloud)| cloud).collect()
}

/// The kernel of [`least`]: in each lane the bits of the bound, and the cloud.
struct Least<'a> {
    bounds: &'a [[f32; LANES]],
    objects: &'a [[u32; LANES]],
    but: &'a [u32],
}

impl NullaryFnOnce for Least<'_> {
    type Output = [[u32; LANES]; 2];

    #[inline(always)]
    fn call(self) -> [[u32; LANES]; 2] {
        // Bounds are not negative: their bits are in their order.
        let (mut least, mut blocks) = ([f32::INFINITY.to_bits(); LANES], [0; LANES]);
        for ((block, bounds), objects) in (0u32..).zip(self.bounds).zip(self.objects) {
            let mut bits = bounds.map(f32::to_bits);
            for &known in self.but {
                for lane in 0..LANES {
                    bits[lane] = if objects[lane] == known { f32::INFINITY.to_bits() } else { bits[lane] };
                }
            }
            for lane in 0..LANES {
                blocks[lane] = if bits[lane] < least[lane] { block } else { blocks[lane] };
                least[lane] = if bits[lane] < least[lane] { bits[lane] } else { least[lane] };
            }
        }
        [least, std::array::from_fn(|lane| blocks[lane] * LANES as u32 + lane as u32)]
    }
}

/// Adds the clouds whose bound is finite and at most the limit: that of their object, or the common one.
pub(super) fn within(
    bounds: &[[f32; LANES]],
    objects: &[[u32; LANES]],
    limit: f32,
    limits: &[(u32, f32)],
    found: &mut Vec<u32>,
) {
    widest(Within { bounds, objects, limit: limit.min(f32::MAX), limits, found });
}

/// The kernel of [`within`].
struct Within<'a> {
    bounds: &'a [[f32; LANES]],
    objects: &'a [[u32; LANES]],
    limit: f32,
    limits: &'a [(u32, f32)],
    found: &'a mut Vec<u32>,
}

impl NullaryFnOnce for Within<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for ((block, bounds), objects) in (0u32..).zip(self.bounds).zip(self.objects) {
            let mut limits = [self.limit; LANES];
            for &(known, limit) in self.limits {
                for lane in 0..LANES {
                    limits[lane] = if objects[lane] == known { limit } else { limits[lane] };
                }
            }
            let mut is_within = [0u32; LANES];
            for lane in 0..LANES {
                is_within[lane] = u32::from(bounds[lane] <= limits[lane]) << lane;
            }
            let mut lanes = is_within.iter().fold(0, |all, one| all | one);
            while lanes != 0 {
                self.found.push(block * LANES as u32 + lanes.trailing_zeros());
                lanes &= lanes - 1;
            }
        }
    }
}
