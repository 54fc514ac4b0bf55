//! What the readers of cloud files have in common: how long a header may be, and text from it in messages.

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
