//! One sharded scale, from its first description to its value.

use std::sync::Arc;

use proto::task::{Described, DescribedShard, DescribedSplit, Evaluation, Scale, Task, TaskResult};
use proto::{Digest, JobId};

use super::combined::Combined;
use super::side::Side;
use crate::scheduler::messages::Finished;

/// A split with the side that its clouds are.
pub type SplitSide = (Digest, Arc<Side>);

/// The scale of a channel, with what was described for it.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundScale {
    /// What distances are divided by.
    pub scale: f64,
    /// Descriptions that evaluations can name, so that no worker has to describe these clouds again: of channel 0.
    pub described: Vec<DescribedSplit>,
}

impl FoundScale {
    /// Has the channel at this place of an evaluation's descriptor divided by this scale, and names what was described of
    /// the evaluation's clouds. The order in which its channels are scaled makes no difference.
    ///
    /// # Panics
    /// If the evaluation has no scale for this place: a programming error.
    pub fn scale(&self, place: u32, evaluation: &mut Evaluation) {
        let Evaluation { query, database, scales, described, .. } = evaluation;
        scales[place as usize] = self.scale;
        let is_matched = |split: &Digest| query.contains(split) || database.contains(split);
        let matched = self.described.iter().filter(|one| is_matched(&one.split));
        let matched = matched.map(|one| DescribedSplit { channel: place, ..one.clone() });
        let before = described.partition_point(|one| one.channel < place);
        described.splice(before..before, matched);
    }
}

/// A shard of a scale, or the scale of all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScaleSubtask {
    /// A shard of a split.
    Shard { split: usize, index: usize },
    /// What is left to do once all are described.
    Scale,
}

/// A scale whose clouds are described in shards.
pub struct ShardedScale {
    scale: Scale,
    splits: Vec<SplitSide>,
    /// Digest of each shard's description, as far as it is known.
    descriptions: Vec<Vec<Option<Digest>>>,
    found: Option<f64>,
    combined: Combined,
}

impl ShardedScale {
    /// A scale of which nothing is there yet.
    pub fn new(scale: Scale, splits: Vec<SplitSide>) -> Self {
        let descriptions = splits.iter().map(|(_, side)| vec![None; side.shards.len()]).collect();
        Self { scale, splits, descriptions, found: None, combined: Combined::default() }
    }

    /// What is to be done first: every shard has to be described.
    pub fn begin(&self) -> Vec<(ScaleSubtask, Task)> {
        let mut tasks = Vec::new();
        for (split, (_, side)) in self.splits.iter().enumerate() {
            let described = side.descriptions(&self.scale.subject).enumerate();
            let task = |(index, shard)| (ScaleSubtask::Shard { split, index }, Task::Description(shard));
            tasks.extend(described.map(task));
        }
        tasks
    }

    /// Takes in the result of a subtask, and returns what can be done by now.
    pub fn take(&mut self, subtask: ScaleSubtask, finished: Finished) -> Option<(ScaleSubtask, Task)> {
        match (subtask, self.combined.take(finished)) {
            (ScaleSubtask::Shard { split, index }, TaskResult::Description(Described { digest, .. })) => {
                self.descriptions[split][index] = Some(digest);
                let described = self.described()?;
                Some((ScaleSubtask::Scale, Task::Scale(Scale { described, ..self.scale.clone() })))
            }
            (ScaleSubtask::Scale, TaskResult::Scale(scale)) => {
                self.found = Some(scale);
                None
            }
            _ => None, // `Task::check` lets none pass
        }
    }

    /// Its value under the name of the whole scale, once that is found.
    pub fn finish(&mut self, job: JobId) -> Option<Finished<FoundScale>> {
        let found = FoundScale { scale: self.found?, described: self.described()? };
        std::mem::take(&mut self.combined).finish(job, found)
    }

    /// All splits, once every shard is described.
    fn described(&self) -> Option<Vec<DescribedSplit>> {
        let splits = self.splits.iter().zip(&self.descriptions);
        let described = splits.map(|((split, side), descriptions)| {
            let shards = side.shards.iter().zip(descriptions).map(|(shard, description)| {
                Some(DescribedShard { manifest: shard.manifest, description: (*description)? })
            });
            Some(DescribedSplit { channel: 0, split: *split, shards: shards.collect::<Option<_>>()? })
        });
        described.collect()
    }
}
