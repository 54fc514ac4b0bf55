//! NSGA-II: several objectives at once (Deb, Pratap, Agarwal and Meyarivan, *A fast and elitist multiobjective genetic
//! algorithm: NSGA-II*, IEEE Transactions on Evolutionary Computation 6(2), 2002).

use std::collections::BTreeSet;

use descriptor::random;
use rand::{Rng, RngExt};

use crate::genome::Genome;
use crate::individual::Individual;
use crate::pareto;
use crate::past::Past;
use crate::score::{Objectives, Score};
use crate::settings::{GaSettings, SettingsError};
use crate::strategy::Strategy;
use crate::variation;

/// How many times as many pairs as are wanted are made at most, where children are there already.
const MOST_ATTEMPTS: u64 = 16;

/// NSGA-II over a genome, with the operators of the genetic algorithm: what survives a generation, followed by its
/// children, is the next.
#[derive(Clone, Debug)]
pub struct Nsga2 {
    genome: Genome,
    settings: GaSettings,
    seed: u64,
}

/// An individual that survives its generation.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Survivor {
    index: u32,
    /// Number of its front, from 0.
    rank: usize,
    /// Crowding distance in its front.
    distance: f64,
}

impl Nsga2 {
    /// Of the settings, population is the number of survivors and of children; elite, scaling and with it the roulette
    /// are not used.
    ///
    /// # Errors
    /// If the settings are not valid ([`GaSettings::validate`]).
    pub fn new(genome: Genome, settings: GaSettings, seed: u64) -> Result<Self, SettingsError> {
        Ok(Self { genome, settings: settings.validate()?, seed })
    }
}

impl Strategy for Nsga2 {
    /// Uniformly random bits.
    fn first(&self) -> Vec<Individual> {
        variation::initial(&self.genome, self.settings.population, self.seed)
    }

    /// First the survivors, by rank and from the greatest crowding distance; then their children, two from each pair of
    /// parents, as many as there may be survivors. No two have the same values: where no more others are found, there are
    /// fewer.
    fn next(
        &self,
        generation: u32,
        population: &[Individual],
        scores: &[Score],
        _past: &Past,
    ) -> Vec<Individual> {
        let Self { genome, settings, seed } = self;
        let mut seen = BTreeSet::new();
        let different: Vec<u32> = (0..)
            .zip(population)
            .filter(|(_, one)| seen.insert(&one.values))
            .map(|(index, _)| index)
            .collect();
        let points: Vec<Objectives> =
            different.iter().map(|&index| scores[index as usize].objectives()).collect();
        let mut survivors = survivors(&points, settings.population as usize);
        survivors.iter_mut().for_each(|survivor| survivor.index = different[survivor.index as usize]);
        let mut all: Vec<Individual> = survivors
            .iter()
            .map(|survivor| population[survivor.index as usize].copied_from(survivor.index))
            .collect();
        let mut known: BTreeSet<Vec<u32>> = all.iter().map(|individual| individual.values.clone()).collect();

        let (rate, slots, next) = (self.mutation_rate(generation), genome.slots(), u64::from(generation) + 1);
        let wanted = all.len() + settings.population as usize;
        let most = MOST_ATTEMPTS * u64::from(settings.population).div_ceil(2);
        for pair in 0..most {
            if all.len() >= wanted {
                break;
            }
            let mut rng = random::stream(*seed, "nsga2.selection", &[next, pair]);
            let (a, b) = (tournament(&survivors, &mut rng), tournament(&survivors, &mut rng));
            let mut rng = random::stream(*seed, "nsga2.crossover", &[next, pair]);
            let parents = [a, b].map(|parent| &population[parent as usize].chromosome[..]);
            let (first, second) = variation::cross(parents, settings, &slots, &mut rng);
            for (number, (mut chromosome, parents)) in
                (2 * pair..).zip([(first, [Some(a), Some(b)]), (second, [Some(b), Some(a)])])
            {
                let mut rng = random::stream(*seed, "nsga2.mutation", &[next, number]);
                variation::mutate(&mut chromosome, genome, settings, rate, &mut rng);
                let child = Individual::new(chromosome, parents, genome);
                if all.len() < wanted && known.insert(child.values.clone()) {
                    all.push(child);
                }
            }
        }
        all
    }

    /// Survivors and children.
    fn largest_generation(&self) -> u32 {
        2 * self.settings.population
    }

    fn mutation_rate(&self, generation: u32) -> f64 {
        self.settings.mutation_rate(generation)
    }
}

/// The `most` best of these points: front by front, of the last front that has room the least crowded; in this order,
/// ties by the lower index.
fn survivors(points: &[Objectives], most: usize) -> Vec<Survivor> {
    let mut survivors = Vec::with_capacity(most);
    for (rank, front) in pareto::fronts(points).into_iter().enumerate() {
        if survivors.len() >= most {
            break;
        }
        let distances = pareto::crowding(points, &front);
        let mut members: Vec<Survivor> = front
            .into_iter()
            .zip(distances)
            .map(|(index, distance)| Survivor { index, rank, distance })
            .collect();
        members.sort_by(|a, b| b.distance.total_cmp(&a.distance)); // stable: the lower index stays first
        members.truncate(most - survivors.len());
        survivors.extend(members);
    }
    survivors
}

/// The better of two survivors, drawn uniformly with replacement: that of the lower rank, then the less crowded, then
/// the first drawn. Gives its index in its generation.
fn tournament(survivors: &[Survivor], rng: &mut impl Rng) -> u32 {
    // Drawn as u64, so that the stream is the same whatever the platform's word.
    let mut draw = || survivors[rng.random_range(0..survivors.len() as u64) as usize];
    let (a, b) = (draw(), draw());
    let is_better = b.rank < a.rank || (b.rank == a.rank && b.distance > a.distance);
    if is_better { b.index } else { a.index }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use proptest::prelude::*;
    use rayon::prelude::*;

    use super::*;
    use crate::genome::{Encoding, Field};
    use crate::hypervolume::hypervolume;
    use crate::score::dominates;
    use crate::strategy::Strategy; // the prelude of proptest has another
    use crate::tests::paper;

    const SETTINGS: fn(u32) -> GaSettings = |population| GaSettings { population, ..GaSettings::default() };

    /// Scores of a landscape of three objectives without structure.
    fn landscape(number: u64, individual: &Individual) -> Score {
        let values: Vec<u64> = individual.values.iter().map(|&value| u64::from(value)).collect();
        let mut rng = random::stream(number, "landscape", &values);
        let further = [rng.random_range(0..6), rng.random_range(0..6)];
        Score { correct: rng.random_range(0..6), queries: 6, margin: 0.0, further }
    }

    /// Every generation of a strategy with its scores.
    fn run(
        strategy: &Nsga2,
        generations: u32,
        score: impl Fn(&Individual) -> Score,
    ) -> Vec<(Vec<Individual>, Vec<Score>)> {
        let mut log: Vec<(Vec<Individual>, Vec<Score>)> = Vec::new();
        for generation in 1..=generations {
            let population = match log.last() {
                Some((before, scores)) => strategy.next(generation - 1, before, scores, &Past::default()),
                None => strategy.first(),
            };
            let scores = population.iter().map(&score).collect();
            log.push((population, scores));
        }
        log
    }

    #[test]
    fn a_tournament_prefers_the_lower_rank_then_the_less_crowded() {
        let survivor = |index, rank, distance| Survivor { index, rank, distance };
        let survivors = [survivor(4, 1, f64::INFINITY), survivor(7, 0, 0.5), survivor(2, 0, 2.0)];
        let mut wins = [0u32; 3];
        for trial in 0..9_000 {
            let winner = tournament(&survivors, &mut random::stream(1, "test", &[trial]));
            wins[survivors.iter().position(|survivor| survivor.index == winner).unwrap()] += 1;
        }
        // Of nine ordered pairs the worst wins one, against itself, the next three, the best five; ± 5 deviations.
        for (wins, expected) in wins.into_iter().zip([1_000, 3_000, 5_000]) {
            assert!((expected - 240..=expected + 240).contains(&wins), "{wins} of {expected}");
        }
    }

    #[test]
    fn a_space_that_is_smaller_than_the_population_is_searched_to_its_end() {
        let genome = Genome::new(vec![Field::new("a", 4), Field::new("b", 3)], Encoding::Binary);
        let strategy = Nsga2::new(genome, SETTINGS(20), 1).unwrap();
        let log = run(&strategy, 6, |individual| landscape(2, individual));
        let met: BTreeSet<&Vec<u32>> = log.iter().flat_map(|(all, _)| all).map(|one| &one.values).collect();
        assert_eq!(met.len(), 12);
        // Nothing new is left: survivors only.
        assert!(log[5].0.iter().all(|individual| individual.elite) && log[5].0.len() == 12);
        let fixed = Genome::new(vec![Field::new("fixed", 1); 3], Encoding::Binary);
        let strategy = Nsga2::new(fixed, SETTINGS(5), 1).unwrap();
        assert!(run(&strategy, 3, |one| landscape(1, one)).iter().skip(1).all(|(all, _)| all.len() == 1));
    }

    /// Run digests rest on these bits.
    #[test]
    fn the_streams_are_pinned() {
        let strategy = Nsga2::new(paper(), SETTINGS(3), 5).unwrap();
        let line = |individual: &Individual| {
            format!("{} {:?} {:?}\n", individual.bit_string(), individual.values, individual.parents)
        };
        let log = run(&strategy, 3, |individual| landscape(3, individual));
        let text: String = log.iter().flat_map(|(population, _)| population).map(line).collect();
        expect_test::expect![[r#"
            0111010010100011010111100 [25, 0, 4, 12, 47] [None, None]
            0111110111000000110001001 [27, 2, 8, 2, 7] [None, None]
            0101001101110111001101110 [17, 4, 14, 26, 86] [None, None]
            0101001101110111001101110 [17, 4, 14, 26, 86] [Some(2), None]
            0111010010100011010111100 [25, 0, 4, 12, 47] [Some(0), None]
            0111110111000000110001001 [27, 2, 8, 2, 7] [Some(1), None]
            0111000000110011011101100 [24, 0, 6, 12, 85] [Some(2), Some(0)]
            0101000111010011000111110 [17, 2, 10, 11, 48] [Some(0), Some(2)]
            0101011001000011011101100 [18, 3, 8, 12, 85] [Some(0), Some(2)]
            0101001101110111001101110 [17, 4, 14, 26, 86] [Some(0), None]
            0111000000110011011101100 [24, 0, 6, 12, 85] [Some(3), None]
            0101000111010011000111110 [17, 2, 10, 11, 48] [Some(4), None]
            0111000000110011011111010 [24, 0, 6, 12, 96] [Some(3), Some(0)]
            0101001101110111000101100 [17, 4, 14, 26, 34] [Some(0), Some(3)]
            0101001101010011011111100 [17, 4, 10, 12, 97] [Some(4), Some(3)]
        "#]]
        .assert_eq(&text);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn a_generation_is_the_best_of_the_one_before_and_new_children_of_these(
            number in any::<u64>(),
            seed in any::<u64>(),
            population in 2u32..12,
        ) {
            let strategy = Nsga2::new(paper(), SETTINGS(population), seed).unwrap();
            let size = population as usize;
            let log = run(&strategy, 6, |individual| landscape(number, individual));
            prop_assert_eq!(&log, &run(&strategy, 6, |individual| landscape(number, individual)));
            for pair in log.windows(2) {
                let ((before, scores), (after, _)) = (&pair[0], &pair[1]);
                let different: BTreeSet<&Vec<u32>> = before.iter().map(|one| &one.values).collect();
                let kept = size.min(different.len());
                prop_assert_eq!(after.len(), kept + size);
                let (kept, children) = after.split_at(kept);
                let mut survivors = BTreeSet::new();
                for survivor in kept {
                    prop_assert!(survivor.elite && survivor.parents[1].is_none());
                    let index = survivor.parents[0].unwrap();
                    prop_assert_eq!(&survivor.chromosome, &before[index as usize].chromosome);
                    prop_assert!(survivors.insert(index));
                }
                // None that was dropped dominates one that survived.
                let of = |index: &u32| scores[*index as usize].objectives();
                let values: BTreeSet<&Vec<u32>> = kept.iter().map(|one| &one.values).collect();
                let dropped = (0..before.len() as u32).filter(|&i| !values.contains(&before[i as usize].values));
                for dropped in dropped {
                    prop_assert!(!survivors.iter().any(|survivor| dominates(&of(&dropped), &of(survivor))));
                }
                let mut known: BTreeSet<&Vec<u32>> = kept.iter().map(|one| &one.values).collect();
                for child in children {
                    prop_assert!(!child.elite && known.insert(&child.values));
                    prop_assert!(child.parents.iter().all(|parent| survivors.contains(&parent.unwrap())));
                }
            }
        }

        #[test]
        fn the_least_crowded_of_the_front_that_is_cut_survive(
            points in prop::collection::vec(prop::array::uniform3(0u64..9), 1..30),
            most in 1usize..30,
        ) {
            let kept = survivors(&points, most);
            prop_assert_eq!(kept.len(), most.min(points.len()));
            let fronts = pareto::fronts(&points);
            for (rank, front) in fronts.iter().enumerate() {
                let distances = pareto::crowding(&points, front);
                let of_rank: Vec<&Survivor> = kept.iter().filter(|survivor| survivor.rank == rank).collect();
                let is_kept = |index: &u32| of_rank.iter().any(|survivor| survivor.index == *index);
                let before: usize = fronts[..rank].iter().map(Vec::len).sum();
                prop_assert_eq!(of_rank.len(), front.len().min(most.saturating_sub(before)));
                let least = of_rank.iter().map(|survivor| survivor.distance).fold(f64::INFINITY, f64::min);
                for (index, distance) in front.iter().zip(distances) {
                    prop_assert!(is_kept(index) || distance <= least);
                }
            }
        }
    }

    const BITS: u32 = 12;
    const SCALE: f64 = 1_048_576.0;

    /// ZDT1, ZDT2 and ZDT3 (Zitzler, Deb and Thiele 2000), by their number.
    fn zdt(which: u32, x: &[f64]) -> Vec<f64> {
        let rest = &x[1..];
        let g = 1.0 + 9.0 * rest.iter().sum::<f64>() / rest.len() as f64;
        let share = x[0] / g;
        let h = match which {
            1 => 1.0 - share.sqrt(),
            2 => 1.0 - share * share,
            _ => 1.0 - share.sqrt() - share * libm::sin(10.0 * PI * x[0]),
        };
        vec![x[0], g * h]
    }

    /// DTLZ2 of three objectives (Deb, Thiele, Laumanns and Zitzler 2002).
    fn dtlz2(x: &[f64]) -> Vec<f64> {
        let g: f64 = x[2..].iter().map(|x| (x - 0.5) * (x - 0.5)).sum();
        let [(s0, c0), (s1, c1)] = [x[0], x[1]].map(|x| {
            let angle = x * PI / 2.0;
            (libm::sin(angle), libm::cos(angle))
        });
        vec![(1.0 + g) * c0 * c1, (1.0 + g) * c0 * s1, (1.0 + g) * s0]
    }

    /// The hypervolume of the last survivors, in the units of the functions.
    fn last_hypervolume(
        variables: usize,
        ends: [f64; 3],
        function: impl Fn(&[f64]) -> Vec<f64>,
        seed: u64,
    ) -> f64 {
        let field = Field::new("x", 1 << BITS);
        let genome = Genome::new(vec![field; variables], Encoding::Binary);
        let settings =
            GaSettings { mutation_rate: 6.0 / genome.bits() as f64, mutation_decay: 1.0, ..SETTINGS(100) };
        let score = |individual: &Individual| {
            let x = individual.values.iter().map(|&value| f64::from(value) / f64::from((1u32 << BITS) - 1));
            let values = function(&x.collect::<Vec<f64>>());
            let whole = |which: usize| values.get(which).map_or(0, |value| (value * SCALE).round() as u64);
            let correct = u32::MAX - whole(0) as u32;
            Score { correct, queries: u32::MAX, margin: 0.0, further: [whole(1), whole(2)] }
        };
        let strategy = Nsga2::new(genome, settings, seed).unwrap();
        let (population, scores) = run(&strategy, 100, score).pop().unwrap();
        let last = &strategy.next(100, &population, &scores, &Past::default())[..100];
        let of = |individual: &Individual| score(individual).objectives();
        let volume = hypervolume(last.iter().map(of), ends.map(|end| (end * SCALE) as u64));
        volume as f64 / SCALE / SCALE / SCALE
    }

    /// The medians are those of pymoo 0.6.2 over 101 seeds, with the same operators and encoding, as
    /// `python3 tests/python/nsga2_peer.py` prints them.
    #[test]
    fn hypervolumes_on_test_functions_are_those_of_pymoo_within_a_hundredth() {
        type Function = fn(&[f64]) -> Vec<f64>;
        // f2 of ZDT3 can be negative, so 1 is added to it.
        let cases: [(&str, usize, [f64; 3], Function, f64); 4] = [
            ("ZDT1", 10, [1.1, 1.1, 1.0], |x| zdt(1, x), 0.86852),
            ("ZDT2", 10, [1.1, 1.1, 1.0], |x| zdt(2, x), 0.53556),
            ("ZDT3", 10, [1.1, 2.1, 1.0], |x| vec![x[0], zdt(3, x)[1] + 1.0], 1.31892),
            ("DTLZ2", 7, [1.1, 1.1, 1.1], dtlz2, 0.66839),
        ];
        for (name, variables, ends, function, expected) in cases {
            let volume = |seed| last_hypervolume(variables, ends, function, seed);
            let mut volumes: Vec<f64> = (1..=31u64).into_par_iter().map(volume).collect();
            volumes.sort_by(f64::total_cmp);
            let got = volumes[15];
            assert!((got / expected - 1.0).abs() < 0.01, "{name}: {got}, pymoo {expected}");
        }
    }
}
