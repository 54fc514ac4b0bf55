//! Preselection: of the children that could be evaluated, those of which a model of the earlier ones expects most
//! (Emmerich, Giannakoglou and Naujoks, Single- and multiobjective evolutionary optimization assisted by Gaussian random
//! field metamodels, IEEE Transactions on Evolutionary Computation 10(4), 2006).

use std::fmt;
use std::sync::Arc;

use crate::individual::Individual;
use crate::past::Past;
use crate::surrogate::{Composition, Part, Surrogate};

/// Individuals that the model learns from at most, the last that were told: making it takes the third power of them.
pub(crate) const MOST_KNOWN: usize = 600;

type PartsOf = dyn Fn(&Individual) -> Option<Vec<Part>> + Send + Sync;

/// Tells what an individual stands for, part by part; `None` of one that would not be evaluated.
#[derive(Clone)]
pub struct Decompose(Arc<PartsOf>);

impl Decompose {
    /// By this function.
    pub fn by(parts: impl Fn(&Individual) -> Option<Vec<Part>> + Send + Sync + 'static) -> Self {
        Self(Arc::new(parts))
    }

    fn composition(&self, individual: &Individual) -> Option<Composition> {
        (self.0)(individual).map(Composition::new)
    }
}

impl fmt::Debug for Decompose {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Decompose")
    }
}

/// The choice of the children of one generation.
pub(crate) struct Preselection<'a> {
    decompose: &'a Decompose,
    surrogate: Option<Surrogate>,
    chosen: Vec<Composition>,
}

impl<'a> Preselection<'a> {
    /// By what the individuals of the past have taught.
    pub(crate) fn new(decompose: &'a Decompose, past: &Past) -> Self {
        let mut known: Vec<(Composition, f64)> = Vec::new();
        for (individual, score) in past.iter() {
            if let Some(new) = decompose.composition(individual)
                && known.iter().all(|(known, _)| *known != new)
            {
                known.push((new, f64::from(score.correct)));
            }
        }
        Self { decompose, surrogate: Surrogate::new(known), chosen: Vec::new() }
    }

    /// So many of these children, those of which most is to be expected first, the earlier of equal ones. Those that would
    /// not be evaluated, are known or were chosen before come last.
    pub(crate) fn choose(&mut self, count: usize, children: Vec<Individual>) -> Vec<Individual> {
        let mut ordered: Vec<(f64, Option<Composition>, Individual)> = children
            .into_iter()
            .map(|child| match self.decompose.composition(&child).filter(|one| !self.is_known(one)) {
                Some(new) => (self.expected(&new), Some(new), child),
                None => (f64::NEG_INFINITY, None, child),
            })
            .collect();
        ordered.sort_by(|(a, ..), (b, ..)| b.total_cmp(a)); // stable
        let mut last = Vec::new();
        let mut best = Vec::with_capacity(count);
        for (_, composition, child) in ordered {
            match composition.filter(|one| !self.chosen.contains(one)) {
                Some(new) if best.len() < count => {
                    self.chosen.push(new);
                    best.push(child);
                }
                _ => last.push(child),
            }
        }
        best.extend(last);
        best.truncate(count);
        best
    }

    fn is_known(&self, one: &Composition) -> bool {
        self.chosen.contains(one) || self.surrogate.as_ref().is_some_and(|surrogate| surrogate.knows(one))
    }

    fn expected(&self, one: &Composition) -> f64 {
        self.surrogate.as_ref().map_or(0.0, |surrogate| surrogate.expect(one).upper())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::genetic::GeneticAlgorithm;
    use crate::genome::Genome;
    use crate::score::tests::scores;
    use crate::settings::GaSettings;
    use crate::strategy::Strategy;
    use crate::tests::{by_slots_and_fields, decompose, paper, run_strategy, slotted};

    fn individual(first: u32, second: u32) -> Individual {
        Individual::of_values(vec![first, second, 0, 0, 0], [None, None], &paper())
    }

    fn past(known: &[(u32, u32, u32)]) -> Past {
        let mut past = Past::of(100);
        for &(first, second, correct) in known {
            past.add(&[individual(first, second)], &scores(&[correct]));
        }
        past
    }

    fn values(individuals: &[Individual]) -> Vec<(u32, u32)> {
        individuals.iter().map(|individual| (individual.values[0], individual.values[1])).collect()
    }

    #[test]
    fn children_like_the_best_are_chosen_and_of_others_the_least_known() {
        let past = past(&[(1, 0, 90), (1, 1, 80), (2, 0, 10), (2, 1, 20)]);
        let children =
            || [(2, 2), (7, 5), (1, 2), (1, 3)].map(|(first, second)| individual(first, second)).to_vec();
        let choose = |count| values(&Preselection::new(&decompose(), &past).choose(count, children()));
        // Two that share a field with the good ones, then what nothing is known of.
        assert_eq!(choose(4), [(1, 2), (1, 3), (7, 5), (2, 2)]);
        assert_eq!(choose(1), [(1, 2)]);
    }

    #[test]
    fn what_is_known_chosen_or_not_worth_it_comes_last() {
        let costly = Decompose::by(|individual| {
            let part = || Part {
                weight: 1.0,
                fields: individual.values.iter().map(|&value| value.into()).collect(),
            };
            (individual.values[0] < 50).then(|| vec![part()])
        });
        let past = past(&[(1, 0, 90), (2, 0, 10), (55, 0, 0)]);
        let mut preselection = Preselection::new(&costly, &past);
        let mut choose = |count, children: &[(u32, u32)]| {
            let children = children.iter().map(|&(first, second)| individual(first, second)).collect();
            values(&preselection.choose(count, children))
        };
        let children = [(1, 0), (56, 0), (1, 5), (1, 5), (2, 5)];
        assert_eq!(choose(2, &children), [(1, 5), (2, 5)]);
        assert_eq!(choose(3, &children), [(1, 0), (56, 0), (1, 5)], "as they are, if nothing is new");
        assert_eq!(choose(2, &[(3, 3)]), [(3, 3)], "no more than there are");
    }

    #[test]
    fn without_a_past_the_first_are_chosen() {
        let children: Vec<Individual> = (0..4).map(|value| individual(value, 0)).collect();
        let chosen = Preselection::new(&decompose(), &Past::of(9)).choose(2, children.clone());
        assert_eq!(chosen, children[..2]);
    }

    /// Slots as parts, each of the same weight.
    fn by_slots(genome: &Genome) -> Decompose {
        let fields_of_slot = genome.fields().len() / 4;
        Decompose::by(move |individual| {
            let part =
                |fields: &[u32]| Part { weight: 1.0, fields: fields.iter().map(|&it| it.into()).collect() };
            Some(individual.values.chunks(fields_of_slot).map(part).collect())
        })
    }

    /// A fitness with structure, at most 12: the best slot for each of four jobs.
    fn jobs(individual: &Individual) -> u32 {
        let job = |job: [u32; 3]| {
            let alike =
                |slot: &[u32]| slot.iter().zip(job).filter(|(own, wanted)| **own == *wanted).count() as u32;
            individual.values.chunks(3).map(alike).max().unwrap()
        };
        [[7, 4, 2], [1, 0, 0], [3, 2, 1], [6, 1, 2]].map(job).iter().sum()
    }

    fn genetic(preselection: u32, seed: u64) -> GeneticAlgorithm {
        let settings = GaSettings { preselection, ..by_slots_and_fields(20) };
        GeneticAlgorithm::new(slotted(), settings, seed, by_slots(&slotted())).unwrap()
    }

    #[test]
    fn it_finds_better_ones_with_as_many_evaluations() {
        let best = |preselection, seed| {
            let log = run_strategy(&genetic(preselection, seed), 8, |_, _, individual| jobs(individual));
            log.iter().flat_map(|(_, correct)| correct).copied().max().unwrap()
        };
        let better =
            |seed| i32::from(best(8, seed) > best(1, seed)) - i32::from(best(8, seed) < best(1, seed));
        let sum: i32 = (0..20).map(better).sum();
        // Of 20 fair coins, 11 more heads than tails are thrown once in a hundred times.
        assert!(sum >= 11, "{sum}");
    }

    #[test]
    fn children_are_new_and_have_parents() {
        let settings = by_slots_and_fields(20);
        let log = run_strategy(&genetic(4, 3), 12, |_, _, individual| jobs(individual));
        let mut met = BTreeSet::new();
        for (generation, (population, _)) in log.iter().enumerate() {
            assert_eq!(population.len(), 20);
            for (index, child) in population.iter().enumerate() {
                assert_eq!(child.elite, generation > 0 && index < settings.elite as usize);
                if generation > 0 && !child.elite {
                    assert!(child.parents.iter().all(|parent| parent.is_some_and(|parent| parent < 20)));
                }
                // Slots of equal fields in another order are the same to the model.
                let mut slots: Vec<&[u32]> = child.values.chunks(3).collect();
                slots.sort();
                assert!(
                    met.insert(slots.concat()) || child.elite || generation == 0,
                    "{generation}: {child:?}"
                );
            }
        }
    }

    #[test]
    fn a_generation_depends_on_all_that_was_told_before() {
        let strategy = genetic(4, 5);
        let one = strategy.first();
        let two = strategy.next(1, &one, &scores(&[5; 20]), &Past::default());
        let correct: Vec<u32> = two.iter().map(jobs).collect();
        let next = |first: u32| {
            let mut past = Past::of(strategy.remembers());
            let earlier: Vec<u32> = one.iter().map(|one| jobs(one) * first).collect();
            past.add(&one, &scores(&earlier));
            past.add(&two, &scores(&correct));
            strategy.next(2, &two, &scores(&correct), &past)
        };
        assert_eq!(next(1), next(1));
        assert_ne!(next(1), next(0), "what can be bred is the same");
    }

    /// Run digests rest on these bits.
    #[test]
    fn what_is_chosen_is_pinned() {
        let settings = GaSettings { preselection: 4, ..by_slots_and_fields(4) };
        let strategy = GeneticAlgorithm::new(slotted(), settings, 5, by_slots(&slotted())).unwrap();
        let log = run_strategy(&strategy, 4, |_, _, individual| jobs(individual));
        let line = |individual: &Individual| format!("{:?} {:?}\n", individual.values, individual.parents);
        let text: String = log.iter().skip(1).flat_map(|(population, _)| population).map(line).collect();
        expect_test::expect![[r#"
            [3, 4, 0, 6, 0, 0, 6, 0, 0, 5, 3, 0] [Some(1), None]
            [6, 0, 2, 6, 0, 0, 7, 2, 0, 5, 3, 0] [Some(1), Some(3)]
            [6, 0, 2, 5, 0, 2, 7, 2, 0, 5, 1, 1] [Some(3), Some(2)]
            [6, 0, 2, 6, 0, 0, 6, 0, 0, 5, 3, 0] [Some(1), Some(3)]
            [6, 0, 2, 6, 0, 0, 7, 2, 0, 5, 3, 0] [Some(1), None]
            [6, 0, 2, 6, 0, 0, 7, 2, 0, 6, 2, 1] [Some(2), Some(1)]
            [6, 0, 2, 7, 0, 0, 6, 0, 0, 5, 3, 0] [Some(3), Some(3)]
            [6, 0, 2, 6, 0, 0, 7, 3, 0, 5, 3, 0] [Some(3), Some(1)]
            [6, 0, 2, 6, 0, 0, 7, 2, 0, 6, 2, 1] [Some(1), None]
            [6, 0, 2, 6, 0, 0, 6, 2, 0, 6, 2, 1] [Some(1), Some(1)]
            [7, 0, 2, 6, 0, 1, 7, 2, 1, 6, 2, 1] [Some(1), Some(1)]
            [7, 0, 2, 6, 0, 0, 7, 2, 0, 6, 2, 1] [Some(1), Some(1)]
        "#]]
        .assert_eq(&text);
    }
}
