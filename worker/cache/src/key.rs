//! Names of derived entries: digests over all that an entry depends on.

use proto::Digest;

/// Collects what an entry depends on. Every part carries its length, so that no two lists of parts run together.
#[derive(Clone, Debug)]
pub struct KeyBuilder(Vec<u8>);

impl KeyBuilder {
    /// The key of an entry of this kind and evaluation version, so far without parts.
    pub fn new(kind: &str, version: u32) -> Self {
        Self(Vec::new()).part(b"descry derived entry").part(kind.as_bytes()).number(version)
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
            KeyBuilder::new("a", 7).finish(),
            KeyBuilder::new("b", 7).finish(),
            KeyBuilder::new("a", 8).finish(),
            KeyBuilder::new("a", 7).part(b"").finish(),
            KeyBuilder::new("a", 7).part(b"xy").finish(),
            KeyBuilder::new("a", 7).part(b"x").part(b"y").finish(),
            KeyBuilder::new("ax", 7).part(b"y").finish(),
            KeyBuilder::new("a", 7).number(1).finish(),
            KeyBuilder::new("a", 7).number(2).finish(),
        ];
        let different: std::collections::BTreeSet<_> = keys.iter().collect();
        assert_eq!(different.len(), keys.len());
        assert_eq!(
            KeyBuilder::new("a", 7).number(1).finish(),
            KeyBuilder::new("a", 7).part(&[1, 0, 0, 0]).finish()
        );
    }
}
