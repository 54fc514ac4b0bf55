//! The genetic algorithm: elitism, roulette, crossover and mutation, by default the paper's (DESIGN 5.8, 5.9 and 5b).

use std::ops::Range;

use descriptor::random;

use crate::genome::Genome;
use crate::individual::Individual;
use crate::past::Past;
use crate::preselection::{self, Decompose, Preselection};
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
    decompose: Decompose,
}

/// The parents that a generation may have.
struct Parents<'a> {
    population: &'a [Individual],
    roulette: Roulette,
    slots: Vec<Vec<Range<usize>>>,
    /// The number of the generation that is made.
    next: u64,
    /// The rate with which children are mutated.
    rate: f64,
}

impl GeneticAlgorithm {
    /// Individuals are only decomposed where children are preselected.
    ///
    /// # Errors
    /// If the settings are not valid ([`GaSettings::validate`]).
    pub fn new(
        genome: Genome,
        settings: GaSettings,
        seed: u64,
        decompose: Decompose,
    ) -> Result<Self, SettingsError> {
        Ok(Self { genome, settings: settings.validate()?, seed, decompose })
    }

    fn preselects(&self) -> bool {
        self.settings.preselection > 1
    }

    /// The two children of a pair of parents. `index`: of the first child. `attempt`: which pair of those from whose
    /// children is chosen, nothing if there is only this one.
    fn breed(&self, parents: &Parents, pair: u64, index: u64, attempt: &[u64]) -> [Individual; 2] {
        let Self { genome, settings, seed, .. } = self;
        let &Parents { population, ref roulette, ref slots, next, rate } = parents;
        let stream = |purpose, number| random::stream(*seed, purpose, &[&[next, number], attempt].concat());
        let mut rng = stream("evolution.selection", pair);
        let (a, b) = (roulette.draw(&mut rng), roulette.draw(&mut rng));
        let mut rng = stream("evolution.crossover", pair);
        let chromosomes = [a, b].map(|parent| &population[parent as usize].chromosome[..]);
        let (first, second) = variation::cross(chromosomes, settings, slots, &mut rng);
        let child = |mut chromosome: Vec<bool>, index, parents: [u32; 2]| {
            let mut rng = stream("evolution.mutation", index);
            variation::mutate(&mut chromosome, genome, settings, rate, &mut rng);
            Individual::new(chromosome, parents.map(Some), genome)
        };
        [child(first, index, [a, b]), child(second, index + 1, [b, a])]
    }
}

impl Strategy for GeneticAlgorithm {
    /// Uniformly random bits.
    fn first(&self) -> Vec<Individual> {
        variation::initial(&self.genome, self.settings.population, self.seed)
    }

    /// First the elite, best first, then the children, two from each pair of parents. If an odd number of children is
    /// wanted, the second child of the last pair is dropped. Where children are preselected, two are chosen from those of
    /// so many pairs.
    fn next(
        &self,
        generation: u32,
        population: &[Individual],
        scores: &[Score],
        past: &Past,
    ) -> Vec<Individual> {
        let Self { genome, settings, .. } = self;
        let elite = best_first(scores).into_iter().take(settings.elite as usize);
        let mut children: Vec<Individual> =
            elite.map(|index| population[index as usize].copied_from(index)).collect();

        let correct: Vec<u32> = scores.iter().map(|score| score.correct).collect();
        let parents = Parents {
            population,
            roulette: Roulette::new(&correct, settings.scaling),
            slots: genome.slots(),
            next: u64::from(generation) + 1,
            rate: self.mutation_rate(generation),
        };
        let mut preselection = self.preselects().then(|| Preselection::new(&self.decompose, past));
        let pairs = (population.len() - children.len()).div_ceil(2);
        for pair in 0..pairs as u64 {
            let index = children.len() as u64;
            match &mut preselection {
                None => children.extend(self.breed(&parents, pair, index, &[])),
                Some(preselection) => {
                    let attempts = 0..u64::from(settings.preselection);
                    let bred = attempts.flat_map(|attempt| self.breed(&parents, pair, index, &[attempt]));
                    children.extend(preselection.choose(2, bred.collect()));
                }
            }
        }
        children.truncate(population.len());
        children
    }

    fn remembers(&self) -> usize {
        if self.preselects() { preselection::MOST_KNOWN } else { 0 }
    }

    fn largest_generation(&self) -> u32 {
        self.settings.population
    }

    fn mutation_rate(&self, generation: u32) -> f64 {
        self.settings.mutation_rate(generation)
    }
}
