//! One evaluation: what is asked of a worker, and what a worker may answer.

use descriptor::Parameters;
use proto::Digest;

/// Describe the clouds of some splits with one set of parameters and match queries against the database.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Evaluation {
    /// The descriptor.
    pub parameters: Parameters,
    /// Split manifests of the queries, in order.
    pub query: Vec<Digest>,
    /// Split manifests of the database, in order.
    pub database: Vec<Digest>,
    /// Clouds in `query`.
    pub queries: u32,
    /// Clouds in `database`.
    pub database_clouds: u32,
    /// Whether each query's match is wanted, or only the counts.
    pub want_matches: bool,
}

/// What an evaluation gives.
#[derive(Clone, Debug, PartialEq)]
pub struct EvaluationResult {
    /// Number of queries.
    pub queries: u32,
    /// Queries whose nearest cloud is of the same object.
    pub object_correct: u32,
    /// Queries whose nearest cloud is of the same category.
    pub category_correct: u32,
    /// One a query if they were wanted, else none.
    pub matches: Vec<Match>,
}

/// A query's nearest database cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Index of the nearest cloud.
    pub nearest: u32,
    /// Its set distance.
    pub distance: f64,
    /// Index and set distance of the nearest cloud of another object, if there is one.
    pub runner_up: Option<(u32, f64)>,
}

#[cfg(test)]
impl Evaluation {
    /// For tests: counts of the paper's best descriptor on so many queries and database clouds, of no split in particular.
    pub fn sample(queries: u32, database_clouds: u32) -> Self {
        let (query, database, want_matches) = (vec![], vec![], false);
        Self { parameters: Parameters::PAPER_BEST, query, database, queries, database_clouds, want_matches }
    }
}

impl Evaluation {
    /// Refuses an answer that cannot be one to this evaluation: wrong numbers of clouds, impossible counts,
    /// indices out of range, distances that are no distances.
    pub fn check(&self, result: &EvaluationResult) -> Result<(), String> {
        if result.queries != self.queries {
            return Err(format!("queries: must be {}, got {}", self.queries, result.queries));
        }
        // The same object is of the same category, so the category can only be right more often.
        if result.object_correct > result.category_correct || result.category_correct > self.queries {
            return Err(format!(
                "counts: must be object <= category <= {}, got {} and {}",
                self.queries, result.object_correct, result.category_correct
            ));
        }
        let wanted = if self.want_matches { self.queries as usize } else { 0 };
        if result.matches.len() != wanted {
            return Err(format!("matches: must be {wanted}, got {}", result.matches.len()));
        }
        for found in &result.matches {
            let clouds = std::iter::once((found.nearest, found.distance)).chain(found.runner_up);
            for (index, distance) in clouds {
                if index >= self.database_clouds || !distance.is_finite() || distance < 0.0 {
                    return Err(format!(
                        "match: must name one of {} clouds at a finite distance, got {index} at {distance}",
                        self.database_clouds
                    ));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_answers_are_refused() {
        let evaluation = Evaluation { want_matches: true, ..Evaluation::sample(2, 3) };
        let found = Match { nearest: 2, distance: 0.5, runner_up: Some((0, 0.75)) };
        let good = EvaluationResult {
            queries: 2,
            object_correct: 1,
            category_correct: 2,
            matches: vec![found, found],
        };
        assert_eq!(evaluation.check(&good), Ok(()));
        let bad: [fn(&mut EvaluationResult); 8] = [
            |result| result.queries = 3,
            |result| result.object_correct = 3,
            |result| result.category_correct = 0,
            |result| result.matches.truncate(1),
            |result| result.matches[0].nearest = 3,
            |result| result.matches[1].distance = f64::NAN,
            |result| result.matches[1].distance = -1.0,
            |result| result.matches[0].runner_up = Some((3, 1.0)),
        ];
        for spoil in bad {
            let mut result = good.clone();
            spoil(&mut result);
            assert!(evaluation.check(&result).is_err(), "{result:?}");
        }
        let counts_only = Evaluation { want_matches: false, ..evaluation };
        assert!(counts_only.check(&good).is_err());
    }
}
