//! Several runs beside each other: which belong together, and what each has reached after how many evaluations.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::address::address;

use super::data::{Rows, percent};
use crate::error::Error;
use crate::read::{FinishedRun, finished, read_file, run_file};
use crate::table_name::TableName;

/// A run among several, by its folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedRun {
    /// What it is called.
    pub name: String,
    /// Its folder.
    pub folder: PathBuf,
    /// What the variant that it is of is called by whoever wrote the sweep, if it has a name.
    pub variant: Option<String>,
}

/// A run among several.
#[derive(Clone, Debug)]
pub(crate) struct Member {
    /// Its label.
    pub label: String,
    /// Its folder.
    pub folder: PathBuf,
    /// The variant that it is of.
    pub variant: Option<String>,
    /// Where its own report is, from the page; `None` if it has none.
    pub report: Option<String>,
    /// Its row.
    pub run: FinishedRun,
    /// The lowest training error, percent, after each number of different descriptors from 1.
    pub best: Vec<f64>,
}

/// Runs of one search on the same clouds, which differ in their seed only.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    /// Its variant, or the settings in which it differs from the others.
    pub name: String,
    /// The settings in which it differs from the others.
    pub settings: String,
    /// The clouds.
    pub data_digest: String,
    /// Its runs.
    pub members: Vec<Member>,
}

/// What is known of several runs.
#[derive(Clone, Debug)]
pub(crate) struct Runs {
    /// The groups, in the order in which their first runs were named.
    pub groups: Vec<Group>,
    /// What was left out, and why.
    pub notes: Vec<String>,
}

impl Runs {
    /// Reads runs, for the page `page`. One that is named twice, or that is the same as another, counts once; one
    /// that is not finished has no result.
    ///
    /// # Errors
    /// If a folder is not a run folder, or if a file in it cannot be read or is damaged; the message names the file.
    pub fn read(runs: &[NamedRun], page: &Path) -> Result<Self, Error> {
        let (mut members, mut notes) = (Vec::new(), Vec::new());
        let mut met: BTreeMap<String, String> = BTreeMap::new();
        for NamedRun { name: label, folder, variant } in runs {
            let file = match run_file(folder) {
                Ok(file) => file,
                Err(Error::Unfinished(_)) => {
                    notes.push(format!("{label} is not finished: it is left out."));
                    continue;
                }
                Err(error) => return Err(error),
            };
            let run = finished(&read_file(&file, TableName::Run)?, &file)?;
            // Two runs with one digest are one search: as two they would pass for independent evidence.
            if let Some(first) = met.insert(run.run_digest.clone(), label.clone()) {
                notes.push(format!("{label} is the same run as {first}: it counts once."));
                met.insert(run.run_digest, first);
                continue;
            }
            let best = best_so_far(folder)?;
            let report = folder.join("report").join("report.html");
            let report = report.is_file().then(|| address(page, &report)).flatten();
            let (label, folder, variant) = (label.clone(), folder.clone(), variant.clone());
            members.push(Member { label, folder, variant, report, run, best });
        }
        Ok(Self { groups: grouped(members), notes })
    }
}

/// The lowest training error after each number of different descriptors. What was met before costs nothing, whether it
/// was remembered by the run or computed again.
fn best_so_far(folder: &Path) -> Result<Vec<f64>, Error> {
    let Some(evaluations) = Rows::read(folder, TableName::Evaluations)? else { return Ok(Vec::new()) };
    let errors = evaluations.numbers(&format!("{}_error", evaluations.counted()?))?;
    let genes: Vec<Vec<Option<f64>>> =
        evaluations.genes().iter().map(|gene| evaluations.optional(&gene.name)).collect::<Result<_, _>>()?;
    let mut met = BTreeSet::new();
    let mut best = Vec::new();
    for (row, &error) in errors.iter().enumerate() {
        let descriptor: Vec<Option<u64>> = genes.iter().map(|gene| gene[row].map(f64::to_bits)).collect();
        if met.insert(descriptor) {
            let lowest = best.last().copied().unwrap_or(f64::INFINITY);
            best.push(percent(error).min(lowest));
        }
    }
    Ok(best)
}

/// What the runs of a group share.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Key {
    settings: Vec<String>,
    data_digest: String,
    variant: Option<String>,
}

/// Runs that differ in nothing but the seed, together.
fn grouped(members: Vec<Member>) -> Vec<Group> {
    let mut keys: Vec<Key> = Vec::new();
    let mut groups: Vec<Vec<Member>> = Vec::new();
    for member in members {
        let row = &member.run.row;
        let (settings, data_digest) = (settings(&row.search_config), row.data_digest.clone());
        let key = Key { settings, data_digest, variant: member.variant.clone() };
        let place = keys.iter().position(|other| *other == key).unwrap_or_else(|| {
            keys.push(key);
            groups.push(Vec::new());
            groups.len() - 1
        });
        groups[place].push(member);
    }
    let differences = differences(&keys, &groups);
    let names = names(&keys, &differences);
    let named = groups.into_iter().zip(keys).zip(differences.into_iter().zip(names));
    named
        .map(|((members, Key { data_digest, .. }), (settings, name))| Group {
            name,
            settings,
            data_digest,
            members,
        })
        .collect()
}

/// The lines of a search's canonical TOML as `section.key = value`, without its seed. (Seeds of the data are in
/// sections.)
fn settings(search_config: &str) -> Vec<String> {
    let mut section = String::new();
    let mut settings = Vec::new();
    for line in search_config.lines().map(str::trim).filter(|line| !line.is_empty()) {
        if let Some(name) = line.strip_prefix('[').and_then(|line| line.strip_suffix(']')) {
            section = format!("{name}.");
        } else if !(section.is_empty() && line.starts_with("seed =")) {
            settings.push(format!("{section}{line}"));
        }
    }
    settings
}

/// The settings in which the groups differ.
fn differences(keys: &[Key], groups: &[Vec<Member>]) -> Vec<String> {
    let everywhere = |setting: &String| keys.iter().all(|key| key.settings.contains(setting));
    let name = |(Key { settings, data_digest: data, .. }, members): (&Key, &Vec<Member>)| {
        let mut parts: Vec<String> = settings
            .iter()
            .filter(|setting| !everywhere(setting))
            .map(|setting| {
                let (key, value) = setting.split_once(" = ").unwrap_or((setting, ""));
                format!("{} {}", key.rsplit('.').next().unwrap_or(key), value.trim_matches('"'))
            })
            .collect();
        if keys.iter().any(|other| other.data_digest != *data) {
            parts.push(format!("data {}", data.get(..8).unwrap_or(data)));
        }
        if parts.is_empty() {
            parts.extend(members.first().map(|member| member.run.row.name.clone()));
        }
        parts.join(", ")
    };
    keys.iter().zip(groups).map(name).collect()
}

/// What to call the groups: by their variants, with their differences where a variant has another beside it of the same
/// name; without variants by their differences.
fn names(keys: &[Key], differences: &[String]) -> Vec<String> {
    let name = |(key, settings): (&Key, &String)| match &key.variant {
        None => settings.clone(),
        Some(variant) if keys.iter().filter(|other| other.variant == key.variant).count() == 1 => {
            variant.clone()
        }
        Some(variant) => format!("{variant}: {settings}"),
    };
    keys.iter().zip(differences).map(name).collect()
}

impl Member {
    /// Test error of its winner, percent.
    pub fn test_error(&self) -> Option<f64> {
        self.run.row.test.map(|counts| percent(self.run.row.errors(counts).share()))
    }

    /// Training error of its winner, percent.
    pub fn training_error(&self) -> f64 {
        percent(self.run.row.errors(self.run.row.train).share())
    }

    /// How far its winner is from the optimum in training, percent.
    pub fn regret(&self) -> Option<f64> {
        self.run.row.regret().map(percent)
    }

    /// The lowest training error after that many different descriptors, percent: a run that has ended keeps what it has.
    pub fn best_after(&self, evaluations: usize) -> Option<f64> {
        self.best.get(evaluations.checked_sub(1)?.min(self.best.len().checked_sub(1)?)).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::fixture;

    const GA: &str = "version = 1\nseed = 1\n\n[dataset.synthetic]\nseed = 7\n\n[search]\nmethod = \"ga\"\n";

    #[test]
    fn runs_are_of_one_group_if_they_differ_in_their_own_seed_only() {
        let other_seed = GA.replacen("seed = 1", "seed = 2", 1);
        assert_eq!(settings(GA), settings(&other_seed));
        assert_ne!(settings(GA), settings(&GA.replace("seed = 7", "seed = 8")));
        assert_eq!(settings(GA), ["version = 1", "dataset.synthetic.seed = 7", "search.method = \"ga\""]);
    }

    #[test]
    fn groups_are_named_by_what_tells_them_apart() {
        let key = |config: &str, data: &str, variant: &str| Key {
            settings: settings(config),
            data_digest: data.to_owned(),
            variant: (!variant.is_empty()).then(|| variant.to_owned()),
        };
        let named = |keys: [Key; 2]| names(&keys, &differences(&keys, &[Vec::new(), Vec::new()]));
        let random = GA.replace("ga", "random");
        assert_eq!(named([key(GA, "d", ""), key(&random, "d", "")]), ["method ga", "method random"]);
        assert_eq!(
            named([key(GA, "0123456789", ""), key(GA, "abcdef0123", "")]),
            ["data 01234567", "data abcdef01"]
        );
        assert_eq!(named([key(GA, "d", "evolved"), key(&random, "d", "blind")]), ["evolved", "blind"]);
        assert_eq!(named([key(GA, "d", "x"), key(&random, "d", "x")]), ["x: method ga", "x: method random"]);
    }

    #[test]
    fn a_run_counts_once_and_an_unfinished_one_not_at_all() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = |name: &str| folder.path().join(name);
        fixture::write(&path("a"));
        fixture::write(&path("b"));
        drop(crate::RunFolder::create(path("c"), &fixture::genes()).unwrap());
        std::fs::create_dir(path("a/report")).unwrap();
        std::fs::write(path("a/report/report.html"), "").unwrap();
        let named = |name: &str| NamedRun { name: name.to_owned(), folder: path(name), variant: None };
        let runs = Runs::read(&["a", "b", "c"].map(named), &path("all.html")).unwrap();
        assert_eq!(runs.notes.len(), 2, "{:?}", runs.notes);
        assert_eq!(runs.groups.len(), 1);
        let [member] = runs.groups[0].members.as_slice() else { panic!("{:?}", runs.groups) };
        assert_eq!(member.report.as_deref(), Some("./a/report/report.html"));
        // Of 9 clouds its individuals have 5, 7, 4 and 6, 8, 5 right, no two of them with the same genes.
        let wrong = member.best.iter().map(|error| (error * 9.0 / 100.0).round() as u32);
        assert_eq!(wrong.collect::<Vec<_>>(), [4, 2, 2, 2, 1, 1]);
        assert_eq!(member.best_after(0), None);
        assert_eq!(member.best_after(2), Some(percent(2.0 / 9.0)));
        assert_eq!(member.best_after(99), Some(percent(1.0 / 9.0)));
    }
}
