//! Which pairs are drawn: the same for every cloud, run and machine.

/// A hash of 32 bits that lets no bit of its argument go unnoticed (Wellons, `lowbias32`).
#[inline(always)]
pub(super) fn lowbias32(mut value: u32) -> u32 {
    value ^= value >> 16;
    value = value.wrapping_mul(0x7feb_352d);
    value ^= value >> 15;
    value = value.wrapping_mul(0x846c_a68b);
    value ^ (value >> 16)
}

/// The two of `points` indices that one draw takes; they may be equal.
#[inline(always)]
pub(super) fn draw(number: u32, points: u32) -> [u32; 2] {
    let first = number.wrapping_mul(2);
    [first, first.wrapping_add(1)].map(|place| {
        let share = u64::from(lowbias32(place)) * u64::from(points);
        (share >> 32) as u32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_hashes() {
        let found = [0, 1, 2, 0x8000_0000, u32::MAX].map(lowbias32);
        assert_eq!(found, [0x0000_0000, 0x6889_90c0, 0xd113_2181, 0xcc4b_4124, 0x6768_824a]);
    }

    #[test]
    fn draws_reach_every_index_evenly() {
        for points in [1u32, 2, 7, 1000] {
            let mut drawn = [vec![0u32; points as usize], vec![0; points as usize]];
            for number in 0..8192 {
                for (drawn, index) in drawn.iter_mut().zip(draw(number, points)) {
                    drawn[index as usize] += 1;
                }
            }
            let expected = 8192.0 / f64::from(points);
            // Six standard deviations.
            let slack = 6.0 * expected.sqrt();
            assert!(
                drawn.iter().flatten().all(|&count| (f64::from(count) - expected).abs() <= slack),
                "{points}"
            );
        }
    }
}
