//! Members of a whole that evolve side by side, each by a genetic algorithm of its own and judged by itself, and are joined.
//!
//! A structure that evolves as a whole is fitted to the clouds that the search sees. Members that know nothing of each other
//! are fitted to them each in its own way, and where one of them is wrong about other clouds the rest may be right (bagging,
//! random subspaces: Breiman 1996, Ho 1998).

use std::ops::Range;

use descriptor::random;
use rand::RngExt;

use crate::genetic::GeneticAlgorithm;
use crate::genome::Genome;
use crate::individual::Individual;
use crate::past::Past;
use crate::preselection::Decompose;
use crate::score::{self, Score};
use crate::settings::{GaSettings, SettingsError};
use crate::strategy::Strategy;

/// Genetic algorithms over equal parts of a genome.
///
/// Individual 0 of each generation but the first joins the best of each member in the generation before; then follow the
/// populations, member after member. The bits of an individual of a member are 0 outside its part.
#[derive(Clone, Debug)]
pub struct Ensemble {
    genome: Genome,
    members: Vec<Member>,
    population: u32,
}

#[derive(Clone, Debug)]
struct Member {
    algorithm: GeneticAlgorithm,
    /// Where its bits and its fields are in the genome.
    bits: Range<usize>,
    fields: Range<usize>,
}

impl Ensemble {
    /// Divides the fields of a genome evenly among so many members.
    ///
    /// # Errors
    /// If the settings are not valid ([`GaSettings::validate`]).
    ///
    /// # Panics
    /// If the fields cannot be divided, or children are preselected: a programming error, as experiments are checked.
    pub fn new(genome: Genome, members: u32, settings: GaSettings, seed: u64) -> Result<Self, SettingsError> {
        let fields = genome.fields();
        assert!(members > 0 && fields.len().is_multiple_of(members as usize), "fields for {members} members");
        assert_eq!(settings.preselection, 1, "members are not preselected");
        let of_member = fields.len() / members as usize;
        let bits: Vec<Range<usize>> = genome.fields_with_bits().map(|(_, bits)| bits).collect();
        let member = |(number, fields): (u64, Range<usize>)| {
            let mut stream = random::stream(seed, "evolution.member", &[number]);
            let part = Genome::new(genome.fields()[fields.clone()].to_vec(), genome.encoding());
            let alone = Decompose::by(|_| None);
            Ok(Member {
                algorithm: GeneticAlgorithm::new(part, settings, stream.random::<u64>(), alone)?,
                bits: bits[fields.start].start..bits[fields.end - 1].end,
                fields,
            })
        };
        let parts = (0..members as usize).map(|number| number * of_member..(number + 1) * of_member);
        let members = (0..).zip(parts).map(member).collect::<Result<_, SettingsError>>()?;
        Ok(Self { genome, members, population: settings.population })
    }

    /// Individuals of a member as those of the whole; the first individual of the generation that they have their parents in
    /// is number `first`.
    fn wholes(&self, member: &Member, own: Vec<Individual>, first: u32) -> Vec<Individual> {
        let whole = |Individual { chromosome, parents, elite, .. }: Individual| {
            let mut bits = vec![false; self.genome.bits()];
            bits[member.bits.clone()].copy_from_slice(&chromosome);
            let parents = parents.map(|parent| parent.map(|parent| first + parent));
            Individual { elite, ..Individual::new(bits, parents, &self.genome) }
        };
        own.into_iter().map(whole).collect()
    }

    /// The children of a member, whose population is at this place.
    fn children(
        &self,
        generation: u32,
        member: &Member,
        (place, population): (usize, &[Individual]),
        scores: &[Score],
    ) -> Vec<Individual> {
        let own: Vec<Individual> = population.iter().map(|whole| member.own(whole)).collect();
        let children = member.algorithm.next(generation, &own, scores, &Past::of(0));
        self.wholes(member, children, place as u32)
    }
}

impl Member {
    /// Its part of an individual. Where the parents are does not matter to it.
    fn own(&self, whole: &Individual) -> Individual {
        Individual {
            chromosome: whole.chromosome[self.bits.clone()].to_vec(),
            values: whole.values[self.fields.clone()].to_vec(),
            parents: [None, None],
            elite: whole.elite,
        }
    }
}

impl Strategy for Ensemble {
    /// Uniformly random bits in the part of each.
    fn first(&self) -> Vec<Individual> {
        let members = self.members.iter();
        members.flat_map(|member| self.wholes(member, member.algorithm.first(), 0)).collect()
    }

    fn next(
        &self,
        generation: u32,
        population: &[Individual],
        scores: &[Score],
        _past: &Past,
    ) -> Vec<Individual> {
        let mut joined = vec![false; self.genome.bits()];
        let mut next = Vec::new();
        for (member, place) in self.members.iter().zip(self.parts(population.len())) {
            let (own, scores) = (&population[place.clone()], &scores[place.clone()]);
            let best = &own[score::best(scores) as usize];
            joined[member.bits.clone()].copy_from_slice(&best.chromosome[member.bits.clone()]);
            next.extend(self.children(generation, member, (place.start, own), scores));
        }
        next.insert(0, Individual::new(joined, [None, None], &self.genome));
        next
    }

    /// The population of each member.
    fn parts(&self, individuals: usize) -> Vec<Range<usize>> {
        let population = self.population as usize;
        let Some(joined) = individuals.checked_sub(self.members.len() * population) else {
            return Vec::new(); // cut off by the budget of evaluations
        };
        let place = |number| joined + number * population..joined + (number + 1) * population;
        (0..self.members.len()).map(place).collect()
    }

    fn next_of_part(
        &self,
        generation: u32,
        part: usize,
        population: &[Individual],
        scores: &[Score],
    ) -> Vec<Individual> {
        let place = self.parts(population.len())[part].clone();
        self.children(generation, &self.members[part], (place.start, &population[place]), scores)
    }

    fn largest_generation(&self) -> u32 {
        1 + self.members.len() as u32 * self.population
    }

    fn mutation_rate(&self, generation: u32) -> f64 {
        self.members[0].algorithm.mutation_rate(generation)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::genome::{Encoding, Field};
    use crate::score::tests::scores as scores_of;
    use crate::strategy::Strategy as _;

    const POPULATION: u32 = 5;

    fn fields() -> Vec<Field> {
        [3, 8, 2, 16, 5, 1].map(|values| Field::new("field", values)).to_vec()
    }

    fn settings(elite: u32) -> GaSettings {
        GaSettings { population: POPULATION, elite, mutation_rate: 0.2, ..GaSettings::default() }
    }

    /// A member alone: fields, and the seed that it has in an ensemble.
    fn alone(number: usize, members: usize, elite: u32, seed: u64) -> (Genome, GeneticAlgorithm) {
        let own = fields().chunks(6 / members).nth(number).unwrap().to_vec();
        let genome = Genome::new(own, Encoding::Gray);
        let seed = random::stream(seed, "evolution.member", &[number as u64]).random::<u64>();
        let none = Decompose::by(|_| None);
        let algorithm = GeneticAlgorithm::new(genome.clone(), settings(elite), seed, none).unwrap();
        (genome, algorithm)
    }

    proptest! {
        #[test]
        fn each_member_evolves_as_if_it_were_alone_and_the_best_are_joined(
            members in prop::sample::select(vec![2usize, 3, 6]),
            elite in 0u32..3,
            seed in any::<u64>(),
            told in prop::collection::vec(prop::collection::vec(0u32..50, 31), 1..6),
        ) {
            let genome = Genome::new(fields(), Encoding::Gray);
            let ensemble = Ensemble::new(genome.clone(), members as u32, settings(elite), seed).unwrap();
            let past = Past::of(0);
            let mut population = ensemble.first();
            let mut own: Vec<Vec<Individual>> =
                (0..members).map(|number| alone(number, members, elite, seed).1.first()).collect();
            for (generation, correct) in (1..).zip(told) {
                let joined = usize::from(generation > 1);
                prop_assert_eq!(population.len(), joined + members * POPULATION as usize);
                prop_assert!(population.len() <= ensemble.largest_generation() as usize);
                let scores = scores_of(&correct)[..population.len()].to_vec();
                let next = ensemble.next(generation, &population, &scores, &past);
                let mut best = String::new();
                let mut at = 0;
                for (number, own) in own.iter_mut().enumerate() {
                    let (part, algorithm) = alone(number, members, elite, seed);
                    let place = joined + number * POPULATION as usize;
                    let bits = at..at + part.bits();
                    at = bits.end;
                    for (individual, own) in population[place..].iter().zip(own.iter()) {
                        prop_assert_eq!(&individual.chromosome[bits.clone()], &own.chromosome[..]);
                        let outside = individual.chromosome.iter().enumerate().filter(|(bit, _)| !bits.contains(bit));
                        prop_assert!(outside.clone().all(|(_, &bit)| !bit));
                        prop_assert_eq!(&individual.values, &genome.decode(&individual.chromosome));
                        prop_assert_eq!(individual.elite, own.elite);
                    }
                    let scores = &scores[place..place + POPULATION as usize];
                    let first = scores.iter().map(|score| score.correct).max().unwrap();
                    let first = scores.iter().position(|score| score.correct == first).unwrap();
                    best += &own[first].bit_string();
                    let children = algorithm.next(generation, own, scores, &past);
                    let after = 1 + number * POPULATION as usize;
                    for (child, own) in next[after..].iter().zip(&children) {
                        let parents = own.parents.map(|parent| parent.map(|parent| parent + place as u32));
                        prop_assert_eq!(child.parents, parents);
                    }
                    *own = children;
                }
                prop_assert_eq!((next[0].bit_string(), next[0].parents, next[0].elite), (best, [None, None], false));
                population = next;
            }
        }
    }

    #[test]
    fn settings_that_are_not_valid_are_refused() {
        let genome = Genome::new(fields(), Encoding::Binary);
        let refused = Ensemble::new(genome, 2, settings(POPULATION + 1), 1).map(drop);
        assert_eq!(refused, settings(POPULATION + 1).validate().map(drop));
        assert!(refused.is_err());
    }
}
