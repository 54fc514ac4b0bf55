//! The folder of a search: found again by the same command, claimed once, refused to any other search.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::{fs, io};

pub use artefact::text::read_bounded;

use crate::experiment::Experiment;
use crate::run::RunError;

/// File in a run or grid folder that says which search it holds.
pub const SEARCH_FILE: &str = "search.toml";

/// The folder of an experiment's run: `out`, or one that the same search finds again; `fresh`: one that is not there.
pub fn folder(experiment: &Experiment, out: Option<PathBuf>, fresh: bool) -> PathBuf {
    chosen(experiment.results_dir(), &experiment.run_folder_name(), out, fresh)
}

/// `out`, or a folder of this name in `parent`; `fresh`: one that is not there.
pub fn chosen(parent: &Path, name: &str, out: Option<PathBuf>, fresh: bool) -> PathBuf {
    let base = out.unwrap_or_else(|| parent.join(name));
    if fresh { beside(&base) } else { base }
}

/// The first folder beside `base`, or itself, that is not there: no finished search is ever removed.
pub fn beside(base: &Path) -> PathBuf {
    if !base.exists() {
        return base.to_owned();
    }
    let numbered = |number: u32| {
        let mut name = base.as_os_str().to_owned();
        name.push(format!("-{number}"));
        PathBuf::from(name)
    };
    (2..).map(numbered).find(|folder| !folder.exists()).unwrap_or_else(|| base.to_owned())
}

/// Refuses a folder that holds another search, or something else than a search, before anything is made in it.
pub fn refuse_another(folder: &Path, search: &str) -> Result<(), RunError> {
    let path = folder.join(SEARCH_FILE);
    match read_bounded(&path) {
        Ok(held) => refuse_other_search(folder, &held, search),
        Err(error) if error.kind() == io::ErrorKind::NotFound => match foreign_entry(folder) {
            Some(entry) => Err(RunError::Occupied { folder: folder.to_owned(), entry: entry.into() }),
            None => Ok(()),
        },
        Err(source) if source.kind() == io::ErrorKind::InvalidInput => Err(RunError::File { path, source }),
        _ => Ok(()), // whatever else is wrong with it shows when the folder is opened and claimed
    }
}

/// Something in a folder that no start has left that was killed before it claimed the folder: such a start leaves a
/// lock, empty folders and files half written.
fn foreign_entry(folder: &Path) -> Option<OsString> {
    let is_empty_folder = |path: &Path| fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_none());
    let names = fs::read_dir(folder).ok()?.flatten().map(|entry| entry.file_name());
    let is_foreign = |name: &OsString| {
        let text = name.to_string_lossy();
        text != results::LOCK && !atomic::is_temporary(&text) && !is_empty_folder(&folder.join(name))
    };
    names.filter(is_foreign).min()
}

/// Marks the folder as this search's, and refuses one that holds another.
pub fn claim(folder: &Path, search: &str) -> Result<(), RunError> {
    let path = folder.join(SEARCH_FILE);
    let failed = |source| RunError::File { path: path.clone(), source };
    match read_bounded(&path) {
        Ok(held) => refuse_other_search(folder, &held, search),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            atomic::write(&path, search.as_bytes()).map_err(failed)
        }
        Err(error) => Err(failed(error)),
    }
}

/// Refuses a folder that holds this search, if another is wanted.
pub fn refuse_other_search(folder: &Path, held: &str, wanted: &str) -> Result<(), RunError> {
    if held == wanted {
        return Ok(());
    }
    Err(RunError::OtherSearch { folder: folder.to_owned(), difference: difference(held, wanted) })
}

/// Refuses a folder whose numbers are of another evaluation version than this program's.
pub fn refuse_other_version(folder: &Path, then: u32) -> Result<(), RunError> {
    if then == descriptor::EVALUATION_VERSION {
        return Ok(());
    }
    Err(RunError::OtherVersion { folder: folder.to_owned(), then })
}

/// Lines of one text that are not in the other, marked - and +.
fn difference(old: &str, new: &str) -> String {
    let only = |a: &str, b: &str, mark: char| {
        let other: Vec<&str> = b.lines().collect();
        a.lines()
            .filter(|line| !other.contains(line))
            .map(|line| format!("  {mark} {line}"))
            .collect::<Vec<_>>()
    };
    let mut lines = only(old, new, '-');
    lines.extend(only(new, old, '+'));
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[test]
    fn a_folder_is_claimed_once_and_refused_to_another_search() {
        let folder = tempfile::tempdir().unwrap();
        claim(folder.path(), "seed = 1\n[ga]\npopulation = 10\n").unwrap();
        claim(folder.path(), "seed = 1\n[ga]\npopulation = 10\n").unwrap();
        refuse_another(folder.path(), "seed = 1\n[ga]\npopulation = 10\n").unwrap();
        for refuse in [claim, refuse_another] {
            let error = refuse(folder.path(), "seed = 2\n[ga]\npopulation = 10\n").unwrap_err().to_string();
            assert!(error.contains("  - seed = 1\n  + seed = 2"), "{error}");
        }
        refuse_another(&folder.path().join("none"), "seed = 2").unwrap();
    }

    #[test]
    fn a_folder_of_somebody_else_is_refused_and_one_that_a_killed_start_left_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        fs::write(folder.join(results::LOCK), "").unwrap();
        fs::create_dir(folder.join("generations")).unwrap();
        fs::write(folder.join(".tmp-host-1-abcdefghijkl"), "half").unwrap();
        refuse_another(folder, "seed = 1\n").unwrap();
        fs::write(folder.join("thesis.tex"), "mine").unwrap();
        fs::create_dir(folder.join("run")).unwrap();
        fs::write(folder.join("run/run.parquet"), "mine").unwrap();
        let error = refuse_another(folder, "seed = 1\n").unwrap_err().to_string();
        assert!(error.contains("have a search.toml") && error.contains("got run among others"), "{error}");
    }

    #[test]
    fn the_mark_of_a_search_can_be_read_by_whom_other_files_can_be_read() {
        let folder = tempfile::tempdir().unwrap();
        let mode = |name| fs::metadata(folder.path().join(name)).unwrap().permissions().mode();
        fs::write(folder.path().join("other"), "").unwrap();
        claim(folder.path(), "seed = 1\n").unwrap();
        assert_eq!(mode(SEARCH_FILE), mode("other"));
    }
}
