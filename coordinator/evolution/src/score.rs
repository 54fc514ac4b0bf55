//! How good an individual is, and the order of two scores.
//!
//! The order of individuals goes by count, then margin. What the paper defines by counts (weights of the roulette, a
//! perfect score, stagnation, a rise of the validation error) goes by the count alone. Searches of several objectives
//! go by dominance.

use std::cmp::Ordering;

/// What a search of several objectives minimises, one number each. An objective that all individuals have the same value
/// of has no part in it.
pub type Objectives = [u64; 3];

/// Pareto dominance: nowhere worse, and better somewhere.
pub fn dominates(a: &Objectives, b: &Objectives) -> bool {
    a != b && a.iter().zip(b).all(|(a, b)| a <= b)
}

/// What an evaluation found out about an individual.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// Queries answered with the right object.
    pub correct: u32,
    /// Queries asked.
    pub queries: u32,
    /// Soft margin, −1 to 1: how much nearer the right object is than the nearest wrong one, mean over the queries. 0
    /// where none is computed.
    pub margin: f64,
    /// What a search of several objectives minimises beside the errors, such as a cost and a size; 0 where it does not.
    pub further: [u64; 2],
}

impl Score {
    /// What a search of several objectives minimises: the errors, then the further objectives.
    pub fn objectives(&self) -> Objectives {
        let [first, second] = self.further;
        [u64::from(self.queries.saturating_sub(self.correct)), first, second]
    }

    /// Greater is better: the count, then the margin. Scores of one set of queries only are comparable.
    pub fn compare(&self, other: &Self) -> Ordering {
        self.correct.cmp(&other.correct).then(self.margin.total_cmp(&other.margin))
    }

    /// Whether it is strictly better.
    pub fn is_better_than(&self, other: &Self) -> bool {
        self.compare(other) == Ordering::Greater
    }

    /// The better of two, this one on ties.
    #[must_use]
    pub fn or_better(self, other: Self) -> Self {
        if other.is_better_than(&self) { other } else { self }
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
        correct.iter().map(|&correct| score(correct, 500)).collect()
    }

    /// A score without margin.
    pub(crate) fn score(correct: u32, queries: u32) -> Score {
        Score { correct, queries, margin: 0.0, further: [0; 2] }
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
        assert!(score(3, 3).is_perfect() && !score(2, 3).is_perfect() && !score(0, 0).is_perfect());
        assert_eq!((score(1, 4).fitness(), score(0, 0).fitness()), (0.25, 0.0));
    }

    #[test]
    fn objectives_are_errors_and_what_else_is_minimised_and_leave_the_order_alone() {
        let one = Score { further: [7, 1], ..score(3, 10) };
        assert_eq!(one.objectives(), [7, 7, 1]);
        assert_eq!(one.compare(&score(3, 10)), Ordering::Equal);
        for (other, expected) in
            [([7, 7, 2], true), ([7, 7, 1], false), ([8, 6, 9], false), ([9, 9, 9], true)]
        {
            assert_eq!(dominates(&one.objectives(), &other), expected, "{other:?}");
        }
    }

    #[test]
    fn the_margin_decides_between_equal_counts_only() {
        let score = |correct, margin| Score { margin, ..score(correct, 9) };
        let scores = [score(4, 1.0), score(5, -1.0), score(5, 0.25), score(5, -0.5), score(5, 0.25)];
        assert_eq!(best_first(&scores), [2, 4, 3, 1, 0]);
        assert_eq!(best(&scores), 2);
        assert!(scores[1].is_better_than(&scores[0]) && !scores[4].is_better_than(&scores[2]));
        // Neither perfection nor fitness knows of it.
        assert!(score(9, -1.0).is_perfect() && !score(8, 1.0).is_perfect());
        assert_eq!(score(3, -1.0).fitness(), score(3, 1.0).fitness());
    }

    proptest! {
        #[test]
        fn the_best_is_the_first_of_the_order(table in prop::collection::vec((0u32..4, -2i32..=2), 1..12)) {
            let one = |&(correct, margin): &(u32, i32)| {
                Score { margin: f64::from(margin) / 2.0, ..score(correct, 500) }
            };
            let scores: Vec<Score> = table.iter().map(one).collect();
            let order = best_first(&scores);
            prop_assert_eq!(Some(best(&scores)), order.first().copied());
            for pair in order.windows(2) {
                let [a, b] = [pair[0], pair[1]].map(|index| table[index as usize]);
                prop_assert!(a > b || (a == b && pair[0] < pair[1]));
            }
        }
    }
}
