//! One member of a generation: its chromosome, what it decodes to and where it comes from.

use descriptor::{Encoding, GeneTable, Parameters};
use rand::{Rng, RngExt};

/// A chromosome with the descriptor it stands for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Individual {
    /// The genes' bits in table order, most significant bit first; empty if every gene is fixed.
    pub chromosome: Vec<bool>,
    /// The descriptor that the chromosome stands for.
    pub parameters: Parameters,
    /// Indices of its parents in the previous generation. A child has two, maybe the same individual twice: the
    /// bits that crossover did not swap come from the first, the swapped ones from the second. An elite individual
    /// has only the first, of which it is a copy. The first generation has none.
    pub parents: [Option<u32>; 2],
    /// Whether it was copied unmutated from the previous generation.
    pub elite: bool,
}

impl Individual {
    /// The individual of a chromosome of [`GeneTable::bits`] bits, not of the elite.
    pub(super) fn new(
        chromosome: Vec<bool>,
        parents: [Option<u32>; 2],
        genes: &GeneTable,
        encoding: Encoding,
    ) -> Self {
        let parameters = genes.decode(&chromosome, encoding);
        Self { chromosome, parameters, parents, elite: false }
    }

    /// The individual that stands for a descriptor of the table, without parents.
    ///
    /// # Panics
    /// If the descriptor is not of the table: a programming error.
    pub fn of(parameters: &Parameters, genes: &GeneTable, encoding: Encoding) -> Self {
        let chromosome = genes.encode(parameters, encoding);
        assert!(chromosome.is_some(), "descriptor of the gene table");
        Self::new(chromosome.unwrap_or_default(), [None, None], genes, encoding)
    }

    /// The copy of this individual, number `index` of its generation, in the elite of the next.
    pub(super) fn copied_from(&self, index: u32) -> Self {
        Self { parents: [Some(index), None], elite: true, ..self.clone() }
    }

    /// The chromosome as `0` and `1`, first bit first.
    pub fn bit_string(&self) -> String {
        self.chromosome.iter().map(|&bit| if bit { '1' } else { '0' }).collect()
    }
}

/// A chromosome of independent, fair bits.
pub(super) fn random_chromosome(bits: usize, rng: &mut impl Rng) -> Vec<bool> {
    (0..bits).map(|_| rng.random::<bool>()).collect()
}
