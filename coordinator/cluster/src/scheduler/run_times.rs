//! How long tasks of one kind and about one cost take: what says when one takes too long.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use proto::task::TaskKind;

use crate::cost::CountedCost;

/// Run times a median is taken of: so many that one slow machine does not move it, so few that it follows caches that
/// warm up.
const RECENT: usize = 63;

/// Tasks of one kind whose costs differ by less than a factor of two: within it, time is in proportion to cost, whatever
/// a task takes beside its computation.
type Class = (TaskKind, u32);

/// Recent run times of tasks of each class.
#[derive(Debug, Default)]
pub(super) struct RunTimes {
    classes: BTreeMap<Class, Recent>,
}

/// Seconds for each unit of cost.
#[derive(Debug, Default)]
struct Recent {
    in_order: VecDeque<f64>,
    sorted: Vec<f64>,
}

impl RunTimes {
    /// Adds a run time and returns whether it is the first of its class.
    pub(super) fn add(&mut self, cost: CountedCost, time: Duration) -> bool {
        let (class, units) = class(cost);
        let seconds = time.as_secs_f64() / units;
        let recent = self.classes.entry(class).or_default();
        let place = |sorted: &[f64], seconds: f64| sorted.partition_point(|&other| other < seconds);
        if recent.in_order.len() == RECENT
            && let Some(oldest) = recent.in_order.pop_front()
        {
            recent.sorted.remove(place(&recent.sorted, oldest));
        }
        recent.in_order.push_back(seconds);
        recent.sorted.insert(place(&recent.sorted, seconds), seconds);
        recent.sorted.len() == 1
    }

    /// What a task of this cost takes by the median of the recent ones of its class, if there was one.
    pub(super) fn expected(&self, cost: CountedCost) -> Option<Duration> {
        let (class, units) = class(cost);
        let sorted = &self.classes.get(&class)?.sorted;
        sorted.get(sorted.len() / 2).map(|seconds| Duration::from_secs_f64(seconds * units))
    }
}

fn class(CountedCost { kind, units }: CountedCost) -> (Class, f64) {
    let units = units.max(1);
    ((kind, units.ilog2()), units as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The cost of an evaluation.
    fn evaluation(units: u64) -> CountedCost {
        CountedCost { kind: TaskKind::Evaluation, units }
    }

    #[test]
    fn the_median_follows_the_recent_ones_of_its_kind_and_cost() {
        let mut times = RunTimes::default();
        let cost = evaluation(1024);
        assert_eq!(times.expected(cost), None);
        assert!(times.add(cost, Duration::from_secs(9)));
        assert_eq!(times.expected(cost), Some(Duration::from_secs(9)));
        for seconds in [1, 2, 1, 2] {
            assert!(!times.add(cost, Duration::from_secs(seconds)));
        }
        assert_eq!(times.expected(cost), Some(Duration::from_secs(2)));
        for _ in 0..RECENT {
            times.add(cost, Duration::from_secs(5));
        }
        assert_eq!(times.expected(cost), Some(Duration::from_secs(5)));
        assert_eq!(times.classes[&class(cost).0].sorted.len(), RECENT);
    }

    #[test]
    fn tasks_of_about_the_same_cost_tell_of_each_other_in_proportion() {
        let mut times = RunTimes::default();
        assert!(times.add(evaluation(1024), Duration::from_secs(2)));
        assert!(!times.add(evaluation(1536), Duration::from_secs(3)));
        assert_eq!(times.expected(evaluation(1536)), Some(Duration::from_secs(3)));
        assert_eq!(times.expected(evaluation(2047)).map(|time| time.as_millis()), Some(3998));
        // Of one that costs a hundred times as much nothing is known yet, nor of one of another kind.
        assert_eq!(times.expected(evaluation(102_400)), None);
        assert_eq!(times.expected(CountedCost { kind: TaskKind::Tile, units: 1024 }), None);
    }
}
