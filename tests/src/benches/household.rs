//! The benchmark data beside the repository, and the experiment on it with every generation forced.

use std::fs;
use std::path::{Path, PathBuf};

use toml::{Table, Value};

use crate::experiments::repository;

/// Generations of the forced run.
pub const GENERATIONS: u32 = 200;

/// The household clouds, or those of a set with the same lists.
#[derive(Debug)]
pub struct Household {
    /// The folder that holds them and their lists.
    pub root: PathBuf,
}

impl Household {
    /// The clouds of a set, as [`find_set`] finds them.
    pub fn find(set: &str) -> Self {
        Self { root: find_set(set) }
    }

    /// Paths in some lists, one list after the other.
    pub fn listed(&self, lists: &[&str]) -> Vec<String> {
        listed(&self.root, lists)
    }

    /// The experiment as it is shipped, on the clouds here; `change` is done to it.
    pub fn experiment(&self, change: impl FnOnce(&mut Table)) -> String {
        let path = repository().join("experiments/household.toml");
        let text = fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let mut experiment: Table = text.parse().unwrap();
        section(&mut experiment, "dataset").insert("root".to_owned(), self.root.to_str().unwrap().into());
        change(&mut experiment);
        experiment.to_string()
    }

    /// The experiment that does all [`GENERATIONS`] and validates each.
    pub fn forced(&self) -> String {
        self.experiment(|experiment| {
            let stop: [(&str, Value); 4] = [
                ("generations", GENERATIONS.into()),
                ("stagnation", "off".into()),
                // Validation errors cannot rise more often than there are generations.
                ("validation_patience", (5 * GENERATIONS).into()),
                ("perfect", false.into()),
            ];
            section(experiment, "stop").extend(stop.map(|(key, value)| (key.to_owned(), value)));
        })
    }
}

/// The folder of a benchmark set below `DESCRY_SHARED`, or in `../shared`; without it the program ends.
pub fn find_set(name: &str) -> PathBuf {
    let shared =
        std::env::var_os("DESCRY_SHARED").map_or_else(|| repository().join("../shared"), PathBuf::from);
    let root = shared.join("data").join(name);
    root.canonicalize().unwrap_or_else(|error| {
        eprintln!(
            "error: {}: no benchmark data, got {error}\nset DESCRY_SHARED to the folder that holds data/{name}",
            root.display()
        );
        std::process::exit(1);
    })
}

/// Paths in some lists of a set, one list after the other.
pub fn listed(root: &Path, lists: &[&str]) -> Vec<String> {
    let read = |list: &&str| {
        let path = root.join(list);
        fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    };
    let text: String = lists.iter().map(read).collect();
    text.lines().filter(|line| !line.is_empty()).map(str::to_owned).collect()
}

/// A section of an experiment; an empty one if it is not written.
pub fn section<'a>(experiment: &'a mut Table, name: &str) -> &'a mut Table {
    let section = experiment.entry(name).or_insert_with(|| Value::Table(Table::new()));
    section.as_table_mut().unwrap()
}
