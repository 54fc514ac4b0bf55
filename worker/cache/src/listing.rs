//! What lies in a cache folder. Whatever vanishes meanwhile, because another process evicts, is passed over.

use std::fs::{self, DirEntry};
use std::path::{Path, PathBuf};

use proto::Digest;

use crate::layout;

/// The keys of the entries of a kind below `root`.
pub fn keys(root: &Path, kind: &str) -> Vec<Digest> {
    let Some(kind) = layout::kind(kind) else { return Vec::new() };
    let folders = folders(&root.join(kind), layout::is_fan_out);
    let entries = folders.iter().flat_map(|folder| list(folder));
    entries.filter_map(|entry| Digest::from_hex(entry.file_name().to_str()?)).collect()
}

/// The folders below `parent` with names that are ours; links are none.
pub fn folders(parent: &Path, is_ours: impl Fn(&str) -> bool) -> Vec<PathBuf> {
    let is_ours = |entry: &DirEntry| {
        entry.file_name().to_str().is_some_and(&is_ours) && entry.file_type().is_ok_and(|kind| kind.is_dir())
    };
    if !is_folder(parent) {
        return Vec::new();
    }
    list(parent).filter(is_ours).map(|entry| entry.path()).collect()
}

/// Whether there is a folder, and no link to one: what lies behind a link is not ours to remove.
pub fn is_folder(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_dir())
}

/// Everything in a folder.
pub fn list(folder: &Path) -> impl Iterator<Item = DirEntry> + use<> {
    fs::read_dir(folder).into_iter().flatten().flatten()
}
