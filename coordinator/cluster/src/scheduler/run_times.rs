//! How long tasks of one kind take: what says when one takes too long.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use crate::task::Likeness;

/// Run times a median is taken of: so many that one slow machine does not move it, so few that it follows caches that
/// warm up.
const RECENT: usize = 63;

/// Recent run times of tasks of each kind.
#[derive(Debug, Default)]
pub(super) struct RunTimes {
    kinds: BTreeMap<Likeness, Recent>,
}

#[derive(Debug, Default)]
struct Recent {
    in_order: VecDeque<Duration>,
    sorted: Vec<Duration>,
}

impl RunTimes {
    /// Adds a run time and returns whether it is the first of its kind.
    pub(super) fn add(&mut self, kind: Likeness, time: Duration) -> bool {
        let recent = self.kinds.entry(kind).or_default();
        if recent.in_order.len() == RECENT
            && let Some(oldest) = recent.in_order.pop_front()
            && let Ok(place) = recent.sorted.binary_search(&oldest)
        {
            recent.sorted.remove(place);
        }
        recent.in_order.push_back(time);
        let place = recent.sorted.partition_point(|&other| other < time);
        recent.sorted.insert(place, time);
        recent.sorted.len() == 1
    }

    /// The median of the recent ones of its kind, if there was one.
    pub(super) fn median(&self, kind: Likeness) -> Option<Duration> {
        let sorted = &self.kinds.get(&kind)?.sorted;
        sorted.get(sorted.len() / 2).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_follows_the_recent_ones_of_its_kind() {
        let mut times = RunTimes::default();
        let (kind, other) = ([0, 1, 2], [0, 1, 3]);
        assert_eq!(times.median(kind), None);
        assert!(times.add(kind, Duration::from_secs(9)));
        assert_eq!(times.median(kind), Some(Duration::from_secs(9)));
        for seconds in [1, 2, 1, 2] {
            assert!(!times.add(kind, Duration::from_secs(seconds)));
        }
        assert_eq!(times.median(kind), Some(Duration::from_secs(2)));
        for _ in 0..RECENT {
            times.add(kind, Duration::from_secs(5));
        }
        assert_eq!(times.median(kind), Some(Duration::from_secs(5)));
        assert_eq!(times.kinds[&kind].sorted.len(), RECENT);
        assert_eq!(times.median(other), None);
    }
}
