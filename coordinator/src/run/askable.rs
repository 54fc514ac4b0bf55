//! Whether the clouds of a data set are fit for a fitness: known sequences, and queries that could be answered.

use std::collections::{BTreeMap, BTreeSet};

use proto::task::Objective;

use crate::dataset::{CloudEntry, Dataset, SPLITS};
use crate::fitness::{Fitness, FitnessProtocol};
use crate::run::RunError;
use crate::run::matching::{Matching, TRAIN1, TRAIN2};

/// Refuses a fitness that these clouds cannot be judged by. What it leaves out of its counts is returned in words.
///
/// # Errors
/// [`RunError::NoSequences`] or [`RunError::NoAnswers`].
pub fn refuse_unaskable(fitness: &Fitness, dataset: &Dataset) -> Result<Vec<String>, RunError> {
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
    // A query can be answered if a cloud of its class is left to match: one of another group.
    let of_cloud = |protocol, (index, cloud): (usize, &CloudEntry)| match protocol {
        FitnessProtocol::CrossSequence => cloud.sequence.map_or(0, |sequence| sequence as usize),
        FitnessProtocol::LeaveOneOut | FitnessProtocol::Split => index,
    };
    let mut notes = Vec::new();
    for (protocol, _) in fitness.protocols() {
        if protocol == FitnessProtocol::Split {
            continue;
        }
        let mut groups: BTreeMap<u32, BTreeSet<usize>> = BTreeMap::new();
        for (index, &cloud) in trained.iter().enumerate() {
            groups.entry(class(cloud)).or_default().insert(of_cloud(protocol, (index, cloud)));
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
