//! Random search: the control that shows what selection adds to mere luck.

use descriptor::{GeneTable, random};

use super::individual::{Individual, random_chromosome};
use super::settings::{GaSettings, SettingsError};

/// Generations of independent random individuals, each distributed as the genetic algorithm's first.
#[derive(Clone, Debug)]
pub struct RandomSearch {
    genes: GeneTable,
    settings: GaSettings,
    seed: u64,
    generation: u32,
    population: Vec<Individual>,
}

impl RandomSearch {
    /// Starts at generation 1. Of the settings only population and encoding are used.
    ///
    /// # Errors
    /// If the settings are not valid ([`GaSettings::validate`]).
    pub fn new(genes: GeneTable, settings: GaSettings, seed: u64) -> Result<Self, SettingsError> {
        let settings = settings.validate()?;
        let mut search = Self { genes, settings, seed, generation: 0, population: Vec::new() };
        search.advance();
        Ok(search)
    }

    /// The current generation, counted from 1.
    pub fn generation(&self) -> u32 {
        self.generation
    }

    /// The individuals of the current generation.
    pub fn population(&self) -> &[Individual] {
        &self.population
    }

    /// Draws the next generation.
    pub fn advance(&mut self) {
        self.generation += 1;
        let individual = |index| {
            let key = [u64::from(self.generation), u64::from(index)];
            let mut rng = random::stream(self.seed, "random search", &key);
            let chromosome = random_chromosome(self.genes.bits(), &mut rng);
            Individual::new(chromosome, [None, None], &self.genes, self.settings.encoding)
        };
        self.population = (0..self.settings.population).map(individual).collect();
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    fn search(seed: u64) -> RandomSearch {
        let settings = GaSettings { population: 64, ..GaSettings::default() };
        RandomSearch::new(GeneTable::paper(), settings, seed).unwrap()
    }

    fn chromosomes(search: &RandomSearch) -> Vec<Vec<bool>> {
        search.population().iter().map(|individual| individual.chromosome.clone()).collect()
    }

    #[test]
    fn generations_repeat_with_the_seed_and_share_no_individual() {
        let (mut a, mut b, other) = (search(1), search(1), search(2));
        assert_ne!(chromosomes(&a), chromosomes(&other));
        let mut seen = BTreeSet::new();
        for generation in 1..=20 {
            assert_eq!((a.generation(), chromosomes(&a)), (generation, chromosomes(&b)));
            for individual in a.population() {
                assert_eq!((individual.parents, individual.elite), ([None, None], false));
                seen.insert(individual.chromosome.clone());
            }
            a.advance();
            b.advance();
        }
        // Two equal ones of 25 random bits are to be expected among 20 times 64; many would be a repeated stream.
        assert!(seen.len() > 20 * 64 - 5, "{}", seen.len());
    }

    #[test]
    fn every_bit_is_fair() {
        let mut search = search(3);
        let mut ones = vec![0u32; GeneTable::paper().bits()];
        for _ in 0..100 {
            for individual in search.population() {
                ones.iter_mut().zip(&individual.chromosome).for_each(|(ones, &bit)| *ones += u32::from(bit));
            }
            search.advance();
        }
        // 6400 throws: 3200 within five standard deviations.
        assert!(ones.iter().all(|ones| (3000..=3400).contains(ones)), "{ones:?}");
    }
}
