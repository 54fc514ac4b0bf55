//! Text of others as it may be shown: nothing in it is invisible, turns its surroundings about, or begins a line of its own.

use std::borrow::Cow;
use std::ops::RangeInclusive;

/// What is no control and no format character and shows nothing all the same: `Default_Ignorable_Code_Point` of Unicode
/// 16, as far as it lies in the categories of letters and marks.
const INVISIBLE: [RangeInclusive<char>; 10] = [
    '\u{34f}'..='\u{34f}',
    '\u{115f}'..='\u{1160}',
    '\u{17b4}'..='\u{17b5}',
    '\u{180b}'..='\u{180f}',
    '\u{2800}'..='\u{2800}', // the empty pattern of Braille, a symbol
    '\u{3164}'..='\u{3164}',
    '\u{fe00}'..='\u{fe0f}',
    '\u{ffa0}'..='\u{ffa0}',
    '\u{1d159}'..='\u{1d159}', // a note head without ink, a symbol
    '\u{e0000}'..='\u{e0fff}',
];

/// Whether a character shows itself and nothing else: none that controls, formats (text directions, joiners, zero
/// widths), separates lines, or is for private use.
pub fn is_printable(c: char) -> bool {
    if c.is_ascii() {
        return !c.is_ascii_control();
    }
    // The standard library escapes all of these. After another character it leaves accents alone.
    let mut bytes = [b'a', 0, 0, 0, 0];
    let length = 1 + c.encode_utf8(&mut bytes[1..]).len();
    let is_escaped =
        str::from_utf8(&bytes[..length]).is_ok_and(|text| text.escape_debug().nth(1) == Some('\\'));
    !is_escaped && !INVISIBLE.iter().any(|range| range.contains(&c))
}

/// A text on one line with the codes of characters that are not printable, such as `\u{202e}` or `\n`.
pub fn printable(text: &str) -> Cow<'_, str> {
    if text.chars().all(is_printable) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_printable(c) { shown.push(c) } else { shown.extend(c.escape_default()) }
    }
    Cow::Owned(shown)
}

/// The same of a text of several lines: those after the first are indented, so that none passes for a line of its own.
pub fn printable_lines(text: &str) -> String {
    let lines = text.lines().enumerate().map(|(number, line)| match line {
        _ if number == 0 || line.starts_with("  ") => printable(line),
        line => Cow::Owned(format!("  {}", printable(line))),
    });
    lines.collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Any text, with what is not printable more often than chance has it.
    fn any_text() -> impl Strategy<Value = String> {
        let tricks = "\u{202a}\u{202b}\u{202c}\u{202d}\u{202e}\u{2066}\u{2067}\u{2068}\u{2069}\u{200b}\u{200c}\u{200d}\
            \u{200e}\u{200f}\u{2028}\u{2029}\u{feff}\u{ad}\u{61c}\u{180e}\u{2060}\u{0}\u{7}\u{8}\u{1b}\u{7f}\u{85}\u{9b}\r\n\t ";
        let trick = proptest::sample::select(tricks.chars().collect::<Vec<_>>());
        proptest::collection::vec(prop_oneof![trick, any::<char>(), proptest::char::range(' ', '~')], 0..60)
            .prop_map(|chars| chars.into_iter().collect())
    }

    #[test]
    fn what_is_invisible_or_moves_text_is_not_printable() {
        let ranges = [
            '\0'..='\u{1f}',            // control
            '\u{7f}'..='\u{a0}',        // control, and the space that is no space
            '\u{200b}'..='\u{200f}',    // zero widths and marks of direction
            '\u{2028}'..='\u{202e}',    // separators, embeddings and overrides
            '\u{2060}'..='\u{206f}',    // word joiner, invisible operators, isolates
            '\u{fe00}'..='\u{fe0f}',    // variation selectors
            '\u{fff9}'..='\u{fffb}',    // annotations
            '\u{e000}'..='\u{f8ff}',    // private use
            '\u{e0000}'..='\u{e01ef}',  // tags and variation selectors
            '\u{f0000}'..='\u{10ffff}', // private use
        ];
        let single = [
            '\u{ad}', '\u{34f}', '\u{61c}', '\u{70f}', '\u{180e}', '\u{3000}', '\u{3164}', '\u{feff}',
            '\u{ffa0}',
        ];
        for c in ranges.into_iter().flatten().chain(single) {
            assert!(!is_printable(c), "{c:?}");
        }
    }

    #[test]
    fn names_of_all_scripts_are_printable() {
        let names = "lab-pc-3 Rechner.Größe café cafe\u{301} 실험실 研究室-2 лаборатория εργαστήριο מעבדה مختبر ห้องแล็บ प्रयोगशाला 🤖 a'b\"c\\d";
        assert_eq!(printable(names), names);
        assert_eq!(printable("a\u{202e}b\nc\u{1b}[31m"), "a\\u{202e}b\\nc\\u{1b}[31m");
        assert_eq!(printable_lines("what\nadvice\n  more\u{2028}\r\n"), "what\n  advice\n  more\\u{2028}");
    }

    proptest! {
        #[test]
        fn what_is_shown_is_printable_whatever_it_was(text in any_text()) {
            let shown = printable(&text);
            prop_assert!(shown.chars().all(is_printable));
            prop_assert_eq!(printable(&shown), &*shown);
            let kept: String = text.chars().filter(|&c| is_printable(c)).collect();
            if kept == text {
                prop_assert_eq!(&*shown, &*text);
            }
        }

        #[test]
        fn no_line_of_several_passes_for_one_of_its_own(text in any_text()) {
            let shown = printable_lines(&text);
            prop_assert_eq!(shown.split('\n').count(), text.lines().count().max(1));
            for (number, line) in shown.split('\n').enumerate() {
                prop_assert!(line.chars().all(is_printable), "{line:?}");
                prop_assert!(number == 0 || line.starts_with("  "), "{line:?}");
            }
            prop_assert_eq!(printable_lines(&shown), &*shown);
        }
    }
}
