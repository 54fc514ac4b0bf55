//! Whether a fitness can be computed on the clouds of a data set: sequences are known, and queries can be answered.

use std::collections::{BTreeMap, BTreeSet};

use proto::task::Objective;

use crate::dataset::{CloudEntry, Dataset, SPLITS};
use crate::fitness::{Fitness, FitnessProtocol};
use crate::run::RunError;
use crate::run::matching::{Matching, TRAIN1, TRAIN2};

/// Refuses a fitness that cannot be computed on these clouds; says in words which clouds it leaves out of its counts.
///
/// # Errors
/// [`RunError::NoSequences`] or [`RunError::NoAnswers`].
pub fn check_fitness(fitness: &Fitness, dataset: &Dataset) -> Result<Vec<String>, RunError> {
    let (validation, _) = Matching::Validation.splits();
    if fitness.needs_sequences()
        && let Some(missing) = dataset.sequences_missing(&[&[TRAIN1, TRAIN2], validation.as_slice()].concat())
    {
        let (count, first) = (missing.count, missing.first);
        return Err(RunError::NoSequences { count, first });
    }
    let class = |cloud: &CloudEntry| match fitness.objective() {
        Objective::Object => cloud.instance,
        Objective::Category => cloud.category,
    };
    let trained: Vec<&CloudEntry> = [TRAIN1, TRAIN2]
        .iter()
        .flat_map(|&split| dataset.splits.all()[split])
        .map(|&index| &dataset.clouds.entries[index as usize])
        .collect();
    let mut notes = Vec::new();
    for (protocol, _) in fitness.protocols() {
        // Of each class the groups of clouds that are not matched with each other: a query can be answered if there is
        // another group.
        let mut groups: BTreeMap<u32, BTreeSet<usize>> = BTreeMap::new();
        for (index, &cloud) in trained.iter().enumerate() {
            let group = match protocol {
                FitnessProtocol::Split => continue, // counts every query
                FitnessProtocol::CrossSequence => cloud.sequence.unwrap_or_default() as usize,
                FitnessProtocol::LeaveOneOut => index,
            };
            groups.entry(class(cloud)).or_default().insert(group);
        }
        if groups.is_empty() {
            continue;
        }
        let lost = trained.iter().filter(|cloud| groups[&class(cloud)].len() < 2).count();
        if lost == trained.len() {
            return Err(RunError::NoAnswers { protocol: protocol.name() });
        }
        if lost > 0 {
            let splits = [SPLITS[TRAIN1], SPLITS[TRAIN2]].join(" and ");
            notes.push(format!(
                "fitness {}: {lost} of {} clouds of {splits} are not counted, as no other cloud is left that they could be recognised by",
                protocol.name(),
                trained.len()
            ));
        }
    }
    Ok(notes)
}
