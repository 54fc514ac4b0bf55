//! Which evaluations and scales are sharded, and how: decided once for each, so that a run that begins again asks for
//! the same shards and tiles.

use proto::JobId;
use proto::task::{Evaluation, Scale, Task};

use super::batch::Waiting;
use super::costs::Costs;
use super::plan::{Load, ShardCount, ShardPlan, pairs_cost};
use crate::store::JobStore;

/// Decides by what the experiment says and what recent tasks took; the store of jobs remembers what was decided.
#[derive(Default)]
pub struct Planner {
    shard_count: ShardCount,
    costs: Costs,
}

impl Planner {
    /// What it decides from here on.
    pub fn set_shard_count(&mut self, shard_count: ShardCount) {
        self.shard_count = shard_count;
    }

    /// Takes in what a task has taken.
    pub fn observe(&mut self, task: &Task, seconds: f64) {
        self.costs.observe(task, seconds);
    }

    /// Decides for each evaluation that is not decided about whether and how it is sharded, and returns the plans that
    /// are new, by job. What was asked as a whole by an earlier start stays whole; `load` is without these evaluations and
    /// those that are `waiting`, which are handed out after them.
    pub fn decide(
        &self,
        evaluations: &[Evaluation],
        waiting: Waiting,
        load: Load,
        jobs: &mut JobStore,
    ) -> Vec<(JobId, ShardPlan)> {
        let mut undecided = Vec::new();
        for evaluation in evaluations {
            let job = Task::Evaluation(evaluation.clone()).job(0);
            if is_undecided(jobs, job, |plan| plan.suits(evaluation)) {
                undecided.push((job, evaluation));
            }
        }
        let load = Load { jobs: load.jobs + undecided.len() + waiting.evaluations, ..load };
        let matching = |evaluation: &Evaluation| self.costs.matching(pairs_cost(evaluation));
        let together: f64 = undecided.iter().map(|(_, evaluation)| matching(evaluation)).sum();
        let mut left = together + self.costs.matching(waiting.pairs_cost);
        let mut new = Vec::new();
        for (job, evaluation) in undecided {
            let plan = ShardPlan::of(evaluation, self.shard_count, (load, left), &self.costs);
            left -= matching(evaluation);
            jobs.set_plan(job, plan);
            new.extend(plan.map(|plan| (job, plan)));
        }
        new
    }

    /// The same for scales, with so many workers.
    pub fn decide_scales(
        &self,
        scales: &[Scale],
        workers: usize,
        jobs: &mut JobStore,
    ) -> Vec<(JobId, ShardPlan)> {
        let mut new = Vec::new();
        for scale in scales {
            let job = Task::Scale(scale.clone()).job(0);
            if is_undecided(jobs, job, |plan| plan.suits_scale(scale)) {
                let plan = ShardPlan::of_scale(scale, self.shard_count, workers, &self.costs);
                jobs.set_plan(job, plan);
                new.extend(plan.map(|plan| (job, plan)));
            }
        }
        new
    }
}

/// Whether there is no plan for a job that suits it; what was asked as a whole before stays whole.
fn is_undecided(jobs: &mut JobStore, job: JobId, suits: impl FnOnce(&ShardPlan) -> bool) -> bool {
    match jobs.plan(job) {
        Some(plan) => plan.is_some_and(|plan| !suits(&plan)),
        None if jobs.is_known(job) => {
            jobs.set_plan(job, None);
            false
        }
        None => true,
    }
}
