//! The parts of test queries and database under each descriptor, described by workers.

use std::sync::Arc;

use descriptor::{Descriptor, Label, Preprocess, SearchSpace, SignatureError, Signatures};
use proto::MAX_DESCRIPTION_BYTES;
use proto::task::{self, Description, Evaluation};

use crate::tasks;
use cluster::blobs::BlobStore;
use cluster::sharding;

/// Clouds that are described together: few, because PFHRGB takes a tenth of a second for each.
const SHARD: u32 = 16;

/// Queries and database under one descriptor.
#[derive(Clone, Debug, PartialEq)]
pub struct Described {
    /// Clouds of either side that it describes, as indices into the side.
    pub clouds: [Vec<u32>; 2],
    /// Their signatures in each channel.
    pub channels: Vec<[Signatures; 2]>,
    /// Keypoints that are described, over all clouds, where descriptions tell it.
    pub keypoints: Option<u64>,
}

/// All test queries and their database, cut into shards.
pub struct Shards {
    preprocess: Preprocess,
    /// The run's.
    space: SearchSpace,
    sides: [Arc<sharding::Side>; 2],
    labels: [Vec<Label>; 2],
}

impl Shards {
    /// Cuts both sides of an evaluation so that each shard's description fits into a message, whichever of these
    /// descriptors it is under, and releases their manifests; `None` if a split is not released.
    pub fn publish(
        evaluation: &Evaluation,
        space: &SearchSpace,
        descriptors: &[Descriptor],
        preprocess: &Preprocess,
        blobs: &BlobStore,
    ) -> Option<Self> {
        let one = descriptors.iter().map(|descriptor| descriptor.signature_bytes(1)).max().unwrap_or(1);
        let fitting = u32::try_from(MAX_DESCRIPTION_BYTES / one.max(1)).unwrap_or(SHARD).clamp(1, SHARD);
        let side = |splits, clouds: u32| {
            sharding::Side::publish(splits, clouds, clouds.div_ceil(fitting), blobs).map(Arc::new)
        };
        let sides = [
            side(&evaluation.query, evaluation.queries)?,
            side(&evaluation.database, evaluation.database_clouds)?,
        ];
        let label = |&task::Label { category, instance }: &task::Label| Label { category, instance };
        let labels = sides.each_ref().map(|side| side.labels.iter().map(label).collect());
        Some(Self { preprocess: *preprocess, space: space.clone(), sides, labels })
    }

    /// What queries and database show.
    pub fn labels(&self) -> [&[Label]; 2] {
        self.labels.each_ref().map(Vec::as_slice)
    }

    /// What workers are asked for: each descriptor in turn, queries before database.
    pub fn tasks(&self, descriptors: &[Descriptor]) -> Vec<Description> {
        let of = |descriptor: &Descriptor| {
            let preparation = tasks::preparation_beside(&self.preprocess, &self.space, descriptor);
            let subject = tasks::subject(&preparation, descriptor);
            let sides = self.sides.iter();
            sides.flat_map(|side| side.descriptions(&subject)).collect::<Vec<_>>()
        };
        descriptors.iter().flat_map(of).collect()
    }

    /// Both sides under each descriptor, in their order, from the answers to [`Shards::tasks`].
    ///
    /// # Errors
    /// If an answer is no description of its shard.
    pub fn gather(
        &self,
        descriptors: &[Descriptor],
        answers: &[Arc<[u8]>],
    ) -> Result<Vec<Described>, SignatureError> {
        let (mut answers, mut gathered) = (answers.iter(), Vec::new());
        for descriptor in descriptors {
            let sides = self.sides.each_ref().map(|side| {
                let shards = side.shards.iter().map(|shard| shard.clouds.len() as u32);
                shards.zip(answers.by_ref()).map(|(clouds, bytes)| (clouds, &**bytes)).collect()
            });
            gathered.push(Described::new(descriptor, sides)?);
        }
        Ok(gathered)
    }
}

/// Of each shard its number of clouds and their encoded signatures.
type Shard<'a> = (u32, &'a [u8]);

impl Described {
    fn new(descriptor: &Descriptor, sides: [Vec<Shard<'_>>; 2]) -> Result<Self, SignatureError> {
        let nothing = [Signatures::default(), Signatures::default()];
        let mut channels = vec![nothing; descriptor.channels().len()];
        for (side, shards) in sides.into_iter().enumerate() {
            for (clouds, bytes) in shards {
                let more = descriptor.decode_signatures(bytes, clouds)?;
                channels.iter_mut().zip(&more).for_each(|(all, more)| all[side].append(more));
            }
        }
        // Every channel tells the same.
        let told: Vec<&[u32]> = channels[0].iter().filter_map(Signatures::keypoints).collect();
        let all = told.iter().copied().flatten().map(|&keypoints| u64::from(keypoints));
        let keypoints = (!told.is_empty()).then(|| all.sum());
        let mut clouds = [Vec::new(), Vec::new()];
        let channels = channels.into_iter().map(|sides| {
            let [(queries, query), (database, known)] = sides.map(Signatures::into_described);
            clouds = [queries, database];
            [query, known]
        });
        let channels = channels.collect();
        Ok(Self { clouds, channels, keypoints })
    }
}
