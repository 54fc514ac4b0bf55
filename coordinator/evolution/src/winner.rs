//! The winner of a search: the best of its generations' bests (DESIGN 5.10).

use crate::individual::Individual;
use crate::score::Score;

/// The best individual of one generation: the best score, the lowest index on ties.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GenerationBest {
    /// Its generation, counted from 1.
    pub generation: u32,
    /// Its index in the generation.
    pub index: u32,
    /// The individual.
    pub individual: Individual,
    /// Its score on the training queries.
    pub score: Score,
    /// Its score on the validation queries; `None` if validation is off.
    pub validation: Option<Score>,
}

impl GenerationBest {
    /// The winner, given that of the generations before.
    ///
    /// With validation it is the one with the best validation score, without it the one with the best score, in both
    /// cases the earliest on ties. A generation that was validated comes before one that was not.
    pub(crate) fn or_leader(self, leader: Option<Self>) -> Self {
        match leader {
            Some(leader) if !self.beats(&leader) => leader,
            _ => self,
        }
    }

    fn beats(&self, leader: &Self) -> bool {
        match (self.validation, leader.validation) {
            // The training score has no part in it, not even on ties.
            (Some(this), Some(leaders)) => this.is_better_than(&leaders),
            (None, None) => self.score.is_better_than(&leader.score),
            (this, _) => this.is_some(),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The generation that wins among (correct, validation errors), from 1.
    fn check(generations: &[(u32, Option<u32>)], expected: Option<u32>) {
        let mut winner = None;
        for (index, &(correct, errors)) in generations.iter().enumerate() {
            let best = GenerationBest {
                generation: index as u32 + 1,
                index: 3,
                individual: Individual {
                    chromosome: vec![true],
                    values: vec![1],
                    parents: [None, None],
                    elite: false,
                },
                score: Score { correct, queries: 10 },
                validation: errors.map(|errors| Score { correct: 20 - errors, queries: 20 }),
            };
            winner = Some(best.or_leader(winner));
        }
        assert_eq!(winner.map(|best| best.generation), expected, "{generations:?}");
    }

    #[test]
    fn with_validation_the_fewest_errors_win_whatever_the_training_fitness() {
        check(&[(5, Some(4)), (6, Some(2)), (9, Some(3))], Some(2));
    }

    #[test]
    fn with_validation_ties_go_to_the_earliest_even_if_a_later_one_trained_better() {
        check(&[(5, Some(4)), (6, Some(2)), (9, Some(2))], Some(2));
        check(&[(5, Some(0)), (9, Some(0))], Some(1));
    }

    #[test]
    fn without_validation_the_best_training_fitness_wins_and_ties_go_to_the_earliest() {
        check(&[(5, None), (9, None), (9, None), (6, None)], Some(2));
        check(&[(0, None), (0, None)], Some(1));
    }

    #[test]
    fn a_validated_generation_comes_before_one_that_was_not() {
        check(&[(9, None), (1, Some(8)), (10, None)], Some(2));
    }

    #[test]
    fn nothing_seen_has_no_winner() {
        check(&[], None);
    }

    proptest! {
        #[test]
        fn it_is_the_first_minimum_of_errors_or_the_first_maximum_of_fitness(
            pairs in prop::collection::vec((0u32..5, 0u32..5), 1..30),
        ) {
            let validated: Vec<_> = pairs.iter().map(|&(correct, errors)| (correct, Some(errors))).collect();
            let fewest = pairs.iter().map(|pair| pair.1).min().unwrap();
            let first = pairs.iter().position(|pair| pair.1 == fewest).unwrap();
            check(&validated, Some(first as u32 + 1));

            let trained: Vec<_> = pairs.iter().map(|&(correct, _)| (correct, None)).collect();
            let most = pairs.iter().map(|pair| pair.0).max().unwrap();
            let first = pairs.iter().position(|pair| pair.0 == most).unwrap();
            check(&trained, Some(first as u32 + 1));
        }
    }
}
