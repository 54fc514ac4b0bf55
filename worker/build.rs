//! Finds what says which commit is built. The programs read it when they are compiled, not this script: when a script runs
//! again, cargo compiles the whole crate again and all that depend on it, and another commit should cost two links.

use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() {
    let manifest = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets it"));
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets it"));
    // Without any such line it would run again with every change of the crate.
    println!("cargo::rerun-if-changed={}", manifest.join("Cargo.toml").display());
    let found = manifest.parent().and_then(|repository| {
        let (folder, witness) = git_folder(&repository.join(".git"))?;
        let log = folder.join("logs/HEAD");
        log.is_file().then_some((log, witness))
    });
    let log = match found {
        Some((log, witness)) => {
            // Were the repository gone, the programs could not be compiled. No commit changes this file.
            println!("cargo::rerun-if-changed={}", witness.display());
            log
        }
        None => {
            let empty = out.join("no-commit");
            fs::write(&empty, "").expect("cargo's folder can be written to");
            empty
        }
    };
    println!("cargo::rustc-env=DESCRY_HEAD_LOG={}", log.display());
}

/// Git's folder for this checkout, and a file that is there as long as the repository is.
fn git_folder(path: &Path) -> Option<(PathBuf, PathBuf)> {
    if path.is_dir() {
        return Some((path.to_owned(), path.join("config")));
    }
    // A worktree: the folder is named in a file.
    let text = fs::read_to_string(path).ok()?;
    let folder = text.strip_prefix("gitdir: ")?.trim_end();
    Some((path.parent()?.join(folder), path.to_owned()))
}
