//! The genetic algorithm: elitism, roulette, crossover and mutation, by default the paper's (DESIGN 5.8, 5.9 and 5b).

use descriptor::random;

use crate::genome::Genome;
use crate::individual::Individual;
use crate::score::{Score, best_first};
use crate::selection::Roulette;
use crate::settings::{GaSettings, SettingsError};
use crate::strategy::Strategy;
use crate::variation;

/// The genetic algorithm over a genome.
#[derive(Clone, Debug)]
pub struct GeneticAlgorithm {
    genome: Genome,
    settings: GaSettings,
    seed: u64,
}

impl GeneticAlgorithm {
    /// # Errors
    /// If the settings are not valid ([`GaSettings::validate`]).
    pub fn new(genome: Genome, settings: GaSettings, seed: u64) -> Result<Self, SettingsError> {
        Ok(Self { genome, settings: settings.validate()?, seed })
    }
}

impl Strategy for GeneticAlgorithm {
    /// Uniformly random bits.
    fn first(&self) -> Vec<Individual> {
        variation::initial(&self.genome, self.settings.population, self.seed)
    }

    /// First the elite, best first, then the children, two from each pair of parents. If an odd number of children is
    /// wanted, the second child of the last pair is dropped.
    fn next(&self, generation: u32, population: &[Individual], scores: &[Score]) -> Vec<Individual> {
        let Self { genome, settings, seed } = self;
        let rate = self.mutation_rate(generation);
        let next = u64::from(generation) + 1;
        let elite = best_first(scores).into_iter().take(settings.elite as usize);
        let mut children: Vec<Individual> =
            elite.map(|index| population[index as usize].copied_from(index)).collect();

        let correct: Vec<u32> = scores.iter().map(|score| score.correct).collect();
        let roulette = Roulette::new(&correct, settings.scaling);
        let slots = genome.slots();
        let pairs = (population.len() - children.len()).div_ceil(2);
        for pair in 0..pairs as u64 {
            let mut rng = random::stream(*seed, "evolution.selection", &[next, pair]);
            let (a, b) = (roulette.draw(&mut rng), roulette.draw(&mut rng));
            let mut rng = random::stream(*seed, "evolution.crossover", &[next, pair]);
            let parents = [a, b].map(|parent| &population[parent as usize].chromosome[..]);
            let (first, second) = variation::cross(parents, settings, &slots, &mut rng);
            for (mut chromosome, parents) in [(first, [Some(a), Some(b)]), (second, [Some(b), Some(a)])] {
                let index = children.len() as u64;
                let mut rng = random::stream(*seed, "evolution.mutation", &[next, index]);
                variation::mutate(&mut chromosome, genome, settings, rate, &mut rng);
                children.push(Individual::new(chromosome, parents, genome));
            }
        }
        children.truncate(population.len());
        children
    }

    fn largest_generation(&self) -> u32 {
        self.settings.population
    }

    fn mutation_rate(&self, generation: u32) -> f64 {
        self.settings.mutation_rate(generation)
    }
}
