//! Tests of whole evolutions: elitism, pairing, determinism and progress on a known landscape.

use descriptor::genes::{Domain, GENES};
use descriptor::{Encoding, GeneTable, random::stream};
use proptest::prelude::*;
use rand::RngExt;

use super::*;

fn ones(individual: &Individual) -> u32 {
    individual.chromosome.iter().filter(|&&bit| bit).count() as u32
}

/// Every generation of a run on a fitness that may depend on generation and index.
fn run(
    settings: GaSettings,
    seed: u64,
    generations: u32,
    fitness: impl Fn(u32, usize, &Individual) -> u32,
) -> Vec<(Vec<Individual>, Vec<u32>)> {
    let mut evolution = Evolution::new(GeneTable::paper(), settings, seed).unwrap();
    let mut log = Vec::new();
    for generation in 1..=generations {
        assert_eq!(evolution.generation(), generation);
        let population = evolution.population().to_vec();
        let correct: Vec<u32> = population
            .iter()
            .enumerate()
            .map(|(index, individual)| fitness(generation, index, individual))
            .collect();
        evolution.tell(&correct);
        log.push((population, correct));
    }
    log
}

/// All settings that change which way the code takes.
fn every_setting() -> Vec<GaSettings> {
    let mut all = Vec::new();
    for (population, elite) in [(2, 0), (2, 1), (7, 0), (7, 3), (10, 1)] {
        for scaling in [Scaling::None, Scaling::Linear, Scaling::Rank] {
            for encoding in [Encoding::Binary, Encoding::Gray] {
                all.push(GaSettings { population, elite, scaling, encoding, ..GaSettings::default() });
            }
        }
    }
    all
}

/// A fitness without structure: the landscape's number picks it.
fn landscape(number: u64) -> impl Fn(u32, usize, &Individual) -> u32 {
    move |_, _, individual| {
        let bits: Vec<u64> = individual.chromosome.iter().map(|&bit| u64::from(bit)).collect();
        stream(number, "landscape", &bits).random_range(0..6)
    }
}

#[test]
fn the_first_generation_is_random_and_without_parents() {
    let settings = GaSettings { population: 400, ..GaSettings::default() };
    let evolution = Evolution::new(GeneTable::paper(), settings, 1).unwrap();
    assert_eq!((evolution.generation(), evolution.population().len()), (1, 400));
    assert!(
        evolution
            .population()
            .iter()
            .all(|individual| individual.parents == [None, None] && !individual.elite)
    );
    for bit in 0..25 {
        let ones = evolution.population().iter().filter(|individual| individual.chromosome[bit]).count();
        assert!((150..=250).contains(&ones), "200 ± 5 deviations of 10, got {ones}");
    }
}

#[test]
fn invalid_settings_are_refused() {
    let settings = GaSettings { population: 1, ..GaSettings::default() };
    let error = Evolution::new(GeneTable::paper(), settings, 1).unwrap_err();
    assert_eq!(error, SettingsError::Population { got: 1 });
}

#[test]
fn each_generation_is_elite_then_pairs_and_decodes_its_own_chromosomes() {
    for settings in every_setting() {
        let log = run(settings, 5, 6, landscape(3));
        let elite = settings.elite as usize;
        for pair in log.windows(2) {
            let ((parents, correct), (children, _)) = (&pair[0], &pair[1]);
            assert_eq!(children.len(), settings.population as usize);
            let order = selection::best_first(correct);
            for (rank, child) in children[..elite].iter().enumerate() {
                assert_eq!((child.parents, child.elite), ([Some(order[rank]), None], true));
                assert_eq!(child.chromosome, parents[order[rank] as usize].chromosome);
            }
            for siblings in children[elite..].chunks(2) {
                let [Some(a), Some(b)] = siblings[0].parents else { panic!("no parents") };
                assert!(a < settings.population && b < settings.population);
                assert!(siblings.iter().all(|child| !child.elite));
                if let Some(second) = siblings.get(1) {
                    assert_eq!(second.parents, [Some(b), Some(a)]);
                }
            }
        }
        for individual in log.iter().flat_map(|(population, _)| population) {
            let parameters = GeneTable::paper().decode(&individual.chromosome, settings.encoding);
            assert_eq!(individual.parameters, parameters);
        }
    }
}

#[test]
fn without_mutation_siblings_share_out_their_parents_bits() {
    let settings = GaSettings { population: 11, elite: 2, mutation_rate: 0.0, ..GaSettings::default() };
    let log = run(settings, 8, 5, landscape(1));
    for pair in log.windows(2) {
        let ((parents, _), (children, _)) = (&pair[0], &pair[1]);
        for siblings in children[2..].chunks(2) {
            let [Some(a), Some(b)] = siblings[0].parents else { panic!("no parents") };
            let (a, b) = (&parents[a as usize].chromosome, &parents[b as usize].chromosome);
            for bit in 0..25 {
                let first = siblings[0].chromosome[bit];
                assert!(first == a[bit] || first == b[bit]);
                if let Some(second) = siblings.get(1) {
                    assert_eq!(
                        u32::from(first) + u32::from(second.chromosome[bit]),
                        u32::from(a[bit]) + u32::from(b[bit])
                    );
                }
            }
        }
    }
    // Nine children are five pairs: the fifth has no second child.
    assert_eq!(log[1].0[2..].chunks(2).map(<[_]>::len).collect::<Vec<_>>(), [2, 2, 2, 2, 1]);
}

#[test]
fn children_of_generation_g_are_mutated_with_p_of_g() {
    // Crossing nothing over and drawing one parent only shows the flips themselves: of a pair of points on 25 bits
    // (2·(25 − d) ordered draws at distance d > 0, 25 at 0) the mean number of bits between, both included, is
    // 1 + (25² − 1) / (3·25) = 9.32, of which the share p flips.
    let settings = GaSettings {
        population: 2_000,
        elite: 1,
        crossover_rate: 0.0,
        mutation_decay: 0.5,
        ..GaSettings::default()
    };
    let log = run(settings, 2, 4, |_, index, _| u32::from(index == 0));
    for (generation, rate) in [(1, 0.40), (2, 0.20), (3, 0.10)] {
        let parent = &log[generation - 1].0[0].chromosome;
        let flips: usize = log[generation].0[1..]
            .iter()
            .map(|child| child.chromosome.iter().zip(parent).filter(|(a, b)| a != b).count())
            .sum();
        let mean = flips as f64 / 1_999.0;
        // The deviation of one child's flips is below 3.2, of the mean over 1999 below 0.072.
        assert!((mean - 9.32 * rate).abs() < 0.3, "generation {generation}: {mean}");
    }
}

#[test]
fn every_generation_and_pair_draws_anew() {
    // From the same population in each generation: zeros and ones show what was swapped and flipped.
    let settings = GaSettings { population: 20, elite: 0, ..GaSettings::default() };
    let generations = |settings| {
        let mut evolution = Evolution::new(GeneTable::paper(), settings, 4).unwrap();
        let start: Vec<Individual> = (0..20)
            .map(|index| Individual {
                chromosome: vec![index % 2 == 0; 25],
                ..evolution.population[0].clone()
            })
            .collect();
        let mut all = Vec::new();
        for _ in 0..5 {
            evolution.population = start.clone();
            evolution.tell(&[1; 20]);
            all.push(evolution.population().to_vec());
        }
        all
    };
    // What crossover swapped, of the first children whose parents differ.
    let mut masks = Vec::new();
    // Whom selection drew, pair by pair.
    let mut drawn = Vec::new();
    for population in generations(GaSettings { mutation_rate: 0.0, ..settings }) {
        for child in population.iter().step_by(2) {
            let [Some(a), Some(b)] = child.parents else { panic!("no parents") };
            if a % 2 != b % 2 {
                masks.push(child.chromosome.iter().map(|&bit| bit != (a % 2 == 0)).collect::<Vec<_>>());
            }
        }
        drawn.push(population.iter().step_by(2).map(|child| child.parents).collect::<Vec<_>>());
    }
    // What mutation flipped, child by child.
    let flips: Vec<Vec<Vec<bool>>> = generations(GaSettings { crossover_rate: 0.0, ..settings })
        .iter()
        .map(|population| {
            let flipped = |child: &Individual| {
                let before = child.parents[0].is_some_and(|parent| parent % 2 == 0);
                child.chromosome.iter().map(|&bit| bit != before).collect()
            };
            population.iter().map(flipped).collect()
        })
        .collect();
    assert!(masks.len() > 15, "about half of 50 pairs differ, got {}", masks.len());
    for i in 0..masks.len() {
        assert!(!masks[..i].contains(&masks[i]), "one of 2^25 masks twice");
    }
    for i in 0..5 {
        assert!(!drawn[..i].contains(&drawn[i]), "the same parents in two generations");
        assert!(!flips[..i].contains(&flips[i]), "the same flips in two generations");
        assert!(drawn[i].iter().any(|pair| *pair != drawn[i][0]), "the same parents for every pair");
        assert!(flips[i].iter().any(|child| *child != flips[i][0]), "the same flips for every child");
    }
}

#[test]
fn the_current_mutation_rate_follows_the_schedule() {
    let mut evolution = Evolution::new(GeneTable::paper(), GaSettings::default(), 1).unwrap();
    let mut rate = 0.40;
    for _ in 0..10 {
        assert_eq!(evolution.mutation_rate(), rate);
        evolution.tell(&[1; 10]);
        rate *= 0.97;
    }
}

#[test]
fn the_same_seed_repeats_every_bit_and_another_does_not() {
    for settings in every_setting() {
        let log = run(settings, 42, 8, landscape(9));
        assert_eq!(log, run(settings, 42, 8, landscape(9)), "{settings:?}");
        let other = run(settings, 43, 8, landscape(9));
        assert!(log.iter().zip(&other).all(|(a, b)| a.0 != b.0), "{settings:?}");
    }
}

#[test]
fn a_generation_depends_on_the_population_and_counts_not_on_how_they_came_about() {
    // Fitness of earlier generations enters by the population alone: where two histories meet in one population,
    // they go on as one.
    let start = Evolution::new(GeneTable::paper(), GaSettings::default(), 6).unwrap();
    let (mut uniform_by_zeros, mut uniform_by_ones) = (start.clone(), start.clone());
    uniform_by_zeros.tell(&[0; 10]);
    uniform_by_ones.tell(&[1; 10]);
    // Draws from ten slots of width 1 either way: equal parents, equal children.
    assert_eq!(uniform_by_zeros.population(), uniform_by_ones.population());
    let correct = [3, 1, 4, 1, 5, 9, 2, 6, 5, 3];
    uniform_by_zeros.tell(&correct);
    uniform_by_ones.tell(&correct);
    assert_eq!(uniform_by_zeros.population(), uniform_by_ones.population());
    let mut different = start;
    different.tell(&[9, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    assert_ne!(uniform_by_zeros.population(), different.population());
}

#[test]
fn chromosomes_without_bits_are_evolved_too() {
    let table = GeneTable::new(GENES.each_ref().map(|spec| Domain::fixed(spec.paper.0)), true).unwrap();
    for settings in every_setting() {
        let mut evolution = Evolution::new(table.clone(), settings, 1).unwrap();
        for _ in 0..3 {
            let population = evolution.population();
            assert!(population.iter().all(|individual| individual.chromosome.is_empty()));
            assert!(population.iter().all(|individual| individual.bit_string().is_empty()));
            evolution.tell(&vec![4; settings.population as usize]);
        }
    }
}

#[test]
#[should_panic(expected = "one count for each individual")]
fn a_missing_count_is_a_programming_error() {
    Evolution::new(GeneTable::paper(), GaSettings::default(), 1).unwrap().tell(&[1; 9]);
}

#[test]
fn the_bit_string_reads_first_bit_first() {
    let evolution = Evolution::new(GeneTable::paper(), GaSettings::default(), 1).unwrap();
    let individual = &evolution.population()[0];
    let text = individual.bit_string();
    assert_eq!(text.len(), 25);
    for (letter, &bit) in text.chars().zip(&individual.chromosome) {
        assert_eq!(letter == '1', bit);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn an_elite_never_loses_the_best(
        number in any::<u64>(),
        seed in any::<u64>(),
        population in 2u32..15,
        elite in 1u32..15,
        scaling in prop::sample::select(vec![Scaling::None, Scaling::Linear, Scaling::Rank]),
    ) {
        prop_assume!(elite < population);
        let settings = GaSettings { population, elite, scaling, ..GaSettings::default() };
        let log = run(settings, seed, 12, landscape(number));
        for pair in log.windows(2) {
            prop_assert!(pair[1].1.iter().max() >= pair[0].1.iter().max());
            // And the individual itself is there, bit for bit.
            let best = selection::best(&pair[0].1).unwrap() as usize;
            prop_assert_eq!(&pair[1].0[0].chromosome, &pair[0].0[best].chromosome);
        }
    }
}

#[test]
fn counting_ones_climbs_to_near_all_of_them() {
    let settings = GaSettings {
        population: 40,
        elite: 2,
        scaling: Scaling::Rank,
        mutation_rate: 0.10,
        ..GaSettings::default()
    };
    for seed in 0..40 {
        let log = run(settings, seed, 60, |_, _, individual| ones(individual));
        let best = |generation: usize| *log[generation].1.iter().max().unwrap();
        // Of 25; the best of 40 random chromosomes has 18 or 19, and drawing 2400 would rarely give 23.
        assert!(best(59) > best(0) && best(59) >= 24, "seed {seed}: {} to {}", best(0), best(59));
    }
}
