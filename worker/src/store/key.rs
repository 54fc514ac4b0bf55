//! Names of derived entries: digests over all that an entry depends on.

use descriptor::{EVALUATION_VERSION, Preprocess, Quantiser, Unit};
use proto::Digest;

/// The kind of entry that holds a cloud made ready for all descriptors of a search space, and the version of its bytes.
pub const PREPARED_CLOUD: &str = "prepared cloud 2";

/// The key of a prepared cloud, given the digest of its source file.
pub fn prepared_cloud_key(preprocess: &Preprocess, quantiser: &Quantiser, cloud: Digest) -> Digest {
    KeyBuilder::new(PREPARED_CLOUD).preprocess(preprocess).part(&quantiser.digest()).part(&cloud.0).finish()
}

/// Collects what an entry depends on. Every part carries its length, so that no two lists of parts run together.
#[derive(Clone, Debug)]
pub struct KeyBuilder(Vec<u8>);

impl KeyBuilder {
    /// The key of an entry of this kind and of the present [`EVALUATION_VERSION`], so far without parts.
    pub fn new(kind: &str) -> Self {
        Self(Vec::new()).part(b"descry derived entry").part(kind.as_bytes()).number(EVALUATION_VERSION)
    }

    /// Adds bytes, such as the digest of an input.
    pub fn part(mut self, bytes: &[u8]) -> Self {
        self.0.extend_from_slice(&(bytes.len() as u64).to_le_bytes());
        self.0.extend_from_slice(bytes);
        self
    }

    /// Adds a parameter.
    pub fn number(self, number: u32) -> Self {
        self.part(&number.to_le_bytes())
    }

    /// Adds how clouds are prepared.
    pub fn preprocess(self, preprocess: &Preprocess) -> Self {
        let Preprocess { leaf_um, normal_radius_um, min_points, colour, unit } = *preprocess;
        let unit = match unit {
            Unit::Metre => 0,
            Unit::Millimetre => 1,
        };
        [leaf_um, normal_radius_um, min_points, u32::from(colour), unit].into_iter().fold(self, Self::number)
    }

    /// The key.
    pub fn finish(self) -> Digest {
        Digest::of(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_differ_when_anything_differs() {
        let keys = [
            KeyBuilder::new("a").finish(),
            KeyBuilder::new("b").finish(),
            KeyBuilder::new("a").part(b"").finish(),
            KeyBuilder::new("a").part(b"xy").finish(),
            KeyBuilder::new("a").part(b"x").part(b"y").finish(),
            KeyBuilder::new("ax").part(b"y").finish(),
            KeyBuilder::new("a").number(1).finish(),
            KeyBuilder::new("a").number(2).finish(),
        ];
        let different: std::collections::BTreeSet<_> = keys.iter().collect();
        assert_eq!(different.len(), keys.len());
        assert_eq!(
            KeyBuilder::new("a").number(1).finish(),
            KeyBuilder::new("a").part(&[1, 0, 0, 0]).finish()
        );
    }
}
