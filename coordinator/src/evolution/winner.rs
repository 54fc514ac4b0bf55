//! The winner of a run: the best of its generations' bests (DESIGN 5.10).

use std::cmp::Reverse;

use descriptor::Parameters;

/// The best individual of one generation: the highest correct count, the lowest index on ties.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GenerationBest {
    /// Its generation, counted from 1.
    pub generation: u32,
    /// Its index in the generation.
    pub individual: u32,
    /// The descriptor it stands for.
    pub parameters: Parameters,
    /// Training queries named correctly.
    pub correct: u32,
    /// Validation queries named wrongly; `None` if validation is off.
    pub validation_errors: Option<u32>,
}

/// The winner among the generations seen so far.
///
/// With validation it is the one with the fewest validation errors, without it the one with the highest correct
/// count, in both cases the earliest on ties. A generation that was validated comes before one that was not.
#[derive(Clone, Copy, Debug, Default)]
pub struct Winner {
    leader: Option<GenerationBest>,
}

impl Winner {
    /// Takes the next generation's best; says whether it is the winner so far.
    pub fn observe(&mut self, best: GenerationBest) -> bool {
        let leads = self.leader.is_none_or(|leader| merit(&best) > merit(&leader));
        if leads {
            self.leader = Some(best);
        }
        leads
    }

    /// The winner so far; `None` before the first generation.
    pub fn get(&self) -> Option<&GenerationBest> {
        self.leader.as_ref()
    }
}

/// What winners are compared by: higher is better, equal leaves the earlier.
fn merit(best: &GenerationBest) -> (Option<Reverse<u32>>, u32) {
    match best.validation_errors {
        // The training fitness has no part in it, not even on ties.
        Some(errors) => (Some(Reverse(errors)), 0),
        None => (None, best.correct),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The generation that wins among (correct, validation errors), from 1.
    fn check(generations: &[(u32, Option<u32>)], expected: Option<u32>) {
        let mut winner = Winner::default();
        for (index, &(correct, validation_errors)) in generations.iter().enumerate() {
            let generation = index as u32 + 1;
            let leads = winner.observe(GenerationBest {
                generation,
                individual: 3,
                parameters: Parameters::PAPER_BEST,
                correct,
                validation_errors,
            });
            assert_eq!(leads, winner.get().is_some_and(|leader| leader.generation == generation));
        }
        assert_eq!(winner.get().map(|best| best.generation), expected, "{generations:?}");
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
