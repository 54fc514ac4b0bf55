//! Named random streams: every random number of a run comes from a key that says what it is for.

use chacha20::ChaCha8Rng;
use rand::SeedableRng;

/// A generator for one purpose of one run.
///
/// The key is BLAKE3 over the seed, the purpose and the indices (generation, individual, …), each written with
/// its length, so that two different requests never share a stream and the order of requests changes nothing.
/// Draw integers as `u32` or `u64`, never `usize`: the width is part of the stream.
pub fn stream(seed: u64, purpose: &str, indices: &[u64]) -> ChaCha8Rng {
    let mut hasher = blake3::Hasher::new_derive_key("descry random stream v1");
    hasher.update(&seed.to_le_bytes());
    hasher.update(&(purpose.len() as u64).to_le_bytes());
    hasher.update(purpose.as_bytes());
    hasher.update(&(indices.len() as u64).to_le_bytes());
    for index in indices {
        hasher.update(&index.to_le_bytes());
    }
    ChaCha8Rng::from_seed(*hasher.finalize().as_bytes())
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::stream;

    #[test]
    fn streams_differ_in_every_part_of_the_key_and_repeat_with_it() {
        let draw = |seed, purpose: &str, indices: &[u64]| stream(seed, purpose, indices).random::<u64>();
        let base = draw(1, "mutation", &[2, 3]);
        assert_eq!(base, draw(1, "mutation", &[2, 3]));
        for other in [
            draw(2, "mutation", &[2, 3]),
            draw(1, "crossover", &[2, 3]),
            draw(1, "mutation", &[3, 2]),
            draw(1, "mutation", &[2]),
            draw(1, "mutation2", &[3]),
        ] {
            assert_ne!(base, other);
        }
    }
}
