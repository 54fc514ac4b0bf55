//! From labelled clouds to the four splits, by lists, manifest or draw.

use std::collections::BTreeMap;

use descriptor::random::stream;
use rand::RngExt;

use super::error::DatasetError;
use super::labelled::Labelled;
use super::layout::Labels;
use super::root::Root;
use super::settings::{DatasetSettings, SeededSplit, SplitRule};
use super::{SPLITS, Wanted};

/// The clouds of the splits that are wanted, each in the order of its list; a draw keeps the order of the layout.
///
/// What the layout found but could not use is added to `ignored`.
pub(super) fn split(
    settings: &DatasetSettings,
    root: &Root,
    wanted: Wanted,
    ignored: &mut Vec<String>,
) -> Result<[Vec<Labelled>; 4], DatasetError> {
    let labels = Labels::read(&settings.layout, root).map_err(DatasetError::of_manifest)?;
    let mut splits = match &settings.splits {
        SplitRule::Lists(lists) => {
            let mut splits = [const { Vec::new() }; 4];
            for ((split, files), name) in splits.iter_mut().zip(lists).zip(SPLITS).take(wanted.count()) {
                for file in files {
                    split.extend(labels.list(file, root).map_err(|error| error.of_list(name))?);
                }
            }
            splits
        }
        SplitRule::Manifest => by_column(labels.all(root, ignored)?)?,
        SplitRule::Seeded(rule) => draw(rule, labels.all(root, ignored)?)?,
    };
    splits[wanted.count()..].fill_with(Vec::new);
    for (split, name) in SPLITS.into_iter().enumerate().take(wanted.count()) {
        if splits[split].is_empty() && !may_be_empty(&settings.splits, split) {
            return Err(DatasetError::no_cloud(name));
        }
    }
    Ok(splits)
}

/// Whether a split, by its position in [`SPLITS`], may be without clouds. A list that is given is not to be empty.
fn may_be_empty(rule: &SplitRule, split: usize) -> bool {
    match (rule, split) {
        (SplitRule::Seeded(rule), 2) => rule.shares[2] == 0.0,
        (SplitRule::Lists(lists), 2) => lists[2].is_empty(),
        (SplitRule::Manifest, 2) => true,
        (SplitRule::Seeded(rule), 3) => rule.shares[3] == 0.0 && rule.test_sequences.is_empty(),
        _ => false,
    }
}

/// Splits by the manifest's column `split`.
fn by_column(clouds: Vec<Labelled>) -> Result<[Vec<Labelled>; 4], DatasetError> {
    let mut splits = [const { Vec::new() }; 4];
    for cloud in clouds {
        let Some(name) = &cloud.split else { continue };
        let Some(index) = SPLITS.iter().position(|split| split == name) else {
            return Err(DatasetError::Manifest {
                place: cloud.place,
                expected: "split train1, train2, validation, test or nothing expected".to_owned(),
                got: name.clone(),
            });
        };
        splits[index].push(cloud);
    }
    Ok(splits)
}

/// Splits at random: see [`deal`]. Each split is within about a cloud of its share over all and within two or
/// three in each instance, also where an instance has few clouds.
pub(super) fn draw(rule: &SeededSplit, clouds: Vec<Labelled>) -> Result<[Vec<Labelled>; 4], DatasetError> {
    let [a, b, c, d] = rule.shares;
    let left_over = 1.0 - (a + b + c + d);
    // Decimal shares that add up to 1 may miss it by a rounding or two.
    if !rule.shares.iter().all(|share| *share >= 0.0) || left_over < -1e-9 {
        return Err(DatasetError::Rule {
            expected: "shares from 0 that add up to at most 1 expected",
            got: format!("{a} + {b} + {c} + {d}"),
            advice: "give train1, train2, validation and test a share each; what is left is not used",
        });
    }
    let shares = [a, b, c, d, if left_over > 1e-9 { left_over } else { 0.0 }];
    let mut held_out = vec![false; clouds.len()];
    for sequence in &rule.test_sequences {
        let mut found = false;
        for (held_out, cloud) in held_out.iter_mut().zip(&clouds) {
            if cloud.sequence.as_ref() == Some(sequence) {
                (*held_out, found) = (true, true);
            }
        }
        if !found {
            return Err(DatasetError::Rule {
                expected: "test_sequences with clouds expected",
                got: format!("none of {} in sequence {sequence}", clouds.len()),
                advice: "name sequences as the layout does: in `uw` the video's number, in a manifest the column",
            });
        }
    }
    if !rule.test_sequences.is_empty() && d != 0.0 {
        return Err(DatasetError::Rule {
            expected: "share 0 for test beside test_sequences expected",
            got: d.to_string(),
            advice: "test is exactly the clouds of those sequences: remove its share",
        });
    }

    let drawn: Vec<&Labelled> =
        clouds.iter().zip(&held_out).filter(|(_, held_out)| !**held_out).map(|(cloud, _)| cloud).collect();
    let mut dealt = deal(&drawn, &shares, rule.stratified, rule.seed).into_iter();
    let mut splits = [const { Vec::new() }; 4];
    for (cloud, held_out) in clouds.into_iter().zip(held_out) {
        let split = if held_out { Some(3) } else { dealt.next() };
        if let Some(split) = split.and_then(|split| splits.get_mut(split)) {
            split.push(cloud);
        }
    }
    Ok(splits)
}

/// Deals clouds out to as many parts as there are shares; gives the part of each cloud.
///
/// They are put into a random order, instance by instance if stratified, and each goes to the part that is furthest
/// behind its share.
pub(super) fn deal(
    clouds: &[impl std::borrow::Borrow<Labelled>],
    shares: &[f64],
    stratified: bool,
    seed: u64,
) -> Vec<usize> {
    let mut groups: BTreeMap<(&str, &str), Vec<usize>> = BTreeMap::new();
    for (index, cloud) in clouds.iter().enumerate() {
        let cloud = cloud.borrow();
        let key = if stratified { (&*cloud.category, &*cloud.instance) } else { ("", "") };
        groups.entry(key).or_default().push(index);
    }
    let (mut part_of, mut counts) = (vec![0; clouds.len()], vec![0_u32; shares.len()]);
    for (number, group) in groups.values_mut().enumerate() {
        // By path, so that the order of a manifest's rows changes nothing.
        let path = |index: usize| &clouds[index].borrow().located.path;
        group.sort_by(|&left, &right| path(left).cmp(path(right)));
        shuffle(group, seed, "split", number as u64);
        for &index in group.iter() {
            let part = furthest_behind(shares, &counts);
            counts[part] += 1;
            part_of[index] = part;
        }
    }
    part_of
}

/// Fisher and Yates: every order is equally likely.
pub(super) fn shuffle<T>(group: &mut [T], seed: u64, purpose: &str, number: u64) {
    let mut rng = stream(seed, purpose, &[number]);
    for last in (1..group.len()).rev() {
        let other = rng.random_range(0..=last as u64);
        group.swap(last, other as usize);
    }
}

/// The index whose count is furthest below its share of all counts after one more, the lowest on ties; never
/// one without a share.
fn furthest_behind(shares: &[f64], counts: &[u32]) -> usize {
    let total = f64::from(counts.iter().sum::<u32>() + 1);
    let behind = |index: usize| shares[index] * total - f64::from(counts[index]);
    let mut best = shares.len() - 1;
    for index in (0..shares.len()).rev().filter(|&index| shares[index] > 0.0) {
        if shares[best] == 0.0 || behind(index) >= behind(best) {
            best = index;
        }
    }
    best
}
