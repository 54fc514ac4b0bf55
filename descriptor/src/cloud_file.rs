//! The cloud in a file of any format that is read: the content says which, not the name.

use crate::pcd::PcdError;
use crate::ply::PlyError;
use crate::rgbd::RgbdError;
use crate::{Cloud, pcd, ply, rgbd};

/// Endings of the names of files that are taken for clouds where folders are searched, in lower case. A colour image of
/// the last ending stands for the images beside it, which [`rgbd::write`] makes one byte string of.
pub const ENDINGS: [&str; 3] = [".pcd", ".ply", "_crop.png"];

/// What is wrong with a cloud file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CloudFileError {
    /// It is neither a PLY file nor images, and as a PCD file it cannot be read.
    #[error(transparent)]
    Pcd(#[from] PcdError),
    /// It begins as a PLY file and cannot be read.
    #[error(transparent)]
    Ply(#[from] PlyError),
    /// It begins as images do and has no cloud.
    #[error(transparent)]
    Rgbd(#[from] RgbdError),
}

/// The cloud in the bytes of a PLY or PCD file, in the file's own unit of length, or in what [`rgbd::write`] has made of
/// images, in metres.
///
/// # Errors
/// What [`ply::read`] says of a file that begins with `ply`, [`rgbd::read`] of images, and [`pcd::read`] of any other.
pub fn read(bytes: &[u8]) -> Result<Cloud, CloudFileError> {
    if ply::is_ply(bytes) {
        Ok(ply::read(bytes)?)
    } else if rgbd::is_rgbd(bytes) {
        Ok(rgbd::read(bytes)?)
    } else {
        Ok(pcd::read(bytes)?)
    }
}

/// Whether a file of this name is taken for a cloud where folders are searched: it ends as one of [`ENDINGS`], in
/// whatever case.
pub fn has_ending(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    ENDINGS.iter().any(|ending| name.ends_with(ending))
}
