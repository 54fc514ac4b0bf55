//! What the readers of cloud files have in common: how long a header may be, text from it in messages, and colours.

/// The data must start within this many bytes. Real headers take some hundred; a bound keeps a file of another
/// format from being searched to its end.
pub(crate) const MAX_HEADER_BYTES: usize = 64 * 1024;

/// Text from a file for a message: escaped and of bounded length.
pub(crate) fn shown(text: &str) -> String {
    const MAX_CHARS: usize = 40;
    if text.is_empty() {
        return "nothing".to_owned();
    }
    let mut short: String = text.chars().take(MAX_CHARS).flat_map(char::escape_debug).collect();
    if text.chars().nth(MAX_CHARS).is_some() {
        short.push('…');
    }
    short
}

/// A colour value of a float type, in messages.
pub(crate) const UNIT: &str = "a number from 0 to 1";

/// 0 to 1 to the nearest of 0 to 255, if it is that.
pub(crate) fn from_unit(value: f64) -> Option<u8> {
    (0.0..=1.0).contains(&value).then_some((value * 255.0 + 0.5) as u8)
}
