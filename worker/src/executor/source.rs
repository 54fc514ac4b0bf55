//! Where the signatures of a split or a shard come from.

use std::sync::Arc;

use proto::Digest;
use proto::task::DescribedSplit;

use crate::executor::decoded::InvalidTask;
use crate::executor::manifest::Manifest;

/// Clouds whose signatures a task needs.
pub(super) struct Source {
    /// Which clouds.
    pub(super) manifest: Arc<Manifest>,
    /// Where their signatures come from.
    pub(super) origin: Origin,
}

/// Where signatures come from.
pub(super) enum Origin {
    /// Of a split, for each channel: from shards that others have described; `None`: described here.
    Split(Vec<Option<JoinedShards>>),
    /// Of a shard, in all channels: encoded, with this digest.
    Shard(Digest),
}

/// The clouds of a split in one channel, described in shards.
pub(super) struct JoinedShards {
    /// What the signatures of the split are kept under.
    pub(super) name: Digest,
    /// Each shard with the digest of its encoded signatures.
    pub(super) shards: Vec<(Arc<Manifest>, Digest)>,
}

impl Source {
    /// The clouds of a split, to be described here in so many channels.
    pub(super) fn split(manifest: Arc<Manifest>, channels: usize) -> Self {
        Self { manifest, origin: Origin::Split((0..channels).map(|_| None).collect()) }
    }

    /// The clouds of a shard with the digest of their encoded signatures.
    pub(super) fn shard((manifest, signatures): (Arc<Manifest>, &Digest)) -> Self {
        Self { manifest, origin: Origin::Shard(*signatures) }
    }

    /// Takes the signatures in one channel from the shards of these manifests.
    ///
    /// # Errors
    /// If there is no such channel, or the shards have other clouds.
    pub(super) fn join(
        &mut self,
        described: &DescribedSplit,
        manifests: Vec<Arc<Manifest>>,
    ) -> Result<(), InvalidTask> {
        let channel = described.channel as usize;
        let clouds = manifests.iter().flat_map(|manifest| &manifest.clouds);
        let are_its =
            clouds.map(|cloud| cloud.digest).eq(self.manifest.clouds.iter().map(|cloud| cloud.digest));
        match &mut self.origin {
            Origin::Split(by_channel) if are_its && channel < by_channel.len() => {
                let names = described.shards.iter().map(|shard| shard.description);
                let shards = manifests.into_iter().zip(names).collect();
                by_channel[channel] = Some(JoinedShards { name: described.name(), shards });
                Ok(())
            }
            _ => Err(InvalidTask::Described { channel }),
        }
    }

    /// What is kept of it in a channel is kept under this: the digest of the manifest, or what the encoded signatures
    /// that a task names are known by. So that wrong signatures are taken for nothing but themselves.
    pub(super) fn name(&self, channel: usize) -> Digest {
        match &self.origin {
            Origin::Shard(name) => *name,
            Origin::Split(by_channel) => match by_channel.get(channel) {
                Some(Some(described)) => described.name,
                _ => self.manifest.digest,
            },
        }
    }

    /// Its names in all channels, and the manifest that says how its signatures are numbered.
    pub(super) fn names(&self) -> Vec<Digest> {
        match &self.origin {
            Origin::Shard(name) => vec![*name],
            Origin::Split(by_channel) => {
                let names = (0..by_channel.len()).map(|channel| self.name(channel));
                names.chain([self.manifest.digest]).collect()
            }
        }
    }
}
