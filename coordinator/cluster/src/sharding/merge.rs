//! Results of tiles as that of the whole: equal, bit for bit, in whatever order tiles come.

use proto::task::{EvaluationResult, Label, Match, MatchingRule, Nearest, is_nearer};

/// What is found for some queries in the part of the database that was looked at so far.
#[derive(Clone, Debug)]
pub struct Merged {
    rule: MatchingRule,
    found: Found,
}

#[derive(Clone, Debug)]
enum Found {
    /// Under the default rule.
    Matches(Vec<Option<Match>>),
    /// Under any other.
    Nearest(Vec<Nearest>),
}

impl Merged {
    /// Nothing was looked at.
    pub fn new(queries: usize, rule: MatchingRule) -> Self {
        let found = if rule.is_default() {
            Found::Matches(vec![None; queries])
        } else {
            Found::Nearest(vec![Nearest::default(); queries])
        };
        Self { rule, found }
    }

    /// Takes in what is found for the queries from `first` on in the part of the database that begins at `offset`;
    /// `labels` are of the whole database.
    pub fn take(&mut self, first: usize, result: &EvaluationResult, offset: u32, labels: &[Label]) {
        match &mut self.found {
            Found::Matches(matches) => {
                for (merged, found) in matches[first..].iter_mut().zip(&result.matches) {
                    let found = Match {
                        nearest: found.nearest + offset,
                        runner_up: found.runner_up.map(|(index, distance)| (index + offset, distance)),
                        ..*found
                    };
                    *merged = Some(merged.map_or(found, |merged| nearer(merged, found, labels)));
                }
            }
            Found::Nearest(nearest) => {
                for (merged, part) in nearest[first..].iter_mut().zip(&result.nearest) {
                    *merged = merged.merge(*part, offset);
                }
            }
        }
    }

    /// The result of queries that show `queries`, once every part of the database was looked at.
    pub fn finish(self, queries: &[Label], database: &[Label], want_matches: bool) -> EvaluationResult {
        match self.found {
            Found::Matches(matches) => {
                let matches: Vec<Match> = matches.into_iter().flatten().collect();
                let pairs = || matches.iter().map(|found| &database[found.nearest as usize]).zip(queries);
                let correct =
                    |is_right: fn((&Label, &Label)) -> bool| pairs().filter(|&pair| is_right(pair)).count();
                EvaluationResult {
                    queries: queries.len() as u32,
                    object_correct: correct(|(found, query)| found.instance == query.instance) as u32,
                    category_correct: correct(|(found, query)| found.category == query.category) as u32,
                    matches: if want_matches { matches } else { Vec::new() },
                    ..EvaluationResult::default()
                }
            }
            Found::Nearest(nearest) => {
                let counts = self.rule.count(&nearest, queries, database);
                EvaluationResult { nearest: if want_matches { nearest } else { Vec::new() }, ..counts }
            }
        }
    }
}

/// The match with two parts of a database, of those with each of them.
fn nearer(one: Match, other: Match, labels: &[Label]) -> Match {
    let (near, far) = if is_nearer(nearest(&one), nearest(&other)) { (one, other) } else { (other, one) };
    let object = |index: u32| labels[index as usize].instance;
    // The nearest of the other part that shows another object: its nearest, or else its runner-up, which is of another
    // object than its nearest.
    let beside =
        if object(far.nearest) == object(near.nearest) { far.runner_up } else { Some(nearest(&far)) };
    let runner_up = match (near.runner_up, beside) {
        (Some(one), Some(other)) => Some(if is_nearer(one, other) { one } else { other }),
        (one, other) => one.or(other),
    };
    Match { runner_up, ..near }
}

fn nearest(found: &Match) -> (u32, f64) {
    (found.nearest, found.distance)
}
