//! One member of a generation: its chromosome, what it decodes to and where it comes from.

use rand::{Rng, RngExt};

use crate::genome::Genome;

/// A chromosome with the value indices that it stands for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Individual {
    /// The fields' bits in order, most significant bit first; empty if every field has one value.
    pub chromosome: Vec<bool>,
    /// The value index of each field of the genome.
    pub values: Vec<u32>,
    /// Indices of its parents in the previous generation. A child of the genetic algorithm has two, maybe the same
    /// individual twice: the bits that crossover did not swap come from the first, the swapped ones from the second.
    /// An elite individual has only the first, of which it is a copy, and a neighbour of hill climbing has only the
    /// first, too. What was drawn at random, or joined of members, has none.
    pub parents: [Option<u32>; 2],
    /// Whether it was copied unchanged from the previous generation.
    pub elite: bool,
}

impl Individual {
    /// The individual of a chromosome of [`Genome::bits`] bits, not of the elite.
    pub(crate) fn new(chromosome: Vec<bool>, parents: [Option<u32>; 2], genome: &Genome) -> Self {
        let values = genome.decode(&chromosome);
        Self { chromosome, values, parents, elite: false }
    }

    /// The individual of independent, fair bits, without parents.
    pub(crate) fn random(genome: &Genome, rng: &mut impl Rng) -> Self {
        let chromosome = (0..genome.bits()).map(|_| rng.random::<bool>()).collect();
        Self::new(chromosome, [None, None], genome)
    }

    /// The individual of these value indices.
    pub(crate) fn of_values(values: Vec<u32>, parents: [Option<u32>; 2], genome: &Genome) -> Self {
        Self { chromosome: genome.encode(&values), values, parents, elite: false }
    }

    /// The copy of this individual, number `index` of its generation, in the elite of the next.
    pub(crate) fn copied_from(&self, index: u32) -> Self {
        Self { parents: [Some(index), None], elite: true, ..self.clone() }
    }

    /// The chromosome as `0` and `1`, first bit first.
    pub fn bit_string(&self) -> String {
        self.chromosome.iter().map(|&bit| if bit { '1' } else { '0' }).collect()
    }
}
