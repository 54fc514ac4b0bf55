//! From labelled clouds to numbered ones: checks over all lists, one reading of every file, the data digest.

use std::collections::BTreeMap;

use cache::Store;
use descriptor::Preprocess;

use super::check::{check_labels, check_overlap, equal_bytes_warning};
use super::error::DatasetError;
use super::inspect::{Inspected, State, inspect, refuse_unit, spacing_warning};
use super::labelled::Labelled;
use super::leak::Position;
use super::record::{self, CloudRecord};
use super::root::Root;
use super::{CloudEntry, Clouds, Instance, SPLITS, SkipReason, SkippedCloud};

/// Unreadable or colourless clouds named in an error; the others are only counted.
const NAMED_CLOUDS: usize = 10;

/// Numbers of categories, instances and sequences, in the order of their names.
pub(super) struct Numbers<'a> {
    categories: BTreeMap<&'a str, u32>,
    instances: BTreeMap<(&'a str, &'a str), u32>,
    sequences: BTreeMap<SequenceOrder<'a>, u32>,
    sets: BTreeMap<&'a str, u32>,
}

/// A sequence's name in its order: video 10 comes after video 9, and names that are no numbers come last.
type SequenceOrder<'a> = (bool, u64, &'a str);

fn sequence_order(name: &str) -> SequenceOrder<'_> {
    let number = name.parse().ok();
    (number.is_none(), number.unwrap_or(0), name)
}

impl<'a> Numbers<'a> {
    /// Of all labels of some clouds; refuses an instance of two categories.
    pub(super) fn of(clouds: impl Iterator<Item = &'a Labelled> + Clone) -> Result<Self, DatasetError> {
        check_labels(clouds.clone())?;
        let categories = numbered(clouds.clone().map(|cloud| &*cloud.category));
        let instances = numbered(clouds.clone().map(|cloud| (&*cloud.category, &*cloud.instance)));
        let sequences =
            numbered(clouds.clone().filter_map(|cloud| cloud.sequence.as_deref()).map(sequence_order));
        let sets = numbered(clouds.filter_map(|cloud| cloud.set.as_deref()));
        Ok(Self { categories, instances, sequences, sets })
    }

    /// Category and instance of one of these clouds.
    pub(super) fn get(&self, cloud: &Labelled) -> (u32, u32) {
        let (category, instance) = (&*cloud.category, &*cloud.instance);
        (self.categories[category], self.instances[&(category, instance)])
    }

    /// Sequence of one of these clouds, if it is known.
    fn sequence(&self, cloud: &Labelled) -> Option<u32> {
        cloud.sequence.as_deref().map(|name| self.sequences[&sequence_order(name)])
    }

    /// Set of one of these clouds: the first where there are no sets.
    fn set(&self, cloud: &Labelled) -> u32 {
        cloud.set.as_deref().map_or(0, |name| self.sets[name])
    }

    pub(super) fn categories(&self) -> Vec<String> {
        self.categories.keys().map(|&name| name.to_owned()).collect()
    }

    pub(super) fn instances(&self) -> Vec<Instance> {
        let instance = |&(category, name): &(&str, &str)| Instance {
            name: name.to_owned(),
            category: self.categories[category],
        };
        self.instances.keys().map(instance).collect()
    }

    fn sequences(&self) -> Vec<String> {
        self.sequences.keys().map(|&(_, _, name)| name.to_owned()).collect()
    }

    fn sets(&self) -> Vec<String> {
        self.sets.keys().map(|&name| name.to_owned()).collect()
    }
}

/// Numbers from 0 for different keys, in their order.
fn numbered<K: Ord>(keys: impl Iterator<Item = K>) -> BTreeMap<K, u32> {
    let mut numbers: BTreeMap<K, u32> = keys.map(|key| (key, 0)).collect();
    numbers.values_mut().zip(0..).for_each(|(number, next)| *number = next);
    numbers
}

/// The clouds of the splits.
pub(super) struct Loaded {
    pub clouds: Clouds,
    /// Indices of each split's usable clouds.
    pub indices: [Vec<u32>; 4],
    /// Of each usable cloud of the splits whose positions are wanted.
    pub positions: Vec<Option<Position>>,
}

/// Checks, reads and numbers the clouds of the splits, and measures the positions in the first `positioned` of them.
pub(super) fn load(
    root: &Root,
    lists: &[Vec<Labelled>; 4],
    positioned: usize,
    preprocess: &Preprocess,
    skip_unreadable: bool,
    store: Option<&Store>,
) -> Result<Loaded, DatasetError> {
    check_overlap(&SPLITS, lists)?;
    let numbers = Numbers::of(lists.iter().flatten())?;
    let listed: Vec<&Labelled> = lists.iter().flatten().collect();
    let positioned = lists[..positioned].iter().map(Vec::len).sum();
    let inspected = inspect(&listed, positioned, root, preprocess, store);
    refuse(&listed, &inspected, skip_unreadable)?;
    refuse_unit(&listed, &inspected, preprocess)?;

    let records = records(lists, &inspected);
    let mut clouds = Clouds {
        root: root.path().to_owned(),
        entries: Vec::new(),
        categories: numbers.categories(),
        instances: numbers.instances(),
        sequences: numbers.sequences(),
        sets: numbers.sets(),
        skipped: Vec::new(),
        warnings: Vec::new(),
        digest: record::data_digest(&records),
        listed: records,
    };
    let (mut indices, mut positions) = ([const { Vec::new() }; 4], Vec::new());
    let mut found = inspected.iter();
    for ((split, listed), indices) in SPLITS.into_iter().zip(lists).zip(&mut indices) {
        for (cloud, inspected) in listed.iter().zip(&mut found) {
            let path = cloud.located.path.clone();
            let reason = match (&inspected.state, inspected.file) {
                (State::Usable, Some((digest, bytes))) => {
                    let ((category, instance), sequence) = (numbers.get(cloud), numbers.sequence(cloud));
                    let set = numbers.set(cloud);
                    indices.push(clouds.entries.len() as u32);
                    clouds.entries.push(CloudEntry {
                        path,
                        category,
                        instance,
                        sequence,
                        set,
                        digest,
                        bytes,
                    });
                    positions.push(inspected.position);
                    continue;
                }
                (State::Skipped(skip), _) => SkipReason::Unusable(*skip),
                (State::Unreadable(reason), _) => SkipReason::Unreadable(reason.clone()),
                // `refuse` lets none of them pass.
                (State::NoColour | State::TooDense(_), _) | (State::Usable, None) => continue,
            };
            clouds.skipped.push(SkippedCloud { path, split, reason });
        }
    }
    clouds.warnings.extend(spacing_warning(&listed, &inspected, preprocess.unit));
    clouds.warnings.extend(equal_bytes_warning(&clouds, &indices));
    Ok(Loaded { clouds, indices, positions })
}

/// Stops at clouds without colour where it is wanted, at those that would take too long, and at unreadable ones unless
/// they may be skipped.
fn refuse(listed: &[&Labelled], inspected: &[Inspected], skip_unreadable: bool) -> Result<(), DatasetError> {
    let (mut unreadable, mut colourless, mut dense) = (Vec::new(), Vec::new(), Vec::new());
    for (cloud, inspected) in listed.iter().zip(inspected) {
        let path = &cloud.located.path;
        match &inspected.state {
            State::Unreadable(reason) => unreadable.push(format!("{path}: {reason}")),
            State::NoColour => colourless.push(path.clone()),
            State::TooDense(reason) => dense.push(format!("{path}: {reason}")),
            State::Usable | State::Skipped(_) => {}
        }
    }
    let named = |all: Vec<String>| (all.len(), all.into_iter().take(NAMED_CLOUDS).collect());
    if !unreadable.is_empty() && !skip_unreadable {
        let (count, first) = named(unreadable);
        return Err(DatasetError::Unreadable { count, first });
    }
    if !dense.is_empty() {
        let (count, first) = named(dense);
        return Err(DatasetError::TooDense { count, first });
    }
    if !colourless.is_empty() {
        let (count, first) = named(colourless);
        return Err(DatasetError::NoColour { count, first });
    }
    Ok(())
}

/// Every listed cloud with the digest of its file.
fn records(lists: &[Vec<Labelled>; 4], inspected: &[Inspected]) -> Vec<CloudRecord> {
    let listed =
        lists.iter().enumerate().flat_map(|(split, clouds)| clouds.iter().map(move |one| (split, one)));
    let record = |((split, cloud), inspected): ((usize, &Labelled), &Inspected)| CloudRecord {
        split,
        category: cloud.category.clone(),
        instance: cloud.instance.clone(),
        path: cloud.located.path.clone(),
        set: cloud.set.clone(),
        digest: inspected.file.map(|(digest, _)| digest),
    };
    listed.zip(inspected).map(record).collect()
}
