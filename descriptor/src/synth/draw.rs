//! Draws from a named random stream, by arithmetic that gives the same bits on every target.

use chacha20::ChaCha8Rng;
use rand::RngExt;

use crate::random;

/// A random stream with the few distributions that the generator needs.
pub(super) struct Draw(ChaCha8Rng);

impl Draw {
    /// The stream of one purpose; see [`random::stream`].
    pub(super) fn new(seed: u64, purpose: &str, indices: &[u64]) -> Self {
        Self(random::stream(seed, purpose, indices))
    }

    /// Uniform in [low, high).
    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (f64::from(self.0.random::<u32>()) / 4_294_967_296.0)
    }

    /// True with the given probability.
    pub(super) fn chance(&mut self, probability: f64) -> bool {
        self.between(0.0, 1.0) < probability
    }

    /// Uniform in 0..count; `count` is at least 1.
    pub(super) fn below(&mut self, count: u32) -> u32 {
        ((u64::from(self.0.random::<u32>()) * u64::from(count)) >> 32) as u32
    }

    /// 32 random bits, to key a lattice of random values.
    pub(super) fn bits(&mut self) -> u32 {
        self.0.random::<u32>()
    }

    /// Mean 0, deviation 1, near enough to normal: the sum of four uniforms, so it never exceeds [`REACH`].
    pub(super) fn gaussian(&mut self) -> f64 {
        let bits = self.0.random::<u64>();
        let sum: u32 = (0..4).map(|part| (bits >> (16 * part)) as u32 & 0xffff).sum();
        (f64::from(sum) - 131_070.0) / 65_536.0 * 3f64.sqrt()
    }

    /// Puts the items into random order (Fisher–Yates).
    pub(super) fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            let other = self.below(last as u32 + 1);
            items.swap(last, other as usize);
        }
    }
}

/// Largest magnitude of [`Draw::gaussian`], rounded up: √12.
#[cfg(test)]
pub(super) const REACH: f64 = 3.465;
