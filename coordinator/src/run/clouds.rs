//! The clouds of a run, kept in its folder: what has changed can be named when the data digest is another.

use std::path::Path;

use proto::Digest;

use crate::dataset::record::{self, CloudRecord};
use crate::dataset::{Dataset, read_file};
use crate::run::RunError;

/// File in the folder of a run or sweep that lists its clouds.
pub const CLOUDS_FILE: &str = "clouds.tsv";

/// Keeps the clouds of a run in its folder. The file is in no digest: it says what the data digest is of.
pub fn keep(folder: &Path, dataset: &Dataset) -> Result<(), RunError> {
    let path = folder.join(CLOUDS_FILE);
    let text = record::to_text(&dataset.clouds.listed);
    if read_file(&path).is_ok_and(|held| held == text.as_bytes()) {
        return Ok(());
    }
    atomic::write(&path, text.as_bytes()).map_err(|source| RunError::File { path, source })
}

/// In what the clouds of now differ from those of the run in a folder, by lines that name them, or why that is not
/// known. `then`: the run's data digest, which the folder's list must have.
pub fn difference(folder: &Path, then: &str, now: &Dataset) -> String {
    let lines = match kept(folder, then) {
        Some(then) => record::difference(&then, &now.clouds.listed),
        None => vec![format!("which clouds differ is not known: {CLOUDS_FILE} is missing from the folder")],
    };
    lines.iter().map(|line| format!("  {line}")).collect::<Vec<_>>().join("\n")
}

/// The clouds that a folder lists, or, for a run of a sweep, that of the sweep.
pub fn listed(folder: &Path) -> Option<Vec<CloudRecord>> {
    let read = |folder: &Path| {
        let bytes = read_file(&folder.join(CLOUDS_FILE)).ok()?;
        record::from_text(std::str::from_utf8(&bytes).ok()?)
    };
    read(folder).or_else(|| read(folder.parent()?))
}

/// The clouds that a folder lists, or, for a run of a sweep, that of the sweep, if they are those of the digest.
pub fn kept(folder: &Path, digest: &str) -> Option<Vec<CloudRecord>> {
    let read = |folder: &Path| {
        let bytes = read_file(&folder.join(CLOUDS_FILE)).ok()?;
        let clouds = record::from_text(std::str::from_utf8(&bytes).ok()?)?;
        (Digest(record::data_digest(&clouds)).to_string() == digest).then_some(clouds)
    };
    read(folder).or_else(|| read(folder.parent()?))
}

/// Digest of a data set.
pub fn data_digest(dataset: &Dataset) -> String {
    proto::Digest(dataset.clouds.digest).to_string()
}
