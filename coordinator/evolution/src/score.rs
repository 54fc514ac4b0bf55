//! How good an individual is. Scores are compared here and nowhere else.

use std::cmp::Ordering;

/// What an evaluation found out about an individual.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Score {
    /// Queries answered with the right object.
    pub correct: u32,
    /// Queries asked.
    pub queries: u32,
}

impl Score {
    /// Greater is better. Scores of one set of queries only are comparable.
    pub fn compare(&self, other: &Self) -> Ordering {
        self.correct.cmp(&other.correct)
    }

    /// Whether it is strictly better.
    pub fn is_better_than(&self, other: &Self) -> bool {
        self.compare(other) == Ordering::Greater
    }

    /// Whether every query was answered with the right object; not without queries.
    pub fn is_perfect(&self) -> bool {
        self.queries > 0 && self.correct >= self.queries
    }

    /// Share of queries answered with the right object, 0 to 1; 0 without queries.
    pub fn fitness(&self) -> f64 {
        if self.queries == 0 { 0.0 } else { f64::from(self.correct) / f64::from(self.queries) }
    }
}

/// Indices of the scores from the best to the worst, ties by the lower index.
pub(crate) fn best_first(scores: &[Score]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..scores.len() as u32).collect();
    order.sort_by(|&a, &b| scores[b as usize].compare(&scores[a as usize])); // stable: the lower index stays first
    order
}

/// Index of the best score, the lowest on ties; 0 of none.
pub(crate) fn best(scores: &[Score]) -> u32 {
    let order = |a: &u32, b: &u32| scores[*a as usize].compare(&scores[*b as usize]).then(b.cmp(a));
    (0..scores.len() as u32).max_by(order).unwrap_or(0)
}

#[cfg(test)]
pub(crate) mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Scores of so many correct answers to 500 queries.
    pub(crate) fn scores(correct: &[u32]) -> Vec<Score> {
        correct.iter().map(|&correct| Score { correct, queries: 500 }).collect()
    }

    #[test]
    fn the_best_is_first_and_ties_go_to_the_lowest_index() {
        assert_eq!(best_first(&scores(&[3, 9, 3, 9, 1])), [1, 3, 0, 2, 4]);
        assert_eq!(best(&scores(&[3, 9, 3, 9, 1])), 1);
        assert_eq!(best(&scores(&[0, 0])), 0);
        assert_eq!((best(&[]), best_first(&[])), (0, vec![]));
    }

    #[test]
    fn without_queries_nothing_was_answered() {
        let score = |correct, queries| Score { correct, queries };
        assert!(score(3, 3).is_perfect() && !score(2, 3).is_perfect() && !score(0, 0).is_perfect());
        assert_eq!((score(1, 4).fitness(), score(0, 0).fitness()), (0.25, 0.0));
    }

    proptest! {
        #[test]
        fn the_best_is_the_first_of_the_order(correct in prop::collection::vec(0u32..5, 1..12)) {
            let order = best_first(&scores(&correct));
            prop_assert_eq!(Some(best(&scores(&correct))), order.first().copied());
            for pair in order.windows(2) {
                let [a, b] = [pair[0], pair[1]].map(|index| correct[index as usize]);
                prop_assert!(a > b || (a == b && pair[0] < pair[1]));
            }
        }
    }
}
