//! How many answers are wrong, of how many that were asked for.

use super::wilson::{wilson, wilson_of_share};
use crate::population::share;

/// How many answers are wrong, of how many that were asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ErrorRate {
    /// Queries with a wrong answer.
    pub wrong: u32,
    /// All queries, at least 1.
    pub queries: u32,
}

impl ErrorRate {
    /// Where so many of the queries have the right answer.
    pub fn new(correct: u32, queries: u32) -> Self {
        Self { wrong: queries.saturating_sub(correct), queries }
    }

    /// The share of wrong answers, from 0 to 1, rounded once.
    pub fn share(self) -> f64 {
        share(self.wrong, self.queries)
    }

    /// Its 95 % interval by [`wilson`].
    pub fn interval(self) -> [f64; 2] {
        wilson(self.wrong, self.queries)
    }

    /// The same where clouds count more than once, so that all queries are worth `effective` of them (see
    /// [`RunRow::train_effective`](crate::RunRow::train_effective)); `None`: where each counts once.
    pub fn interval_of(self, effective: Option<f64>) -> [f64; 2] {
        effective.map_or_else(|| self.interval(), |effective| wilson_of_share(self.share(), effective))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_is_of_the_answers_that_are_wrong() {
        // 15 of 148 is an example of Newcombe (Two-sided confidence intervals for the single proportion, 1998).
        let rate = ErrorRate::new(133, 148);
        assert_eq!((rate.wrong, rate.queries), (15, 148));
        assert!((rate.share() - 0.1014).abs() < 5e-5, "{}", rate.share());
        let [low, high] = rate.interval();
        assert!((low - 0.0624).abs() < 5e-5 && (high - 0.1605).abs() < 5e-5, "{low} {high}");
        assert_eq!(ErrorRate::new(9, 7).wrong, 0, "of a damaged table");
        // The same clouds, each counted a hundred times.
        let hundredfold = ErrorRate::new(13_300, 14_800);
        assert_eq!(hundredfold.interval_of(Some(148.0)), rate.interval());
        assert_eq!(hundredfold.interval_of(None), hundredfold.interval());
    }
}
