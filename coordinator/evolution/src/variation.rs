//! What evolutionary strategies have in common: the first population, and children by the operators of the settings.

use std::ops::Range;

use descriptor::random;
use rand::Rng;

use crate::genome::Genome;
use crate::individual::Individual;
use crate::settings::{Crossover, GaSettings, Mutation};
use crate::{crossover, mutation};

/// So many individuals of uniformly random bits.
pub(crate) fn initial(genome: &Genome, population: u32, seed: u64) -> Vec<Individual> {
    let individual = |index| {
        let mut rng = random::stream(seed, "evolution.initial", &[1, u64::from(index)]);
        Individual::random(genome, &mut rng)
    };
    (0..population).map(individual).collect()
}

/// The chromosomes of two children, before they are mutated. `slots`: those of the genome.
pub(crate) fn cross(
    [first, second]: [&[bool]; 2],
    settings: &GaSettings,
    slots: &[Vec<Range<usize>>],
    rng: &mut impl Rng,
) -> (Vec<bool>, Vec<bool>) {
    let exchanged = settings.crossover_rate;
    match settings.crossover {
        Crossover::Uniform => crossover::uniform(first, second, exchanged, rng),
        Crossover::Slots => crossover::by_slots(first, second, slots, exchanged, rng),
        Crossover::AnySlots => {
            let second = crossover::shuffle_slots(second, slots, rng);
            crossover::by_slots(first, &second, slots, exchanged, rng)
        }
    }
}

/// Mutates a child.
pub(crate) fn mutate(
    chromosome: &mut [bool],
    genome: &Genome,
    settings: &GaSettings,
    rate: f64,
    rng: &mut impl Rng,
) {
    match settings.mutation {
        Mutation::InOrder => mutation::in_order(chromosome, rate, rng),
        Mutation::Field => mutation::by_field(chromosome, genome, rate, rng),
        Mutation::Slot => mutation::by_slot(chromosome, genome, rate, rng),
    }
}
