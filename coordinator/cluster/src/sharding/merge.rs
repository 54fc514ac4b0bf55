//! Matches of tiles as those of the whole: equal, bit for bit, in whatever order tiles come.

use std::cmp::Ordering;

use proto::task::{Label, Match};

/// The matches of some queries with the part of the database that was looked at so far.
#[derive(Clone, Debug, Default)]
pub struct Merged {
    matches: Vec<Option<Match>>,
}

impl Merged {
    /// Nothing was looked at.
    pub fn new(queries: usize) -> Self {
        Self { matches: vec![None; queries] }
    }

    /// Takes in the matches of the queries from `first` on with the part of the database that begins at `offset`;
    /// `labels` are of the whole database.
    pub fn take(&mut self, first: usize, matches: &[Match], offset: u32, labels: &[Label]) {
        for (merged, found) in self.matches[first..].iter_mut().zip(matches) {
            let found = Match {
                nearest: found.nearest + offset,
                runner_up: found.runner_up.map(|(index, distance)| (index + offset, distance)),
                ..*found
            };
            *merged = Some(merged.map_or(found, |merged| nearer(merged, found, labels)));
        }
    }

    /// One match a query, once every part was looked at.
    pub fn finish(self) -> Vec<Match> {
        self.matches.into_iter().flatten().collect()
    }
}

/// The match with two parts of a database, of those with each of them.
fn nearer(one: Match, other: Match, labels: &[Label]) -> Match {
    let (near, far) = if before(nearest(&one), nearest(&other)) { (one, other) } else { (other, one) };
    let object = |index: u32| labels[index as usize].instance;
    // The nearest of the other part that shows another object: its nearest, or else its runner-up, which is of another
    // object than its nearest.
    let beside =
        if object(far.nearest) == object(near.nearest) { far.runner_up } else { Some(nearest(&far)) };
    let runner_up = match (near.runner_up, beside) {
        (Some(one), Some(other)) => Some(if before(one, other) { one } else { other }),
        (one, other) => one.or(other),
    };
    Match { runner_up, ..near }
}

fn nearest(found: &Match) -> (u32, f64) {
    (found.nearest, found.distance)
}

/// Of equal distances the lowest index counts.
fn before(one: (u32, f64), other: (u32, f64)) -> bool {
    one.1.total_cmp(&other.1).then(one.0.cmp(&other.0)) == Ordering::Less
}
