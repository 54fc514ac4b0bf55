//! Hill climbing with random restarts: the control that shows what a population adds to local search.

use descriptor::random;

use crate::genome::Genome;
use crate::individual::Individual;
use crate::past::Past;
use crate::score::{Score, best};
use crate::strategy::Strategy;

/// From a random point to the best of its neighbours, as long as that is better; then from another random point.
///
/// A climb takes several generations. Its first is the start alone, which has no parents. Each further one is the point
/// that has been reached, as the elite, and all its neighbours: every field, ordered or not, by one value index down,
/// then up, in the order of the fields. Their parent is that point in the generation before. If no neighbour has a strictly better
/// score, the next generation is the start of another climb; of equal ones the lowest index is gone to. Generations
/// and stop rule count through all climbs.
#[derive(Clone, Debug)]
pub struct HillClimb {
    genome: Genome,
    seed: u64,
}

impl HillClimb {
    /// A climb over a genome.
    pub fn new(genome: Genome, seed: u64) -> Self {
        Self { genome, seed }
    }

    fn start(&self, generation: u32) -> Vec<Individual> {
        let mut rng = random::stream(self.seed, "hill climb start", &[u64::from(generation)]);
        vec![Individual::random(&self.genome, &mut rng)]
    }

    /// The generation after one whose individual number `index` is `point`.
    fn neighbourhood(&self, point: &Individual, index: u32) -> Vec<Individual> {
        let mut generation = vec![point.copied_from(index)];
        for (place, field) in self.genome.fields().iter().enumerate() {
            let value = point.values[place];
            let up = Some(value + 1).filter(|&up| up < field.values);
            for neighbour in value.checked_sub(1).into_iter().chain(up) {
                let mut values = point.values.clone();
                values[place] = neighbour;
                generation.push(Individual::of_values(values, [Some(index), None], &self.genome));
            }
        }
        generation
    }
}

impl Strategy for HillClimb {
    fn first(&self) -> Vec<Individual> {
        self.start(1)
    }

    fn next(
        &self,
        generation: u32,
        population: &[Individual],
        scores: &[Score],
        _past: &Past,
    ) -> Vec<Individual> {
        let best = best(scores);
        let best_point = &population[best as usize];
        // The elite is the point itself: it is first, and so the best unless a neighbour is strictly better.
        if best_point.elite { self.start(generation + 1) } else { self.neighbourhood(best_point, best) }
    }

    fn largest_generation(&self) -> u32 {
        1 + self.genome.fields().iter().map(|field| (field.values - 1).min(2)).sum::<u32>()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;
    use crate::score::tests::scores;
    use crate::strategy::Strategy; // the prelude of proptest has another
    use crate::tests::{Generation, run_strategy};
    use crate::{Encoding, Field, Search, StopReason, StopSettings, WinnerRule};

    /// Separable, with a local optimum of the first field at 2 and the global one at 8.
    const FIRST: [u32; 9] = [0, 3, 6, 4, 1, 2, 5, 8, 9];
    const SECOND: [u32; 7] = [0, 1, 2, 3, 2, 1, 0];

    fn two_peaks(individual: &Individual) -> u32 {
        FIRST[individual.values[0] as usize] + SECOND[individual.values[1] as usize]
    }

    fn genome(values: &[u32], encoding: Encoding) -> Genome {
        let field = |&values: &u32| Field::new("field", values);
        Genome::new(values.iter().map(field).collect(), encoding)
    }

    fn peaks_search(seed: u64) -> HillClimb {
        HillClimb::new(genome(&[9, 7], Encoding::Binary), seed)
    }

    /// All points one step away, by definition: those whose value indices differ in one field, by one.
    fn neighbours(point: &[u32], genome: &Genome) -> Vec<Vec<u32>> {
        let mut all = Vec::new();
        for (place, field) in genome.fields().iter().enumerate() {
            for step in [-1, 1] {
                let mut values: Vec<i64> = point.iter().map(|&value| i64::from(value)).collect();
                values[place] += step;
                if (0..i64::from(field.values)).contains(&values[place]) {
                    all.push(values.iter().map(|&value| value as u32).collect());
                }
            }
        }
        all
    }

    /// Follows a log by the definition of the method; returns the count at the end of each finished climb.
    fn check(log: &[Generation], genome: &Genome) -> Vec<u32> {
        let mut ends = Vec::new();
        // The point of the climb with its index in the generation before; `None`: a climb begins.
        let mut at: Option<(Vec<u32>, u32)> = None;
        for (population, correct) in log {
            let values: Vec<Vec<u32>> = population.iter().map(|one| one.values.clone()).collect();
            let Some((point, index)) = at else {
                assert_eq!(population.len(), 1);
                assert_eq!((population[0].parents, population[0].elite), ([None, None], false));
                at = Some((values[0].clone(), 0));
                continue;
            };
            assert_eq!(values[0], point);
            assert_eq!(values[1..], neighbours(&point, genome));
            assert!(population.iter().all(|one| one.parents == [Some(index), None]));
            assert!(population[0].elite && population[1..].iter().all(|one| !one.elite));
            for one in &population[1..] {
                assert_eq!(one.chromosome, genome.encode(&one.values));
            }
            let highest = correct.iter().max().copied().unwrap_or_default();
            let first = correct.iter().position(|&count| count == highest).unwrap();
            assert!(correct[first] >= correct[0], "a climb never goes down");
            at = (highest > correct[0]).then(|| (values[first].clone(), first as u32));
            if at.is_none() {
                ends.push(correct[0]);
            }
        }
        ends
    }

    #[test]
    fn climbs_end_at_the_local_or_the_global_optimum_and_begin_again() {
        for seed in 0..20 {
            let search = peaks_search(seed);
            let log = run_strategy(&search, 120, |_, _, individual| two_peaks(individual));
            let ends = check(&log, &search.genome);
            assert!(ends.len() >= 10, "a climb takes 11 generations at most: {ends:?}");
            assert!(ends.iter().all(|end| [6 + 3, 9 + 3].contains(end)), "{ends:?}");
            assert!(ends.contains(&9) && ends.contains(&12), "some of {} starts each way", ends.len());
        }
    }

    #[test]
    fn of_equally_good_neighbours_the_first_is_gone_to_and_an_equal_one_is_no_step() {
        // Every neighbour of the start is better by one.
        let search = HillClimb::new(genome(&[5, 5, 5], Encoding::Gray), 1);
        let log = run_strategy(
            &search,
            3,
            |generation, index, _| {
                if generation == 2 { u32::from(index > 0) } else { 1 }
            },
        );
        assert_eq!(log[2].0[0].values, log[1].0[1].values);
        assert_eq!(log[2].0[0].parents, [Some(1), None]);
        // On a plateau every second generation is a start.
        let log = run_strategy(&search, 9, |_, _, _| 3);
        assert_eq!(check(&log, &search.genome), [3; 4]);
    }

    #[test]
    fn starts_are_random_chromosomes() {
        let genome = genome(&[64; 4], Encoding::Binary);
        let search = HillClimb::new(genome, 2);
        let log = run_strategy(&search, 2000, |_, _, _| 0);
        let starts: Vec<_> = log.iter().filter(|(population, _)| !population[0].elite).collect();
        assert_eq!(starts.len(), 1000);
        for bit in 0..24 {
            let ones = starts.iter().filter(|(population, _)| population[0].chromosome[bit]).count();
            assert!((420..=580).contains(&ones), "500 ± 5 deviations of 16, got {ones}");
        }
    }

    #[test]
    fn without_neighbours_every_second_generation_is_the_same_start() {
        for values in [&[1, 1][..], &[]] {
            let search = HillClimb::new(genome(values, Encoding::Binary), 1);
            assert_eq!(search.largest_generation(), 1);
            let log = run_strategy(&search, 6, |_, _, _| 3);
            assert_eq!(check(&log, &search.genome), [3; 3]);
        }
    }

    #[test]
    fn the_same_seed_and_scores_repeat_every_generation_and_the_budget_ends_the_search() {
        let stop = StopSettings {
            perfect: false,
            validation_patience: None,
            stagnation: None,
            generations: 30,
            evaluations: None,
        };
        let begin = |seed| Search::new(Box::new(peaks_search(seed)), stop, WinnerRule::Fitness);
        let mut search = begin(5);
        let mut told = Vec::new();
        let last = loop {
            let population = search.ask().to_vec();
            let correct: Vec<u32> = population.iter().map(two_peaks).collect();
            told.push((population, scores(&correct)));
            let state = search.tell(&scores(&correct), None, 0);
            assert_eq!(state.mutation_rate, 0.0);
            if let Some(reason) = state.stop {
                break (reason, state.winner.score.correct);
            }
        };
        assert_eq!((last, told.len()), ((StopReason::Generations, 12), 30));
        // Begun again, and told everything that was told before.
        let mut again = begin(5);
        for (population, scores) in &told {
            assert_eq!(again.ask(), population);
            again.tell(scores, None, 0);
        }
        assert_ne!(begin(6).ask(), told[0].0);
    }

    #[test]
    fn a_budget_of_evaluations_ends_the_search_with_the_neighbour_that_reaches_it() {
        let mut cut = false;
        for budget in 20..30 {
            let stop = StopSettings {
                perfect: false,
                validation_patience: None,
                stagnation: None,
                generations: 1000,
                evaluations: Some(budget),
            };
            let mut search = Search::new(Box::new(peaks_search(5)), stop, WinnerRule::Fitness);
            let mut met = BTreeSet::new();
            loop {
                let asked: Vec<_> = search.ask().iter().map(|individual| individual.values.clone()).collect();
                let left = search.evaluations_left(met.len() as u64).unwrap();
                let fits = |end: &usize| {
                    let new = asked[..*end].iter().filter(|&values| !met.contains(values));
                    new.collect::<BTreeSet<_>>().len() as u64 <= left
                };
                let allowed = (1..=asked.len()).take_while(fits).count();
                assert!(allowed > 0);
                cut |= allowed < asked.len();
                search.keep_first(allowed);
                assert_eq!(search.ask().len(), allowed);
                met.extend(asked.into_iter().take(allowed));
                let correct: Vec<u32> = search.ask().iter().map(two_peaks).collect();
                let state = search.tell(&scores(&correct), None, met.len() as u64);
                assert!(met.len() <= budget as usize);
                assert_eq!(state.stop, (met.len() == budget as usize).then_some(StopReason::Evaluations));
                if state.stop.is_some() {
                    break;
                }
            }
        }
        assert!(cut, "every budget ended between two generations");
    }

    proptest! {
        #[test]
        fn any_landscape_is_climbed_by_the_definition(
            values in prop::collection::vec(1u32..6, 0..4),
            number in any::<u64>(),
            seed in any::<u64>(),
            gray in any::<bool>(),
            ordered in any::<bool>(),
        ) {
            let encoding = if gray { Encoding::Gray } else { Encoding::Binary };
            let field = |&values: &u32| Field { ordered, slot: Some(0), ..Field::new("field", values) };
            let search = HillClimb::new(Genome::new(values.iter().map(field).collect(), encoding), seed);
            let landscape = |_, _, individual: &Individual| {
                let point: Vec<u64> = individual.values.iter().map(|&value| u64::from(value)).collect();
                use rand::RngExt;
                random::stream(number, "landscape", &point).random_range(0..8)
            };
            let log = run_strategy(&search, 40, landscape);
            check(&log, &search.genome);
            let largest = search.largest_generation() as usize;
            prop_assert!(log.iter().all(|(population, _)| population.len() <= largest));
            if values.iter().all(|&values| values != 2) {
                // From the middle of every field there are two ways.
                let middle: Vec<u32> = values.iter().map(|values| values / 2).collect();
                let middle = Individual::of_values(middle, [None, None], &search.genome);
                prop_assert_eq!(search.neighbourhood(&middle, 0).len(), largest);
            }
        }
    }
}
