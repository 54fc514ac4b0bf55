//! Moving some lanes of vectors together: numbers between two bounds, codes that count.

use pulp::Simd;
use pulp::bytemuck::cast_slice;

/// Lanes of the widest vectors.
const LANES: usize = 16;

/// A bound that every squared distance is above.
pub(crate) const BELOW_ALL: f32 = -1.0;

/// Appends `first` + i, for each value i above `beyond` and at most `limit`, to the first `count` of `places`, ascending;
/// how many there are then. NaN is never selected. There must be room for all values.
///
/// Free of branches with AVX2 and AVX-512, as about half of the points of a block are neighbours, in no pattern that a
/// processor could predict.
#[inline(always)]
pub(crate) fn select<S: Simd, const N: usize>(
    simd: S,
    values: &[f32; N],
    [beyond, limit]: [f32; 2],
    first: u32,
    places: &mut [u32],
    mut count: usize,
) -> usize {
    const { assert!(N.is_multiple_of(S::F32_LANES)) }
    let (beyond, limit) = (simd.splat_f32s(beyond), simd.splat_f32s(limit));
    let mut numbers = simd.add_u32s(simd.splat_u32s(first), S::as_simd_u32s(&NUMBERS).0[0]);
    for &values in S::as_simd_f32s(values).0 {
        let is_above = simd.greater_than_f32s(values, beyond);
        let is_within = simd.less_than_or_equal_f32s(values, limit);
        let places = &mut places[count..count + S::F32_LANES];
        count += pack(simd, numbers, simd.and_m32s(is_above, is_within), places);
        numbers = simd.add_u32s(numbers, simd.splat_u32s(S::F32_LANES as u32));
    }
    count
}

/// The numbers of lanes.
pub(crate) const NUMBERS: [u32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Writes the kept lanes, in their order, to the first of as many places as there are lanes, and anything to the others; how
/// many are kept.
#[inline(always)]
pub(crate) fn pack<S: Simd>(simd: S, lanes: S::u32s, are_kept: S::m32s, places: &mut [u32]) -> usize {
    #[cfg(target_arch = "x86_64")]
    if let Some(count) = packed(simd, lanes, are_kept, places) {
        return count;
    }
    let lanes = [lanes];
    let are_kept = [simd.select_u32s(are_kept, simd.splat_u32s(1), simd.splat_u32s(0))];
    let are_kept: &[u32] = cast_slice(&are_kept);
    if are_kept.iter().fold(0, |any, is_kept| any | is_kept) == 0 {
        return 0;
    }
    let mut count = 0;
    for (&lane, &is_kept) in cast_slice::<_, u32>(&lanes).iter().zip(are_kept) {
        places[count] = lane;
        count += is_kept as usize;
    }
    count
}

/// [`pack`] by an instruction, if there is one.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn packed<S: Simd>(simd: S, lanes: S::u32s, are_kept: S::m32s, places: &mut [u32]) -> Option<usize> {
    use std::any::Any;

    let [simd, lanes, are_kept]: [&dyn Any; 3] = [&simd, &lanes, &are_kept];
    let lanes: &pulp::u32x16 = lanes.downcast_ref()?;
    if let Some(avx512) = simd.downcast_ref::<pulp::x86::V4>() {
        let are_kept: &pulp::b16 = are_kept.downcast_ref()?;
        let packed = avx512.avx512f._mm512_maskz_compress_epi32(are_kept.0, pulp::cast(*lanes));
        places.copy_from_slice(&pulp::cast::<_, [u32; LANES]>(packed));
        return Some(are_kept.0.count_ones() as usize);
    }
    let avx2 = simd.downcast_ref::<pulp::x86::V3_512b>()?.0;
    let are_kept: &pulp::m32x16 = are_kept.downcast_ref()?;
    let (lanes, are_kept): ([pulp::u32x8; 2], [pulp::f32x8; 2]) = (pulp::cast(*lanes), pulp::cast(*are_kept));
    let mut count = 0;
    for (lanes, are_kept) in lanes.into_iter().zip(are_kept) {
        let flags = avx2.avx._mm256_movemask_ps(pulp::cast(are_kept)) as u8;
        let order = PLACES[usize::from(flags)];
        let packed = avx2.avx2._mm256_permutevar8x32_epi32(pulp::cast(lanes), pulp::cast(order));
        places[count..count + OCTET].copy_from_slice(&pulp::cast::<_, [u32; OCTET]>(packed));
        count += flags.count_ones() as usize;
    }
    Some(count)
}

/// Lanes of a vector of AVX2.
#[cfg(target_arch = "x86_64")]
const OCTET: usize = 8;

/// For every set of flags the places of those that are set, ascending, then zeros.
#[cfg(target_arch = "x86_64")]
static PLACES: [[u32; OCTET]; 1 << OCTET] = {
    let mut places = [[0; OCTET]; 1 << OCTET];
    let mut flags = 0;
    while flags < 1 << OCTET {
        let (mut count, mut place) = (0, 0);
        while place < OCTET {
            if flags >> place & 1 == 1 {
                places[flags][count] = place as u32;
                count += 1;
            }
            place += 1;
        }
        flags += 1;
    }
    places
};

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use pulp::WithSimd;

    use super::*;
    use crate::wide::widest;

    const N: usize = 64;

    struct Select<'a> {
        values: &'a [f32; N],
        bounds: [f32; 2],
        first: u32,
        places: &'a mut [u32],
        count: usize,
    }

    impl WithSimd for Select<'_> {
        type Output = usize;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> usize {
            select(simd, self.values, self.bounds, self.first, self.places, self.count)
        }
    }

    /// Numbers about both bounds, the bounds themselves, and what is no distance.
    fn value() -> impl Strategy<Value = f32> {
        prop_oneof![
            8 => 0.0f32..4.0,
            3 => prop::sample::select(vec![1.0, 1f32.next_up(), 3.0, 3f32.next_up(), f32::INFINITY, f32::NAN]),
        ]
    }

    /// With AVX2 where there is more, too.
    fn with_avx2(select: Select<'_>) -> usize {
        #[cfg(target_arch = "x86_64")]
        if let Some(vectors) = pulp::x86::V3::try_new() {
            return select.with_simd(pulp::x86::V3_512b(vectors));
        }
        widest(select)
    }

    proptest! {
        #[test]
        fn selected_are_the_values_between_the_bounds(
            blocks in prop::collection::vec(prop::collection::vec(value(), N), 0..5),
            bounds in prop::sample::select(vec![[1.0, 3.0], [-1.0, 3.0], [-1.0, 9.0], [3.0, 3.0]]),
        ) {
            let [beyond, limit] = bounds;
            for level in 0..4 {
                let mut places = vec![0; blocks.len() * N];
                let (mut expected, mut count) = (Vec::new(), 0);
                for (block, values) in blocks.iter().enumerate() {
                    let values: &[f32; N] = values.as_slice().try_into().unwrap();
                    let first = (block * N) as u32;
                    let is_between = |&value: &f32| beyond < value && value <= limit;
                    expected.extend((first..).zip(values).filter_map(|(place, value)| is_between(value).then_some(place)));
                    let select = Select { values, bounds, first, places: &mut places, count };
                    count = match level {
                        0 => widest(select),
                        1 => select.with_simd(pulp::Scalar512b),
                        2 => select.with_simd(pulp::Scalar::new()),
                        _ => with_avx2(select),
                    };
                }
                prop_assert_eq!(&places[..count], expected);
            }
        }
    }
}
