//! Which evaluations are cut, and how: decided once for each, so that a run that begins again asks for the same pieces.

use std::collections::BTreeMap;
use std::sync::Arc;

use proto::task::{Evaluation, Task};
use proto::{Digest, JobId};

use super::batch::Planned;
use super::costs::Costs;
use super::cut::{Cut, Load, Pieces, SideCut};
use super::side::Side;
use crate::blobs::BlobStore;

/// Decides, and remembers what it has decided.
#[derive(Default)]
pub struct Planner {
    pieces: Pieces,
    costs: Costs,
    /// Evaluations that were asked for, by the names of their jobs, with how they were cut.
    decided: BTreeMap<JobId, Option<Cut>>,
    /// Sides that were cut, by splits and number of shards.
    sides: BTreeMap<(Vec<Digest>, u32), Arc<Side>>,
}

impl Planner {
    /// A planner that keeps to the cuts of earlier starts.
    pub fn new(cuts: BTreeMap<JobId, Cut>) -> Self {
        let decided = cuts.into_iter().map(|(job, cut)| (job, Some(cut))).collect();
        Self { decided, ..Self::default() }
    }

    /// What it decides from here on.
    pub fn set_pieces(&mut self, pieces: Pieces) {
        self.pieces = pieces;
    }

    /// Takes in what a task has taken.
    pub fn observe(&mut self, task: &Task, seconds: f64) {
        self.costs.observe(task, seconds);
    }

    /// Whether the evaluation of this job was cut when it was asked for before.
    pub fn has_cut(&self, job: JobId) -> bool {
        self.decided.get(&job).is_some_and(Option::is_some)
    }

    /// Decides for each evaluation whether and how it is cut, and returns the cuts that are new, by job. What
    /// `was_asked` as a whole by an earlier start stays whole; `load` is without these evaluations.
    pub fn decide(
        &mut self,
        evaluations: &[Evaluation],
        load: Load,
        was_asked: impl Fn(JobId) -> bool,
    ) -> Vec<(JobId, Cut)> {
        let mut undecided = Vec::new();
        for evaluation in evaluations {
            let job = Task::Evaluation(evaluation.clone()).job(0);
            match self.decided.get(&job) {
                Some(Some(cut)) if !cut.suits(evaluation) => undecided.push((job, evaluation)),
                Some(_) => {}
                None if was_asked(job) => drop(self.decided.insert(job, None)),
                None => undecided.push((job, evaluation)),
            }
        }
        let load = Load { jobs: load.jobs + undecided.len(), ..load };
        let mut new = Vec::new();
        for (job, evaluation) in undecided {
            let cut = Cut::of(evaluation, self.pieces, load, &self.costs);
            self.decided.insert(job, cut);
            new.extend(cut.map(|cut| (job, cut)));
        }
        new
    }

    /// Lays out an evaluation that was decided about, and releases the manifests of its shards.
    pub fn lay_out(&mut self, evaluation: Evaluation, blobs: &BlobStore) -> Planned {
        let job = Task::Evaluation(evaluation.clone()).job(0);
        let cut = self.decided.get(&job).copied().flatten();
        let laid_out = cut.and_then(|cut| {
            let query = self.side(&evaluation.query, evaluation.queries, cut.query, blobs)?;
            let database =
                self.side(&evaluation.database, evaluation.database_clouds, cut.database, blobs)?;
            Some((cut, [query, database]))
        });
        (evaluation, laid_out)
    }

    fn side(&mut self, splits: &[Digest], clouds: u32, cut: SideCut, blobs: &BlobStore) -> Option<Arc<Side>> {
        let key = (splits.to_vec(), cut.shards);
        if let Some(side) = self.sides.get(&key) {
            return Some(Arc::clone(side));
        }
        let side = Arc::new(Side::publish(splits, clouds, cut.shards, blobs)?);
        self.sides.insert(key, Arc::clone(&side));
        Some(side)
    }
}
