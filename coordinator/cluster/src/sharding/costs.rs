//! How long shards and tiles of an evaluation will take.

use std::collections::VecDeque;

use proto::task::{Scale, Task, TaskKind};

use crate::cost::{CountedCost, counted_cost};

/// One unit of counted cost on one thread of the machine of the figures in `tests/benches`, seconds.
const UNIT_SECONDS: f64 = 1e-9;
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
    /// In whole scales, which do both, too.
    scales: Factor,
}

#[derive(Clone, Debug, Default)]
struct Factor(VecDeque<f64>);

impl Costs {
    /// Seconds of one worker for describing clouds of so much counted cost.
    pub fn describing(&self, cost: u64) -> f64 {
        cost as f64 * UNIT_SECONDS * self.clouds.median().or(self.whole.median()).unwrap_or(1.0)
    }

    /// Seconds of one worker for matching pairs of clouds of so much counted cost.
    pub fn matching(&self, cost: u64) -> f64 {
        cost as f64 * UNIT_SECONDS * self.pairs.median().or(self.whole.median()).unwrap_or(1.0)
    }

    /// Seconds of one worker for describing the clouds of a scale.
    pub fn describing_for(&self, scale: &Scale) -> f64 {
        let units = Task::Scale(scale.clone()).describing_cost();
        units as f64 * UNIT_SECONDS * self.scales.median().or(self.clouds.median()).unwrap_or(1.0)
    }

    /// Takes in what a task has taken.
    pub fn observe(&mut self, task: &Task, seconds: f64) {
        if task.descriptions().next().is_some() && task.kind() != TaskKind::Tile {
            return; // of its clouds some were described before: it says nothing of others
        }
        let CountedCost { kind, units } = counted_cost(task);
        let factor = match kind {
            TaskKind::Evaluation => &mut self.whole,
            TaskKind::Description => &mut self.clouds,
            TaskKind::Tile => &mut self.pairs,
            TaskKind::Scale => &mut self.scales,
            TaskKind::GridCell => return, // never sharded
        };
        factor.add(seconds / (units as f64 * UNIT_SECONDS));
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
    use proto::Digest;
    use proto::task::{DescribedShard, DescribedSplit, Description, Evaluation, Subject};

    use super::*;

    fn described() -> DescribedShard {
        DescribedShard { manifest: Digest([1; 32]), description: Digest([2; 32]) }
    }

    #[test]
    fn predictions_follow_the_median_of_what_recent_tasks_took() {
        let evaluation = Evaluation::sample(1, 1000, 1000);
        let (subject, manifest) = (evaluation.subject.clone(), Digest([0; 32]));
        let mut costs = Costs::default();
        let [describing, matching] = [costs.describing(120_000_000), costs.matching(60_000_000)];
        let whole = Task::Evaluation(evaluation);
        costs.observe(&whole, 3.0 * (describing + matching));
        let about =
            |seconds: f64, expected: f64| assert!((seconds / expected - 1.0).abs() < 1e-9, "{seconds}");
        about(costs.describing(120_000_000), 3.0 * describing);
        about(costs.matching(60_000_000), 3.0 * matching);

        // What was measured by itself counts before what was measured with something else.
        let shard = Task::Description(Description { subject, manifest, clouds: 1000 });
        for factor in [2.0, 2.0, 1e9] {
            costs.observe(&shard, factor * describing / 2.0);
        }
        about(costs.describing(120_000_000), 2.0 * describing);
        about(costs.matching(60_000_000), 3.0 * matching);
        // Whole scales say how long scales take; those of clouds that were described before do not.
        let subject = Subject::sample(1);
        let scale = Scale { subject, splits: Vec::new(), clouds: 1000, described: Vec::new() };
        let matched = DescribedSplit { channel: 0, split: Digest([1; 32]), shards: vec![described()] };
        let before = Costs::default().describing_for(&scale);
        about(costs.describing_for(&scale), 2.0 * before);
        costs.observe(&Task::Scale(Scale { described: vec![matched], ..scale.clone() }), 1e9);
        about(costs.describing_for(&scale), 2.0 * before);
        costs.observe(
            &Task::Scale(scale.clone()),
            5.0 * counted_cost(&Task::Scale(scale.clone())).units as f64 * 1e-9,
        );
        about(costs.describing_for(&scale), 5.0 * before);
        for _ in 0..RECENT {
            costs.observe(&shard, f64::INFINITY);
        }
        about(costs.describing(120_000_000), FACTORS[1] * describing);
        assert_eq!(costs.clouds.0.len(), RECENT);
    }
}
