//! Whether a fitness can be computed on the clouds of a data set: sequences are known, queries can be answered, and there are
//! validation clouds where the search asks them; and what it is of a descriptor that answers none.

use std::collections::{BTreeMap, BTreeSet};
use std::iter::Sum;

use proto::task::{Exclusion, Label};
use results::Counts;

use crate::dataset::{CloudEntry, Dataset, SPLITS};
use crate::experiment::Experiment;
use crate::fitness::{Measured, Part};
use crate::run::RunError;
use crate::run::matching::{Matching, TRAIN1, TRAIN2};
use crate::run::sets::with_weight;
use crate::weighing::{check_sets as check_teaching, teaching_sets};

/// Refuses a fitness that cannot be computed on these clouds, and a search that would ask validation clouds where there are
/// none; says in words which clouds the fitness leaves out of its counts, and that other weights may suit the recogniser.
///
/// # Errors
/// [`RunError::NoValidation`], [`RunError::NoSequences`], [`RunError::Weigh`], [`RunError::NoAnswers`],
/// [`RunError::NoValidationAnswers`], [`RunError::UnknownSet`], [`RunError::NoWeight`] or [`RunError::EmptySet`].
pub fn check_fitness(experiment: &Experiment, dataset: &Dataset) -> Result<Vec<String>, RunError> {
    let (fitness, weights) = (experiment.fitness(), experiment.set_weights(dataset));
    check_sets(experiment, dataset)?;
    let weighted = with_weight(&weights);
    let of_set = |&set: &u32| dataset.clouds.of_set(&dataset.splits.validation, set).count();
    let validating: usize = weighted.iter().map(of_set).sum();
    if experiment.validates() && validating == 0 {
        return Err(RunError::NoValidation);
    }
    let (validation, _) = Matching::Validation.splits();
    if fitness.needs_sequences()
        && let Some(missing) = dataset.sequences_missing(&[&[TRAIN1, TRAIN2], validation.as_slice()].concat())
    {
        let (count, first) = (missing.count, missing.first);
        return Err(RunError::NoSequences { count, first });
    }
    let mut notes = Vec::new();
    if let Some(how) = experiment.weighs() {
        check_teaching(&teaching_sets(dataset, &weights))?;
        let method = experiment.recognition();
        if how.misleads(method) {
            notes.push(format!(
                "search.weigh: \"separately\" is likely to suit recognition.method = \"{}\" better than \"jointly\": it \
                 learns from the clouds that the weights were learned from, too",
                method.name()
            ));
        }
    }
    let mut validated = Queries::default();
    for (protocol, _) in fitness.protocols() {
        for matching in [Matching::Train, Matching::Validation] {
            for part in fitness.of_protocol(protocol).parts(matching) {
                let queries: Queries = weighted.iter().map(|&set| Queries::of(&part, dataset, set)).sum();
                let Queries { counted, all } = queries;
                match matching {
                    Matching::Validation => validated = [validated, queries].into_iter().sum(),
                    _ if counted == 0 && all > 0 => {
                        return Err(RunError::NoAnswers { protocol: protocol.name() });
                    }
                    _ => {}
                }
                if counted < all {
                    let splits: Vec<&str> = part.query.iter().map(|&split| SPLITS[split]).collect();
                    notes.push(format!(
                        "fitness {}: {} of {all} clouds of {} are not counted, as no other cloud is left that they could \
                         be recognised by",
                        protocol.name(),
                        all - counted,
                        splits.join(" and "),
                    ));
                }
            }
        }
    }
    if validated.counted == 0 && validated.all > 0 {
        return Err(RunError::NoValidationAnswers { clouds: validating, across: fitness.needs_sequences() });
    }
    Ok(notes)
}

/// Refuses weights of sets that the clouds do not have, and sets whose clouds cannot be compared.
fn check_sets(experiment: &Experiment, dataset: &Dataset) -> Result<(), RunError> {
    let clouds = &dataset.clouds;
    if let Some(name) = experiment.weighted_sets().find(|name| !clouds.sets.iter().any(|set| set == name)) {
        return Err(RunError::UnknownSet {
            place: "search.sets",
            name: name.to_owned(),
            known: clouds.sets.join(", "),
        });
    }
    if experiment.set_weights(dataset).iter().all(|&weight| weight == 0) {
        return Err(RunError::NoWeight);
    }
    for (set, name) in (0..).zip(&clouds.sets) {
        for split in [TRAIN1, TRAIN2] {
            if clouds.of_set(dataset.splits.all()[split], set).next().is_none() {
                return Err(RunError::EmptySet { name: name.clone(), split: SPLITS[split] });
            }
        }
    }
    Ok(())
}

/// The counts of a descriptor that recognises nothing.
pub fn nothing_recognised(experiment: &Experiment, dataset: &Dataset, matching: Matching) -> Measured {
    let parts = experiment.fitness().parts(matching);
    let of_part = |set, weight: u32, part: &Part| {
        let queries = Queries::of(part, dataset, set).counted;
        let margin = part.rule.margin.then_some(-f64::from(queries));
        (Counts { object_correct: 0, category_correct: 0, queries }, margin, weight * part.weight)
    };
    let weights = experiment.set_weights(dataset);
    let of_sets = (0..).zip(weights).filter(|&(_, weight)| weight > 0);
    let (of_part, parts) = (&of_part, &parts);
    Measured::sum(of_sets.flat_map(|(set, weight)| parts.iter().map(move |part| of_part(set, weight, part))))
}

/// How many queries a part of a fitness has.
#[derive(Clone, Copy, Default)]
struct Queries {
    /// Those that can be answered; all under the plain rule, which counts every query.
    counted: u32,
    all: u32,
}

impl Sum for Queries {
    fn sum<I: Iterator<Item = Self>>(parts: I) -> Self {
        parts.fold(Self::default(), |sum, part| Self {
            counted: sum.counted + part.counted,
            all: sum.all + part.all,
        })
    }
}

impl Queries {
    fn of(part: &Part, dataset: &Dataset, set: u32) -> Self {
        let Dataset { clouds, splits: all, .. } = dataset;
        let clouds = |splits: &[usize]| -> Vec<&CloudEntry> {
            let indices = splits.iter().flat_map(|&split| clouds.of_set(all.all()[split], set));
            indices.map(|index| &clouds.entries[index as usize]).collect()
        };
        let queries = clouds(part.query);
        let all = queries.len() as u32;
        if part.rule.is_default() {
            return Self { counted: all, all };
        }
        let class = |cloud: &CloudEntry| {
            part.rule.class(Label { category: cloud.category, instance: cloud.instance })
        };
        // Clouds of one group are not matched with each other.
        let group = |cloud: &CloudEntry| match part.rule.exclude {
            Exclusion::None => None,
            Exclusion::SameSequence => cloud.sequence.map(Group::Sequence),
            Exclusion::SameCloud => Some(Group::Cloud(cloud.digest)),
        };
        let mut groups: BTreeMap<u32, BTreeSet<Option<Group>>> = BTreeMap::new();
        for cloud in clouds(part.database) {
            groups.entry(class(cloud)).or_default().insert(group(cloud));
        }
        let is_counted = |query: &&&CloudEntry| {
            let own = group(query);
            let of_class = groups.get(&class(query));
            of_class.is_some_and(|groups| groups.iter().any(|group| group.is_none() || *group != own))
        };
        Self { counted: queries.iter().filter(is_counted).count() as u32, all }
    }
}

#[derive(PartialEq, Eq, PartialOrd, Ord)]
enum Group {
    Sequence(u32),
    Cloud([u8; 32]),
}
