//! Split manifests: which clouds a split or a shard of one has, in order, and what they show. Each is a blob.

use prost::Message as _;

use super::Label;
use super::wire::InvalidMessage;
use crate::{Digest, v2};

/// One cloud of a split.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CloudEntry {
    /// Digest of the source file.
    pub digest: Digest,
    /// Size of the source file by the manifest's account, bytes.
    pub bytes: u64,
    /// What it shows.
    pub label: Label,
    /// Its path in the data set, for messages.
    pub path: String,
    /// The sequence that it was taken in, numbered across objects; `None` where no evaluation asks for it.
    pub sequence: Option<u32>,
}

/// The clouds of one split or shard.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SplitManifest {
    /// Name of the split; empty of a shard.
    pub split: String,
    /// In order.
    pub clouds: Vec<CloudEntry>,
}

impl SplitManifest {
    /// The bytes of its blob.
    pub fn encode(self) -> Vec<u8> {
        let listed = |cloud: CloudEntry| v2::ManifestCloud {
            digest: cloud.digest.to_vec(),
            bytes: cloud.bytes,
            category: cloud.label.category,
            instance: cloud.label.instance,
            path: cloud.path,
            sequence: cloud.sequence,
        };
        let Self { split, clouds } = self;
        v2::SplitManifest { split, clouds: clouds.into_iter().map(listed).collect() }.encode_to_vec()
    }

    /// Reads a blob.
    ///
    /// # Errors
    /// If it is no manifest.
    pub fn decode(bytes: &[u8]) -> Result<Self, InvalidMessage> {
        let v2::SplitManifest { split, clouds } = v2::SplitManifest::decode(bytes)?;
        let listed = |cloud: v2::ManifestCloud| {
            Ok(CloudEntry {
                digest: Digest::try_from(&cloud.digest[..])?,
                bytes: cloud.bytes,
                label: Label { category: cloud.category, instance: cloud.instance },
                path: cloud.path,
                sequence: cloud.sequence,
            })
        };
        Ok(Self { split, clouds: clouds.into_iter().map(listed).collect::<Result<_, InvalidMessage>>()? })
    }
}
