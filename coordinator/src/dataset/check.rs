//! Checks over all splits together: overlap, labels, and what a run could not make sense of.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use super::error::DatasetError;
use super::labelled::Labelled;
use super::{CloudEntry, Clouds, SPLITS};

/// Names listed in a warning; the others are only counted.
const NAMED: usize = 10;

/// Refuses a cloud that is listed twice, in one list or in two. Two names of one file are the same cloud.
pub(super) fn check_overlap(names: &[&'static str], lists: &[Vec<Labelled>]) -> Result<(), DatasetError> {
    let mut seen: HashMap<&Path, (&'static str, &Labelled)> = HashMap::new();
    for (&split, clouds) in names.iter().zip(lists) {
        for cloud in clouds {
            let Some((first_split, first)) = seen.insert(&cloud.located.file, (split, cloud)) else {
                continue;
            };
            let path = cloud.located.path.clone();
            let (first, second) = (first.place.clone(), cloud.place.clone());
            return Err(if first_split == split {
                DatasetError::Twice { path, first, second }
            } else {
                DatasetError::Overlap {
                    path,
                    first_split,
                    second_split: split,
                    places: Box::new([first, second]),
                }
            });
        }
    }
    Ok(())
}

/// Refuses an instance of two categories.
pub(super) fn check_labels<'a>(clouds: impl Iterator<Item = &'a Labelled>) -> Result<(), DatasetError> {
    let mut seen: HashMap<&str, &Labelled> = HashMap::new();
    for cloud in clouds {
        let first = *seen.entry(&cloud.instance).or_insert(cloud);
        if first.category != cloud.category {
            return Err(DatasetError::TwoCategories {
                instance: cloud.instance.clone(),
                categories: Box::new([first.category.clone(), cloud.category.clone()]),
                places: Box::new([first.place.clone(), cloud.place.clone()]),
            });
        }
    }
    Ok(())
}

/// A warning if queries are of instances that the database has no usable cloud of in their set.
pub(super) fn unrecognisable_warning(
    clouds: &Clouds,
    splits: [&[u32]; 4],
    query: usize,
    database: &[usize],
) -> Option<String> {
    let of_set = |index: u32| {
        let CloudEntry { set, instance, .. } = clouds.entries[index as usize];
        (set, instance)
    };
    let database_indices = database.iter().flat_map(|&group| splits[group]);
    let known: HashSet<(u32, u32)> = database_indices.map(|&index| of_set(index)).collect();
    let (mut queries, all) = (0, splits[query].len());
    let mut missing = vec![false; clouds.instances.len()];
    for (set, instance) in splits[query].iter().map(|&index| of_set(index)) {
        if !known.contains(&(set, instance)) {
            missing[instance as usize] = true;
            queries += 1;
        }
    }
    if queries == 0 {
        return None;
    }
    let missing: Vec<&str> = clouds
        .instances
        .iter()
        .zip(missing)
        .filter(|(_, missing)| *missing)
        .map(|(instance, _)| &*instance.name)
        .collect();
    let database: Vec<&str> = database.iter().map(|&group| SPLITS[group]).collect();
    Some(format!(
        "split {}: clouds of objects in {} expected, got {queries} of {all} without ({}: {}{})\n\
         they can never be recognised: the object error of {} cannot be below {}; list clouds of these objects in the \
         database, leave the queries out, or go by category errors",
        SPLITS[query],
        database.join(" + "),
        match missing.len() {
            1 => "1 object".to_owned(),
            objects => format!("{objects} objects"),
        },
        missing[..missing.len().min(NAMED)].join(", "),
        if missing.len() > NAMED { ", …" } else { "" },
        SPLITS[query],
        format_args!("{:.2} %", 100.0 * queries as f64 / all as f64),
    ))
}

/// A warning if two splits hold files with the same bytes: copies are recognised whatever the descriptor.
pub(super) fn equal_bytes_warning(clouds: &Clouds, indices: &[Vec<u32>; 4]) -> Option<String> {
    let mut seen: HashMap<[u8; 32], (usize, u32)> = HashMap::new();
    let mut pairs = Vec::new();
    for (group, indices) in indices.iter().enumerate() {
        for &index in indices {
            let (first_group, first) =
                *seen.entry(clouds.entries[index as usize].digest).or_insert((group, index));
            if first_group != group {
                pairs.push((first, index));
            }
        }
    }
    let &(first, second) = pairs.first()?;
    let path = |index: u32| &clouds.entries[index as usize].path;
    Some(format!(
        "splits: clouds that differ expected, got {} with the bytes of a cloud of another split, such as {} of {}\n\
         such a query is always recognised: remove the copies",
        pairs.len(),
        path(second),
        path(first),
    ))
}
