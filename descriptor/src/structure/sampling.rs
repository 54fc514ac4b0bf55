//! Which pairs are drawn: the same for every cloud, run and machine.

use crate::structure::block::LANES;

/// A hash of 32 bits that lets no bit of its argument go unnoticed (Wellons, `lowbias32`).
#[inline(always)]
pub(super) fn lowbias32(mut value: u32) -> u32 {
    value ^= value >> 16;
    value = value.wrapping_mul(0x7feb_352d);
    value ^= value >> 15;
    value = value.wrapping_mul(0x846c_a68b);
    value ^ (value >> 16)
}

/// The draws of a channel, to be scaled to any number of points.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Draws {
    /// Of the first and of the second point of each draw; filled up to whole groups of [`LANES`].
    hashes: [Vec<u32>; 2],
    /// Number of draws.
    samples: u32,
}

impl Draws {
    /// So many draws.
    pub(super) fn new(samples: u32) -> Self {
        let of_group = samples.next_multiple_of(LANES as u32);
        let hashes = [0, 1].map(|second: u32| {
            let hash = |number: u32| lowbias32(number.wrapping_mul(2).wrapping_add(second));
            (0..of_group).map(hash).collect()
        });
        Self { hashes, samples }
    }

    /// Number of groups.
    pub(super) fn groups(&self) -> usize {
        self.samples.div_ceil(LANES as u32) as usize
    }

    /// A group of draws: for each lane the indices among so many points, and whether they make a pair.
    #[inline(always)]
    pub(super) fn group(&self, number: usize, points: u32) -> ([[u32; LANES]; 2], [bool; LANES]) {
        let mut drawn = [[0; LANES]; 2];
        for (drawn, hashes) in drawn.iter_mut().zip(&self.hashes) {
            for (index, &hash) in drawn.iter_mut().zip(&hashes[number * LANES..][..LANES]) {
                *index = ((u64::from(hash) * u64::from(points)) >> 32) as u32;
            }
        }
        let lanes = self.samples - (number * LANES) as u32;
        let mut is_pair = [false; LANES];
        for (lane, is_pair) in is_pair.iter_mut().enumerate() {
            *is_pair = (drawn[0][lane] != drawn[1][lane]) & ((lane as u32) < lanes);
        }
        (drawn, is_pair)
    }
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
    fn draws_are_scaled_hashes() {
        for (samples, points) in [(1, 5), (64, 2), (100, 1000), (512, 65_537)] {
            let draws = Draws::new(samples);
            let mut drawn = Vec::new();
            for ([ones, others], is_pair) in (0..draws.groups()).map(|number| draws.group(number, points)) {
                drawn.extend(ones.into_iter().zip(others).zip(is_pair));
            }
            assert_eq!(drawn.len(), samples.next_multiple_of(LANES as u32) as usize);
            for (number, ((one, other), is_pair)) in (0..).zip(drawn) {
                let index = |place: u32| ((u64::from(lowbias32(place)) * u64::from(points)) >> 32) as u32;
                assert_eq!([one, other], [index(2 * number), index(2 * number + 1)]);
                assert_eq!(is_pair, number < samples && one != other);
            }
        }
    }

    #[test]
    fn draws_reach_every_index_evenly() {
        for points in [1u32, 2, 7, 1000] {
            let mut drawn = [vec![0u32; points as usize], vec![0; points as usize]];
            let draws = Draws::new(8192);
            for (indices, _) in (0..draws.groups()).map(|number| draws.group(number, points)) {
                for (drawn, indices) in drawn.iter_mut().zip(indices) {
                    indices.into_iter().for_each(|index| drawn[index as usize] += 1);
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
