//! The values that one gene may take: evenly spaced, in whole ticks.

use serde::{Deserialize, Serialize};

/// The values one gene may take: `low + k * step` ticks for k in `0..count`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Domain {
    /// Lowest value, ticks.
    pub low: u32,
    /// Distance of neighbouring values, ticks; any value if `count` is 1.
    pub step: u32,
    /// Number of values, at least 1.
    pub count: u32,
}

impl Domain {
    /// A gene that always has the same value.
    pub fn fixed(ticks: u32) -> Self {
        Self { low: ticks, step: 1, count: 1 }
    }

    /// The highest value, ticks.
    pub fn high(&self) -> u32 {
        self.low + (self.count - 1) * self.step
    }

    /// Every value, in ticks, ascending.
    pub fn values(&self) -> impl Iterator<Item = u32> + use<> {
        let Self { low, step, count } = *self;
        (0..count).map(move |k| low + k * step)
    }

    /// Which value this is, counted from the lowest; `None` if it is none of them.
    pub fn index_of(&self, ticks: u32) -> Option<u32> {
        let steps = ticks.checked_sub(self.low)?;
        let index = steps / self.step.max(1);
        (index < self.count && index.checked_mul(self.step) == Some(steps)).then_some(index)
    }
}
