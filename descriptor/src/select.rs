//! Which of some flags are set, without branches.

/// Places beyond those of all flags that [`select`] writes to.
pub(crate) const ROOM: usize = 8;

/// Appends `first` + i, for each flag i that is set, to the first `count` of `places`, ascending; how many there are then.
/// There must be room for all flags and [`ROOM`] more.
///
/// Free of branches, as about half of the points of a block are neighbours, in no pattern that a processor could predict;
/// eight points at once.
#[inline(always)]
pub(crate) fn select<const N: usize>(
    flags: &[bool; N],
    first: u32,
    places: &mut [u32],
    mut count: usize,
) -> usize {
    for (group, first) in flags.as_chunks::<8>().0.iter().zip((first..).step_by(8)) {
        let flags = u64::from_le_bytes(group.map(u8::from));
        // Each byte is 0 or 1: the product has byte i at bit 56 + i, and nothing carries into these bits.
        let bits = flags.wrapping_mul(0x0102_0408_1020_4080) >> 56;
        let offsets = PLACES[bits as usize];
        let mut found = [first; 8];
        for lane in 0..8 {
            found[lane] += u32::from(offsets[lane]);
        }
        places[count..count + 8].copy_from_slice(&found);
        count += (flags.wrapping_mul(0x0101_0101_0101_0101) >> 56) as usize;
    }
    count
}

/// For every set of eight flags the places of those that are set, ascending, then zeros.
static PLACES: [[u8; 8]; 256] = {
    let mut places = [[0; 8]; 256];
    let mut flags = 0;
    while flags < 256 {
        let (mut count, mut place) = (0, 0);
        while place < 8 {
            if flags >> place & 1 == 1 {
                places[flags][count] = place;
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

    proptest! {
        #[test]
        fn selected_are_the_flags_that_are_set(
            blocks in prop::collection::vec(prop::collection::vec(any::<bool>(), N), 0..5),
            dense in 0u32..3,
        ) {
            let mut places = vec![0; blocks.len() * N + ROOM];
            let (mut expected, mut count) = (Vec::new(), 0);
            for (block, flags) in blocks.iter().enumerate() {
                let flags: [bool; N] = std::array::from_fn(|place| match dense {
                    0 => false,
                    1 => flags[place],
                    _ => true,
                });
                let first = (block * N) as u32;
                expected.extend((first..).zip(flags).filter_map(|(place, flag)| flag.then_some(place)));
                count = select(&flags, first, &mut places, count);
            }
            prop_assert_eq!(&places[..count], expected);
        }
    }
}
