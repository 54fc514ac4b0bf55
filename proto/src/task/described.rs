//! Clouds of a split that were described in one channel before.

use crate::Digest;

/// The clouds of a split in one channel, described in shards.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DescribedSplit {
    /// The channel: its position in the descriptor, from 0.
    pub channel: u32,
    /// The split's manifest.
    pub split: Digest,
    /// Its shards: their clouds, one after the other, are those of the split.
    pub shards: Vec<DescribedShard>,
}

/// A shard with its description by a descriptor that has one channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DescribedShard {
    /// Its split manifest.
    pub manifest: Digest,
    /// Its description.
    pub description: Digest,
}

impl DescribedSplit {
    /// What its signatures are known by: other descriptions are other signatures.
    pub fn name(&self) -> Digest {
        match &self.shards[..] {
            [shard] => shard.description,
            shards => {
                Digest::of(&shards.iter().map(|shard| shard.description.0).collect::<Vec<_>>().concat())
            }
        }
    }
}
