//! Whether an answer is about an object that the database shows at all (open-set recognition): a probability, and how large
//! it must be, both found inside the database.
//!
//! Each cloud is asked twice, both times without the clouds of its own sequence or fold: once of a database that shows its
//! object, and once of one that does not. A logistic regression tells the first answers from the second.

use std::cmp::Ordering;
use std::collections::BTreeSet;

use super::Settings;
use super::folds::folds;
use super::held_out::{Evidence, HeldOut};
use super::kernel_ridge::MAX_CLOUDS;
use super::learn::LabelledClouds;
use super::logistic::{self, TERMS, logistic};

/// Objects are left out one by one if there are no more, else in so many groups.
pub const MOST_GROUPS: usize = 12;
/// Two must be left where one is left out.
pub const LEAST_OBJECTS: usize = 3;
/// Answers of either kind without which nothing is calibrated: a twentieth of fewer is none.
pub const LEAST_ANSWERS: usize = 20;

/// When an answer is believed. There are two rules: by probability, and by the margin alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RejectRule {
    /// Whether a recogniser that learns has answered; else the nearest cloud has.
    pub is_learned: bool,
    /// The median set distance of known clouds to the nearest cloud of all.
    pub typical_distance: f64,
    /// Of 1 and the three features.
    pub coefficients: [f64; TERMS],
    /// The least that is believed by probability.
    pub least_probability: f64,
    /// The least that is believed by the margin alone.
    pub least_margin: f64,
}

/// A rule and what it makes of the answers that it was found by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// The rule.
    pub rule: RejectRule,
    /// Answers about clouds whose object was shown.
    pub known: u32,
    /// Answers about clouds whose object was not shown.
    pub unknown: u32,
    /// How many of both are rejected by probability.
    pub rejected: [u32; 2],
    /// How many of both are rejected by the margin alone.
    pub rejected_by_margin: [u32; 2],
}

/// Why a database says nothing about objects that it does not show.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RejectError {
    /// Where an object is left out, two must be left to choose between.
    #[error(
        "database: must show at least {LEAST_OBJECTS} objects to tell unknown ones from them, got {got}\nadd objects"
    )]
    Objects {
        /// How many there are.
        got: usize,
    },
    /// Too few clouds that others of their object, or of other objects, are left for.
    #[error(
        "database: must have at least {LEAST_ANSWERS} clouds whose object is in another sequence or fold, too, got {got}\nadd clouds"
    )]
    Answers {
        /// The fewer ones of answers about known and unknown objects.
        got: usize,
    },
    /// The distances of all pairs would not fit.
    #[error(
        "database: must have at most {MAX_CLOUDS} clouds to tell unknown objects from those that it shows, got {got}\nexport fewer clouds"
    )]
    Clouds {
        /// How many there are.
        got: usize,
    },
    /// All answers are alike.
    #[error(
        "database: answers about known objects must differ from those about unknown ones, got equal ones\nuse another descriptor"
    )]
    Alike,
}

/// Answers inside a database, from which rules of any rate are found.
#[derive(Clone, Debug, PartialEq)]
pub struct CrossAnswers {
    is_learned: bool,
    /// About clouds whose object was shown; sorted.
    known: Vec<Evidence>,
    /// About the same clouds where it was not; sorted.
    unknown: Vec<Evidence>,
}

impl RejectRule {
    /// The probability that the object is one that the database shows, if half of what is asked is.
    pub fn probability(&self, evidence: Evidence) -> f64 {
        let [a, b, c] = features(self.is_learned, self.typical_distance, evidence);
        let [constant, of_a, of_b, of_c] = self.coefficients;
        logistic(constant + of_a * a + of_b * b + of_c * c)
    }

    /// Whether an answer is believed.
    pub fn accepts(&self, evidence: Evidence) -> bool {
        self.probability(evidence) >= self.least_probability
    }

    /// Whether an answer is believed by its margin alone.
    pub fn accepts_by_margin(&self, evidence: Evidence) -> bool {
        evidence.margin >= self.least_margin
    }
}

/// Of the nearest cloud its distance relative to the typical one, and the margin relative to the runner-up's distance; of a
/// recogniser that learns distance and margin as they are, and the nearest cloud's distance relative to the typical one.
fn features(is_learned: bool, typical: f64, evidence: Evidence) -> [f64; TERMS - 1] {
    let Evidence { distance, margin, nearest } = evidence;
    if is_learned {
        return [distance, margin, nearest / typical];
    }
    let runner_up = distance + margin;
    [distance / typical, if runner_up > 0.0 { margin / runner_up } else { 0.0 }, 0.0]
}

impl CrossAnswers {
    /// Asks each cloud of a database, by the current rayon pool; without settings the nearest cloud answers. What is left
    /// out together goes by sequences, as in [`ChosenSettings`](super::ChosenSettings), and by objects: one by one, or in
    /// [`MOST_GROUPS`] groups. A recogniser is learned at most 5 · (1 + [`MOST_GROUPS`]) times.
    ///
    /// # Errors
    /// [`RejectError`] if there are too few objects or clouds, or too many.
    pub fn new(
        settings: Option<&Settings>,
        clouds: &LabelledClouds<'_>,
        sequences: &[Option<u32>],
    ) -> Result<Self, RejectError> {
        let objects = clouds.objects;
        let groups = groups(objects);
        let shown = objects.iter().collect::<BTreeSet<_>>().len();
        if shown < LEAST_OBJECTS {
            return Err(RejectError::Objects { got: shown });
        }
        if objects.len() > MAX_CLOUDS {
            return Err(RejectError::Clouds { got: objects.len() }); // before the distances of too many
        }
        let folds = folds(objects, sequences);
        let count = |of: &[usize]| of.iter().max().map_or(0, |last| last + 1);
        // Of each fold first all objects, then all but those of each group.
        let rounds: Vec<(usize, Option<usize>)> = (0..count(&folds))
            .flat_map(|fold| {
                std::iter::once(None).chain((0..count(&groups)).map(Some)).map(move |group| (fold, group))
            })
            .collect();
        let round = |&(fold, group): &(usize, Option<usize>)| {
            let is_left_out = |cloud: usize| group == Some(groups[cloud]);
            let known: Vec<usize> =
                (0..objects.len()).filter(|&cloud| folds[cloud] != fold && !is_left_out(cloud)).collect();
            let there: BTreeSet<u32> = known.iter().map(|&cloud| objects[cloud]).collect();
            let is_asked = |&cloud: &usize| {
                let is_wanted = match group {
                    Some(_) => is_left_out(cloud),
                    None => there.contains(&objects[cloud]),
                };
                is_wanted && folds[cloud] == fold
            };
            (known, (0..objects.len()).filter(is_asked).collect())
        };
        let asked: Vec<(Vec<usize>, Vec<usize>)> = rounds.iter().map(round).collect();
        let found = HeldOut::new(settings, clouds).ask_all(&asked);
        let mut answers: [Vec<Evidence>; 2] = Default::default();
        for ((_, group), found) in rounds.iter().zip(found) {
            answers[usize::from(group.is_some())].extend(found.iter().map(|answer| answer.evidence));
        }
        let [known, unknown] = answers;
        Self::of(settings.is_some(), known, unknown)
    }

    /// Of answers of either kind, in any order.
    ///
    /// # Errors
    /// [`RejectError::Answers`] if there are too few.
    pub fn of(
        is_learned: bool,
        mut known: Vec<Evidence>,
        mut unknown: Vec<Evidence>,
    ) -> Result<Self, RejectError> {
        let got = known.len().min(unknown.len());
        if got < LEAST_ANSWERS {
            return Err(RejectError::Answers { got });
        }
        // Sums in an order that is the same for every order of clouds.
        let key = |evidence: &Evidence| [evidence.distance, evidence.margin, evidence.nearest];
        for answers in [&mut known, &mut unknown] {
            answers.sort_by(|a, b| {
                let pairs = key(a).into_iter().zip(key(b));
                pairs.fold(Ordering::Equal, |order, (a, b)| order.then(a.total_cmp(&b)))
            });
        }
        Ok(Self { is_learned, known, unknown })
    }

    /// The rules by which at most this share of the answers about known objects is rejected, 0 to 1.
    ///
    /// # Errors
    /// [`RejectError::Alike`] if nothing tells answers apart.
    pub fn calibrate(&self, false_rejections: f64) -> Result<Calibration, RejectError> {
        let Self { is_learned, ref known, ref unknown } = *self;
        let mut nearest: Vec<f64> = known.iter().map(|evidence| evidence.nearest).collect();
        nearest.sort_by(f64::total_cmp);
        let median = nearest[nearest.len() / 2];
        let typical_distance = if median > 0.0 { median } else { 1.0 };
        let of = |answers: &[Evidence]| -> Vec<_> {
            answers.iter().map(|&evidence| features(is_learned, typical_distance, evidence)).collect()
        };
        let coefficients = logistic::fit([&of(known), &of(unknown)]).ok_or(RejectError::Alike)?;
        let mut rule = RejectRule {
            is_learned,
            typical_distance,
            coefficients,
            least_probability: 0.0,
            least_margin: 0.0,
        };
        rule.least_probability =
            least(known.iter().map(|&evidence| rule.probability(evidence)), false_rejections);
        rule.least_margin = least(known.iter().map(|evidence| evidence.margin), false_rejections);
        let rejected = |accepts: fn(&RejectRule, Evidence) -> bool| {
            [known, unknown]
                .map(|answers| answers.iter().filter(|&&evidence| !accepts(&rule, evidence)).count() as u32)
        };
        Ok(Calibration {
            rule,
            known: known.len() as u32,
            unknown: unknown.len() as u32,
            rejected: rejected(RejectRule::accepts),
            rejected_by_margin: rejected(RejectRule::accepts_by_margin),
        })
    }
}

/// The largest value that at most this share of the values lie below.
fn least(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let below = (share * sorted.len() as f64) as usize; // rounds down
    sorted[below.min(sorted.len() - 1)]
}

/// The group of each cloud, from 0: objects are numbered as they come, so that like ones, which often come together, are
/// left out apart.
fn groups(objects: &[u32]) -> Vec<usize> {
    let mut numbers = std::collections::BTreeMap::new();
    let of: Vec<usize> = objects
        .iter()
        .map(|object| {
            let next = numbers.len();
            *numbers.entry(object).or_insert(next)
        })
        .collect();
    let groups = numbers.len().clamp(1, MOST_GROUPS);
    of.into_iter().map(|number| number % groups).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::matrix::Matrix;
    use super::super::testing::{Sample, sample};
    use super::super::{KernelRidgeSettings, ProjectionSettings};
    use super::*;
    use crate::distance::SetDistance;
    use crate::signature::{Signature, Signatures};

    fn signatures(values: &Matrix) -> Signatures {
        let signature = |row: usize| Signature {
            centroid: values.row(row).iter().map(|&value| value as f32).collect(),
            deviation: Vec::new(),
        };
        (0..values.rows()).map(signature).collect::<Vec<_>>().iter().collect()
    }

    /// Of the nearest cloud, kernel ridge regression and a projection.
    fn all() -> [Option<Settings>; 3] {
        [
            None,
            Some(Settings::KernelRidge(KernelRidgeSettings::ALL[0])),
            Some(Settings::Projection(ProjectionSettings::all()[0])),
        ]
    }

    fn answers(settings: Option<&Settings>, sample: &Sample, sequences: &[Option<u32>]) -> CrossAnswers {
        let signatures = signatures(&sample.values);
        let channels = [(&signatures, SetDistance::ChiSquared, 1.5)];
        let clouds = LabelledClouds { channels: &channels, objects: &sample.objects };
        CrossAnswers::new(settings, &clouds, sequences).unwrap()
    }

    fn turns(clouds: usize) -> Vec<Option<u32>> {
        (0..clouds as u32).map(|cloud| Some(cloud % 3)).collect()
    }

    #[test]
    fn answers_of_the_nearest_cloud_are_their_definition() {
        // More objects than groups: objects 0 and 12, and 1 and 13, are left out together.
        let sample = sample(14, 6, 20);
        let sequences = turns(sample.objects.len());
        let signatures = signatures(&sample.values);
        let distance = |a: usize, b: usize| {
            let [a, b] = [a, b].map(|cloud| Signature {
                centroid: signatures.get(cloud)[0].to_vec(),
                deviation: Vec::new(),
            });
            1.5 * f64::from(a.distance(&b))
        };
        let mut expected = [Vec::new(), Vec::new()];
        for query in 0..sample.objects.len() {
            for (is_unknown, answers) in expected.iter_mut().enumerate() {
                let is_there = |cloud: usize| {
                    sequences[cloud] != sequences[query]
                        && (is_unknown == 0 || sample.objects[cloud] % 12 != sample.objects[query] % 12)
                };
                let mut of_objects = std::collections::BTreeMap::new();
                for cloud in (0..sample.objects.len()).filter(|&cloud| is_there(cloud)) {
                    let least = of_objects.entry(sample.objects[cloud]).or_insert(f64::INFINITY);
                    *least = f64::min(*least, distance(query, cloud));
                }
                let mut least: Vec<f64> = of_objects.into_values().collect();
                least.sort_by(f64::total_cmp);
                answers.push(Evidence { distance: least[0], margin: least[1] - least[0], nearest: least[0] });
            }
        }
        let [known, unknown] = expected;
        assert_eq!(answers(None, &sample, &sequences), CrossAnswers::of(false, known, unknown).unwrap());
    }

    #[test]
    fn what_is_known_is_told_from_what_is_not_by_every_recogniser() {
        let sample = sample(8, 12, 40);
        for settings in all() {
            let answers = answers(settings.as_ref(), &sample, &turns(96));
            assert_eq!((answers.known.len(), answers.unknown.len()), (96, 96));
            let found = answers.calibrate(0.05).unwrap();
            assert!(found.rejected[0] <= 4 && found.rejected_by_margin[0] <= 4, "{found:?}");
            assert!(found.rejected[1] > 40 && found.rejected_by_margin[1] > 40, "{found:?}");
            assert_eq!(found.rule.is_learned, settings.is_some());
            let none = answers.calibrate(0.0).unwrap();
            assert_eq!((none.rejected[0], none.rejected_by_margin[0]), (0, 0));
            assert_eq!(none.rule.coefficients, found.rule.coefficients);
        }
    }

    /// Neither the order of clouds nor the numbers of objects and sequences decide on anything where each object is left
    /// out alone.
    #[test]
    fn the_order_of_clouds_changes_no_bit_of_the_nearest_cloud() {
        let sample = sample(5, 9, 20);
        let sequences = turns(45);
        let order: Vec<usize> = (0..45).map(|at| at * 23 % 45).collect();
        let other = Sample {
            values: sample.values.select(&order),
            objects: order.iter().map(|&cloud| 70 - sample.objects[cloud]).collect(),
        };
        let of_other: Vec<Option<u32>> =
            order.iter().map(|&cloud| sequences[cloud].map(|it| it + 4)).collect();
        let [found, again] = [answers(None, &sample, &sequences), answers(None, &other, &of_other)]
            .map(|answers| answers.calibrate(0.1).unwrap());
        assert_eq!(found, again);
    }

    #[test]
    fn what_is_too_little_is_refused_by_name() {
        let refused = |objects: u32, clouds: u32, sequence: &dyn Fn(u32) -> Option<u32>| {
            let sample = sample(objects, clouds, 8);
            let signatures = signatures(&sample.values);
            let channels = [(&signatures, SetDistance::ChiSquared, 1.0)];
            let clouds = LabelledClouds { channels: &channels, objects: &sample.objects };
            let sequences: Vec<_> = (0..sample.objects.len() as u32).map(sequence).collect();
            all().map(|settings| CrossAnswers::new(settings.as_ref(), &clouds, &sequences).unwrap_err())
        };
        assert_eq!(refused(0, 0, &|_| None), [RejectError::Objects { got: 0 }; 3]);
        assert_eq!(refused(1, 30, &|_| None), [RejectError::Objects { got: 1 }; 3]);
        assert_eq!(refused(2, 30, &|_| None), [RejectError::Objects { got: 2 }; 3]);
        // Of one cloud an object, none is known when it is left out.
        assert_eq!(refused(30, 1, &|_| None), [RejectError::Answers { got: 0 }; 3]);
        assert_eq!(refused(3, 5, &|_| None), [RejectError::Answers { got: 15 }; 3]);
        // Each object in a sequence of its own.
        assert_eq!(refused(4, 9, &|cloud| Some(cloud / 9)), [RejectError::Answers { got: 0 }; 3]);
        let many: Vec<u32> = (0..=MAX_CLOUDS as u32).collect();
        let clouds = LabelledClouds { channels: &[], objects: &many };
        let got = MAX_CLOUDS + 1;
        assert_eq!(CrossAnswers::new(None, &clouds, &vec![None; got]), Err(RejectError::Clouds { got }));
        for error in refused(3, 5, &|_| None) {
            assert_eq!(error.to_string().lines().count(), 2);
        }
    }

    #[test]
    fn clouds_that_are_all_alike_are_all_believed() {
        let alike = vec![Evidence { distance: 0.0, margin: 0.0, nearest: 0.0 }; 30];
        let found = CrossAnswers::of(false, alike.clone(), alike.clone()).unwrap().calibrate(0.05).unwrap();
        assert_eq!((found.rejected, found.rejected_by_margin), ([0; 2], [0; 2]));
        assert_eq!(found.rule.probability(alike[0]), 0.5);
        let infinite = vec![Evidence { distance: f64::INFINITY, margin: 0.0, nearest: 0.0 }; 30];
        let refused = CrossAnswers::of(true, infinite, alike).unwrap().calibrate(0.05);
        assert_eq!(refused, Err(RejectError::Alike));
    }

    #[test]
    fn groups_are_objects_by_turns() {
        assert_eq!(groups(&[9, 9, 4, 9, 7]), [0, 0, 1, 0, 2]);
        let many: Vec<u32> = (0..30).collect();
        assert_eq!(groups(&many)[..14], [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 0, 1]);
        assert_eq!(groups(&[]), [0; 0]);
    }

    proptest! {
        #[test]
        fn at_most_the_share_lies_below_and_more_would_with_the_next(
            values in prop::collection::vec(0.0..1.0f64, 1..60),
            share in 0.0..=1.0f64,
        ) {
            let least = least(values.iter().copied(), share);
            let below = |bound: f64| values.iter().filter(|&&value| value < bound).count() as f64;
            let all = values.len() as f64;
            prop_assert!(below(least) <= share * all);
            let next = values.iter().copied().filter(|&value| value > least).min_by(f64::total_cmp);
            if let Some(next) = next {
                prop_assert!(below(next) > share * all);
            }
        }
    }
}
