//! A search under way: asked for a generation, told its scores, it says how it stands and when it ends.

use std::ops::Range;

use crate::front::Front;
use crate::individual::Individual;
use crate::past::Past;
use crate::score::{self, Score};
use crate::settings::StopSettings;
use crate::stop::{StopReason, StopRule};
use crate::strategy::Strategy;
use crate::winner::{Found, WinnerRule};

/// A strategy with its current generation, its stop rule and the winner so far.
pub struct Search {
    strategy: Box<dyn Strategy>,
    generation: u32,
    population: Vec<Individual>,
    validates: bool,
    stop: StopRule,
    rule: WinnerRule,
    winner: Option<Found>,
    front: Front,
    past: Past,
    /// The next generation, if it is known, with the scores from which it follows.
    foreseen: Option<(Vec<Score>, Vec<Individual>)>,
}

/// How a search stands after a generation.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Index of the generation's best individual: the best score, the lowest index on ties.
    pub best: u32,
    /// The best score of all generations so far.
    pub best_so_far: Score,
    /// The winner so far.
    pub winner: Found,
    /// Whether the winner is of this generation.
    pub improved: bool,
    /// The rate with which the generation's children are mutated, 0 to 1; 0 if there is no mutation.
    pub mutation_rate: f64,
    /// Why the search ends with this generation; `None` if it goes on.
    pub stop: Option<StopReason>,
}

impl Search {
    /// A search at generation 1. Generations are validated if stop or winner go by that.
    pub fn new(strategy: Box<dyn Strategy>, stop: StopSettings, rule: WinnerRule) -> Self {
        let population = strategy.first();
        let past = Past::of(strategy.remembers());
        let validates = rule.validates(&stop);
        let stop = StopRule::new(stop);
        Self {
            strategy,
            generation: 1,
            population,
            validates,
            stop,
            rule,
            winner: None,
            front: Front::default(),
            past,
            foreseen: None,
        }
    }

    /// The current generation, counted from 1.
    pub fn generation(&self) -> u32 {
        self.generation
    }

    /// The individuals of the current generation, in the order in which [`Search::tell`] wants their scores.
    pub fn ask(&self) -> &[Individual] {
        &self.population
    }

    /// The front of all individuals whose scores were told.
    pub fn front(&self) -> &Front {
        &self.front
    }

    /// How many more different individuals may be evaluated, now that there were `evaluations`; `None` without a budget.
    pub fn evaluations_left(&self, evaluations: u64) -> Option<u64> {
        self.stop.evaluations_left(evaluations)
    }

    /// Drops all individuals of the current generation but the first `count`, at least one: the others are beyond the
    /// budget of evaluations.
    pub fn keep_first(&mut self, count: usize) {
        self.population.truncate(count.max(1));
        self.foreseen = None;
    }

    /// Index of the individual that is to be validated, now that the scores of the current generation are known; `None`
    /// if the search does without validation.
    pub fn to_validate(&self, scores: &[Score]) -> Option<u32> {
        self.validates.then(|| score::best(scores))
    }

    /// The individuals of the next generation, now that the scores of the current one are known, if the search will go on
    /// whatever the validation says; `evaluations` as for [`Search::tell`].
    pub fn foresee(&mut self, scores: &[Score], evaluations: u64) -> Option<&[Individual]> {
        let best = scores[score::best(scores) as usize];
        if self.strategy.exhausted().is_some() || self.stop.may_end(best, evaluations) {
            return None;
        }
        let next = self.following(scores);
        let (_, next) = self.foreseen.insert((scores.to_vec(), next));
        Some(next)
    }

    /// Individuals of the current generation that have children of their own, whatever the others' scores, each in one part at
    /// most, if the next generation will be whole; `evaluations` as for [`Search::tell`].
    pub fn parts(&self, evaluations: u64) -> Vec<Range<usize>> {
        let largest = u64::from(self.strategy.largest_generation());
        if self.evaluations_left(evaluations).is_some_and(|left| left < largest) {
            return Vec::new();
        }
        self.strategy.parts(self.population.len())
    }

    /// The individuals of the next generation that follow from one of these parts, whose scores these are; `None` if the
    /// search may end with this one, as far as can be said now that `best` is the best score of the generation.
    pub fn foresee_part(
        &self,
        part: usize,
        scores: &[Score],
        (best, evaluations): (Score, u64),
    ) -> Option<Vec<Individual>> {
        if self.strategy.exhausted().is_some() || self.stop.may_end(best, evaluations) {
            return None;
        }
        Some(self.strategy.next_of_part(self.generation, part, &self.population, scores))
    }

    /// The generation that follows from these scores of the current one.
    fn following(&mut self, scores: &[Score]) -> Vec<Individual> {
        match self.foreseen.take() {
            Some((before, next)) if before == scores => next,
            _ => {
                self.past.add(&self.population, scores);
                self.strategy.next(self.generation, &self.population, scores, &self.past)
            }
        }
    }

    /// Takes the scores of the current generation, in individual order, the validation score of the individual that
    /// [`Search::to_validate`] named, and how many different individuals have been evaluated, this generation included;
    /// makes the next generation, unless the search ends with this one.
    ///
    /// # Panics
    /// If there is not one score for each individual: a programming error, as the caller waits for all of them.
    pub fn tell(&mut self, scores: &[Score], validation: Option<Score>, evaluations: u64) -> State {
        assert_eq!(scores.len(), self.population.len(), "one score for each individual");
        let generation = self.generation;
        let best = score::best(scores);
        let candidate = Found {
            generation,
            index: best,
            individual: self.population[best as usize].clone(),
            score: scores[best as usize],
            validation,
        };
        for (index, (individual, &score)) in (0..).zip(self.population.iter().zip(scores)) {
            self.front.add(generation, index, individual, score);
        }
        let (best_so_far, stop) = self.stop.observe(candidate.score, validation, evaluations);
        let stop = self.strategy.exhausted().or(stop);
        let winner = candidate.or_leader(self.winner.take(), self.rule);
        self.winner = Some(winner.clone());
        if stop.is_none() {
            self.population = self.following(scores);
            self.generation += 1;
        }
        let improved = winner.generation == generation;
        let mutation_rate = self.strategy.mutation_rate(generation);
        State { best, best_so_far, winner, improved, mutation_rate, stop }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::ensemble::Ensemble;
    use crate::genetic::GeneticAlgorithm;
    use crate::genome::{Encoding, Field, Genome};
    use crate::score::tests::{score, scores as scores_of};
    use crate::settings::GaSettings;
    use crate::stop::tests::NEVER;
    use crate::tests::{decompose, paper};

    proptest! {
        #[test]
        fn what_is_foreseen_of_each_part_is_the_next_generation_but_for_those_who_are_joined(
            told in prop::collection::vec(prop::collection::vec(0u32..50, 13), 1..6),
            budget in prop::option::of(1u32..60),
            stagnation in prop::option::of(1u32..4),
            generations in 1u32..6,
        ) {
            let stop = StopSettings { evaluations: budget, stagnation, generations, ..NEVER };
            let settings = GaSettings { population: 4, ..GaSettings::default() };
            let fields = vec![Field::new("field", 16); 3];
            let strategy = Ensemble::new(Genome::new(fields, Encoding::Gray), 3, settings, 7).unwrap();
            let mut search = Search::new(Box::new(strategy), stop, WinnerRule::Fitness);
            let mut evaluations = 0;
            for correct in told {
                evaluations += search.ask().len() as u64;
                let scores = scores_of(&correct)[..search.ask().len()].to_vec();
                let best = scores[score::best(&scores) as usize];
                let parts = search.parts(evaluations);
                prop_assert_eq!(parts.is_empty(), budget.is_some_and(|budget| evaluations + 13 > budget.into()));
                // Of what is known before all scores are, and of what is known then.
                let foresee = |best| {
                    let parts = (0..).zip(&parts);
                    let foreseen = parts.map(|(part, place)| {
                        search.foresee_part(part, &scores[place.clone()], (best, evaluations))
                    });
                    foreseen.collect::<Vec<Option<Vec<Individual>>>>()
                };
                let [before, foreseen] = [scores[0], best].map(foresee);
                if search.tell(&scores, None, evaluations).stop.is_some() {
                    prop_assert!([before, foreseen].iter().flatten().all(Option::is_none));
                    break;
                }
                let population = search.ask()[1..].chunks(4);
                for ((before, foreseen), children) in before.into_iter().zip(foreseen).zip(population) {
                    prop_assert_eq!(foreseen.as_deref(), Some(children));
                    prop_assert!(before.is_none_or(|before| before == children));
                }
            }
        }

        #[test]
        fn what_is_foreseen_is_the_next_generation_whatever_the_validation_says(
            told in prop::collection::vec((prop::array::uniform4(0u32..50), 0u32..50), 1..12),
            patience in prop::option::of(1u32..3),
            stagnation in prop::option::of(1u32..5),
            generations in 1u32..12,
            preselection in 1u32..4,
        ) {
            let stop = StopSettings { validation_patience: patience, stagnation, generations, ..NEVER };
            let settings = GaSettings { population: 4, preselection, ..GaSettings::default() };
            let strategy = GeneticAlgorithm::new(paper(), settings, 7, decompose()).unwrap();
            let mut search = Search::new(Box::new(strategy), stop, WinnerRule::Validation);
            // One that is never asked what it foresees takes the same way, whatever the other was asked.
            let strategy = GeneticAlgorithm::new(paper(), settings, 7, decompose()).unwrap();
            let mut blind = Search::new(Box::new(strategy), stop, WinnerRule::Validation);
            for (evaluations, (correct, validated)) in (4u64..).step_by(4).zip(told) {
                search.foresee(&scores_of(&correct.map(|correct| 50 - correct)), evaluations);
                let scores = scores_of(&correct);
                let foreseen = search.foresee(&scores, evaluations).map(<[_]>::to_vec);
                let state = search.tell(&scores, Some(score(validated, 50)), evaluations);
                prop_assert_eq!(&blind.tell(&scores, Some(score(validated, 50)), evaluations), &state);
                prop_assert_eq!(blind.ask(), search.ask());
                if let Some(foreseen) = foreseen {
                    prop_assert_eq!((state.stop, &foreseen[..]), (None, search.ask()));
                } else if patience.is_none() {
                    prop_assert!(state.stop.is_some());
                }
                if state.stop.is_some() {
                    break;
                }
            }
        }
    }
}
