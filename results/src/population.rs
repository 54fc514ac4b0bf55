//! What a generation's row derives from its individuals: best, mean, worst, diversity.

/// The quotient of two counts, correctly rounded.
pub(crate) fn share(part: u32, whole: u32) -> f64 {
    f64::from(part) / f64::from(whole)
}

/// The part of an individual that the summary needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Member<'a> {
    pub chromosome: &'a str,
    pub correct: u32,
    /// Tells equal counts apart.
    pub margin: f64,
    pub queries: u32,
    pub remembered: bool,
}

/// A generation in numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PopulationSummary {
    /// Index of the best individual, the lowest on ties.
    pub best_individual: u32,
    /// Its number of queries with the right object.
    pub best_object_correct: u32,
    /// Number of queries.
    pub queries: u32,
    /// Highest fitness.
    pub best_fitness: f64,
    /// Mean fitness: the sum of correct answers over the sum of queries, rounded once.
    pub mean_fitness: f64,
    /// Lowest fitness.
    pub worst_fitness: f64,
    /// Mean pairwise Hamming distance of the chromosomes as a share of their bits; 0 for a single individual.
    pub diversity: f64,
    /// Individuals that a worker evaluated.
    pub evaluations_computed: u32,
    /// Individuals whose result was known already.
    pub evaluations_remembered: u32,
}

impl PopulationSummary {
    /// Summary of these individuals; `None` if there are none.
    pub(crate) fn of_members(members: &[Member]) -> Option<Self> {
        let first = members.first()?;
        let (mut best, mut worst) = (0, first.correct);
        for (index, member) in members.iter().enumerate() {
            let leader = &members[best];
            let order = member.correct.cmp(&leader.correct).then(member.margin.total_cmp(&leader.margin));
            if order.is_gt() {
                best = index;
            }
            worst = worst.min(member.correct);
        }
        let correct: u64 = members.iter().map(|member| u64::from(member.correct)).sum();
        let queries: u64 = members.iter().map(|member| u64::from(member.queries)).sum();
        let remembered = members.iter().filter(|member| member.remembered).count() as u32;
        Some(Self {
            best_individual: best as u32,
            best_object_correct: members[best].correct,
            queries: first.queries,
            best_fitness: share(members[best].correct, first.queries),
            mean_fitness: correct as f64 / queries as f64,
            worst_fitness: share(worst, first.queries),
            diversity: diversity(members),
            evaluations_computed: members.len() as u32 - remembered,
            evaluations_remembered: remembered,
        })
    }
}

/// A bit that k of n individuals have set differs in k·(n − k) of the n·(n − 1)/2 pairs: exact in integers, and
/// linear in the population where comparing all pairs is not.
fn diversity(members: &[Member]) -> f64 {
    let bits = members.first().map_or(0, |member| member.chromosome.len());
    let n = members.len() as u64;
    if n < 2 || bits == 0 {
        return 0.0;
    }
    let mut set = vec![0u64; bits];
    for member in members {
        for (count, bit) in set.iter_mut().zip(member.chromosome.bytes()) {
            *count += u64::from(bit == b'1');
        }
    }
    let differing: u64 = set.iter().map(|&k| k * n.saturating_sub(k)).sum();
    differing as f64 / (bits as u64 * (n * (n - 1) / 2)) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn summary(members: &[(&str, u32, bool)]) -> PopulationSummary {
        let members: Vec<Member> = members
            .iter()
            .map(|&(chromosome, correct, remembered)| Member {
                chromosome,
                correct,
                margin: 0.0,
                queries: 8,
                remembered,
            })
            .collect();
        PopulationSummary::of_members(&members).unwrap()
    }

    #[test]
    fn best_is_the_first_of_the_equally_good() {
        let got = summary(&[("0", 3, false), ("0", 6, true), ("0", 6, false), ("0", 1, true)]);
        assert_eq!((got.best_individual, got.best_object_correct), (1, 6));
        assert_eq!((got.best_fitness, got.mean_fitness, got.worst_fitness), (0.75, 0.5, 0.125));
        assert_eq!((got.evaluations_computed, got.evaluations_remembered), (2, 2));
    }

    #[test]
    fn diversity_is_the_mean_hamming_distance_over_all_pairs() {
        let chromosomes = ["00110", "01100", "11111", "00110", "10001", "01010"];
        let mut differing = 0;
        let mut pairs = 0;
        for (a, left) in chromosomes.iter().enumerate() {
            for right in &chromosomes[a + 1..] {
                differing += left.bytes().zip(right.bytes()).filter(|(a, b)| a != b).count();
                pairs += 1;
            }
        }
        let members: Vec<_> = chromosomes.iter().map(|&chromosome| (chromosome, 1, false)).collect();
        assert_eq!(summary(&members).diversity, differing as f64 / (5 * pairs) as f64);
        assert_eq!(summary(&members[..1]).diversity, 0.0);
        assert_eq!(summary(&[("01", 1, false), ("10", 1, false)]).diversity, 1.0);
    }

    #[test]
    fn the_margin_tells_equal_counts_apart_and_nothing_else() {
        let member =
            |correct, margin| Member { chromosome: "0", correct, margin, queries: 8, remembered: false };
        let best = |members: &[Member]| PopulationSummary::of_members(members).unwrap().best_individual;
        assert_eq!(best(&[member(3, 0.9), member(4, -0.2), member(4, 0.1), member(4, 0.1)]), 2);
    }

    #[test]
    fn no_individual_has_no_summary() {
        assert_eq!(PopulationSummary::of_members(&[]), None);
    }
}
