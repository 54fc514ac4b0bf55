//! Whether what a command printed is what a page shows.

/// Stands for any lines, or within a line for any text.
const ANY: &str = "…";
/// What numbers before these words depend on the machine for.
const MEASURED: [&str; 5] = ["s", "ms", "threads", "thread", "MB"];

/// A line without what depends on the machine, and with single spaces.
fn plain(line: &str) -> String {
    let words: Vec<&str> = line.split_whitespace().collect();
    let is_number = |word: &str| word.parse::<f64>().is_ok();
    let bare = |word: &'_ str| word.trim_matches(|c: char| ",;:.()|".contains(c)).to_owned();
    let mut plain = Vec::new();
    let mut index = 0;
    while let Some(&word) = words.get(index) {
        index += 1;
        let unit = words.get(index).map(|unit| bare(unit)).unwrap_or_default();
        let is_rate = bare(word).strip_suffix("/s").is_some_and(is_number);
        if is_number(word) && ["h", "min"].contains(&&*unit) {
            index += 1; // of "1 min 16 s", the seconds stay
        } else if is_rate || is_number(word) && MEASURED.contains(&&*unit) {
            plain.push("#");
        } else {
            plain.push(word);
        }
    }
    plain.join(" ")
}

fn line_matches(shown: &str, printed: &str) -> bool {
    let (shown, printed) = (plain(shown), plain(printed));
    let Some((first, others)) = shown.split_once(ANY) else { return shown == printed };
    let Some(mut rest) = printed.strip_prefix(first) else { return false };
    let (between, last) = others.rsplit_once(ANY).unwrap_or(("", others));
    for part in between.split(ANY) {
        let Some((_, after)) = rest.split_once(part) else { return false };
        rest = after;
    }
    rest.ends_with(last)
}

/// Whether `printed` is what is `shown`.
pub fn matches(shown: &[&str], printed: &[&str]) -> bool {
    match shown.split_first() {
        None => printed.is_empty(),
        Some((first, rest)) if first.trim() == ANY => {
            (0..=printed.len()).any(|skipped| matches(rest, &printed[skipped..]))
        }
        Some((first, rest)) => printed
            .split_first()
            .is_some_and(|(line, others)| line_matches(first, line) && matches(rest, others)),
    }
}

#[test]
fn what_is_measured_and_what_is_left_out_may_differ_and_nothing_else() {
    for (shown, printed, expected) in [
        ("best 19.44 % | 21.9/s | at most 8 s left", "best 19.44 % | 7.1/s | at most 11 s left", true),
        ("best 19.44 %", "best 19.45 %", false),
        ("time          2 s", "time 12.5 s", true),
        ("time 2 s", "time 1 min 07 s", true),
        ("joined, 2 threads, descry", "joined, 16 threads, descry", true),
        ("took 5 seconds", "took 6 seconds", false),
        ("a … c", "a b c", true),
        ("a … c", "a b d", false),
        ("a …", "a", false),
        ("a … c … e", "a b c d e", true),
        ("a … c … e", "a b d e", false),
        ("#ca=…&token=…", "#ca=12&token=34", true),
        ("one\n…\nfour", "one\ntwo\nthree\nfour", true),
        ("one\n…\nfour", "one\nfour", true),
        ("one\n…\nfour", "one\ntwo", false),
        ("…", "", true),
        ("", "one", false),
        ("one", "", false),
        ("one", "one\ntwo", false),
    ] {
        let [shown_lines, printed_lines] = [shown, printed].map(|text| text.lines().collect::<Vec<_>>());
        assert_eq!(matches(&shown_lines, &printed_lines), expected, "{shown:?} {printed:?}");
    }
}
