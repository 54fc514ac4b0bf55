//! Which characters show themselves: names in tables come from other machines.

/// Whether a character is shown as itself and does nothing else; a test holds it against that of the protocol, which this
/// crate must not know.
pub fn is_printable(c: char) -> bool {
    /// Letters, marks and symbols of Unicode that show nothing.
    const INVISIBLE: [(char, char); 10] = [
        ('\u{34f}', '\u{34f}'),
        ('\u{115f}', '\u{1160}'),
        ('\u{17b4}', '\u{17b5}'),
        ('\u{180b}', '\u{180f}'),
        ('\u{2800}', '\u{2800}'),
        ('\u{3164}', '\u{3164}'),
        ('\u{fe00}', '\u{fe0f}'),
        ('\u{ffa0}', '\u{ffa0}'),
        ('\u{1d159}', '\u{1d159}'),
        ('\u{e0000}', '\u{e0fff}'),
    ];
    if c.is_ascii() {
        return !c.is_ascii_control();
    }
    // The standard library escapes controls, formats, separators and private use. After another character it leaves
    // accents alone.
    let mut bytes = [b'a', 0, 0, 0, 0];
    let length = 1 + c.encode_utf8(&mut bytes[1..]).len();
    let is_escaped =
        str::from_utf8(&bytes[..length]).is_ok_and(|text| text.escape_debug().nth(1) == Some('\\'));
    !is_escaped && !INVISIBLE.iter().any(|&(first, last)| (first..=last).contains(&c))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_invisible_or_moves_text_is_not_printable() {
        for c in "\0\n\u{1b}\u{7f}\u{9b}\u{ad}\u{200b}\u{200d}\u{2028}\u{202e}\u{2066}\u{2069}\u{3164}\u{fe0f}\u{feff}\u{e000}\u{e0041}".chars() {
            assert!(!is_printable(c), "{c:?}");
        }
        let names = "mug_1 Größe cafe\u{301} 研究室 лаборатория מעבדה مختبر 🤖 a'b\"c\\d";
        assert!(names.chars().all(is_printable));
    }
}
