//! One side of an evaluation, queries or database: its shards with their manifests.

use std::ops::Range;

use proto::Digest;
use proto::task::{CloudEntry, Description, Label, SplitManifest, Subject};

use super::plan::shares;
use crate::blobs::BlobStore;

/// A shard: clouds that are described together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Its split manifest.
    pub manifest: Digest,
    /// Which of the side's clouds.
    pub clouds: Range<u32>,
}

/// All clouds of a side.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Side {
    /// What they show, in order.
    pub labels: Vec<Label>,
    /// How they are sharded, in order.
    pub shards: Vec<Shard>,
}

impl Side {
    /// Divides the `clouds` clouds of some splits, one after the other, into shards, and releases their manifests; `None`
    /// if a split is not released, or they list other clouds.
    pub fn publish(splits: &[Digest], clouds: u32, shards: u32, blobs: &BlobStore) -> Option<Self> {
        let mut listed: Vec<CloudEntry> = Vec::new();
        for split in splits {
            listed.extend(listed_in(*split, blobs)?);
        }
        if listed.len() != clouds as usize || !(1..=clouds).contains(&shards) {
            return None;
        }
        let labels = listed.iter().map(|cloud| cloud.label).collect();
        let shard = |clouds: Range<u32>| {
            let (split, listed) = (String::new(), &listed[clouds.start as usize..clouds.end as usize]);
            let manifest = SplitManifest { split, clouds: listed.to_vec() }.encode();
            Shard { manifest: blobs.publish_bytes(manifest), clouds }
        };
        let shards = shares(clouds, shards).map(shard).collect();
        Some(Self { labels, shards })
    }

    /// The clouds of a split as one shard, which is the split itself; `None` if it is not released.
    pub fn of_split(split: Digest, blobs: &BlobStore) -> Option<Self> {
        let labels: Vec<Label> = listed_in(split, blobs)?.iter().map(|cloud| cloud.label).collect();
        let shards = vec![Shard { manifest: split, clouds: 0..labels.len() as u32 }];
        Some(Self { labels, shards })
    }

    /// What describing each of its shards asks for, in order.
    pub fn descriptions(&self, subject: &Subject) -> impl Iterator<Item = Description> {
        self.shards.iter().map(|Shard { manifest, clouds }| {
            let clouds = clouds.len() as u32;
            Description { subject: subject.clone(), manifest: *manifest, clouds }
        })
    }
}

fn listed_in(split: Digest, blobs: &BlobStore) -> Option<Vec<CloudEntry>> {
    Some(SplitManifest::decode(&blobs.read(split).ok()?).ok()?.clouds)
}
