//! The file that says which sweep a folder is of.

use std::io;
use std::path::Path;

use crate::run::RunError;
use crate::run::directory::read_bounded;

/// File in the folder of a sweep that tells it in full.
pub const SWEEP_FILE: &str = "sweep.toml";

/// The sweep that a folder was made for, in full, if it is one of a sweep.
pub fn recorded_sweep(folder: &Path) -> Result<Option<String>, RunError> {
    let path = folder.join(SWEEP_FILE);
    match read_bounded(&path) {
        Ok(record) => Ok(Some(record)),
        Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {
            Ok(None)
        }
        Err(source) => Err(RunError::File { path, source }),
    }
}
