//! Counts that a run has found, by descriptor: bytes in a map whose memory is bounded.

use std::path::Path;

use cluster::spill::{SpillError, SpillMap};
use proto::task::DescriptorBytes;
use results::Counts;

use crate::fitness::Measured;

/// What descriptors have.
#[derive(Debug)]
pub(super) struct FoundCounts(SpillMap);

impl Default for FoundCounts {
    /// In memory alone.
    fn default() -> Self {
        Self::new(None)
    }
}

impl FoundCounts {
    /// None yet. What outgrows memory goes to a file in this folder, if there is one.
    pub(super) fn new(folder: Option<&Path>) -> Self {
        Self(SpillMap::new(folder))
    }

    pub(super) fn get(&self, descriptor: &DescriptorBytes) -> Result<Option<Measured>, SpillError> {
        Ok(self.0.get(descriptor.bytes())?.as_deref().and_then(decode))
    }

    pub(super) fn contains(&self, descriptor: &DescriptorBytes) -> Result<bool, SpillError> {
        self.0.contains(descriptor.bytes())
    }

    pub(super) fn insert(&mut self, descriptor: &DescriptorBytes, measured: Measured) {
        self.0.insert(descriptor.bytes(), encode(&measured));
    }

    /// Shows canonical bytes of all descriptors, and what they have.
    pub(super) fn for_each(&self, mut see: impl FnMut(&[u8], Measured)) -> Result<(), SpillError> {
        self.0.for_each(|descriptor, bytes| {
            if let Some(measured) = decode(bytes) {
                see(descriptor, measured);
            }
        })
    }
}

/// Three counts, then the margin if there is one.
fn encode(measured: &Measured) -> Vec<u8> {
    let Measured { counts: Counts { object_correct, category_correct, queries }, margin } = *measured;
    let counts = [object_correct, category_correct, queries].map(u32::to_le_bytes);
    counts.into_iter().flatten().chain(margin.into_iter().flat_map(f64::to_le_bytes)).collect()
}

fn decode(bytes: &[u8]) -> Option<Measured> {
    let (&[object_correct, category_correct, queries], margin) = bytes.as_chunks().0.split_first_chunk()?;
    let counts = Counts {
        object_correct: u32::from_le_bytes(object_correct),
        category_correct: u32::from_le_bytes(category_correct),
        queries: u32::from_le_bytes(queries),
    };
    Some(Measured { counts, margin: margin.as_flattened().first_chunk().copied().map(f64::from_le_bytes) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_descriptors_have_comes_back_to_the_bit() {
        let counts = Counts { object_correct: 1, category_correct: 258, queries: u32::MAX };
        for margin in [None, Some(-0.0), Some(1.0 / 3.0), Some(f64::MIN_POSITIVE)] {
            let decoded = decode(&encode(&Measured { counts, margin })).unwrap();
            assert_eq!(decoded.counts, counts);
            assert_eq!(decoded.margin.map(f64::to_bits), margin.map(f64::to_bits));
        }
    }
}
