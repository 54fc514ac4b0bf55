//! The parts of test queries and database under each descriptor, described by workers.

use std::sync::Arc;

use descriptor::description::{self, DescriptionError};
use descriptor::fixed::description::{self as fixed, DescribedClouds};
use descriptor::{Descriptor, FixedKind, Label, Parameters, Parts};
use proto::MAX_DESCRIPTION_BYTES;
use proto::task::{self, Description, Evaluation, Preparation};

use crate::tasks;
use cluster::assembly;
use cluster::blobs::BlobStore;

/// Clouds that are described together: few, because PFHRGB takes a tenth of a second for each.
const SHARD: u32 = 16;

/// Queries and database under one descriptor.
#[derive(Clone, Debug, PartialEq)]
pub struct Described {
    /// Clouds of either side that it describes, as indices into the side.
    pub clouds: [Vec<u32>; 2],
    /// Their parts.
    pub parts: DescribedParts,
    /// Keypoints that are described, over all clouds, where descriptions tell it.
    pub keypoints: Option<u64>,
}

/// Parts of queries and database.
#[derive(Clone, Debug, PartialEq)]
pub enum DescribedParts {
    /// Of the paper's kind: shape, and colour.
    DiskRing([Parts; 2], [Parts; 2]),
    /// Of one without genes.
    Fixed([Parts; 2]),
}

/// All test queries and their database, cut into shards.
pub struct Shards {
    preparation: Preparation,
    sides: [Arc<assembly::Side>; 2],
    labels: [Vec<Label>; 2],
}

impl Shards {
    /// Cuts both sides of an evaluation so that each shard's description fits into a message, whichever of these
    /// descriptors it is under, and releases their manifests; `None` if a split is not released.
    pub fn publish(evaluation: &Evaluation, descriptors: &[Descriptor], blobs: &BlobStore) -> Option<Self> {
        let one = descriptors.iter().map(|descriptor| descriptor.description_length(1)).max().unwrap_or(1);
        let fitting = u32::try_from(MAX_DESCRIPTION_BYTES / one.max(1)).unwrap_or(SHARD).clamp(1, SHARD);
        let side = |splits, clouds: u32| {
            assembly::Side::publish(splits, clouds, clouds.div_ceil(fitting), blobs).map(Arc::new)
        };
        let sides = [
            side(&evaluation.query, evaluation.queries)?,
            side(&evaluation.database, evaluation.database_clouds)?,
        ];
        let label = |&task::Label { category, instance }: &task::Label| Label { category, instance };
        let labels = sides.each_ref().map(|side| side.labels.iter().map(label).collect());
        Some(Self { preparation: evaluation.subject.preparation.clone(), sides, labels })
    }

    /// What queries and database show.
    pub fn labels(&self) -> [&[Label]; 2] {
        self.labels.each_ref().map(Vec::as_slice)
    }

    /// What workers are asked for: each descriptor in turn, queries before database.
    pub fn tasks(&self, descriptors: &[Descriptor]) -> Vec<Description> {
        let of = |descriptor: &Descriptor| {
            let subject = tasks::subject(&self.preparation, descriptor);
            let shards = self.sides.iter().flat_map(|side| &side.shards);
            shards.map(move |shard| Description {
                subject: subject.clone(),
                manifest: shard.manifest,
                clouds: shard.clouds.len() as u32,
            })
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
    ) -> Result<Vec<Described>, DescriptionError> {
        let (mut answers, mut gathered) = (answers.iter(), Vec::new());
        for descriptor in descriptors {
            let sides = self.sides.each_ref().map(|side| {
                let shards = side.shards.iter().map(|shard| shard.clouds.len() as u32);
                shards.zip(answers.by_ref()).map(|(clouds, bytes)| (clouds, &**bytes)).collect()
            });
            gathered.push(match descriptor {
                Descriptor::DiskRing(parameters) => disk_ring(parameters, sides)?,
                Descriptor::Fixed(one) => without_genes(one.kind, sides)?,
            });
        }
        Ok(gathered)
    }
}

/// Descriptions of a side's shards with their numbers of clouds.
type Descriptions<'a> = Vec<(u32, &'a [u8])>;

fn disk_ring(parameters: &Parameters, sides: [Descriptions<'_>; 2]) -> Result<Described, DescriptionError> {
    let [mut shape, mut colour] =
        [[Parts::default(), Parts::default()], [Parts::default(), Parts::default()]];
    for (side, shards) in sides.into_iter().enumerate() {
        for (clouds, bytes) in shards {
            let [more_shape, more_colour] = description::decode(bytes, parameters, clouds)?;
            shape[side].append(&more_shape);
            colour[side].append(&more_colour);
        }
    }
    let clouds = shape.each_ref().map(|parts| (0..parts.clouds() as u32).collect());
    Ok(Described { clouds, parts: DescribedParts::DiskRing(shape, colour), keypoints: None })
}

fn without_genes(kind: FixedKind, sides: [Descriptions<'_>; 2]) -> Result<Described, DescriptionError> {
    let mut all = [DescribedClouds::default(), DescribedClouds::default()];
    for (all, shards) in all.iter_mut().zip(sides) {
        for (clouds, bytes) in shards {
            all.append(&fixed::decode(bytes, kind, clouds)?);
        }
    }
    let keypoints = all.iter().flat_map(|side| &side.keypoints).map(|&keypoints| u64::from(keypoints)).sum();
    let [(queries, query_parts), (database, database_parts)] = all.map(DescribedClouds::into_described);
    Ok(Described {
        clouds: [queries, database],
        parts: DescribedParts::Fixed([query_parts, database_parts]),
        keypoints: Some(keypoints),
    })
}
