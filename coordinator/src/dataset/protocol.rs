//! Protocols of evaluation: which clouds train, validate and test, for a data set that comes without lists.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

use super::check::{check_labels, check_overlap};
use super::error::DatasetError;
use super::images::cloud_bytes;
use super::labelled::Labelled;
use super::layout::Labels;
use super::root::Root;
use super::settings::{Layout, SeededSplit};
use super::split::{deal, draw};

/// What is held out for the test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// A third of each object's clouds, in the proportions of the paper's data set.
    Paper,
    /// Each sequence in turn, of all objects: another day, another camera position.
    Sequences,
    /// One object of each category in turn: what is asked of the others is the category.
    Instances,
    /// Each of so many equal parts in turn.
    Folds(u32),
}

/// One way to split a data set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fold {
    /// Says what is held out; fit for a folder.
    pub name: String,
    /// Paths of train1, train2, validation and test, relative to the data root.
    pub splits: [Vec<String>; 4],
}

/// The folds of a protocol.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Folds {
    /// In order.
    pub folds: Vec<Fold>,
    /// Files of the layout that are no clouds by its rules.
    pub ignored: Vec<String>,
    /// Clouds whose bytes are those of another: they are in no split, because a frame that trains must not test.
    pub copies: Vec<String>,
    /// Categories of one object only, which leave-instance-out cannot hold out.
    pub lone_categories: Vec<String>,
}

/// train1, train2, validation and test of the paper's 1418 clouds: 352, 352, 239 and 475.
const PAPER: [f64; 4] = [352.0 / 1418.0, 352.0 / 1418.0, 239.0 / 1418.0, 475.0 / 1418.0];
/// The same without the test.
const TRAINING: [f64; 4] = [352.0 / 943.0, 352.0 / 943.0, 239.0 / 943.0, 0.0];

impl Protocol {
    /// Splits every cloud that the layout finds below `root`, in the same way for the same seed.
    ///
    /// # Errors
    /// If there is no such data set, or it has too few sequences, objects or clouds for the protocol.
    pub fn folds(self, root: &Path, layout: &Layout, seed: u64) -> Result<Folds, DatasetError> {
        let root = Root::open(root)?;
        let mut ignored = Vec::new();
        let clouds = Labels::read(layout, &root)?.all(&root, &mut ignored)?;
        check_overlap(&["all"], std::slice::from_ref(&clouds))?;
        check_labels(clouds.iter())?;
        let (clouds, copies) = without_copies(&root, clouds)?;
        if clouds.is_empty() {
            return Err(DatasetError::no_cloud("data"));
        }
        check_paths(&clouds)?;
        let (held_out, lone_categories) = match self {
            Self::Paper => (vec![("paper".to_owned(), drawn_test(&clouds, seed))], Vec::new()),
            Self::Sequences => (sequences(&clouds)?, Vec::new()),
            Self::Instances => instances(&clouds, seed)?,
            Self::Folds(count) => (parts(&clouds, count, seed)?, Vec::new()),
        };
        let folds = held_out.into_iter().map(|(name, test)| fold(name, &clouds, &test, seed));
        Ok(Folds { folds: folds.collect::<Result<_, _>>()?, ignored, copies, lone_categories })
    }
}

/// Refuses paths that would be read as something else from a list.
fn check_paths(clouds: &[Labelled]) -> Result<(), DatasetError> {
    let is_unfit = |path: &&String| path.starts_with('#') || path.trim() != path.as_str();
    match clouds.iter().map(|cloud| &cloud.located.path).find(is_unfit) {
        Some(path) => Err(DatasetError::Rule {
            expected: "paths that a list can hold expected",
            got: path.clone(),
            advice: "rename it: in a list # begins a comment, and white space at an end is dropped",
        }),
        None => Ok(()),
    }
}

/// The clouds without those whose bytes an earlier one has, and the paths of these.
fn without_copies(root: &Root, clouds: Vec<Labelled>) -> Result<(Vec<Labelled>, Vec<String>), DatasetError> {
    let (mut seen, mut copies, mut unique) = (HashMap::new(), Vec::new(), Vec::new());
    for cloud in clouds {
        let bytes = cloud_bytes(&root.path().join(&cloud.located.path)).map_err(|reason| {
            DatasetError::NotThere { place: cloud.place.clone(), path: cloud.located.path.clone(), reason }
        })?;
        if seen.insert(*blake3::hash(&bytes).as_bytes(), ()).is_some() {
            copies.push(cloud.located.path);
        } else {
            unique.push(cloud);
        }
    }
    Ok((unique, copies))
}

/// Whether each cloud is in the test.
type Test = Vec<bool>;

fn drawn_test(clouds: &[Labelled], seed: u64) -> Test {
    let [.., test] = PAPER;
    deal(clouds, &[1.0 - test, test], true, seed).into_iter().map(|part| part == 1).collect()
}

fn sequences(clouds: &[Labelled]) -> Result<Vec<(String, Test)>, DatasetError> {
    let names: BTreeSet<&String> = clouds.iter().filter_map(|cloud| cloud.sequence.as_ref()).collect();
    if names.len() < 2 {
        return Err(too_few(
            "at least 2 sequences expected",
            names.len(),
            "clouds of the uw layout name their video",
        ));
    }
    let files: BTreeSet<String> = names.iter().map(|name| as_file_name(name)).collect();
    let fold = |(index, name): (usize, &String)| {
        let test = clouds.iter().map(|cloud| cloud.sequence.as_ref() == Some(name)).collect();
        // Names that differ may be alike as those of files.
        let number = if files.len() < names.len() { format!("{}-", index + 1) } else { String::new() };
        (format!("sequence-{number}{}", as_file_name(name)), test)
    };
    Ok(names.iter().copied().enumerate().map(fold).collect())
}

/// Folds, and the categories that have one object only.
type HeldOut = (Vec<(String, Test)>, Vec<String>);

fn instances(clouds: &[Labelled], seed: u64) -> Result<HeldOut, DatasetError> {
    let mut categories: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for cloud in clouds {
        categories.entry(&cloud.category).or_default().insert(&cloud.instance);
    }
    let lone = |objects: &BTreeSet<&str>| objects.len() < 2;
    let lone_categories = categories.iter().filter(|(_, objects)| lone(objects));
    let lone_categories = lone_categories.map(|(category, _)| (*category).to_owned()).collect();
    categories.retain(|_, objects| !lone(objects));
    let most = categories.values().map(BTreeSet::len).max().unwrap_or(0);
    if most == 0 {
        return Err(too_few("a category of at least 2 objects expected", 0, "take another protocol"));
    }
    // Which objects are held out together is drawn: names are often in the order in which they were recorded.
    let mut orders = Vec::new();
    for (number, objects) in categories.into_values().enumerate() {
        let mut objects: Vec<&str> = objects.into_iter().collect();
        super::split::shuffle(&mut objects, seed, "held out objects", number as u64);
        orders.push(objects);
    }
    let fold = |fold: usize| {
        let held: BTreeSet<&str> = orders.iter().map(|objects| objects[fold % objects.len()]).collect();
        let test = clouds.iter().map(|cloud| held.contains(&*cloud.instance)).collect();
        (format!("instances-{}", fold + 1), test)
    };
    Ok(((0..most).map(fold).collect(), lone_categories))
}

fn parts(clouds: &[Labelled], count: u32, seed: u64) -> Result<Vec<(String, Test)>, DatasetError> {
    if count < 2 || count as usize > clouds.len() {
        return Err(DatasetError::Rule {
            expected: "2 folds to one a cloud expected",
            got: format!("{count} of {} clouds", clouds.len()),
            advice: "choose another --folds",
        });
    }
    let dealt = deal(clouds, &vec![1.0 / f64::from(count); count as usize], true, seed);
    let fold = |part: usize| {
        let test = dealt.iter().map(|&own| own == part).collect();
        (format!("fold-{}", part + 1), test)
    };
    Ok((0..count as usize).map(fold).collect())
}

/// The fold with this test: the other clouds are drawn for the other splits, object by object.
fn fold(name: String, clouds: &[Labelled], test: &Test, seed: u64) -> Result<Fold, DatasetError> {
    let (tested, others): (Vec<_>, Vec<_>) = clouds.iter().cloned().zip(test).partition(|(_, test)| **test);
    let others = others.into_iter().map(|(cloud, _)| cloud).collect();
    let rule = SeededSplit { seed, shares: TRAINING, stratified: true, test_sequences: Vec::new() };
    let mut splits = draw(&rule, others)?.map(|clouds| clouds.into_iter().map(path).collect::<Vec<_>>());
    splits[3] = tested.into_iter().map(|(cloud, _)| path(cloud)).collect();
    match super::SPLITS.into_iter().zip(&splits).find(|(_, paths)| paths.is_empty()) {
        Some((split, _)) => {
            Err(too_few("a cloud for each split expected", clouds.len(), empty_advice(split)))
        }
        None => Ok(Fold { name, splits }),
    }
}

fn empty_advice(split: &'static str) -> &'static str {
    match split {
        "test" => "take fewer folds, or more clouds: one test would be empty",
        _ => "take more clouds: one of train1, train2 and validation would be empty",
    }
}

fn path(cloud: Labelled) -> String {
    cloud.located.path
}

fn too_few(expected: &'static str, got: usize, advice: &'static str) -> DatasetError {
    DatasetError::Rule { expected, got: got.to_string(), advice }
}

/// A name out of a manifest as part of a folder's name: of bounded length, not always unique.
fn as_file_name(name: &str) -> String {
    name.chars()
        .take(40)
        .map(|letter| if letter.is_alphanumeric() || "-_".contains(letter) { letter } else { '_' })
        .collect()
}
