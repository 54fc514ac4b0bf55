//! The runs, sweeps and grids below the folders that a dashboard shows.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use results::TableName;

use crate::run::directory::SEARCH_FILE;
use crate::sweep::SWEEP_FILE;

/// Folders of folders that are looked into.
const DEPTH: usize = 3;
/// Runs beyond which no more are looked for.
const MOST: usize = 5000;

/// What a folder holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A run.
    Run,
    /// A sweep, whose members are runs in folders of its own.
    Sweep,
    /// An exhaustive search.
    Grid,
}

/// A folder with results.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    /// Its path below the folder that is shown, with `/`; of that folder itself its name.
    pub id: String,
    /// Where it is.
    pub folder: PathBuf,
    /// What it holds.
    pub kind: Kind,
    /// The id of the sweep that it is a member of.
    pub sweep: Option<String>,
    /// Inode and time of the file that says what is searched: a run in the place of one that was removed has others.
    stamp: Option<(u64, SystemTime)>,
}

/// What there is below some folders, sorted by id. A folder that cannot be read has nothing.
pub fn find(roots: &[PathBuf]) -> Vec<Found> {
    let (mut found, mut names) = (Vec::new(), BTreeSet::new());
    for root in roots {
        let name = fs::canonicalize(root).unwrap_or_else(|_| root.clone());
        let name =
            name.file_name().map_or_else(|| "results".to_owned(), |name| name.to_string_lossy().into_owned());
        // Two folders of one name are two.
        let numbered = (2..).map(|number| format!("{name}-{number}"));
        let unused = std::iter::once(name.clone()).chain(numbered).find(|name| names.insert(name.clone()));
        let name = unused.unwrap_or(name);
        match kind(root) {
            Some(_) => look(root, &name, None, DEPTH, &mut found),
            None if roots.len() == 1 => look_below(root, "", None, DEPTH, &mut found),
            None => look_below(root, &name, None, DEPTH, &mut found),
        }
    }
    found.sort_by(|a, b| a.id.cmp(&b.id));
    found.dedup_by(|a, b| a.id == b.id);
    found
}

/// What a folder holds, if it is one of ours.
fn kind(folder: &Path) -> Option<Kind> {
    let has = |name: &str| folder.join(name).exists();
    if has(SWEEP_FILE) {
        Some(Kind::Sweep)
    } else if has(TableName::Cells.as_str()) && has(SEARCH_FILE) {
        Some(Kind::Grid)
    } else if has(SEARCH_FILE) || has(TableName::Evaluations.as_str()) {
        Some(Kind::Run)
    } else {
        None
    }
}

fn look(folder: &Path, id: &str, sweep: Option<&str>, depth: usize, found: &mut Vec<Found>) {
    if found.len() >= MOST {
        return;
    }
    let Some(kind) = kind(folder) else {
        return look_below(folder, id, None, depth, found);
    };
    let sweep = sweep.map(str::to_owned);
    let file = folder.join(if kind == Kind::Sweep { SWEEP_FILE } else { SEARCH_FILE });
    let stamp = file.metadata().ok().and_then(|file| Some((file.ino(), file.modified().ok()?)));
    found.push(Found { id: id.to_owned(), folder: folder.to_owned(), kind, sweep, stamp });
    if kind == Kind::Sweep {
        look_below(folder, id, Some(id), 1, found);
    }
}

fn look_below(folder: &Path, id: &str, sweep: Option<&str>, depth: usize, found: &mut Vec<Found>) {
    if depth == 0 {
        return;
    }
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let (name, path) = (entry.file_name(), entry.path());
        let Some(name) = name.to_str().filter(|name| !name.starts_with('.')) else { continue };
        // A link could lead out of what is shown, or in a circle.
        if !entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            continue;
        }
        let id = if id.is_empty() { name.to_owned() } else { format!("{id}/{name}") };
        look(&path, &id, sweep, depth - 1, found);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ids(roots: &[PathBuf]) -> Vec<(String, Kind, Option<String>)> {
        find(roots).into_iter().map(|found| (found.id, found.kind, found.sweep)).collect()
    }

    #[test]
    fn runs_grids_and_members_of_sweeps_are_found_and_links_are_not_followed() {
        let parent = tempfile::tempdir().unwrap();
        let at = |path: &str| parent.path().join(path);
        for (folder, file) in [
            ("results/runs/one", SEARCH_FILE),
            ("results/runs/sweep", SWEEP_FILE),
            ("results/runs/sweep/seed-1", SEARCH_FILE),
            ("results/grids/demo", SEARCH_FILE),
            ("elsewhere", SEARCH_FILE),
            ("results/other", "notes.txt"),
        ] {
            fs::create_dir_all(at(folder)).unwrap();
            fs::write(at(folder).join(file), "").unwrap();
        }
        fs::create_dir(at("results/grids/demo/cells")).unwrap();
        std::os::unix::fs::symlink(at("elsewhere"), at("results/runs/link")).unwrap();
        let sweep = Some("runs/sweep".to_owned());
        assert_eq!(
            ids(&[at("results")]),
            [
                ("grids/demo".to_owned(), Kind::Grid, None),
                ("runs/one".to_owned(), Kind::Run, None),
                ("runs/sweep".to_owned(), Kind::Sweep, None),
                ("runs/sweep/seed-1".to_owned(), Kind::Run, sweep),
            ]
        );
        assert_eq!(ids(&[at("results/runs/one")]), [("one".to_owned(), Kind::Run, None)]);
        let both = ids(&[at("results/runs/one"), at("results/grids")]);
        assert_eq!(both.iter().map(|found| found.0.as_str()).collect::<Vec<_>>(), ["grids/demo", "one"]);
        assert_eq!(ids(&[at("nothing")]), []);
        let twice = ids(&[at("results/runs/one"), at("results/runs/one")]);
        assert_eq!(twice.iter().map(|found| found.0.as_str()).collect::<Vec<_>>(), ["one", "one-2"]);
        let before = find(&[at("elsewhere")]);
        fs::remove_file(at("elsewhere").join(SEARCH_FILE)).unwrap();
        let later = SystemTime::now() + std::time::Duration::from_secs(5);
        let file = fs::File::create(at("elsewhere").join(SEARCH_FILE)).unwrap();
        file.set_modified(later).unwrap();
        assert_ne!(find(&[at("elsewhere")]), before, "another run in its place");
    }
}
