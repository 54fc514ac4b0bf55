//! Which evaluations are sharded, and how: decided once for each, so that a run that begins again asks for the same subtasks.

use std::collections::BTreeMap;
use std::sync::Arc;

use proto::{Digest, JobId};

use super::batch::Planned;
use super::costs::Costs;
use super::plan::{Load, ShardCount, ShardPlan, SidePlan};
use super::side::Side;
use crate::blobs::BlobStore;
use crate::evaluation::Evaluation;
use crate::task::Task;

/// Decides, and remembers what it has decided.
#[derive(Default)]
pub struct Planner {
    shard_count: ShardCount,
    costs: Costs,
    /// Evaluations that were asked for, by the names of their jobs, with how they were sharded.
    decided: BTreeMap<JobId, Option<ShardPlan>>,
    /// Sides that were sharded, by splits and number of shards.
    sides: BTreeMap<(Vec<Digest>, u32), Arc<Side>>,
}

impl Planner {
    /// A planner that keeps to the plans of earlier starts.
    pub fn new(plans: BTreeMap<JobId, ShardPlan>) -> Self {
        let decided = plans.into_iter().map(|(job, plan)| (job, Some(plan))).collect();
        Self { decided, ..Self::default() }
    }

    /// What it decides from here on.
    pub fn set_shard_count(&mut self, shard_count: ShardCount) {
        self.shard_count = shard_count;
    }

    /// Takes in what a task has taken.
    pub fn observe(&mut self, task: &Task, seconds: f64) {
        self.costs.observe(task, seconds);
    }

    /// Whether the evaluation of this job was sharded when it was asked for before.
    pub fn has_plan(&self, job: JobId) -> bool {
        self.decided.get(&job).is_some_and(Option::is_some)
    }

    /// Decides for each evaluation whether and how it is sharded, and returns the plans that are new, by job. What
    /// `was_asked` as a whole by an earlier start stays whole; `load` is without these evaluations.
    pub fn decide(
        &mut self,
        evaluations: &[Evaluation],
        load: Load,
        was_asked: impl Fn(JobId) -> bool,
    ) -> Vec<(JobId, ShardPlan)> {
        let mut undecided = Vec::new();
        for evaluation in evaluations {
            let job = Task::Evaluation(evaluation.clone()).job(0);
            match self.decided.get(&job) {
                Some(Some(plan)) if !plan.suits(evaluation) => undecided.push((job, evaluation)),
                Some(_) => {}
                None if was_asked(job) => drop(self.decided.insert(job, None)),
                None => undecided.push((job, evaluation)),
            }
        }
        let load = Load { jobs: load.jobs + undecided.len(), ..load };
        let mut new = Vec::new();
        for (job, evaluation) in undecided {
            let plan = ShardPlan::of(evaluation, self.shard_count, load, &self.costs);
            self.decided.insert(job, plan);
            new.extend(plan.map(|plan| (job, plan)));
        }
        new
    }

    /// Lays out an evaluation that was decided about, and releases the manifests of its shards.
    pub fn lay_out(&mut self, evaluation: Evaluation, blobs: &BlobStore) -> Planned {
        let job = Task::Evaluation(evaluation.clone()).job(0);
        let plan = self.decided.get(&job).copied().flatten();
        let laid_out = plan.and_then(|plan| {
            let query = self.side(&evaluation.query, evaluation.queries, plan.query, blobs)?;
            let database =
                self.side(&evaluation.database, evaluation.database_clouds, plan.database, blobs)?;
            Some((plan, [query, database]))
        });
        (evaluation, laid_out)
    }

    fn side(
        &mut self,
        splits: &[Digest],
        clouds: u32,
        plan: SidePlan,
        blobs: &BlobStore,
    ) -> Option<Arc<Side>> {
        let key = (splits.to_vec(), plan.shards);
        if let Some(side) = self.sides.get(&key) {
            return Some(Arc::clone(side));
        }
        let side = Arc::new(Side::publish(splits, clouds, plan.shards, blobs)?);
        self.sides.insert(key, Arc::clone(&side));
        Some(side)
    }
}
