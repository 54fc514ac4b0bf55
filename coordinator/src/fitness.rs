//! What a search's fitness counts: which clouds are matched with which, and how much each of these protocols weighs
//! (DESIGN 5b).

use std::fmt;

use proto::task::{Exclusion, MatchingRule, Objective};
use results::Counts;

use crate::run::matching::{Matching, TRAIN1, TRAIN2};

/// Which training clouds are matched with which. Validation clouds are judged by the same rule against both training
/// sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FitnessProtocol {
    /// train1 against train2 (paper).
    Split,
    /// Each cloud of both training sets against those of other sequences.
    CrossSequence,
    /// Each cloud of both training sets against all others.
    LeaveOneOut,
}

/// The fitness of a search: a sum of counts with whole weights, at least one of them above 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fitness {
    weights: [u32; FitnessProtocol::ALL.len()],
    objective: Objective,
    margin: bool,
}

/// Which clouds one evaluation of a fitness matches, as positions in [`SPLITS`](crate::dataset::SPLITS), under which
/// rule, and the weight of its counts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// Splits of the queries.
    pub query: &'static [usize],
    /// Splits of the database.
    pub database: &'static [usize],
    /// Which clouds of the database a query is not compared with, and what is counted.
    pub rule: MatchingRule,
    /// Of its counts, at least 1.
    pub weight: u32,
}

/// Counts under a fitness: sums over its parts, each times its weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Weighted counts.
    pub counts: Counts,
    /// Soft margin, −1 to 1; `None` where none is asked for.
    pub margin: Option<f64>,
}

impl FitnessProtocol {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Split, Self::CrossSequence, Self::LeaveOneOut];

    /// Its name in experiments.
    pub fn name(self) -> &'static str {
        match self {
            Self::Split => "split",
            Self::CrossSequence => "cross-sequence",
            Self::LeaveOneOut => "leave-one-out",
        }
    }

    fn exclusion(self) -> Exclusion {
        match self {
            Self::Split => Exclusion::None,
            Self::CrossSequence => Exclusion::SameSequence,
            Self::LeaveOneOut => Exclusion::SameCloud,
        }
    }
}

/// Largest weight of a protocol.
pub const MAX_WEIGHT: u32 = 100;

const BOTH: &[usize] = &[TRAIN1, TRAIN2];

impl Fitness {
    /// The paper's: objects of train1 among those of train2.
    pub const PAPER: Self = Self { weights: [1, 0, 0], objective: Objective::Object, margin: false };

    /// Objects of each training cloud among those of other sequences.
    pub const CROSS_SEQUENCE: Self = Self { weights: [0, 1, 0], objective: Objective::Object, margin: true };

    /// With a weight for each of [`FitnessProtocol::ALL`]; `None` if all are 0 or one is above [`MAX_WEIGHT`].
    pub fn new(weights: [u32; 3], objective: Objective, margin: bool) -> Option<Self> {
        let is_sound = weights.iter().any(|&weight| weight > 0) && weights.iter().all(|&w| w <= MAX_WEIGHT);
        is_sound.then_some(Self { weights, objective, margin })
    }

    /// The weight of each of [`FitnessProtocol::ALL`].
    pub fn weights(&self) -> [u32; 3] {
        self.weights
    }

    /// Its protocols with their weights, those of weight 0 left out.
    pub fn protocols(&self) -> impl Iterator<Item = (FitnessProtocol, u32)> {
        FitnessProtocol::ALL.into_iter().zip(self.weights).filter(|&(_, weight)| weight > 0)
    }

    /// The same with one of its protocols only.
    pub fn of_protocol(&self, protocol: FitnessProtocol) -> Self {
        let weights = FitnessProtocol::ALL.map(|other| u32::from(other == protocol));
        Self { weights, ..*self }
    }

    /// What has to be recognised.
    pub fn objective(&self) -> Objective {
        self.objective
    }

    /// Whether it counts what the paper's does, so that a grid counts it, too; the margin only breaks ties.
    pub fn counts_as_the_paper(&self) -> bool {
        Self { margin: false, ..*self } == Self::PAPER
    }

    /// Whether equal counts are told apart by the soft margin.
    pub fn has_margin(&self) -> bool {
        self.margin
    }

    /// Whether clouds must have sequences.
    pub fn needs_sequences(&self) -> bool {
        self.protocols().any(|(protocol, _)| protocol == FitnessProtocol::CrossSequence)
    }

    /// The evaluations whose weighted sum it is. Protocols that ask for the same are one part. Test clouds are matched
    /// plainly, whatever the fitness.
    pub fn parts(&self, matching: Matching) -> Vec<Part> {
        let plain = |rule, weight| {
            let (query, database) = matching.splits();
            Part { query, database, rule, weight }
        };
        let mut parts: Vec<Part> = Vec::new();
        for (protocol, weight) in self.protocols() {
            let rule = |exclude| MatchingRule { exclude, objective: self.objective, margin: self.margin };
            let part = match (matching, protocol) {
                (Matching::Test, _) => return vec![plain(MatchingRule::default(), 1)],
                // A validation cloud is in no training set: there is no cloud to leave out.
                (Matching::Train, FitnessProtocol::Split)
                | (Matching::Validation, FitnessProtocol::Split | FitnessProtocol::LeaveOneOut) => {
                    plain(rule(Exclusion::None), weight)
                }
                (Matching::Validation, FitnessProtocol::CrossSequence) => {
                    plain(rule(Exclusion::SameSequence), weight)
                }
                (Matching::Train, _) => {
                    Part { query: BOTH, database: BOTH, rule: rule(protocol.exclusion()), weight }
                }
            };
            match parts.iter_mut().find(|other| Part { weight, ..(*other).clone() } == part) {
                Some(same) => same.weight += weight,
                None => parts.push(part),
            }
        }
        parts
    }

    /// Of these counts, that of correct answers that matters.
    fn correct(&self, counts: &Counts) -> u32 {
        match self.objective {
            Objective::Object => counts.object_correct,
            Objective::Category => counts.category_correct,
        }
    }

    /// The same for tables, which have counts of objects beside it; `None` where it is theirs.
    pub fn objective_correct(&self, counts: &Counts) -> Option<u32> {
        (self.objective != Objective::Object).then(|| self.correct(counts))
    }

    /// How good a descriptor is by these counts.
    pub fn score(&self, measured: &Measured) -> evolution::Score {
        let Measured { counts, margin } = measured;
        evolution::Score {
            correct: self.correct(counts),
            queries: counts.queries,
            margin: margin.unwrap_or_default(),
            further: [0; 2],
        }
    }
}

/// As the keys of `[search.fitness]` that determine what is counted: `split = 1, cross-sequence = 2`.
impl fmt::Display for Fitness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (place, (protocol, weight)) in self.protocols().enumerate() {
            let comma = if place == 0 { "" } else { ", " };
            write!(f, "{comma}{} = {weight}", protocol.name())?;
        }
        match self.objective {
            Objective::Object => Ok(()),
            Objective::Category => write!(f, ", objective = \"category\""),
        }
    }
}

impl Measured {
    /// The weighted sum of counts, each with the sum of its margins, in the order of the parts.
    pub fn sum(parts: impl IntoIterator<Item = (Counts, Option<f64>, u32)>) -> Self {
        let mut counts = Counts { object_correct: 0, category_correct: 0, queries: 0 };
        let mut margins: Option<f64> = None;
        for (part, margin, weight) in parts {
            let of = |count: u32| count.saturating_mul(weight);
            counts.object_correct = counts.object_correct.saturating_add(of(part.object_correct));
            counts.category_correct = counts.category_correct.saturating_add(of(part.category_correct));
            counts.queries = counts.queries.saturating_add(of(part.queries));
            margins =
                margin.map(|margin| margins.unwrap_or_default() + f64::from(weight) * margin).or(margins);
        }
        let mean = |sum: f64| if counts.queries == 0 { 0.0 } else { sum / f64::from(counts.queries) };
        Self { counts, margin: margins.map(mean) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(object_correct: u32, category_correct: u32, queries: u32) -> Counts {
        Counts { object_correct, category_correct, queries }
    }

    #[test]
    fn the_papers_fitness_is_one_plain_evaluation() {
        let rule = MatchingRule::default();
        for matching in [Matching::Train, Matching::Validation, Matching::Test] {
            let (query, database) = matching.splits();
            assert_eq!(Fitness::PAPER.parts(matching), [Part { query, database, rule, weight: 1 }]);
        }
        assert!(!Fitness::PAPER.needs_sequences());
    }

    #[test]
    fn protocols_that_ask_for_the_same_are_asked_once() {
        let fitness = Fitness::new([1, 3, 2], Objective::Category, true).unwrap();
        assert!(fitness.needs_sequences());
        let parts = |queries| -> Vec<(Exclusion, u32)> {
            fitness.parts(queries).iter().map(|part| (part.rule.exclude, part.weight)).collect()
        };
        assert_eq!(
            parts(Matching::Train),
            [(Exclusion::None, 1), (Exclusion::SameSequence, 3), (Exclusion::SameCloud, 2)]
        );
        assert_eq!(parts(Matching::Validation), [(Exclusion::None, 3), (Exclusion::SameSequence, 3)]);
        let all = fitness.parts(Matching::Train);
        assert!(all.iter().all(|part| part.rule.margin && part.rule.objective == Objective::Category));
    }

    #[test]
    fn weights_that_make_no_fitness_are_refused() {
        assert_eq!(Fitness::new([0; 3], Objective::Object, true), None);
        assert_eq!(Fitness::new([0, MAX_WEIGHT + 1, 0], Objective::Object, true), None);
        assert!(Fitness::new([0, MAX_WEIGHT, 0], Objective::Object, true).is_some());
    }

    #[test]
    fn sums_are_weighted_and_the_margin_is_their_mean() {
        let parts = [(counts(3, 4, 5), Some(2.5), 1), (counts(1, 2, 2), Some(-0.5), 3)];
        let measured = Measured::sum(parts);
        assert_eq!(measured.counts, counts(6, 10, 11));
        assert_eq!(measured.margin, Some((2.5 - 1.5) / 11.0));
        let objects = Fitness::new([1, 1, 0], Objective::Object, true).unwrap();
        let categories = Fitness::new([1, 1, 0], Objective::Category, true).unwrap();
        assert_eq!([objects, categories].map(|fitness| fitness.score(&measured).correct), [6, 10]);
        assert_eq!(Measured::sum([(counts(3, 4, 5), None, 1)]).margin, None);
        assert_eq!(Measured::sum([(counts(0, 0, 0), Some(0.0), 1)]).margin, Some(0.0));
    }
}
