//! Random search: the control that shows what selection adds to mere luck.

use descriptor::random;

use crate::genome::Genome;
use crate::individual::Individual;
use crate::past::Past;
use crate::score::Score;
use crate::settings::{GaSettings, SettingsError};
use crate::strategy::Strategy;

/// Generations of independent random individuals, each distributed as the genetic algorithm's first.
#[derive(Clone, Debug)]
pub struct RandomSearch {
    genome: Genome,
    population: u32,
    seed: u64,
}

impl RandomSearch {
    /// Of the settings only the population is used.
    ///
    /// # Errors
    /// If the settings are not valid ([`GaSettings::validate`]).
    pub fn new(genome: Genome, settings: GaSettings, seed: u64) -> Result<Self, SettingsError> {
        Ok(Self { genome, population: settings.validate()?.population, seed })
    }

    fn draw(&self, generation: u32) -> Vec<Individual> {
        let individual = |index| {
            let key = [u64::from(generation), u64::from(index)];
            Individual::random(&self.genome, &mut random::stream(self.seed, "random search", &key))
        };
        (0..self.population).map(individual).collect()
    }
}

impl Strategy for RandomSearch {
    fn first(&self) -> Vec<Individual> {
        self.draw(1)
    }

    fn next(
        &self,
        generation: u32,
        _population: &[Individual],
        _scores: &[Score],
        _past: &Past,
    ) -> Vec<Individual> {
        self.draw(generation + 1)
    }

    fn largest_generation(&self) -> u32 {
        self.population
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::tests::paper;

    /// The first `generations` of a random search.
    fn generations(seed: u64, generations: u32) -> Vec<Vec<Individual>> {
        let settings = GaSettings { population: 64, ..GaSettings::default() };
        let search = RandomSearch::new(paper(), settings, seed).unwrap();
        let mut all = vec![search.first()];
        all.extend((1..generations).map(|generation| search.next(generation, &[], &[], &Past::default())));
        all
    }

    #[test]
    fn generations_repeat_with_the_seed_and_share_no_individual() {
        let all = generations(1, 20);
        assert_eq!(all, generations(1, 20));
        assert_ne!(all[0], generations(2, 1)[0]);
        let mut seen = BTreeSet::new();
        for individual in all.iter().flatten() {
            assert_eq!((individual.parents, individual.elite), ([None, None], false));
            seen.insert(individual.chromosome.clone());
        }
        // Two equal ones of 25 random bits are to be expected among 20 times 64; many would be a repeated stream.
        assert!(seen.len() > 20 * 64 - 5, "{}", seen.len());
    }

    #[test]
    fn every_bit_is_fair() {
        let mut ones = vec![0u32; paper().bits()];
        for individual in generations(3, 100).iter().flatten() {
            ones.iter_mut().zip(&individual.chromosome).for_each(|(ones, &bit)| *ones += u32::from(bit));
        }
        // 6400 throws: 3200 within five standard deviations.
        assert!(ones.iter().all(|ones| (3000..=3400).contains(ones)), "{ones:?}");
    }
}
