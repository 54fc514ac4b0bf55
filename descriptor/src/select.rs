//! Which of some numbers lie between two bounds, without branches.

#[cfg(target_arch = "x86_64")]
use pulp::Simd;

/// Numbers that are compared at once.
const BLOCK: usize = 16;

/// Numbers whose places one entry of [`PLACES`] has.
const HALF: usize = BLOCK / 2;

/// Places beyond those of all numbers that [`Selector::select`] writes to.
pub(crate) const ROOM: usize = BLOCK;

/// A bound that every squared distance is above.
pub(crate) const BELOW_ALL: f32 = -1.0;

/// How numbers are selected: made where loops begin, as it asks what the processor can do.
#[derive(Clone, Copy, Default)]
pub(crate) struct Selector {
    /// Moves the selected places together.
    #[cfg(target_arch = "x86_64")]
    avx512: Option<pulp::x86::V4>,
}

impl Selector {
    /// With the instructions that kernels run with.
    #[inline(always)]
    pub(crate) fn new() -> Self {
        Self {
            #[cfg(target_arch = "x86_64")]
            avx512: crate::wide::avx512(),
        }
    }

    /// Appends `first` + i, for each value i above `beyond` and at most `limit`, to the first `count` of `places`,
    /// ascending; how many there are then. NaN is never selected. There must be room for all values and [`ROOM`] more.
    ///
    /// Free of branches, as about half of the points of a block are neighbours, in no pattern that a processor could
    /// predict.
    #[inline(always)]
    pub(crate) fn select<const N: usize>(
        self,
        values: &[f32; N],
        [beyond, limit]: [f32; 2],
        first: u32,
        places: &mut [u32],
        mut count: usize,
    ) -> usize {
        for (values, first) in values.as_chunks::<BLOCK>().0.iter().zip((first..).step_by(BLOCK)) {
            #[cfg(target_arch = "x86_64")]
            if let Some(avx512) = self.avx512 {
                let (found, selected) = compressed(avx512, values, [beyond, limit], first);
                places[count..count + BLOCK].copy_from_slice(&found);
                count += selected;
                continue;
            }
            let mut bits = [0u32; BLOCK];
            for (lane, bit) in bits.iter_mut().enumerate() {
                *bit = if (values[lane] > beyond) & (values[lane] <= limit) { 1 << lane } else { 0 };
            }
            let selected = bits.into_iter().fold(0, |all, bit| all | bit);
            for (half, first) in [(selected as u8, first), ((selected >> HALF) as u8, first + HALF as u32)] {
                let offsets = PLACES[usize::from(half)];
                let mut found = [first; HALF];
                for lane in 0..HALF {
                    found[lane] += u32::from(offsets[lane]);
                }
                places[count..count + HALF].copy_from_slice(&found);
                count += half.count_ones() as usize;
            }
        }
        count
    }
}

/// The places of the selected values of a block, which begins at place `first`, and how many they are.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn compressed(
    avx512: pulp::x86::V4,
    values: &[f32; BLOCK],
    [beyond, limit]: [f32; 2],
    first: u32,
) -> ([u32; BLOCK], usize) {
    let values = pulp::cast(*values);
    let above = avx512.less_than_f32s(avx512.splat_f32s(beyond), values);
    let within = avx512.less_than_or_equal_f32s(values, avx512.splat_f32s(limit));
    let selected = above.0 & within.0;
    let mut places = [first; BLOCK];
    for (lane, place) in (0u32..).zip(&mut places) {
        *place += lane;
    }
    let found = avx512.avx512f._mm512_maskz_compress_epi32(selected, pulp::cast(places));
    (pulp::cast(found), selected.count_ones() as usize)
}

/// For every set of flags the places of those that are set, ascending, then zeros.
static PLACES: [[u8; HALF]; 1 << HALF] = {
    let mut places = [[0; HALF]; 1 << HALF];
    let mut flags = 0;
    while flags < 1 << HALF {
        let (mut count, mut place) = (0, 0);
        while place < HALF {
            if flags >> place & 1 == 1 {
                places[flags][count] = place as u8;
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

    use super::*;

    const N: usize = 64;

    /// Numbers about both bounds, the bounds themselves, and what is no distance.
    fn value() -> impl Strategy<Value = f32> {
        prop_oneof![
            8 => 0.0f32..4.0,
            3 => prop::sample::select(vec![1.0, 1f32.next_up(), 3.0, 3f32.next_up(), f32::INFINITY, f32::NAN]),
        ]
    }

    proptest! {
        #[test]
        fn selected_are_the_values_between_the_bounds(
            blocks in prop::collection::vec(prop::collection::vec(value(), N), 0..5),
            bounds in prop::sample::select(vec![[1.0, 3.0], [-1.0, 3.0], [-1.0, 9.0], [3.0, 3.0]]),
        ) {
            let [beyond, limit] = bounds;
            for selector in [Selector::new(), Selector::default()] {
                let mut places = vec![0; blocks.len() * N + ROOM];
                let (mut expected, mut count) = (Vec::new(), 0);
                for (block, values) in blocks.iter().enumerate() {
                    let values: &[f32; N] = values.as_slice().try_into().unwrap();
                    let first = (block * N) as u32;
                    let is_between = |&value: &f32| beyond < value && value <= limit;
                    expected.extend((first..).zip(values).filter_map(|(place, value)| is_between(value).then_some(place)));
                    count = selector.select(values, bounds, first, &mut places, count);
                }
                prop_assert_eq!(&places[..count], expected);
            }
        }
    }
}
