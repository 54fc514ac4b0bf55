//! The shard plan of an evaluation: how many shards and tiles, and which clouds fall to each.

use std::num::NonZeroU32;
use std::ops::Range;

use proto::MAX_DESCRIPTION_BYTES;
use proto::task::{Evaluation, Scale};

use super::costs::Costs;
use crate::blobs::DESCRIPTIONS;

/// A shard that is predicted to take less is not worth its overhead, seconds; …
const LEAST_SHARD: f64 = 0.1;
/// … nor is a tile, whose result is small.
const LEAST_TILE: f64 = 0.05;
/// A channel that takes less is described by each worker that needs it: the tasks beside would take as long as taking its
/// descriptions from the coordinator saves, seconds.
const LEAST_DESCRIBED: f64 = 0.02;
/// What the coordinator's network of 1 Gbit/s carries, bytes a second.
const NETWORK: f64 = 1.1e8;
/// So many workers take a description from the coordinator, as far as there are others: in searches for structures it was
/// 1.3 with six workers and 1.6 with ten.
const TAKERS: usize = 2;
/// What is left of a description that is compressed, as a share: a third of it in a search for structures.
const COMPRESSED: f64 = 0.35;
/// The coordinator has room for the descriptions of so many channels, which a population may have.
const CHANNELS_KEPT: f64 = 64.0;
/// Shards per worker of all evaluations: several, so that a slow one does not hold up all others.
const SHARDS_PER_WORKER: f64 = 2.0;
/// Tiles per worker of all that is left to match, which are rounded up to a power of two.
const TILES_PER_WORKER: f64 = 1.5;
/// The most shards, and the most tiles, of one evaluation.
pub const MAX_SHARDS: u32 = 4096;

/// Into how many shards and tiles the experiment wants an evaluation divided.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ShardCount {
    /// As many as keep the workers busy.
    #[default]
    Auto,
    /// This many of each kind, as far as there are clouds; 1 shards nothing.
    Fixed(NonZeroU32),
}

/// What there is to do, and who is there to do it.
#[derive(Clone, Copy, Debug)]
pub struct Load {
    /// Evaluations that are asked for together, and other jobs that are under way.
    pub jobs: usize,
    /// Workers that are there.
    pub workers: usize,
}

/// How one side, queries or database, is sharded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SidePlan {
    /// Shards, in which clouds are described, at least 1.
    pub shards: u32,
    /// Ranges of shards, which are sides of tiles, 1 to `shards`.
    pub ranges: u32,
}

/// How an evaluation is sharded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShardPlan {
    /// The queries.
    pub query: SidePlan,
    /// The database.
    pub database: SidePlan,
}

impl ShardPlan {
    /// How to shard an evaluation; `None`: not at all. `left` is how long one worker would be matching this evaluation
    /// and those that are handed out after it, seconds.
    pub fn of(
        evaluation: &Evaluation,
        shard_count: ShardCount,
        (load, left): (Load, f64),
        costs: &Costs,
    ) -> Option<Self> {
        let (queries, database) = (evaluation.queries, evaluation.database_clouds);
        if queries == 0 || database == 0 {
            return None;
        }
        let (shards, tiles) = match shard_count {
            ShardCount::Fixed(count) => (count.get(), count.get()),
            ShardCount::Auto if load.workers < 2 => return None,
            ShardCount::Auto => {
                let shards = SHARDS_PER_WORKER * load.workers as f64 / load.jobs.max(1) as f64;
                if shards <= 1.0 {
                    return None;
                }
                let matching = costs.matching(pairs_cost(evaluation));
                let describing = costs.describing(clouds_cost(evaluation));
                // Its channels have scales, so that workers have described most of its clouds already. They keep that by
                // split: shards would have to be described again.
                if !evaluation.scales.is_empty() && matching < describing {
                    return None;
                }
                // Tiles are what the workers end with: the less is left, the smaller they are.
                let tiles = TILES_PER_WORKER * load.workers as f64 * matching / left.max(matching);
                // Of few sizes, all even: each number of shards has manifests of its own.
                let power = |wanted: f64, seconds: f64, least: f64| {
                    let wanted = (wanted.ceil() as u32).min(MAX_SHARDS).next_power_of_two();
                    wanted.min(previous_power((seconds / least) as u32))
                };
                (power(shards, describing, LEAST_SHARD), power(tiles, matching, LEAST_TILE))
            }
        };
        if shards.max(tiles) < 2 {
            return None;
        }
        let [of_query, of_database] = tile_sides(tiles, queries, database);
        let length =
            |clouds: u32| u64::from(clouds).saturating_mul(evaluation.subject.facts.description_bytes);
        let least = |clouds| length(clouds).div_ceil(MAX_DESCRIPTION_BYTES);
        let side = |clouds: u32, ranges: u32| {
            let share = u64::from(shards) * u64::from(clouds) / (u64::from(queries) + u64::from(database));
            let shards = share.max(least(clouds)).max(u64::from(ranges));
            let shards = shards.next_power_of_two().clamp(1, u64::from(clouds)) as u32;
            SidePlan { shards, ranges: ranges.min(shards) }
        };
        let plan = Self { query: side(queries, of_query), database: side(database, of_database) };
        // A cloud that no message can describe is described where it is matched.
        let fits = |SidePlan { shards, .. }: SidePlan, clouds: u32| {
            let largest = clouds.div_ceil(shards);
            length(largest) <= MAX_DESCRIPTION_BYTES
        };
        (fits(plan.query, queries) && fits(plan.database, database)).then_some(plan)
    }

    /// How to shard a scale; `None`: not at all. What is described in shards is at the coordinator, from which workers take
    /// it for the scale and for evaluations with its channel, instead of describing it again. There may be more shards:
    /// each split has one, and each fits into a message.
    pub fn of_scale(scale: &Scale, shard_count: ShardCount, workers: usize, costs: &Costs) -> Option<Self> {
        let clouds = scale.clouds;
        let length = u64::from(clouds).saturating_mul(scale.subject.facts.description_bytes);
        let compressed = COMPRESSED * length as f64;
        let wanted = match shard_count {
            ShardCount::Fixed(count) if count.get() > 1 => count.get(),
            ShardCount::Auto if workers > 1 && compressed <= DESCRIPTIONS as f64 / CHANNELS_KEPT => {
                let seconds = costs.describing_for(scale);
                // All workers describe at the same time, and the coordinator has to keep up with them.
                let sending = compressed * (workers - 1).min(TAKERS) as f64 / NETWORK;
                if seconds < LEAST_DESCRIBED.max(sending * workers as f64) {
                    return None;
                }
                let most = workers.min(MAX_SHARDS as usize) as u32;
                previous_power(((seconds / LEAST_SHARD) as u32).min(most)).max(1)
            }
            ShardCount::Fixed(_) | ShardCount::Auto => return None,
        };
        // A cloud that no message can describe is described where it is matched, like clouds that would take too many.
        let least = length.div_ceil(MAX_DESCRIPTION_BYTES);
        if clouds == 0 || least > u64::from(clouds.min(MAX_SHARDS)) {
            return None;
        }
        let side = SidePlan { shards: wanted.min(clouds), ranges: 1 };
        Some(Self { query: side, database: side })
    }

    /// Whether a scale of so many clouds can be sharded like this.
    pub fn suits_scale(&self, scale: &Scale) -> bool {
        (1..=scale.clouds).contains(&self.query.shards)
    }

    /// Whether an evaluation of so many clouds can be sharded like this.
    pub fn suits(&self, evaluation: &Evaluation) -> bool {
        let suits = |SidePlan { shards, ranges }: SidePlan, clouds: u32| {
            (1..=shards).contains(&ranges) && shards <= clouds
        };
        suits(self.query, evaluation.queries) && suits(self.database, evaluation.database_clouds)
    }
}

/// Counted cost of describing all clouds of an evaluation.
fn clouds_cost(evaluation: &Evaluation) -> u64 {
    let clouds = u64::from(evaluation.queries) + u64::from(evaluation.database_clouds);
    clouds.saturating_mul(evaluation.subject.facts.cloud_cost)
}

/// Counted cost of matching all pairs of an evaluation.
pub fn pairs_cost(evaluation: &Evaluation) -> u64 {
    let pairs = u64::from(evaluation.queries) * u64::from(evaluation.database_clouds);
    pairs.saturating_mul(evaluation.subject.facts.pair_cost)
}

/// Which of `total` things fall to each of `parts`, in order, as evenly as can be.
pub fn shares(total: u32, parts: u32) -> impl Iterator<Item = Range<u32>> {
    let bound = move |part: u32| (u64::from(total) * u64::from(part) / u64::from(parts)) as u32;
    (0..parts).map(move |part| bound(part)..bound(part + 1))
}

/// Rows and columns of at most so many tiles, about as high as they are wide: these read the fewest descriptions. Of a
/// power of two both are, too, which divide the shards into equal ranges.
fn tile_sides(tiles: u32, queries: u32, database: u32) -> [u32; 2] {
    let tiles = tiles.max(1);
    let rows = (f64::from(tiles) * f64::from(queries) / f64::from(database)).sqrt().round() as u32;
    let rows = if tiles.is_power_of_two() { previous_power(rows) } else { rows };
    let rows = rows.clamp(1, tiles.min(queries));
    [rows, (tiles / rows).clamp(1, database)]
}

/// The largest power of two that is not above `number`; 0 of 0.
fn previous_power(number: u32) -> u32 {
    number.checked_ilog2().map_or(0, |exponent| 1 << exponent)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use proto::task::{Facts, Subject};

    use super::*;

    /// Bytes of a cloud's description under the paper's best descriptor.
    const SIGNATURE: u64 = 1504;

    fn evaluation(queries: u32, database_clouds: u32) -> Evaluation {
        let mut evaluation = Evaluation::sample(1, queries, database_clouds);
        evaluation.subject.facts.description_bytes = SIGNATURE;
        evaluation
    }

    fn fixed(count: u32) -> ShardCount {
        ShardCount::Fixed(NonZeroU32::new(count).unwrap())
    }

    /// How the last of ten evaluations of so many clouds is sharded for so many workers.
    fn auto(clouds: u32, workers: usize) -> Option<ShardPlan> {
        one_of_ten(clouds, workers, 1.0)
    }

    /// How that is sharded after which so many are left, itself included.
    fn one_of_ten(clouds: u32, workers: usize, left: f64) -> Option<ShardPlan> {
        let (load, evaluation) = (Load { jobs: 10, workers }, evaluation(clouds, clouds));
        let seconds = left * Costs::default().matching(pairs_cost(&evaluation));
        ShardPlan::of(&evaluation, ShardCount::Auto, (load, seconds), &Costs::default())
    }

    #[test]
    fn nothing_is_cut_that_keeps_the_workers_busy_or_is_over_soon() {
        let large = 100_000;
        for (clouds, workers) in [(large, 0), (large, 1), (large, 5), (100, 1000)] {
            assert_eq!(auto(clouds, workers), None, "{clouds} clouds, {workers} workers");
        }
        let load = Load { jobs: 1, workers: 100 };
        for (queries, database) in [(0, 9), (9, 0)] {
            assert_eq!(
                ShardPlan::of(&evaluation(queries, database), fixed(9), (load, 0.0), &Costs::default()),
                None
            );
        }
        assert_eq!(ShardPlan::of(&evaluation(9, 9), fixed(1), (load, 0.0), &Costs::default()), None);
    }

    #[test]
    fn more_workers_get_more_pieces_and_the_last_tiles_are_the_smallest() {
        let tiles = |plan: ShardPlan| plan.query.ranges * plan.database.ranges;
        let of_workers = [10, 100, 1000].map(|workers| auto(100_000, workers).unwrap());
        assert_eq!(of_workers.map(tiles), [16, 256, 2048]);
        let of_a_hundred =
            [10, 7, 6, 4, 3, 2, 1].map(|left| tiles(one_of_ten(100_000, 100, f64::from(left)).unwrap()));
        assert_eq!(of_a_hundred, [16, 32, 32, 64, 64, 128, 256]);
        // Describing takes some ten seconds, which are not divided into more than a hundred shards.
        assert!(
            of_workers.iter().all(|plan| plan.query.shards + plan.database.shards <= 256),
            "{of_workers:?}"
        );
        // Only describing is worth while.
        let plan = auto(4000, 100).unwrap();
        assert!(plan.query.shards > 1 && tiles(plan) > 1, "{plan:?}");
    }

    #[test]
    fn tiles_of_an_evaluation_are_of_one_size() {
        for left in 1..=10 {
            let plan = one_of_ten(4096, 100, f64::from(left)).unwrap();
            for SidePlan { shards, ranges } in [plan.query, plan.database] {
                assert_eq!(shards % ranges, 0, "{plan:?}");
            }
        }
    }

    #[test]
    fn what_costs_more_is_divided_more_finely() {
        let plan = |factor: u64| {
            let mut evaluation = evaluation(1000, 1000);
            let Facts { cloud_cost, pair_cost, .. } = &mut evaluation.subject.facts;
            (*cloud_cost, *pair_cost) = (*cloud_cost * factor, *pair_cost * factor);
            ShardPlan::of(
                &evaluation,
                ShardCount::Auto,
                (Load { jobs: 10, workers: 1000 }, 0.0),
                &Costs::default(),
            )
        };
        assert_eq!(plan(1), None, "some tenths of a second");
        let dear = plan(100).unwrap();
        assert_eq!((dear.query.ranges, dear.database.ranges), (8, 8));
        assert_eq!(dear.query.shards + dear.database.shards, 64);
    }

    #[test]
    fn clouds_that_were_described_for_scales_are_not_described_again_unless_matching_them_takes_longer() {
        let plan = |shard_count, clouds: u32, has_scales: bool| {
            let mut evaluation = evaluation(clouds, clouds);
            evaluation.scales = if has_scales { vec![0.5] } else { Vec::new() };
            ShardPlan::of(&evaluation, shard_count, (Load { jobs: 1, workers: 10 }, 0.0), &Costs::default())
        };
        // Describing a cloud costs as much as matching a thousand pairs.
        for (clouds, is_sharded) in [(1500, false), (2500, true)] {
            assert!(plan(ShardCount::Auto, clouds, false).is_some(), "{clouds} clouds");
            assert_eq!(plan(ShardCount::Auto, clouds, true).is_some(), is_sharded, "{clouds} clouds");
            assert!(plan(fixed(4), clouds, true).is_some(), "{clouds} clouds");
        }
    }

    #[test]
    fn channels_that_are_dear_to_describe_are_described_once_and_in_shards() {
        let plan_of = |shard_count, clouds: u32, workers, description_bytes| {
            let mut subject = Subject::sample(1); // a cloud in 60 µs
            subject.facts.description_bytes = description_bytes;
            let scale = Scale { subject, splits: Vec::new(), clouds, described: Vec::new() };
            let plan = ShardPlan::of_scale(&scale, shard_count, workers, &Costs::default());
            assert!(plan.is_none_or(|plan| plan.suits_scale(&scale) && plan.query == plan.database));
            plan.map(|plan| plan.query.shards)
        };
        let plan = |shard_count, clouds, workers| plan_of(shard_count, clouds, workers, 8);
        for (clouds, workers, shards) in [
            (0, 10, None),
            (300, 10, None), // 0.018 s
            (400, 10, Some(1)),
            (400, 1, None), // nobody else needs it
            (4000, 10, Some(2)),
            (10_000, 10, Some(4)),
            (100_000, 10, Some(8)),
            (100_000, 3, Some(2)),
        ] {
            assert_eq!(plan(ShardCount::Auto, clouds, workers), shards, "{clouds} clouds, {workers} workers");
        }
        // The coordinator has no room for those of a population, or sends them more slowly than all workers describe.
        assert_eq!(plan(ShardCount::Auto, 1_600_000, 10), None);
        for (workers, bytes) in [(2, [9200, 9600]), (10, [920, 960])] {
            assert_eq!(
                bytes.map(|bytes| plan_of(ShardCount::Auto, 900, workers, bytes).is_some()),
                [true, false],
                "{workers} workers"
            );
        }
        for (count, clouds, shards) in [(1, 100, None), (4, 100, Some(4)), (4, 3, Some(3)), (4, 0, None)] {
            assert_eq!(plan(fixed(count), clouds, 1), shards, "{count} shards of {clouds} clouds");
        }
        let most = MAX_DESCRIPTION_BYTES;
        assert_eq!([most, most + 1].map(|bytes| plan_of(fixed(2), 9, 1, bytes)), [Some(2), None]);
        let clouds = [MAX_SHARDS, MAX_SHARDS + 1];
        assert_eq!(clouds.map(|clouds| plan_of(fixed(2), clouds, 1, most)), [Some(2), None]);
    }

    #[test]
    fn a_fixed_number_is_kept_as_far_as_there_are_clouds() {
        let load = Load { jobs: 100, workers: 1 };
        let plan = |count, queries, database| {
            let plan =
                ShardPlan::of(&evaluation(queries, database), fixed(count), (load, 0.0), &Costs::default());
            let ShardPlan { query, database } = plan.unwrap();
            [query.shards, query.ranges, database.shards, database.ranges]
        };
        assert_eq!(plan(16, 100, 100), [8, 4, 8, 4]);
        assert_eq!(plan(16, 10, 1000), [1, 1, 16, 16]);
        assert_eq!(plan(4096, 3, 5), [3, 3, 5, 5]);
        assert_eq!(plan(3, 10, 10), [2, 2, 1, 1]);
    }

    #[test]
    fn shards_fit_into_messages() {
        let load = Load { jobs: 1, workers: 1 };
        let huge = evaluation(1_000_000, 10);
        let plan = ShardPlan::of(&huge, fixed(2), (load, 0.0), &Costs::default()).unwrap();
        let largest = shares(1_000_000, plan.query.shards).map(|share| share.len() as u32).max().unwrap();
        assert!(u64::from(largest) * SIGNATURE <= MAX_DESCRIPTION_BYTES, "{plan:?}");
        let mut undescribable = evaluation(10, 10);
        undescribable.subject.facts.description_bytes = MAX_DESCRIPTION_BYTES + 1;
        assert_eq!(ShardPlan::of(&undescribable, fixed(4), (load, 0.0), &Costs::default()), None);
    }

    proptest! {
        #[test]
        fn every_cut_suits_its_evaluation_and_shares_are_all_there_is(
            queries in 0u32..500,
            database in 0u32..500,
            count in 1u32..=MAX_SHARDS,
            workers in 0usize..3000,
            jobs in 0usize..100,
            left in 0.0..1e4f64,
        ) {
            let evaluation = evaluation(queries, database);
            let slow = Costs::slower(1e4);
            for shard_count in [fixed(count), ShardCount::Auto] {
                let Some(plan) = ShardPlan::of(&evaluation, shard_count, (Load { jobs, workers }, left), &slow) else { continue };
                prop_assert!(plan.suits(&evaluation), "{plan:?}");
                let shares: Vec<_> = shares(queries, plan.query.shards).collect();
                prop_assert!(shares.iter().all(|share| !share.is_empty()));
                let all: Vec<u32> = shares.into_iter().flatten().collect();
                prop_assert_eq!(all, (0..queries).collect::<Vec<u32>>());
            }
        }
    }
}
