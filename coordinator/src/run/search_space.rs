//! A search space as the search sees it: a genome with a field for each gene, and individuals part by part.

use descriptor::{Descriptor, FieldSpec, SearchSpace};
use evolution::{Decompose, Encoding, Field, Genome, Individual, Part, SettingsError, Strategy};

use crate::experiment::Experiment;

/// The genome of a search space: a field for each gene, in chromosome order. Value indices of the one are those of the
/// other.
pub fn genome(space: &SearchSpace, encoding: Encoding) -> Genome {
    let fields = space.fields().into_iter();
    let fields = fields.map(|FieldSpec { gene, values, slot, is_ordered }| Field {
        name: gene.name.to_owned(),
        values,
        ordered: is_ordered,
        slot,
    });
    Genome::new(fields.collect(), encoding)
}

/// An experiment's strategy; `None` of an exhaustive search.
///
/// # Errors
/// As [`Method::strategy`](evolution::Method::strategy).
pub fn strategy(experiment: &Experiment) -> Result<Option<Box<dyn Strategy>>, SettingsError> {
    let genome = genome(experiment.space(), experiment.encoding());
    let members = match experiment.space() {
        SearchSpace::Structures(space) => space.members,
        _ => 1,
    };
    experiment.method().strategy(&genome, members, *experiment.ga(), experiment.seed(), decompose(experiment))
}

/// What an individual stands for.
///
/// # Panics
/// If it is not of the space: a programming error, as the genome is that of the space.
pub fn decode(space: &SearchSpace, individual: &Individual) -> Descriptor {
    space.decode(&individual.values).expect("value indices of the search space's genome")
}

/// Individuals of an experiment's search space part by part: a structure's channels. What the experiment does not afford
/// has none.
fn decompose(experiment: &Experiment) -> Decompose {
    let experiment = experiment.clone();
    Decompose::by(move |individual| {
        let descriptor = decode(experiment.space(), individual);
        experiment.affords(&descriptor).then(|| parts(&descriptor))
    })
}

/// The channels of a structure by their genes, each with its weight; of other families all genes together.
fn parts(descriptor: &Descriptor) -> Vec<Part> {
    match descriptor {
        Descriptor::Structure(structure) => {
            let part = |(ticks, weight): (Vec<Option<u32>>, f64)| {
                let fields = ticks.into_iter().map(|ticks| ticks.map_or(u64::MAX, u64::from));
                Part { weight, fields: fields.collect() }
            };
            structure.channel_genes().into_iter().map(part).collect()
        }
        other => {
            let fields = other.values().into_iter().map(|value| value.map_or(u64::MAX, f64::to_bits));
            vec![Part { weight: 1.0, fields: fields.collect() }]
        }
    }
}

#[cfg(test)]
mod tests {
    use descriptor::{Descriptor, Domain, Family, GeneTable, Parameters};
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_papers_genome_has_25_bits() {
        let paper = SearchSpace::DiskRing(GeneTable::paper());
        let genome = genome(&paper, Encoding::Binary);
        assert_eq!(genome.fields().iter().map(Field::bits).collect::<Vec<_>>(), [6, 3, 4, 5, 7]);
        let best = Descriptor::DiskRing(Parameters::PAPER_BEST);
        assert_eq!(paper.encode(&best).unwrap(), [52, 5, 8, 15, 67]);
        assert_eq!(paper.decode(&[52, 5, 8, 15, 67]), Some(best));
    }

    proptest! {
        #[test]
        fn whatever_a_genome_decodes_to_is_a_descriptor_of_the_space(
            counts in prop::array::uniform5(1u32..40),
            bits in prop::collection::vec(any::<bool>(), 30),
            colour in any::<bool>(),
            second in any::<bool>(),
        ) {
            let lows = [8, 3, 5_000, 60_000, 100_000];
            let steps = [2, 1, 1_000, 1_000, 10_000];
            let count = |gene: usize| if gene == 1 { counts[gene] % 9 + 1 } else { counts[gene] };
            let domain = |gene: usize| Domain { low: lows[gene], step: steps[gene], count: count(gene) };
            let space = if second {
                SearchSpace::new(Family::GlobalHue, true, &[Domain { low: 2, step: 1, count: counts[0] }])
            } else {
                SearchSpace::new(Family::DiskRing, colour, &[0, 1, 2, 3, 4].map(domain))
            };
            let space = space.unwrap();
            for encoding in [Encoding::Binary, Encoding::Gray] {
                let genome = genome(&space, encoding);
                let indices = genome.decode(&bits[..genome.bits()]);
                let decoded = space.decode(&indices).unwrap();
                prop_assert_eq!(space.encode(&decoded), Some(indices.clone()));
                let values = decoded.values().into_iter().flatten();
                for (((spec, domain), index), (field, value)) in
                    space.genes().into_iter().zip(indices).zip(genome.fields().iter().zip(values))
                {
                    prop_assert_eq!(domain.values().nth(index as usize), spec.ticks(value));
                    prop_assert_eq!((field.name.as_str(), field.values), (spec.name, domain.count));
                }
            }
        }
    }
}
