//! How long tasks of one kind and about one cost take: what says when one takes too long.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use proto::task::{Task, TaskKind};

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
    pub(super) fn add(&mut self, task: &Task, time: Duration) -> bool {
        let (class, cost) = class(task);
        let seconds = time.as_secs_f64() / cost;
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

    /// What such a task takes by the median of the recent ones of its class, if there was one.
    pub(super) fn expected(&self, task: &Task) -> Option<Duration> {
        let (class, cost) = class(task);
        let sorted = &self.classes.get(&class)?.sorted;
        sorted.get(sorted.len() / 2).map(|seconds| Duration::from_secs_f64(seconds * cost))
    }
}

fn class(task: &Task) -> (Class, f64) {
    let cost = task.cost().max(1);
    ((task.kind(), cost.ilog2()), cost as f64)
}

#[cfg(test)]
mod tests {
    use proto::task::Evaluation;

    use super::*;

    /// An evaluation that costs so much.
    fn costs(cost: u64) -> Task {
        let mut evaluation = Evaluation::sample(1, 1, 0);
        evaluation.subject.facts.cloud_cost = cost;
        Task::Evaluation(evaluation)
    }

    #[test]
    fn the_median_follows_the_recent_ones_of_its_kind_and_cost() {
        let mut times = RunTimes::default();
        let task = costs(1024);
        assert_eq!(times.expected(&task), None);
        assert!(times.add(&task, Duration::from_secs(9)));
        assert_eq!(times.expected(&task), Some(Duration::from_secs(9)));
        for seconds in [1, 2, 1, 2] {
            assert!(!times.add(&task, Duration::from_secs(seconds)));
        }
        assert_eq!(times.expected(&task), Some(Duration::from_secs(2)));
        for _ in 0..RECENT {
            times.add(&task, Duration::from_secs(5));
        }
        assert_eq!(times.expected(&task), Some(Duration::from_secs(5)));
        assert_eq!(times.classes[&class(&task).0].sorted.len(), RECENT);
    }

    #[test]
    fn tasks_of_about_the_same_cost_tell_of_each_other_in_proportion() {
        let mut times = RunTimes::default();
        assert!(times.add(&costs(1024), Duration::from_secs(2)));
        assert!(!times.add(&costs(1536), Duration::from_secs(3)));
        assert_eq!(times.expected(&costs(1536)), Some(Duration::from_secs(3)));
        assert_eq!(times.expected(&costs(2047)).map(|time| time.as_millis()), Some(3998));
        // Of one that costs a hundred times as much nothing is known yet, nor of one of another kind.
        assert_eq!(times.expected(&costs(102_400)), None);
        let Task::Evaluation(evaluation) = costs(1024) else { panic!("another task") };
        let (query_descriptions, database_descriptions) = (vec![], vec![]);
        let tile = proto::task::Tile { evaluation, query_descriptions, database_descriptions };
        assert_eq!(times.expected(&Task::Tile(tile)), None);
    }
}
