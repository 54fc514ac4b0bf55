//! Between descriptors and what a search knows of them: the value index of each gene.

use descriptor::{GeneTable, Parameters};
use evolution::{Encoding, Field, Genome};

/// The genome of a search space: a field for each gene, in chromosome order.
pub fn genome(genes: &GeneTable, encoding: Encoding) -> Genome {
    let fields =
        genes.genes().map(|(spec, domain)| Field { name: spec.name.to_owned(), values: domain.count });
    Genome::new(fields.collect(), encoding)
}

/// The descriptor of value indices of the table's genome.
///
/// # Panics
/// If there is not one index for each gene, or one is beyond its gene's values: a programming error, as a genome makes
/// no others.
pub fn descriptor(genes: &GeneTable, values: &[u32]) -> Parameters {
    genes.at(values).expect("value indices of the table's genome")
}

/// The value indices of a descriptor, one for each gene.
///
/// # Panics
/// If the descriptor is not of the table: a programming error.
pub fn values(genes: &GeneTable, parameters: &Parameters) -> Vec<u32> {
    genes.indices(parameters).expect("a descriptor of the table")
}

#[cfg(test)]
mod tests {
    use descriptor::genes::Domain;
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_papers_genome_has_25_bits() {
        let genome = genome(&GeneTable::paper(), Encoding::Binary);
        assert_eq!(genome.fields().iter().map(Field::bits).collect::<Vec<_>>(), [6, 3, 4, 5, 7]);
        let best = Parameters::PAPER_BEST;
        assert_eq!(values(&GeneTable::paper(), &best), [52, 5, 8, 15, 67]);
        assert_eq!(descriptor(&GeneTable::paper(), &[52, 5, 8, 15, 67]), best);
    }

    proptest! {
        #[test]
        fn values_are_those_of_the_table_and_back(
            counts in prop::array::uniform5(1u32..40),
            bits in prop::collection::vec(any::<bool>(), 30),
            colour in any::<bool>(),
        ) {
            let lows = [8, 3, 5_000, 60_000, 100_000];
            let steps = [2, 1, 1_000, 1_000, 10_000];
            let count = |gene: usize| if gene == 1 { counts[gene] % 9 + 1 } else { counts[gene] };
            let domain = |gene: usize| Domain { low: lows[gene], step: steps[gene], count: count(gene) };
            let table = GeneTable::new(std::array::from_fn(domain), colour).unwrap();
            for encoding in [Encoding::Binary, Encoding::Gray] {
                let genome = genome(&table, encoding);
                let indices = genome.decode(&bits[..genome.bits()]);
                let decoded = descriptor(&table, &indices);
                prop_assert!(table.contains(&decoded));
                prop_assert_eq!(values(&table, &decoded), indices.clone());
                for (((spec, domain), index), field) in table.genes().zip(indices).zip(genome.fields()) {
                    prop_assert_eq!(domain.values().nth(index as usize), Some(decoded.ticks(spec.kind)));
                    prop_assert_eq!((field.name.as_str(), field.values), (spec.name, domain.count));
                }
            }
        }
    }
}
