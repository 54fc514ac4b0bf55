//! Tests of whole searches: elitism, pairing, determinism, progress on a known landscape, and what is told of it.

mod operators;

use descriptor::random::stream;
use proptest::prelude::*;
use rand::RngExt;

use super::*;
use crate::score::{best, best_first, tests::score, tests::scores};
use crate::stop::tests::NEVER;
use crate::strategy::Strategy; // the prelude of proptest has another

/// The genome of the paper's search space: 25 bits.
pub(crate) fn paper() -> Genome {
    paper_in(Encoding::Binary)
}

fn paper_in(encoding: Encoding) -> Genome {
    let field = |(name, values): (&str, u32)| Field::new(name, values);
    let fields = [("shape_bins", 57), ("m", 6), ("R1", 16), ("R2", 30), ("w", 101)].map(field);
    Genome::new(fields.into(), encoding)
}

fn genetic(settings: GaSettings, seed: u64) -> GeneticAlgorithm {
    GeneticAlgorithm::new(paper(), settings, seed, decompose()).unwrap()
}

/// One part of the values as they are.
pub(crate) fn decompose() -> Decompose {
    Decompose::by(|individual| {
        Some(vec![Part {
            weight: 1.0,
            fields: individual.values.iter().map(|&value| value.into()).collect(),
        }])
    })
}

fn ones(individual: &Individual) -> u32 {
    individual.chromosome.iter().filter(|&&bit| bit).count() as u32
}

/// A generation with the correct count of each individual.
pub(crate) type Generation = (Vec<Individual>, Vec<u32>);

/// Every generation of a strategy on a fitness that may depend on generation and index.
pub(crate) fn run_strategy(
    strategy: &dyn Strategy,
    generations: u32,
    fitness: impl Fn(u32, usize, &Individual) -> u32,
) -> Vec<Generation> {
    let mut log = Vec::new();
    let mut past = Past::of(strategy.remembers());
    let mut population = strategy.first();
    for generation in 1..=generations {
        let correct: Vec<u32> = population
            .iter()
            .enumerate()
            .map(|(index, individual)| fitness(generation, index, individual))
            .collect();
        past.add(&population, &scores(&correct));
        let next = strategy.next(generation, &population, &scores(&correct), &past);
        log.push((std::mem::replace(&mut population, next), correct));
    }
    log
}

/// Every generation of the genetic algorithm on the paper's genome.
fn run(
    settings: GaSettings,
    seed: u64,
    generations: u32,
    fitness: impl Fn(u32, usize, &Individual) -> u32,
) -> Vec<Generation> {
    run_strategy(&genetic(settings, seed), generations, fitness)
}

fn search(settings: GaSettings, seed: u64, stop: StopSettings) -> Search {
    Search::new(Box::new(genetic(settings, seed)), stop, WinnerRule::paper(&stop))
}

/// All settings that change which way the code takes.
fn every_setting() -> Vec<GaSettings> {
    let mut all = Vec::new();
    for (population, elite) in [(2, 0), (2, 1), (7, 0), (7, 3), (10, 1)] {
        for scaling in [Scaling::None, Scaling::Linear, Scaling::Rank] {
            for (crossover, mutation) in [
                (Crossover::Uniform, Mutation::InOrder),
                (Crossover::Slots, Mutation::Field),
                (Crossover::Slots, Mutation::Slot),
            ] {
                let operators = GaSettings { crossover, mutation, ..GaSettings::default() };
                all.push(GaSettings { population, elite, scaling, ..operators });
            }
        }
    }
    all
}

/// Four slots of three fields, the middle one of categories: 32 bits.
pub(crate) fn slotted() -> Genome {
    let field = |slot, values, ordered| Field { slot: Some(slot), ordered, ..Field::new("field", values) };
    let slot = |slot| [field(slot, 8, true), field(slot, 5, false), field(slot, 3, true)];
    Genome::new((0..4).flat_map(slot).collect(), Encoding::Binary)
}

/// The settings of [`slotted`].
pub(crate) fn by_slots_and_fields(population: u32) -> GaSettings {
    GaSettings {
        population,
        crossover: Crossover::Slots,
        mutation: Mutation::Field,
        mutation_rate: 0.1,
        mutation_decay: 1.0,
        ..GaSettings::default()
    }
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
    let population = genetic(settings, 1).first();
    assert_eq!(population.len(), 400);
    assert!(population.iter().all(|individual| individual.parents == [None, None] && !individual.elite));
    for bit in 0..25 {
        let ones = population.iter().filter(|individual| individual.chromosome[bit]).count();
        assert!((150..=250).contains(&ones), "200 ± 5 deviations of 10, got {ones}");
    }
}

#[test]
fn invalid_settings_are_refused() {
    let settings = GaSettings { population: 1, ..GaSettings::default() };
    for method in [Method::Ga, Method::Random, Method::Nsga2] {
        let refused = method.strategy(&paper(), 1, settings, 1, decompose()).map(drop);
        assert_eq!(refused, Err(SettingsError::Population { got: 1 }));
    }
}

#[test]
fn each_generation_is_elite_then_pairs_and_decodes_its_own_chromosomes() {
    let cases = every_setting().into_iter().flat_map(|settings| {
        [Encoding::Binary, Encoding::Gray].map(|encoding| (settings, paper_in(encoding)))
    });
    for (settings, genome) in cases {
        let strategy = GeneticAlgorithm::new(genome.clone(), settings, 5, decompose()).unwrap();
        let log = run_strategy(&strategy, 6, landscape(3));
        let elite = settings.elite as usize;
        for pair in log.windows(2) {
            let ((parents, correct), (children, _)) = (&pair[0], &pair[1]);
            assert_eq!(children.len(), settings.population as usize);
            let order = best_first(&scores(correct));
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
            assert_eq!(individual.values, genome.decode(&individual.chromosome));
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
fn every_generation_and_pair_draws_anew() {
    // From the same population in each generation: zeros and ones show what was swapped and flipped.
    let settings = GaSettings { population: 20, elite: 0, ..GaSettings::default() };
    let generations = |settings| {
        let start: Vec<Individual> =
            (0..20).map(|index| Individual::new(vec![index % 2 == 0; 25], [None, None], &paper())).collect();
        let next =
            |generation| genetic(settings, 4).next(generation, &start, &scores(&[1; 20]), &Past::default());
        (1..=5).map(next).collect::<Vec<_>>()
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
    let mut search = search(GaSettings::default(), 1, NEVER);
    let mut rate = 0.40;
    for _ in 0..10 {
        assert_eq!(search.tell(&scores(&[1; 10]), None, 0).mutation_rate, rate);
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
    let begin = || search(GaSettings::default(), 6, NEVER);
    let (mut uniform_by_zeros, mut uniform_by_ones) = (begin(), begin());
    uniform_by_zeros.tell(&scores(&[0; 10]), None, 0);
    uniform_by_ones.tell(&scores(&[1; 10]), None, 0);
    // Draws from ten slots of width 1 either way: equal parents, equal children.
    assert_eq!(uniform_by_zeros.ask(), uniform_by_ones.ask());
    let correct = scores(&[3, 1, 4, 1, 5, 9, 2, 6, 5, 3]);
    uniform_by_zeros.tell(&correct, None, 0);
    uniform_by_ones.tell(&correct, None, 0);
    assert_eq!(uniform_by_zeros.ask(), uniform_by_ones.ask());
    let mut different = begin();
    different.tell(&scores(&[9, 0, 0, 0, 0, 0, 0, 0, 0, 0]), None, 0);
    assert_ne!(uniform_by_zeros.ask(), different.ask());
}

#[test]
fn chromosomes_without_bits_are_evolved_too() {
    let fixed = Field::new("fixed", 1);
    let genome = Genome::new(vec![fixed; 5], Encoding::Binary);
    for settings in every_setting() {
        let strategy = GeneticAlgorithm::new(genome.clone(), settings, 1, decompose()).unwrap();
        for (population, _) in run_strategy(&strategy, 3, |_, _, _| 4) {
            assert_eq!(population.len(), settings.population as usize);
            assert!(population.iter().all(|individual| individual.chromosome.is_empty()));
            assert!(population.iter().all(|individual| individual.bit_string().is_empty()));
            assert!(population.iter().all(|individual| individual.values == [0; 5]));
        }
    }
}

#[test]
#[should_panic(expected = "one score for each individual")]
fn a_missing_score_is_a_programming_error() {
    search(GaSettings::default(), 1, NEVER).tell(&scores(&[1; 9]), None, 0);
}

#[test]
fn the_bit_string_reads_first_bit_first() {
    let individual = &genetic(GaSettings::default(), 1).first()[0];
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
            let best = best(&scores(&pair[0].1)) as usize;
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

#[test]
fn by_slots_and_fields_a_separable_optimum_is_found() {
    // The sum of the ordered fields and a point for each right category: at most 4·(7 + 2 + 1).
    let fitness = |_, _, individual: &Individual| {
        let slot = |values: &[u32]| values[0] + values[2] + u32::from(values[1] == 3);
        individual.values.chunks(3).map(slot).sum()
    };
    for seed in 0..20 {
        let settings = GaSettings { elite: 2, scaling: Scaling::Rank, ..by_slots_and_fields(40) };
        let log = run_strategy(
            &GeneticAlgorithm::new(slotted(), settings, seed, decompose()).unwrap(),
            60,
            fitness,
        );
        let best = |generation: usize| *log[generation].1.iter().max().unwrap();
        assert!(best(0) < 36 && best(59) == 40, "seed {seed}: {} to {}", best(0), best(59));
    }
}

#[test]
fn the_elite_and_the_best_go_by_the_margin_and_selection_does_not() {
    let genome = slotted();
    let strategy = GeneticAlgorithm::new(genome, by_slots_and_fields(6), 3, decompose()).unwrap();
    let population = strategy.first();
    let with = |margins: [f64; 6]| margins.map(|margin| Score { margin, ..score(4, 9) });
    let [one, other] = [with([0.0, 0.1, 0.5, 0.2, -0.1, 0.5]), with([0.0; 6])];
    let next = |scores| strategy.next(1, &population, scores, &Past::default());
    let (one, other) = (next(&one[..]), next(&other[..]));
    assert_eq!([&one[0], &other[0]].map(|elite| elite.parents[0]), [Some(2), Some(0)]);
    assert_eq!(one[1..], other[1..]);
}

#[test]
fn a_winner_by_validation_is_validated_without_a_patience_and_one_by_fitness_with_it() {
    let (first, second) = (scores(&[1, 4, 4, 2]), scores(&[1, 4, 5, 2]));
    let settings = GaSettings { population: 4, ..GaSettings::default() };
    let begin = |stop, rule| Search::new(Box::new(genetic(settings, 1)), stop, rule);
    let patient = StopSettings { validation_patience: Some(1), ..NEVER };
    for (stop, rule, validated, (winner, reason)) in [
        (NEVER, WinnerRule::Validation, true, (1, None)),
        (patient, WinnerRule::Fitness, true, (2, Some(StopReason::Validation))),
        (NEVER, WinnerRule::Fitness, false, (2, None)),
    ] {
        let mut search = begin(stop, rule);
        assert_eq!(search.to_validate(&first), validated.then_some(1));
        let validation = |correct| validated.then(|| score(correct, 50));
        search.tell(&first, validation(30), 4);
        let state = search.tell(&second, validation(29), 8);
        assert_eq!((state.winner.generation, state.stop), (winner, reason), "{rule:?}");
    }
}

#[test]
fn a_search_counts_generations_keeps_the_winner_and_ends_with_the_stop_rule() {
    let stop = StopSettings { generations: 4, validation_patience: Some(9), ..NEVER };
    let settings = GaSettings { population: 4, ..GaSettings::default() };
    let mut search = search(settings, 3, stop);
    let told = [([3, 5, 5, 1], 40), ([7, 2, 2, 2], 42), ([6, 9, 9, 9], 42), ([1, 1, 1, 8], 41)];
    let expected = [(1, 5, (1, 1)), (0, 7, (2, 0)), (1, 9, (2, 0)), (3, 9, (2, 0))];
    for (generation, ((correct, validated), (best, best_so_far, winner))) in
        (1..).zip(told.into_iter().zip(expected))
    {
        assert_eq!(search.generation(), generation);
        let asked = search.ask().to_vec();
        let scores = scores(&correct);
        assert_eq!(search.to_validate(&scores), Some(best));
        let validation = score(validated, 50);
        let state = search.tell(&scores, Some(validation), 0);
        assert_eq!((state.best, state.best_so_far.correct), (best, best_so_far));
        assert_eq!((state.winner.generation, state.winner.index), winner);
        assert_eq!(state.improved, winner.0 == generation);
        if state.improved {
            assert_eq!(state.winner.individual, asked[best as usize]);
            assert_eq!(state.winner.score, scores[best as usize]);
            assert_eq!(state.winner.validation, Some(validation));
        }
        assert_eq!(state.stop, (generation == 4).then_some(StopReason::Generations));
    }
    // Nothing follows the last generation.
    assert_eq!(search.generation(), 4);
}

#[test]
fn without_validation_there_is_nothing_to_validate() {
    let search = search(GaSettings::default(), 1, NEVER);
    assert_eq!(search.to_validate(&scores(&[1; 10])), None);
}

#[test]
fn the_best_of_a_grid_is_the_only_individual_of_the_only_generation() {
    let best = vec![52, 5, 8, 15, 67];
    for encoding in [Encoding::Binary, Encoding::Gray] {
        let genome = paper_in(encoding);
        let mut search =
            Search::new(Box::new(Exhaustive::new(best.clone(), &genome)), NEVER, WinnerRule::Fitness);
        let [only] = search.ask() else { panic!("one individual") };
        assert_eq!((&only.values, only.parents, only.elite), (&best, [None, None], false));
        assert_eq!(genome.decode(&only.chromosome), best);
        let state = search.tell(&scores(&[7]), None, 0);
        assert_eq!((state.stop, state.mutation_rate), (Some(StopReason::Exhaustive), 0.0));
        assert_eq!((state.winner.generation, state.winner.index), (1, 0));
    }
}

/// Run digests rest on these bits.
#[test]
fn the_streams_and_operators_are_pinned() {
    let settings = GaSettings { population: 4, ..GaSettings::default() };
    let text = |method: Method, genome: &Genome, settings| {
        let strategy = method.strategy(genome, 1, settings, 5, decompose()).unwrap().unwrap();
        let log = run_strategy(strategy.as_ref(), 3, |_, _, individual| ones(individual));
        let line = |individual: &Individual| {
            format!("{} {:?} {:?}\n", individual.bit_string(), individual.values, individual.parents)
        };
        log.iter().flat_map(|(population, _)| population).map(line).collect::<String>()
    };
    expect_test::expect![[r#"
        0111010010100011010111100 [25, 0, 4, 12, 47] [None, None]
        0111110111000000110001001 [27, 2, 8, 2, 7] [None, None]
        0101001101110111001101110 [17, 4, 14, 26, 86] [None, None]
        1100011110111011111100011 [43, 5, 7, 14, 78] [None, None]
        1100011110111011111100011 [43, 5, 7, 14, 78] [Some(3), None]
        0111110010000001010001111 [27, 0, 0, 4, 11] [Some(1), Some(0)]
        0111010110100001011111000 [25, 2, 4, 4, 94] [Some(0), Some(1)]
        0111010100000011101001101 [25, 1, 0, 13, 60] [Some(1), Some(2)]
        1100011110111011111100011 [43, 5, 7, 14, 78] [Some(0), None]
        1101001110101000111100011 [46, 5, 5, 2, 78] [Some(0), Some(0)]
        1100011110111011011000011 [43, 5, 7, 12, 52] [Some(0), Some(0)]
        0111010111101000101111101 [25, 2, 13, 1, 98] [Some(3), Some(3)]
    "#]]
    .assert_eq(&text(Method::Ga, &paper(), settings));
    expect_test::expect![[r#"
        01110100101000110101111001001001 [3, 3, 0, 5, 0, 2, 2, 4, 1, 2, 1, 0] [None, None]
        01111101110000001100010010111000 [3, 4, 0, 6, 0, 0, 6, 0, 0, 5, 3, 0] [None, None]
        01010011011101110011011100011101 [2, 2, 2, 3, 3, 2, 1, 3, 2, 0, 4, 0] [None, None]
        11000111101110111111000110101110 [6, 0, 2, 5, 3, 2, 7, 2, 0, 5, 1, 1] [None, None]
        11000111101110111111000110101110 [6, 0, 2, 5, 3, 2, 7, 2, 0, 5, 1, 1] [Some(3), None]
        01110100010000111100010010111000 [3, 3, 0, 2, 0, 2, 6, 0, 0, 5, 3, 0] [Some(1), Some(0)]
        01111101110000000101111001101001 [3, 4, 0, 6, 0, 0, 2, 4, 1, 3, 1, 0] [Some(0), Some(1)]
        01111101011010111100100010111000 [3, 4, 0, 3, 1, 2, 6, 1, 0, 5, 3, 0] [Some(1), Some(2)]
        11000111101110111111000110101110 [6, 0, 2, 5, 3, 2, 7, 2, 0, 5, 1, 1] [Some(0), None]
        11000111101111111111000110101110 [6, 0, 2, 5, 4, 2, 7, 2, 0, 5, 1, 1] [Some(0), Some(0)]
        11000111101110111111000110101110 [6, 0, 2, 5, 3, 2, 7, 2, 0, 5, 1, 1] [Some(0), Some(0)]
        01111101011010111110100010101000 [3, 4, 0, 3, 1, 2, 7, 1, 0, 5, 1, 0] [Some(3), Some(3)]
    "#]]
    .assert_eq(&text(Method::Ga, &slotted(), by_slots_and_fields(4)));
    expect_test::expect![[r#"
        1011100011001111111111001 [40, 0, 9, 29, 95] [None, None]
        0001011001010011101010001 [4, 3, 10, 13, 63] [None, None]
        0001001011011101011011001 [3, 3, 11, 19, 70] [None, None]
        1100101101100101101000110 [44, 4, 12, 20, 55] [None, None]
        1011010000011101010010110 [40, 0, 3, 19, 17] [None, None]
        1101001010011010011101100 [46, 3, 3, 8, 85] [None, None]
        0001100100100100010000101 [5, 1, 4, 15, 3] [None, None]
        0100000000100011101011010 [14, 0, 4, 13, 71] [None, None]
        1011111110011010001010010 [41, 5, 3, 7, 64] [None, None]
        0101011101011001001101010 [18, 4, 11, 3, 83] [None, None]
        0000110100001111010011111 [2, 1, 1, 27, 24] [None, None]
        0111101101000100011111010 [26, 4, 8, 15, 96] [None, None]
    "#]]
    .assert_eq(&text(Method::Random, &paper(), settings));
}
