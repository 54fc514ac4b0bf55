//! The genetic algorithm: asks for the fitness of one generation and makes the next from it (DESIGN 5.8 to 5.10).
//!
//! Pure and synchronous: no clock, no files, no threads. All randomness comes from streams keyed by seed, purpose,
//! generation and index, so a generation depends on nothing but the seed, the settings and the counts told before.

pub mod crossover;
pub mod individual;
pub mod mutation;
pub mod random_search;
pub mod selection;
pub mod settings;
pub mod stop;
pub mod winner;

use descriptor::{GeneTable, random};

pub use individual::Individual;
pub use random_search::RandomSearch;
pub use settings::{GaSettings, Method, Scaling, SettingsError, StopSettings};
pub use stop::{StopReason, StopRule};
pub use winner::{GenerationBest, Winner};

/// A population and what it takes to make the next one.
#[derive(Clone, Debug)]
pub struct Evolution {
    genes: GeneTable,
    settings: GaSettings,
    seed: u64,
    generation: u32,
    population: Vec<Individual>,
}

impl Evolution {
    /// Starts at generation 1, whose chromosomes are uniformly random bits.
    ///
    /// # Errors
    /// If the settings are not valid ([`GaSettings::validate`]).
    pub fn new(genes: GeneTable, settings: GaSettings, seed: u64) -> Result<Self, SettingsError> {
        let settings = settings.validate()?;
        let population = (0..settings.population)
            .map(|index| {
                let mut rng = random::stream(seed, "evolution.initial", &[1, u64::from(index)]);
                let chromosome = individual::random_chromosome(genes.bits(), &mut rng);
                Individual::new(chromosome, [None, None], &genes, settings.encoding)
            })
            .collect();
        Ok(Self { genes, settings, seed, generation: 1, population })
    }

    /// The current generation, counted from 1.
    pub fn generation(&self) -> u32 {
        self.generation
    }

    /// The individuals of the current generation, in the order in which [`Evolution::tell`] wants their counts.
    pub fn population(&self) -> &[Individual] {
        &self.population
    }

    /// The rate p(g) with which the children of the current generation g are mutated.
    pub fn mutation_rate(&self) -> f64 {
        self.settings.mutation_rate(self.generation)
    }

    /// Takes the correct counts of the current generation, in individual order, and makes the next generation:
    /// first the elite, best first, then the children, two from each pair of parents. If an odd number of
    /// children is wanted, the second child of the last pair is dropped.
    ///
    /// # Panics
    /// If there is not one count for each individual: a programming error, as the caller waits for all of them.
    pub fn tell(&mut self, correct: &[u32]) {
        assert_eq!(correct.len(), self.population.len(), "one count for each individual");
        let rate = self.mutation_rate();
        let wanted = self.population.len();
        let next = self.generation + 1;

        let mut population: Vec<Individual> = selection::best_first(correct)
            .into_iter()
            .take(self.settings.elite as usize)
            .map(|index| self.population[index as usize].copied_from(index))
            .collect();

        let roulette = selection::Roulette::new(correct, self.settings.scaling);
        let pairs = (wanted - population.len()).div_ceil(2);
        for pair in 0..pairs as u64 {
            let mut rng = random::stream(self.seed, "evolution.selection", &[u64::from(next), pair]);
            let (a, b) = (roulette.draw(&mut rng), roulette.draw(&mut rng));
            let mut rng = random::stream(self.seed, "evolution.crossover", &[u64::from(next), pair]);
            let (first, second) = crossover::uniform(
                &self.population[a as usize].chromosome,
                &self.population[b as usize].chromosome,
                self.settings.crossover_rate,
                &mut rng,
            );
            for (mut chromosome, parents) in [(first, [Some(a), Some(b)]), (second, [Some(b), Some(a)])] {
                let index = population.len() as u64;
                let mut rng = random::stream(self.seed, "evolution.mutation", &[u64::from(next), index]);
                mutation::in_order(&mut chromosome, rate, &mut rng);
                population.push(Individual::new(chromosome, parents, &self.genes, self.settings.encoding));
            }
        }
        population.truncate(wanted);
        self.population = population;
        self.generation = next;
    }
}

#[cfg(test)]
mod tests;
