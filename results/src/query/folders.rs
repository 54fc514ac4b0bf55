//! Which folders a query is over, and what to call them.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use super::error::QueryError;
use crate::error::Error;
use crate::file::names;
use crate::read::table_files;
use crate::table_name::TableName;

/// How far below a named folder runs are looked for: a folder of results holds those of sweeps, which hold runs.
const DEPTH: usize = 2;

/// Name of the column that says which folder a row is from, where rows are from several.
pub(super) const RUN_FOLDER: &str = "run_folder";

/// All tables of runs and grids.
pub(super) fn all_tables() -> impl Iterator<Item = TableName> {
    let of_runs = TableName::RUN
        .into_iter()
        .chain(TableName::FRONT)
        .chain(TableName::SETS)
        .chain(TableName::COMPARISON)
        .chain(TableName::PERTURBED);
    of_runs.chain(TableName::GRID)
}

/// The folder of a run or a grid.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Member {
    /// What its rows say in `run_folder`.
    pub name: String,
    pub folder: PathBuf,
}

/// The runs and grids in these folders, in order; one that is named twice counts once.
pub(super) fn members(folders: &[impl AsRef<Path>]) -> Result<Vec<Member>, QueryError> {
    let mut found = Vec::new();
    for folder in folders {
        let folder = folder.as_ref();
        // The canonical path: `.` gets a name, and two paths to one folder count once.
        let whole = fs::canonicalize(folder).ok().filter(|folder| folder.is_dir());
        let whole = whole.ok_or_else(|| QueryError::NoFolder(folder.to_owned()))?;
        let before = found.len();
        look_into(&whole, DEPTH, &mut found)?;
        if found.len() == before {
            return Err(QueryError::NoTables(folder.to_owned()));
        }
    }
    let mut seen = BTreeSet::new();
    found.retain(|folder| seen.insert(folder.clone()));
    let names = ends_that_differ(&found);
    Ok(names.into_iter().zip(found).map(|(name, folder)| Member { name, folder }).collect())
}

/// Adds the folder if it has tables, else the folders in it.
fn look_into(folder: &Path, depth: usize, found: &mut Vec<PathBuf>) -> Result<(), Error> {
    for table in all_tables() {
        if !table_files(folder, table)?.is_empty() {
            found.push(folder.to_owned());
            return Ok(());
        }
    }
    if depth > 0 {
        for name in names(folder)?.iter().filter(|name| !name.starts_with('.')) {
            let inner = folder.join(name);
            if inner.is_dir() {
                look_into(&inner, depth - 1, found)?;
            }
        }
    }
    Ok(())
}

/// The ends of these paths, all of as many components as it takes to tell them apart.
fn ends_that_differ(folders: &[PathBuf]) -> Vec<String> {
    let end = |folder: &PathBuf, length: usize| {
        let parts: Vec<&OsStr> = folder.iter().collect();
        let end: PathBuf = parts[parts.len().saturating_sub(length)..].iter().collect();
        end.display().to_string()
    };
    let longest = folders.iter().map(|folder| folder.iter().count()).max().unwrap_or(1);
    let mut names = Vec::new();
    for length in 1..=longest {
        names = folders.iter().map(|folder| end(folder, length)).collect();
        if names.iter().collect::<BTreeSet<_>>().len() == folders.len() {
            break;
        }
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_as_long_as_it_takes() {
        for (folders, expected) in [
            (vec!["/r/demo"], vec!["demo"]),
            (vec!["/r/s/seed-1", "/r/s/seed-2"], vec!["seed-1", "seed-2"]),
            (vec!["/r/s/seed-1", "/r/t/seed-1", "/r/t/x"], vec!["s/seed-1", "t/seed-1", "t/x"]),
            (vec!["/a/r", "/a"], vec!["r", "a"]),
            (vec!["/", "/a/a", "/a"], vec!["/", "a/a", "/a"]),
        ] {
            let folders: Vec<PathBuf> = folders.into_iter().map(PathBuf::from).collect();
            assert_eq!(ends_that_differ(&folders), expected);
        }
    }
}
