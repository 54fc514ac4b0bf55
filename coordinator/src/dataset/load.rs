//! From labelled clouds to numbered ones: checks over all lists, one reading of every file, the data digest.

use std::collections::BTreeMap;

use cache::Store;
use descriptor::Preprocess;

use super::check::{check_labels, check_overlap, equal_bytes_warning};
use super::error::DatasetError;
use super::inspect::{Inspected, State, inspect, refuse_unit, spacing_warning};
use super::layout::Labelled;
use super::record::{self, CloudRecord};
use super::root::Root;
use super::{CloudEntry, Clouds, Instance, SPLITS, SkipReason, SkippedCloud};

/// Unreadable or colourless clouds named in an error; the others are only counted.
const NAMED_CLOUDS: usize = 10;

/// Numbers of categories and instances, in the order of their names.
pub(super) struct Numbers<'a> {
    categories: BTreeMap<&'a str, u32>,
    instances: BTreeMap<(&'a str, &'a str), u32>,
}

impl<'a> Numbers<'a> {
    /// Of all labels of some clouds; refuses an instance of two categories.
    pub(super) fn of(clouds: impl Iterator<Item = &'a Labelled> + Clone) -> Result<Self, DatasetError> {
        check_labels(clouds.clone())?;
        let categories = numbered(clouds.clone().map(|cloud| &*cloud.category));
        let instances = numbered(clouds.map(|cloud| (&*cloud.category, &*cloud.instance)));
        Ok(Self { categories, instances })
    }

    /// Category and instance of one of these clouds.
    pub(super) fn get(&self, cloud: &Labelled) -> (u32, u32) {
        let (category, instance) = (&*cloud.category, &*cloud.instance);
        (self.categories[category], self.instances[&(category, instance)])
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
}

/// Numbers from 0 for different keys, in their order.
fn numbered<K: Ord>(keys: impl Iterator<Item = K>) -> BTreeMap<K, u32> {
    let mut numbers: BTreeMap<K, u32> = keys.map(|key| (key, 0)).collect();
    numbers.values_mut().zip(0..).for_each(|(number, next)| *number = next);
    numbers
}

/// Checks, reads and numbers the clouds of the splits; also the indices of each split's usable clouds.
pub(super) fn load(
    root: &Root,
    lists: &[Vec<Labelled>; 4],
    preprocess: &Preprocess,
    skip_unreadable: bool,
    store: Option<&Store>,
) -> Result<(Clouds, [Vec<u32>; 4]), DatasetError> {
    check_overlap(&SPLITS, lists)?;
    let numbers = Numbers::of(lists.iter().flatten())?;
    let listed: Vec<&Labelled> = lists.iter().flatten().collect();
    let inspected = inspect(&listed, root, preprocess, store);
    refuse(&listed, &inspected, skip_unreadable)?;
    refuse_unit(&listed, &inspected, preprocess)?;

    let records = records(lists, &inspected);
    let mut clouds = Clouds {
        root: root.path().to_owned(),
        entries: Vec::new(),
        categories: numbers.categories(),
        instances: numbers.instances(),
        skipped: Vec::new(),
        warnings: Vec::new(),
        digest: record::data_digest(&records),
        listed: records,
    };
    let mut indices = [const { Vec::new() }; 4];
    let mut found = inspected.iter();
    for ((split, listed), indices) in SPLITS.into_iter().zip(lists).zip(&mut indices) {
        for (cloud, inspected) in listed.iter().zip(&mut found) {
            let path = cloud.located.path.clone();
            let reason = match (&inspected.state, inspected.file) {
                (State::Usable, Some((digest, bytes))) => {
                    let (category, instance) = numbers.get(cloud);
                    indices.push(clouds.entries.len() as u32);
                    clouds.entries.push(CloudEntry { path, category, instance, digest, bytes });
                    continue;
                }
                (State::Skipped(skip), _) => SkipReason::Unusable(*skip),
                (State::Unreadable(reason), _) => SkipReason::Unreadable(reason.clone()),
                // `refuse` lets neither pass.
                (State::NoColour, _) | (State::Usable, None) => continue,
            };
            clouds.skipped.push(SkippedCloud { path, split, reason });
        }
    }
    clouds.warnings.extend(spacing_warning(&listed, &inspected, preprocess.unit));
    clouds.warnings.extend(equal_bytes_warning(&clouds, &indices));
    Ok((clouds, indices))
}

/// Stops at clouds without colour where it is wanted, and at unreadable ones unless they may be skipped.
fn refuse(listed: &[&Labelled], inspected: &[Inspected], skip_unreadable: bool) -> Result<(), DatasetError> {
    let (mut unreadable, mut colourless) = (Vec::new(), Vec::new());
    for (cloud, inspected) in listed.iter().zip(inspected) {
        let path = &cloud.located.path;
        match &inspected.state {
            State::Unreadable(reason) => unreadable.push(format!("{path}: {reason}")),
            State::NoColour => colourless.push(path.clone()),
            State::Usable | State::Skipped(_) => {}
        }
    }
    let named = |all: Vec<String>| (all.len(), all.into_iter().take(NAMED_CLOUDS).collect());
    if !unreadable.is_empty() && !skip_unreadable {
        let (count, first) = named(unreadable);
        return Err(DatasetError::Unreadable { count, first });
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
        digest: inspected.file.map(|(digest, _)| digest),
    };
    listed.zip(inspected).map(record).collect()
}
