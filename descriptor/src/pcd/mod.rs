//! PCD files: reading what sensors and PCL write, and writing what both can read.
//!
//! PCD 0.7 and its `.7` variant without a VERSION line (DESIGN 5.1). Bytes come from outside: every count is
//! checked against the bytes at hand before memory is asked for.

mod data;
mod error;
mod header;
mod write;

#[cfg(test)]
mod malformed;
#[cfg(test)]
mod tests;

pub use error::PcdError;
pub use header::DataEncoding;
pub use write::write;

use crate::Cloud;

/// The cloud in the bytes of a PCD file, in the file's own unit of length.
///
/// Fields come in any order and with any others between them. `x`, `y` and `z` are F4 or F8 (narrowed to f32);
/// points whose position is then not finite are dropped. `rgb` or `rgba`, F4 or U4, holds 0x00RRGGBB in its
/// bits whatever its type; its top byte is ignored. Without either, `r`, `g` and `b` together are the colour: U1, or F4
/// from 0 to 1, rounded to the nearest of 256 steps. A file without any of them has no colours. The viewpoint is
/// VIEWPOINT's translation, or the origin. A cloud without points is valid.
///
/// # Errors
/// Each is a [`PcdError`] with two lines of text; the caller puts the file's name in front. Memory stays below
/// some hundred bytes a byte of input: the LZF format expands 88-fold at most.
pub fn read(bytes: &[u8]) -> Result<Cloud, PcdError> {
    let header = header::read(bytes)?;
    data::read(&header, bytes)
}
