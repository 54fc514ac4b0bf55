//! The typeface that every reader of PDF has: which byte is which letter (WinAnsi), and how wide it is.

/// What stands for a letter that the typeface does not have.
const UNKNOWN: u8 = 0xbf; // ¿

/// Letters of the bytes from 0x80 on, where they are not those of Latin 1.
const SPECIAL: [(char, u8); 28] = [
    ('€', 0x80),
    ('‚', 0x82),
    ('ƒ', 0x83),
    ('„', 0x84),
    ('…', 0x85),
    ('†', 0x86),
    ('‡', 0x87),
    ('ˆ', 0x88),
    ('‰', 0x89),
    ('Š', 0x8a),
    ('‹', 0x8b),
    ('Œ', 0x8c),
    ('Ž', 0x8e),
    ('‘', 0x91),
    ('’', 0x92),
    ('“', 0x93),
    ('”', 0x94),
    ('•', 0x95),
    ('–', 0x96),
    ('−', 0x96), // the minus: the typeface has a dash as wide
    ('—', 0x97),
    ('˜', 0x98),
    ('™', 0x99),
    ('š', 0x9a),
    ('›', 0x9b),
    ('œ', 0x9c),
    ('ž', 0x9e),
    ('Ÿ', 0x9f),
];

/// Widths of the bytes from 0x20 on in thousandths of the type's height, from the metrics that Adobe has published.
#[rustfmt::skip]
const WIDTHS: [u16; 224] = [
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278,
    556, 556, 556, 556, 556, 556, 556, 556, 556, 556, 278, 278, 584, 584, 584, 556,
    1015, 667, 667, 722, 722, 667, 611, 778, 722, 278, 500, 667, 556, 833, 722, 778,
    667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 278, 278, 278, 469, 556,
    333, 556, 556, 500, 556, 556, 278, 556, 556, 222, 222, 500, 222, 833, 556, 556,
    556, 556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334, 260, 334, 584, 350,
    556, 350, 222, 556, 333, 1000, 556, 556, 333, 1000, 667, 333, 1000, 350, 611, 350,
    350, 222, 222, 333, 333, 350, 556, 1000, 333, 1000, 500, 333, 944, 350, 500, 667,
    278, 333, 556, 556, 556, 556, 260, 556, 333, 737, 370, 556, 584, 333, 737, 333,
    400, 584, 333, 333, 333, 556, 537, 278, 333, 333, 365, 556, 834, 834, 834, 611,
    667, 667, 667, 667, 667, 667, 1000, 722, 667, 667, 667, 667, 278, 278, 278, 278,
    722, 722, 778, 778, 778, 778, 778, 584, 778, 722, 722, 722, 722, 667, 667, 611,
    556, 556, 556, 556, 556, 556, 889, 500, 556, 556, 556, 556, 278, 278, 278, 278,
    556, 556, 556, 556, 556, 556, 556, 584, 611, 556, 556, 556, 556, 500, 556, 500,
];

/// The bytes of a text.
pub(super) fn encoded(text: &str) -> Vec<u8> {
    let byte = |c: char| match u32::from(c) {
        code @ (0x20..=0x7e | 0xa0..=0xff) => code as u8,
        _ => SPECIAL.iter().find(|(letter, _)| *letter == c).map_or(UNKNOWN, |&(_, byte)| byte),
    };
    text.chars().map(byte).collect()
}

/// The width of these bytes, in heights of the type.
pub(super) fn width(bytes: &[u8]) -> f64 {
    let of = |byte: &u8| byte.checked_sub(0x20).and_then(|place| WIDTHS.get(usize::from(place)));
    bytes.iter().filter_map(of).map(|&width| f64::from(width)).sum::<f64>() / 1000.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_have_their_bytes_and_what_has_none_is_seen_to_be_missing() {
        assert_eq!(encoded("Größe −5…"), b"Gr\xf6\xdfe \x965\x85");
        assert_eq!(encoded("物\u{7f}\u{85}"), [UNKNOWN; 3]);
        assert!(SPECIAL.iter().all(|(c, _)| u32::from(*c) > 0xff));
    }

    #[test]
    fn widths_are_those_of_the_metrics() {
        assert_eq!(width(&encoded("Hello World")), 5.167);
        assert_eq!(width(&encoded("§÷ÿ")), (556.0 + 584.0 + 500.0) / 1000.0);
        assert_eq!(width(b"\n"), 0.0);
    }
}
