//! One sharded evaluation, from its first description to its result.

use std::ops::Range;
use std::sync::Arc;

use proto::task::{Described, Evaluation, EvaluationResult, Task, TaskResult, Tile};
use proto::{Digest, JobId};

use super::combined::Combined;
use super::merge::Merged;
use super::plan::{ShardPlan, shares};
use super::side::Side;
use crate::scheduler::messages::Finished;

/// A shard or a tile of an evaluation. Side 0 are the queries, side 1 is the database.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subtask {
    /// A shard of a side.
    Shard { side: usize, index: usize },
    /// A tile, by its ranges of shards of each side.
    Tile { ranges: [usize; 2] },
}

/// One side of a sharded evaluation.
struct Half {
    side: Arc<Side>,
    /// Digest of each shard's description, as far as it is known.
    descriptions: Vec<Option<Digest>>,
    /// Shards that are matched together.
    ranges: Vec<Range<usize>>,
}

/// An evaluation that is divided into shards and tiles.
pub struct ShardedEvaluation {
    evaluation: Evaluation,
    halves: [Half; 2],
    /// Which tiles were asked for, row by row.
    asked: Vec<bool>,
    /// Tiles without a result.
    missing: usize,
    /// Until the result is given.
    merged: Option<Merged>,
    combined: Combined,
}

impl Half {
    fn new(side: Arc<Side>, ranges: u32) -> Self {
        let shards = side.shards.len();
        let ranges = shares(shards as u32, ranges).map(|range| range.start as usize..range.end as usize);
        Self { descriptions: vec![None; shards], ranges: ranges.collect(), side }
    }

    /// Descriptions of a range, once all of them are known.
    fn descriptions(&self, range: usize) -> Option<Vec<Digest>> {
        self.descriptions[self.ranges[range].clone()].iter().copied().collect()
    }

    fn manifests(&self, range: usize) -> Vec<Digest> {
        self.side.shards[self.ranges[range].clone()].iter().map(|shard| shard.manifest).collect()
    }

    /// Which clouds a range has.
    fn clouds(&self, range: usize) -> Range<u32> {
        let Range { start, end } = self.ranges[range];
        let bound = |shard: usize| self.side.shards.get(shard).map(|shard| shard.clouds.start);
        bound(start).unwrap_or(0)..bound(end).unwrap_or(self.side.labels.len() as u32)
    }
}

impl ShardedEvaluation {
    /// An evaluation of which nothing is there yet.
    pub fn new(evaluation: Evaluation, plan: ShardPlan, [query, database]: [Arc<Side>; 2]) -> Self {
        let merged = Merged::new(query.labels.len(), evaluation.rule);
        let halves = [Half::new(query, plan.query.ranges), Half::new(database, plan.database.ranges)];
        let tiles = halves[0].ranges.len() * halves[1].ranges.len();
        Self {
            evaluation,
            halves,
            asked: vec![false; tiles],
            missing: tiles,
            merged: Some(merged),
            combined: Combined::default(),
        }
    }

    /// What is to be done first: every shard has to be described.
    pub fn begin(&self) -> Vec<(Subtask, Task)> {
        let mut tasks = Vec::new();
        for (side, half) in self.halves.iter().enumerate() {
            let described = half.side.descriptions(&self.evaluation.subject).enumerate();
            tasks.extend(
                described.map(|(index, shard)| (Subtask::Shard { side, index }, Task::Description(shard))),
            );
        }
        tasks
    }

    /// Takes in the result of a subtask, and returns what can be done by now.
    pub fn take(&mut self, subtask: Subtask, finished: Finished) -> Vec<(Subtask, Task)> {
        match (subtask, self.combined.take(finished)) {
            (Subtask::Shard { side, index }, TaskResult::Description(Described { digest, .. })) => {
                self.halves[side].descriptions[index] = Some(digest);
                self.ready(side, index)
            }
            (Subtask::Tile { ranges }, TaskResult::Evaluation(result)) => {
                self.missing -= 1;
                let [query, database] = &self.halves;
                let first = query.clouds(ranges[0]).start as usize;
                let offset = database.clouds(ranges[1]).start;
                if let Some(merged) = &mut self.merged {
                    merged.take(first, &result, offset, &database.side.labels);
                }
                Vec::new()
            }
            _ => Vec::new(), // `Task::check` lets none pass
        }
    }

    /// Tiles that waited for this shard and wait for no other.
    fn ready(&mut self, side: usize, shard: usize) -> Vec<(Subtask, Task)> {
        let mut tasks = Vec::new();
        let range = self.halves[side].ranges.partition_point(|range| range.end <= shard);
        for across in 0..self.halves[1 - side].ranges.len() {
            let ranges = if side == 0 { [range, across] } else { [across, range] };
            let place = ranges[0] * self.halves[1].ranges.len() + ranges[1];
            if !self.asked[place]
                && let Some(tile) = self.tile(ranges)
            {
                self.asked[place] = true;
                tasks.push((Subtask::Tile { ranges }, Task::Tile(tile)));
            }
        }
        tasks
    }

    /// A tile, if its shards are described.
    fn tile(&self, ranges: [usize; 2]) -> Option<Tile> {
        let [query, database] = &self.halves;
        Some(Tile {
            evaluation: Evaluation {
                subject: self.evaluation.subject.clone(),
                query: query.manifests(ranges[0]),
                database: database.manifests(ranges[1]),
                queries: query.clouds(ranges[0]).len() as u32,
                database_clouds: database.clouds(ranges[1]).len() as u32,
                want_matches: true,
                rule: self.evaluation.rule,
                scales: self.evaluation.scales.clone(),
                described: Vec::new(),
            },
            query_descriptions: query.descriptions(ranges[0])?,
            database_descriptions: database.descriptions(ranges[1])?,
        })
    }

    /// The result under the name of the whole evaluation, once every tile has its result.
    pub fn finish(&mut self, job: JobId) -> Option<Finished<EvaluationResult>> {
        if self.missing > 0 {
            return None;
        }
        let [queries, database] = self.halves.each_ref().map(|half| &half.side.labels[..]);
        let result = self.merged.take()?.finish(queries, database, self.evaluation.want_matches);
        std::mem::take(&mut self.combined).finish(job, result)
    }
}
