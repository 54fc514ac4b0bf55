//! Texts from files and for messages, of bounded length.

use std::fs;
use std::io::{self, Read};
use std::path::Path;

pub use proto::{hex, is_printable};

/// A text of at most 1 MiB, as every search and every record is; what is longer is cut, and so differs from all of them.
pub fn read_bounded(path: &Path) -> io::Result<String> {
    if !fs::metadata(path)?.is_file() {
        // A pipe would be waited for.
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "something that is no file"));
    }
    let mut bytes = Vec::new();
    fs::File::open(path)?.take(1 << 20).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// At most `limit` characters, none of them a control character.
pub fn shortened(text: &str, limit: usize) -> String {
    let mut rest = text.chars();
    let mut short: String =
        rest.by_ref().take(limit).map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect();
    if rest.next().is_some() {
        short.push('…');
    }
    short
}

/// A number as a message shows it: one of very many digits with an exponent.
pub fn number(value: f64) -> String {
    let size = value.abs();
    let is_long = value.is_finite() && size != 0.0 && !(1e-9..1e12).contains(&size);
    if is_long { format!("{value:e}") } else { value.to_string() }
}
