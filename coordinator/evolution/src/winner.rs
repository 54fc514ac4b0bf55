//! The winner of a search: the best of its generations' bests (DESIGN 5.10 and 5b), or of its front.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::individual::Individual;
use crate::score::Score;
use crate::settings::StopSettings;

/// Which of the generations' bests is the winner; of a search of several objectives, which point of its front.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase", rename = "winner")]
pub enum WinnerRule {
    /// The one that does best on the validation clouds. Every generation's best is then validated.
    Validation,
    /// The one with the best training fitness.
    Fitness,
}

impl WinnerRule {
    /// The paper's: by validation if the search may stop for it, else by fitness.
    pub fn paper(stop: &StopSettings) -> Self {
        if stop.validation_patience.is_some() { Self::Validation } else { Self::Fitness }
    }

    /// Whether the best of each generation is validated, for this rule or for the stop rule.
    pub fn validates(self, stop: &StopSettings) -> bool {
        self == Self::Validation || stop.validation_patience.is_some()
    }
}

/// An individual with where it was found and how good it is: the best of a generation, or a point of the front.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Its generation, counted from 1.
    pub generation: u32,
    /// Its index in the generation.
    pub index: u32,
    /// The individual.
    pub individual: Individual,
    /// Its score on the training queries.
    pub score: Score,
    /// Its score on the validation queries; `None` if it was not validated.
    pub validation: Option<Score>,
}

impl Found {
    /// The winner of this one and those before, of which `leader` is the winner.
    ///
    /// By validation it is the one with the best validation score, by fitness the one with the best score, in both cases
    /// the earliest on ties. By validation, one that was validated comes before one that was not.
    pub fn or_leader(self, leader: Option<Self>, rule: WinnerRule) -> Self {
        match leader {
            Some(leader) if !self.beats(&leader, rule) => leader,
            _ => self,
        }
    }

    fn beats(&self, leader: &Self, rule: WinnerRule) -> bool {
        match (rule, self.validation, leader.validation) {
            (WinnerRule::Fitness, ..) | (_, None, None) => self.score.is_better_than(&leader.score),
            // The training score has no part in it, not even on ties.
            (WinnerRule::Validation, Some(this), Some(leaders)) => this.is_better_than(&leaders),
            (WinnerRule::Validation, this, _) => this.is_some(),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::score::tests::score;

    /// The generation that wins by validation among (correct, validation errors), from 1.
    fn check(generations: &[(u32, Option<u32>)], expected: Option<u32>) {
        check_rule(WinnerRule::Validation, generations, expected);
    }

    fn check_rule(rule: WinnerRule, generations: &[(u32, Option<u32>)], expected: Option<u32>) {
        let mut winner = None;
        for (index, &(correct, errors)) in generations.iter().enumerate() {
            let best = Found {
                generation: index as u32 + 1,
                index: 3,
                individual: Individual {
                    chromosome: vec![true],
                    values: vec![1],
                    parents: [None, None],
                    elite: false,
                },
                score: score(correct, 10),
                validation: errors.map(|errors| score(20 - errors, 20)),
            };
            winner = Some(best.or_leader(winner, rule));
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
    fn by_fitness_the_best_training_fitness_wins_whatever_the_validation() {
        let check = |generations: &[_], expected| check_rule(WinnerRule::Fitness, generations, expected);
        check(&[(5, Some(0)), (9, Some(9)), (9, Some(1)), (6, Some(0))], Some(2));
        check(&[(9, None), (1, Some(0)), (10, Some(9))], Some(3));
        check(&[(5, None), (9, None), (9, None)], Some(2));
    }

    #[test]
    fn between_equal_counts_the_margin_decides() {
        let best = |generation, [training, validated]: [f64; 2]| Found {
            generation,
            index: 0,
            individual: Individual {
                chromosome: vec![],
                values: vec![],
                parents: [None, None],
                elite: false,
            },
            score: Score { margin: training, ..score(5, 10) },
            validation: Some(Score { margin: validated, ..score(7, 10) }),
        };
        let (first, second) = (best(1, [0.5, 0.2]), best(2, [0.4, 0.3]));
        let winner = |rule| second.clone().or_leader(Some(first.clone()), rule).generation;
        assert_eq!([winner(WinnerRule::Fitness), winner(WinnerRule::Validation)], [1, 2]);
    }

    #[test]
    fn what_the_paper_goes_by_and_what_is_validated_follow_from_the_stop_rule() {
        let on = StopSettings::default();
        let off = StopSettings { validation_patience: None, ..on };
        assert_eq!(
            [on, off].map(|stop| WinnerRule::paper(&stop)),
            [WinnerRule::Validation, WinnerRule::Fitness]
        );
        assert!(WinnerRule::Fitness.validates(&on) && WinnerRule::Validation.validates(&off));
        assert!(!WinnerRule::Fitness.validates(&off));
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
            check_rule(WinnerRule::Fitness, &validated, Some(first as u32 + 1));
        }
    }
}
