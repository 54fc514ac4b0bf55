//! Sharded evaluations give what they give whole, whatever the plan and the order of arrival.

mod awaiting;
mod busy;

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use descriptor::recognise::recognise_from;
use descriptor::{Correct, DistanceMatrix, Signature, Signatures};
use proptest::prelude::*;
use proto::journal::Assurance;
use proto::task::{
    CloudEntry, Described, DescribedSplit, Evaluation, EvaluationResult, Exclusion, Label, Match,
    MatchingRule, Nearest, Objective, Scale, SplitManifest, Subject, Task, TaskResult, Tile,
};
use proto::{Digest, JobId, MAX_DESCRIPTION_BYTES, Principal, WorkerId};

use super::batch::{Planned, PlannedScale};
use super::side::Shard;
use super::*;
use crate::blobs::BlobStore;
use crate::journal::Recorded;
use crate::scheduler::messages::Finished;
use crate::store::JobStore;

/// A cloud whose descriptor is one number, so that few numbers make many equal distances.
#[derive(Clone, Copy, Debug)]
struct Toy {
    /// Clouds of one number have one digest.
    number: u8,
    instance: u32,
    sequence: u32,
}

/// What workers can fetch.
#[derive(Default)]
struct World {
    blobs: BlobStore,
}

impl World {
    /// The manifest of some clouds, which are told apart by where they are.
    fn publish(&self, name: &str, clouds: &[Toy]) -> Digest {
        let entry = |(index, cloud): (usize, &Toy)| CloudEntry {
            digest: Digest([cloud.number; 32]),
            bytes: 1,
            label: label(cloud),
            path: format!("{name}/{index}/{}", cloud.number),
            sequence: Some(cloud.sequence),
        };
        let clouds = clouds.iter().enumerate().map(entry).collect();
        self.blobs.publish_bytes(SplitManifest { split: name.to_owned(), clouds }.encode())
    }

    /// The clouds of manifests, shards among them.
    fn clouds(&self, manifests: &[Digest]) -> Vec<Toy> {
        let mut clouds = Vec::new();
        for manifest in manifests {
            let bytes = self.blobs.read(*manifest).unwrap();
            let listed = SplitManifest::decode(&bytes).unwrap().clouds;
            clouds.extend(listed.iter().map(|one| Toy {
                number: one.digest.0[0],
                instance: one.label.instance,
                sequence: one.sequence.unwrap(),
            }));
        }
        clouds
    }

    /// What a worker reports for an evaluation.
    fn evaluate(&self, evaluation: &Evaluation) -> EvaluationResult {
        let [queries, database] = [&evaluation.query, &evaluation.database].map(|side| self.clouds(side));
        let label = |cloud: &Toy| {
            let Label { category, instance } = label(cloud);
            descriptor::Label { category, instance }
        };
        let labels = [&queries, &database].map(|side| side.iter().map(label).collect::<Vec<_>>());
        let distances = DistanceMatrix::new(&signatures(&queries), &signatures(&database));
        let scale = |channel: usize| evaluation.scales.get(channel).copied().unwrap_or(1.0);
        let weights = [0.67 / scale(0), (1.0 - 0.67) / scale(1)];
        if !evaluation.rule.is_default() {
            let distance = |query: usize, cloud: usize| {
                let distance = f64::from(distances.row(query)[cloud]);
                weights[0] * distance + weights[1] * distance
            };
            return by_definition(evaluation, &queries, &database, distance);
        }
        let channels = weights.map(|weight| (&distances, weight));
        let found = recognise_from(queries.len(), &channels, &labels[1]).unwrap();
        let correct = Correct::count(&found, &labels[0], &labels[1]);
        let matches = found.iter().map(|found| Match {
            nearest: found.nearest.index,
            distance: found.nearest.distance,
            runner_up: found.runner_up.map(|hit| (hit.index, hit.distance)),
        });
        EvaluationResult {
            queries: queries.len() as u32,
            object_correct: correct.object as u32,
            category_correct: correct.category as u32,
            matches: if evaluation.want_matches { matches.collect() } else { Vec::new() },
            ..EvaluationResult::default()
        }
    }

    /// What a worker reports.
    fn answer(&self, task: &Task) -> TaskResult {
        match task {
            Task::Evaluation(evaluation) => TaskResult::Evaluation(self.evaluate(evaluation)),
            Task::Description(shard) => {
                assert_eq!(self.clouds(&[shard.manifest]).len(), shard.clouds as usize);
                TaskResult::Description(described(shard.manifest))
            }
            Task::Tile(Tile { evaluation, query_descriptions, database_descriptions }) => {
                let shards = evaluation.query.iter().chain(&evaluation.database);
                let expected: Vec<Digest> = shards.map(|shard| described(*shard).digest).collect();
                assert_eq!([&query_descriptions[..], database_descriptions].concat(), expected);
                let result = TaskResult::Evaluation(self.evaluate(evaluation));
                task.check(&result).unwrap();
                result
            }
            Task::Scale(scale) => {
                self.check_described(&scale.splits, &scale.described);
                TaskResult::Scale(self.scale(scale))
            }
            Task::GridCell(_) => panic!("{task}"),
        }
    }

    /// Stands for the scale of some splits.
    fn scale(&self, scale: &Scale) -> f64 {
        self.clouds(&scale.splits).iter().map(|cloud| f64::from(cloud.number) + 0.5).sum()
    }

    /// Every split that has clouds is described, in shards that are the split one after the other, by what workers have
    /// answered; or none.
    fn check_described(&self, splits: &[Digest], all: &[DescribedSplit]) {
        for one in all {
            assert_eq!(one.channel, 0);
            assert!(one.shards.iter().all(|shard| shard.description == described(shard.manifest).digest));
            let shards: Vec<Digest> = one.shards.iter().map(|shard| shard.manifest).collect();
            let listed =
                |manifests| self.clouds(manifests).iter().map(|cloud| cloud.number).collect::<Vec<_>>();
            assert_eq!(listed(&shards), listed(&[one.split]));
        }
        let named: Vec<Digest> = all.iter().map(|one| one.split).collect();
        assert!(
            all.is_empty()
                || splits.iter().all(|split| named.contains(split) || self.clouds(&[*split]).is_empty())
        );
    }
}

/// An evaluation under a rule as it is defined: every query with every cloud that is left to it.
fn by_definition(
    evaluation: &Evaluation,
    queries: &[Toy],
    database: &[Toy],
    distance: impl Fn(usize, usize) -> f64,
) -> EvaluationResult {
    let MatchingRule { exclude, objective, margin } = evaluation.rule;
    let mut result = EvaluationResult { margin: margin.then_some(0.0), ..EvaluationResult::default() };
    for (index, query) in queries.iter().enumerate() {
        let is_left = |cloud: &Toy| match exclude {
            Exclusion::None => true,
            Exclusion::SameCloud => cloud.number != query.number,
            Exclusion::SameSequence => cloud.sequence != query.sequence,
        };
        let is_own = |cloud: &Toy| match objective {
            Objective::Object => cloud.instance == query.instance,
            Objective::Category => label(cloud).category == label(query).category,
        };
        let left = database.iter().enumerate().filter(|(_, cloud)| is_left(cloud));
        let mut left: Vec<(f64, usize)> = left.map(|(cloud, _)| (distance(index, cloud), cloud)).collect();
        left.sort_by(|one, other| one.partial_cmp(other).unwrap());
        let first = |own: bool| {
            let found = left.iter().find(|(_, cloud)| is_own(&database[*cloud]) == own);
            found.map(|&(distance, cloud)| (cloud as u32, distance))
        };
        let nearest = Nearest { same: first(true), other: first(false) };
        if evaluation.want_matches {
            result.nearest.push(nearest);
        }
        let Some((_, same)) = nearest.same else { continue };
        let [named, shown] = [&database[left[0].1], query].map(label);
        result.queries += 1;
        result.object_correct += u32::from(named.instance == shown.instance);
        result.category_correct += u32::from(named.category == shown.category);
        if let Some(sum) = &mut result.margin {
            *sum += match nearest.other {
                Some((_, other)) if other + same > 0.0 => (other - same) / (other + same),
                Some(_) => 0.0,
                None => 1.0,
            };
        }
    }
    result
}

/// Stands for the description of a shard.
fn described(manifest: Digest) -> Described {
    Described::named(Digest::of(&manifest.0))
}

fn label(cloud: &Toy) -> Label {
    Label { category: cloud.instance / 2, instance: cloud.instance }
}

fn signatures(clouds: &[Toy]) -> Signatures {
    let signature = |cloud: &Toy| {
        let share = f32::from(cloud.number) / 8.0;
        Signature { centroid: vec![share, 1.0 - share], deviation: vec![0.0, 0.0] }
    };
    clouds.iter().map(signature).collect::<Vec<Signature>>().iter().collect()
}

fn finished(job: JobId, result: TaskResult, worker: &str) -> Finished {
    let queued = Duration::from_millis(5);
    let worker_id = WorkerId([worker.len() as u8; 16]);
    Finished {
        job,
        result,
        worker_id,
        worker: worker.to_owned(),
        attempt: 1,
        queued,
        run_seconds: 0.5,
        principal: Principal::Coordinator,
        seconded: None,
        assurance: if worker == "two" { Assurance::Unaudited } else { Assurance::Audited },
    }
}

/// Results of evaluations whose tasks are answered in an order that `seed` decides, with the number of tasks.
fn carry_out(
    world: &World,
    evaluations: &[Evaluation],
    planner: &Planner,
    jobs: &mut JobStore,
    seed: u64,
) -> (Vec<Finished<EvaluationResult>>, usize) {
    let evaluations: Vec<AwaitingScales> = evaluations.iter().cloned().map(Into::into).collect();
    let ((done, _), tasks) = carry_out_with(world, (&evaluations, &[]), planner, jobs, seed);
    (done, tasks)
}

/// Of evaluations and of scales.
type Results = (Vec<Finished<EvaluationResult>>, Vec<Finished<FoundScale>>);

fn carry_out_with(
    world: &World,
    (evaluations, scales): (&[AwaitingScales], &[Scale]),
    planner: &Planner,
    jobs: &mut JobStore,
    seed: u64,
) -> (Results, usize) {
    let load = Load { jobs: 0, workers: 8 };
    planner.decide_scales(scales, load.workers, jobs);
    let mut batch = Batch::new(evaluations.to_vec());
    let mut first = begin_ready(world, &mut batch, planner, jobs);
    first.extend(batch.begin_scales(scales.iter().map(|one| lay_out_scale(world, one, jobs)).collect()));
    let mut open: Vec<(usize, Task)> = first.into_iter().enumerate().collect();
    let (mut given, mut draw) = (open.len(), seed);
    while !open.is_empty() {
        draw = draw.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(1);
        let (number, task) = open.swap_remove((draw >> 33) as usize % open.len());
        let worker = if number % 2 == 0 { "even" } else { "odd" };
        let mut further = batch.take(number, finished(task.job(0), world.answer(&task), worker));
        further.extend(begin_ready(world, &mut batch, planner, jobs));
        for task in further {
            open.push((given, task));
            given += 1;
        }
    }
    assert_eq!(batch.waiting(), Waiting::default());
    assert_eq!(batch.evaluated().len(), evaluations.len());
    (batch.finish(), given)
}

/// Begins what waits for no scale any more.
fn begin_ready(world: &World, batch: &mut Batch, planner: &Planner, jobs: &mut JobStore) -> Vec<Task> {
    let mut tasks = Vec::new();
    let ready = batch.take_ready();
    let evaluations: Vec<Evaluation> = ready.iter().map(|(_, evaluation)| evaluation.clone()).collect();
    planner.decide(&evaluations, batch.waiting(), Load { jobs: 0, workers: 8 }, jobs);
    for (index, evaluation) in ready {
        tasks.extend(batch.begin(index, lay_out(world, &evaluation, jobs)));
    }
    tasks
}

fn lay_out(world: &World, evaluation: &Evaluation, jobs: &JobStore) -> Planned {
    let plan = jobs.plan(Task::Evaluation(evaluation.clone()).job(0)).flatten();
    Layouts::default().lay_out(evaluation.clone(), plan, &world.blobs)
}

fn lay_out_scale(world: &World, scale: &Scale, jobs: &JobStore) -> PlannedScale {
    let plan = jobs.plan(Task::Scale(scale.clone()).job(0)).flatten();
    Layouts::default().lay_out_scale(scale.clone(), plan, &world.blobs)
}

fn toys(most: usize) -> impl Strategy<Value = Vec<Toy>> {
    let toy = (0u8..=8, 0u32..5, 0u32..3);
    let toy = toy.prop_map(|(number, instance, sequence)| Toy { number, instance, sequence });
    prop::collection::vec(toy, 1..most)
}

fn rules() -> impl Strategy<Value = MatchingRule> {
    let exclude = vec![Exclusion::None, Exclusion::SameCloud, Exclusion::SameSequence];
    let objective = vec![Objective::Object, Objective::Category];
    let parts = (prop::sample::select(exclude), prop::sample::select(objective), any::<bool>());
    parts.prop_map(|(exclude, objective, margin)| MatchingRule { exclude, objective, margin })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn subtasks_in_any_order_are_the_whole(
        queries in toys(14),
        databases in prop::collection::vec(toys(16), 1..3),
        count in 1u32..30,
        want_matches in any::<bool>(),
        rule in rules(),
        scales in prop_oneof![Just(vec![]), Just(vec![0.3, 7.0])],
        seed in any::<u64>(),
    ) {
        let world = World::default();
        let query = vec![world.publish("query", &queries)];
        let database: Vec<Digest> =
            databases.iter().enumerate().map(|(index, side)| world.publish(&index.to_string(), side)).collect();
        let evaluation = Evaluation {
            subject: Subject::sample(1),
            query,
            database,
            queries: queries.len() as u32,
            database_clouds: databases.iter().map(Vec::len).sum::<usize>() as u32,
            want_matches,
            rule,
            scales,
            described: vec![],
        };
        let subject = Subject::sample(2);
        let evaluations = [evaluation.clone(), Evaluation { subject, ..evaluation.clone() }];
        let shard_count = ShardCount::Fixed(count.try_into().unwrap());
        let mut planner = Planner::default();
        planner.set_shard_count(shard_count);
        let mut jobs = JobStore::default();
        let (done, tasks) = carry_out(&world, &evaluations, &planner, &mut jobs, seed);
        let bits = |result: &EvaluationResult| TaskResult::Evaluation(result.clone()).fingerprint();
        for (finished, evaluation) in done.iter().zip(&evaluations) {
            let whole = world.evaluate(evaluation);
            prop_assert_eq!(&finished.result, &whole);
            prop_assert_eq!(bits(&finished.result), bits(&whole));
            prop_assert_eq!(finished.job, Task::Evaluation(evaluation.clone()).job(0));
        }
        // Once more: the same plan, whatever a planner would decide by now.
        planner.observe(&Task::Evaluation(evaluation), 1e9);
        let (again, tasks_again) = carry_out(&world, &evaluations, &planner, &mut jobs, !seed);
        prop_assert_eq!(tasks_again, tasks);
        prop_assert_eq!(&again[0].result, &done[0].result);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn scales_of_splits_described_in_any_order_are_those_of_the_whole(
        splits in prop::collection::vec(prop_oneof![toys(16), Just(vec![])], 0..4),
        count in 1u32..30,
        seed in any::<u64>(),
    ) {
        let world = World::default();
        let lengths: Vec<usize> = splits.iter().map(Vec::len).collect();
        let clouds = lengths.iter().sum::<usize>() as u32;
        let splits: Vec<Digest> =
            splits.iter().enumerate().map(|(index, clouds)| world.publish(&index.to_string(), clouds)).collect();
        // Each split has its share of the shards, rounded down, but at least one if it has clouds.
        let share = |length: usize| (count.min(clouds) as usize * length / clouds as usize).max(1);
        let shards = splits.iter().zip(&lengths).filter(|(_, length)| **length > 0);
        let shards: BTreeMap<Digest, usize> = shards.map(|(&split, &length)| (split, share(length))).collect();
        let expected = if count == 1 { 0 } else { shards.values().sum() };
        let scale = |number| Scale {
            subject: Subject::sample(number),
            splits: splits.clone(),
            clouds,
            described: vec![],
        };
        let scales = [scale(1), scale(2)];
        let mut planner = Planner::default();
        planner.set_shard_count(ShardCount::Fixed(count.try_into().unwrap()));
        let mut jobs = JobStore::default();
        let ((_, done), tasks) = carry_out_with(&world, (&[], &scales), &planner, &mut jobs, seed);
        prop_assert_eq!(done.len(), 2);
        for (finished, asked) in done.iter().zip(&scales) {
            prop_assert_eq!(finished.job, Task::Scale(asked.clone()).job(0));
            prop_assert_eq!(finished.result.scale, world.scale(asked));
            let described = &finished.result.described;
            let listed: usize = described.iter().map(|one| one.shards.len()).sum();
            prop_assert_eq!(listed, expected);
            prop_assert_eq!(described.is_empty(), listed == 0);
            // Each shard, and the scale; a scale alone if nothing is described before.
            prop_assert_eq!(tasks, 2 * (listed + 1));
        }
        let ((_, again), tasks_again) = carry_out_with(&world, (&[], &scales), &Planner::default(), &mut jobs, !seed);
        prop_assert_eq!(tasks_again, tasks);
        prop_assert_eq!(&again[0].result, &done[0].result);
    }
}

#[test]
fn shards_of_a_scale_fit_into_messages_however_its_clouds_fall_to_splits() {
    let (world, fitting) = (World::default(), 2);
    let toy = Toy { number: 0, instance: 0, sequence: 0 };
    let splits: Vec<Digest> =
        [5, 2, 1].map(|clouds| world.publish(&clouds.to_string(), &vec![toy; clouds])).into();
    let mut scale =
        Scale { subject: Subject::sample(1), splits: splits.clone(), clouds: 8, described: vec![] };
    scale.subject.facts.description_bytes = MAX_DESCRIPTION_BYTES / fitting;
    let mut planner = Planner::default();
    planner.set_shard_count(ShardCount::Fixed(2.try_into().unwrap()));
    let mut jobs = JobStore::default();
    planner.decide_scales(std::slice::from_ref(&scale), 8, &mut jobs);
    let laid_out = lay_out_scale(&world, &scale, &jobs).1.unwrap();
    let shards: Vec<&Shard> = laid_out.iter().flat_map(|(_, side)| &side.shards).collect();
    assert_eq!(shards.len(), 3 + 1 + 1);
    assert!(shards.iter().all(|shard| shard.clouds.len() as u64 <= fitting), "{shards:?}");
    // A split that is one shard is not listed anew.
    assert!(splits[1..].iter().all(|split| shards.iter().any(|shard| shard.manifest == *split)));

    scale.subject.facts.description_bytes = MAX_DESCRIPTION_BYTES + 1;
    let plan =
        ShardPlan { query: SidePlan { shards: 2, ranges: 1 }, database: SidePlan { shards: 2, ranges: 1 } };
    jobs.set_plan(Task::Scale(scale.clone()).job(0), Some(plan));
    assert!(lay_out_scale(&world, &scale, &jobs).1.is_none());
}

#[test]
fn a_scale_that_was_begun_whole_stays_whole_and_a_plan_that_nobody_made_is_none() {
    let world = World::default();
    let toys: Vec<Toy> = (0..9).map(|number| Toy { number, instance: 0, sequence: 0 }).collect();
    let splits = vec![world.publish("split", &toys)];
    let scale = Scale { subject: Subject::sample(1), splits, clouds: 9, described: vec![] };
    let (asked, job) = (std::slice::from_ref(&scale), Task::Scale(scale.clone()).job(0));
    let mut planner = Planner::default();
    planner.set_shard_count(ShardCount::Fixed(3.try_into().unwrap()));
    let plans = planner.decide_scales(asked, 8, &mut JobStore::default());
    assert_eq!((plans.len(), plans[0].0, plans[0].1.query.shards), (1, job, 3));

    let mut held = JobStore::default();
    held.restore(Recorded { leases: vec![(job, 1, WorkerId([1; 16]))], ..Recorded::default() });
    assert_eq!(planner.decide_scales(asked, 8, &mut held), []);
    assert!(lay_out_scale(&world, &scale, &held).1.is_none());

    let side = SidePlan { shards: 10, ranges: 1 };
    let plan = ShardPlan { query: side, database: side };
    let mut damaged = JobStore::default();
    damaged.restore(Recorded { plans: [(job, plan)].into(), ..Recorded::default() });
    assert_eq!(planner.decide_scales(asked, 8, &mut damaged), plans, "another is made");

    let mut jobs = JobStore::default();
    planner.decide_scales(asked, 8, &mut jobs);
    assert!(lay_out_scale(&World::default(), &scale, &jobs).1.is_none(), "it is not published");
}

/// Twenty queries and a database of thirty clouds, on machines that take an hour for them.
fn slow() -> (World, Evaluation, Planner) {
    let world = World::default();
    let toys: Vec<Toy> =
        (0..30).map(|index| Toy { number: index % 9, instance: u32::from(index) % 4, sequence: 0 }).collect();
    let evaluation = Evaluation {
        subject: Subject::sample(1),
        query: vec![world.publish("query", &toys[..20])],
        database: vec![world.publish("database", &toys)],
        ..Evaluation::sample(1, 20, 30)
    };
    let mut planner = Planner::default();
    planner.observe(&Task::Evaluation(evaluation.clone()), 3600.0);
    (world, evaluation, planner)
}

#[test]
fn subtasks_are_accounted_for_together() {
    let (world, evaluation, planner) = slow();
    let mut jobs = JobStore::default();
    let (done, tasks) = carry_out(&world, std::slice::from_ref(&evaluation), &planner, &mut jobs, 7);
    assert!(tasks > 16, "{tasks}");
    let Finished { worker, attempt, run_seconds, assurance, .. } = &done[0];
    assert_eq!((worker.as_str(), *attempt, *assurance), ("2 workers", 1, Assurance::Audited));
    assert_eq!(*run_seconds, 0.5 * tasks as f64);
}

#[test]
fn a_run_that_goes_on_keeps_to_its_plans_and_to_what_it_asked_whole() {
    let (world, evaluation, planner) = slow();
    let load = Load { jobs: 0, workers: 8 };
    let asked = std::slice::from_ref(&evaluation);
    let plans = planner.decide(asked, Waiting::default(), load, &mut JobStore::default());
    let job = Task::Evaluation(evaluation.clone()).job(0);
    assert_eq!(plans[0].0, job);
    let restored = |plan| {
        let mut jobs = JobStore::default();
        jobs.restore(Recorded { plans: [(job, plan)].into(), ..Recorded::default() });
        jobs
    };

    // Nobody has come back yet, and nothing was measured.
    let (again, mut jobs) = (Planner::default(), restored(plans[0].1));
    assert_eq!(jobs.plan(job), Some(Some(plans[0].1)));
    let alone = Load { jobs: 0, workers: 0 };
    assert_eq!(again.decide(asked, Waiting::default(), alone, &mut jobs), []);
    assert_eq!(lay_out(&world, &evaluation, &jobs).1.unwrap().0, plans[0].1);

    // A plan that nobody can have made is none.
    let side = SidePlan { shards: 4000, ranges: 2 };
    let mut damaged = restored(ShardPlan { query: side, database: side });
    assert_eq!(again.decide(asked, Waiting::default(), alone, &mut damaged), []);
    assert!(lay_out(&world, &evaluation, &damaged).1.is_none());

    // What a worker may still hold is not sharded.
    let mut held = JobStore::default();
    let leases = vec![(job, 1, WorkerId([1; 16]))];
    held.restore(Recorded { leases, ..Recorded::default() });
    assert_eq!(planner.decide(asked, Waiting::default(), load, &mut held), []);
    assert!(lay_out(&world, &evaluation, &held).1.is_none());
}

#[test]
fn what_is_not_published_is_not_sharded() {
    let (mut world, evaluation, planner) = slow();
    let mut jobs = JobStore::default();
    let load = Load { jobs: 0, workers: 8 };
    planner.decide(std::slice::from_ref(&evaluation), Waiting::default(), load, &mut jobs);
    world.blobs = BlobStore::default();
    assert!(lay_out(&world, &evaluation, &jobs).1.is_none());
}
