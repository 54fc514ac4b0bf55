//! PLY files, version 1.0: a text header and the elements that it names, as text or binary of either order of bytes.
//!
//! Bytes come from outside: every count is checked against the bytes at hand before memory is asked for, and no loop
//! is longer than the bytes that are left.

mod data;
mod error;
mod header;

#[cfg(test)]
mod malformed;
#[cfg(test)]
mod tests;

pub use error::PlyError;

use crate::Cloud;

/// Whether a file begins as PLY files do: with the word `ply` alone on its line.
pub fn is_ply(bytes: &[u8]) -> bool {
    bytes.strip_prefix(b"ply").is_some_and(|rest| rest.first().is_none_or(u8::is_ascii_whitespace))
}

/// The cloud in the bytes of a PLY file, in the file's own unit of length.
///
/// Points are the rows of the element `vertex`. `x`, `y` and `z` are of any type but lists, rounded once to f32; points
/// whose position is then not finite are dropped. Colours are `red green blue`, `diffuse_red diffuse_green diffuse_blue`
/// or `r g b`: of `uchar` they are taken as they are; of `ushort` from 0 to 65535, and of `float` and `double` from 0 to
/// 1, they are rounded to the nearest of 256 steps. A file without any of them has no colours. Other properties and
/// elements are skipped, wherever they stand. The viewpoint is `view_px view_py view_pz` of the element `camera`, as PCL
/// writes it, or else the origin. A cloud without points is valid.
///
/// # Errors
/// Each is a [`PlyError`] with two lines of text; the caller puts the file's name in front. Memory stays below some ten
/// bytes a byte of input.
pub fn read(bytes: &[u8]) -> Result<Cloud, PlyError> {
    let header = header::read(bytes)?;
    data::read(&header, bytes)
}
