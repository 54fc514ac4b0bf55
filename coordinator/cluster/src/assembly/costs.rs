//! What pieces of an evaluation will take.

use std::collections::VecDeque;

use descriptor::Descriptor;

use crate::shard::Description;
use crate::task::Task;

/// Describing one cloud on one thread of the machine of the figures in `tests/benches`, seconds.
const CLOUD_SECONDS: f64 = 60e-6;
/// Matching one pair of clouds on it, seconds.
const PAIR_SECONDS: f64 = 60e-9;
/// Measurements a median is taken of.
const RECENT: usize = 63;
/// A factor beyond these is none of a machine's.
const FACTORS: [f64; 2] = [1e-3, 1e5];

/// How much slower than that machine the workers are, by what their recent tasks took.
#[derive(Clone, Debug, Default)]
pub struct Costs {
    /// In describing.
    clouds: Factor,
    /// In matching.
    pairs: Factor,
    /// In whole evaluations, which do both.
    whole: Factor,
}

#[derive(Clone, Debug, Default)]
struct Factor(VecDeque<f64>);

impl Costs {
    /// So many seconds of one worker for describing clouds.
    pub fn describing(&self, clouds: u64) -> f64 {
        clouds as f64 * CLOUD_SECONDS * self.clouds.median().or(self.whole.median()).unwrap_or(1.0)
    }

    /// So many seconds of one worker for matching pairs of clouds.
    pub fn matching(&self, pairs: u64) -> f64 {
        pairs as f64 * PAIR_SECONDS * self.pairs.median().or(self.whole.median()).unwrap_or(1.0)
    }

    /// Takes in what a task has taken.
    pub fn observe(&mut self, task: &Task, seconds: f64) {
        let pairs = |queries: u32, database: u32| f64::from(queries) * f64::from(database) * PAIR_SECONDS;
        match task {
            Task::Evaluation(whole) => {
                let clouds = f64::from(whole.queries) + f64::from(whole.database_clouds);
                let predicted = clouds * CLOUD_SECONDS + pairs(whole.queries, whole.database_clouds);
                self.whole.add(seconds / predicted);
            }
            Task::Description(Description { descriptor: Descriptor::DiskRing(_), clouds, .. }) => {
                self.clouds.add(seconds / (f64::from(*clouds) * CLOUD_SECONDS));
            }
            Task::Tile(tile) => {
                let (queries, database) = (tile.evaluation.queries, tile.evaluation.database_clouds);
                self.pairs.add(seconds / pairs(queries, database));
            }
            Task::GridCell(_) | Task::Description(_) => {} // never in pieces
        }
    }

    /// Those of machines that are slower by this.
    #[cfg(test)]
    pub fn slower(factor: f64) -> Self {
        let mut costs = Self::default();
        costs.whole.add(factor);
        costs
    }
}

impl Factor {
    fn add(&mut self, factor: f64) {
        if factor.is_nan() {
            return; // of nothing
        }
        if self.0.len() == RECENT {
            self.0.pop_front();
        }
        let [least, most] = FACTORS;
        self.0.push_back(factor.clamp(least, most));
    }

    fn median(&self) -> Option<f64> {
        let mut sorted: Vec<f64> = self.0.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied()
    }
}

#[cfg(test)]
mod tests {
    use descriptor::Parameters;
    use proto::Digest;

    use super::*;
    use crate::evaluation::Evaluation;

    #[test]
    fn predictions_follow_the_median_of_what_recent_tasks_took() {
        let (parameters, manifest) = (Parameters::PAPER_BEST, Digest([0; 32]));
        let evaluation = Evaluation { parameters, ..Evaluation::sample(1000, 1000) };
        let mut costs = Costs::default();
        let [describing, matching] = [costs.describing(2000), costs.matching(1_000_000)];
        let whole = Task::Evaluation(evaluation);
        costs.observe(&whole, 3.0 * (describing + matching));
        let about =
            |seconds: f64, expected: f64| assert!((seconds / expected - 1.0).abs() < 1e-9, "{seconds}");
        about(costs.describing(2000), 3.0 * describing);
        about(costs.matching(1_000_000), 3.0 * matching);

        // What was measured by itself counts before what was measured with something else.
        let shard = Task::Description(Description {
            descriptor: Descriptor::DiskRing(parameters),
            manifest,
            clouds: 1000,
        });
        for factor in [2.0, 2.0, 1e9] {
            costs.observe(&shard, factor * describing / 2.0);
        }
        about(costs.describing(2000), 2.0 * describing);
        about(costs.matching(1_000_000), 3.0 * matching);
        for _ in 0..RECENT {
            costs.observe(&shard, f64::INFINITY);
        }
        about(costs.describing(2000), FACTORS[1] * describing);
        assert_eq!(costs.clouds.0.len(), RECENT);
    }
}
