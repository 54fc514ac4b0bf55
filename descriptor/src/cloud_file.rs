//! The cloud in a file of any format that is read: the content says which, not the name.

use crate::pcd::PcdError;
use crate::ply::PlyError;
use crate::{Cloud, pcd, ply};

/// Endings of the names of files that are taken for clouds where folders are searched, in lower case.
pub const ENDINGS: [&str; 2] = [".pcd", ".ply"];

/// What is wrong with a cloud file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CloudFileError {
    /// It is no PLY file, and as a PCD file it cannot be read.
    #[error(transparent)]
    Pcd(#[from] PcdError),
    /// It begins as a PLY file and cannot be read.
    #[error(transparent)]
    Ply(#[from] PlyError),
}

/// The cloud in the bytes of a PLY or PCD file, in the file's own unit of length.
///
/// # Errors
/// What [`ply::read`] says of a file that begins with `ply`, and [`pcd::read`] of any other.
pub fn read(bytes: &[u8]) -> Result<Cloud, CloudFileError> {
    if ply::is_ply(bytes) { Ok(ply::read(bytes)?) } else { Ok(pcd::read(bytes)?) }
}

/// Whether a file of this name is taken for a cloud where folders are searched: it ends as one of [`ENDINGS`], in
/// whatever case.
pub fn has_ending(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    ENDINGS.iter().any(|ending| name.ends_with(ending))
}
