//! Text for people, in lines that a terminal of 80 columns shows whole.

use std::time::Duration;

/// Columns of a terminal that need not be asked.
pub const COLUMNS: usize = 80;

/// A label and its value, which goes on below itself where it is too long for a line. A word longer than a line, such
/// as a path, stands whole.
pub fn labelled(label: &str, width: usize, value: &str) -> String {
    wrapped(&format!("{label:<width$}{value}"), width)
}

/// Lines of at most [`COLUMNS`], broken at spaces; those after the first of each line of `text` are indented.
pub fn wrapped(text: &str, indent: usize) -> String {
    text.lines().map(|line| wrapped_line(line, indent)).collect()
}

fn wrapped_line(line: &str, indent: usize) -> String {
    let (mut text, mut rest) = (String::new(), line.to_owned());
    while let Some(end) = end_of_line(&rest, indent) {
        text.push_str(rest[..end].trim_end());
        text.push('\n');
        rest = format!("{:indent$}{}", "", rest[end..].trim_start());
    }
    text + &rest + "\n"
}

/// Where a line that is too long ends; `None` if it is not, or is a single word.
fn end_of_line(line: &str, indent: usize) -> Option<usize> {
    // The first character that is too many may be the space at which the line ends.
    let (limit, after) = line.char_indices().nth(COLUMNS).map(|(at, c)| (at, at + c.len_utf8()))?;
    let begin = line.char_indices().nth(indent).map_or(limit, |(begin, _)| begin);
    let begin = begin + (line[begin..].len() - line[begin..].trim_start().len());
    // A number stays with its unit, and a share with its count in brackets.
    let may_end = |at: &usize| !line[begin + at..].trim_start().starts_with(['%', '(']);
    let spaces = |text: &str| text.match_indices(' ').map(|(at, _)| at).rfind(may_end);
    let within = (begin < limit).then(|| spaces(&line[begin..after])).flatten();
    let end = begin + within.or_else(|| line[begin..].find(' '))?;
    (!line[end..].trim().is_empty()).then_some(end)
}

/// Columns padded to their widest cell, the first to the left, the others to the right. Where that is too wide, the
/// first cell of each row has a line of its own.
pub fn table(rows: &[Vec<String>]) -> String {
    const GAP: &str = "  ";
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let whole = widths.iter().sum::<usize>() + GAP.len() * columns.saturating_sub(1);
    let line = |row: &Vec<String>| {
        let Some((first, others)) = row.split_first() else { return "\n".to_owned() };
        let padded = others.iter().zip(&widths[1..]).map(|(cell, &width)| format!("{GAP}{cell:>width$}"));
        let others = padded.collect::<String>();
        let line = match whole > COLUMNS {
            true => format!("{first}\n{others}"),
            false => format!("{first:<width$}{others}", width = widths[0]),
        };
        format!("{}\n", line.trim_end())
    };
    rows.iter().map(line).collect()
}

/// A share as per cent with two digits, as tables of errors have it.
pub fn percent(share: f64) -> String {
    format!("{:.2} %", 100.0 * share)
}

/// A duration as people read it.
pub fn clock(duration: Duration) -> String {
    let seconds = duration.as_secs();
    match (seconds / 3600, seconds / 60 % 60, seconds % 60) {
        (0, 0, seconds) => format!("{seconds} s"),
        (0, minutes, seconds) => format!("{minutes} min {seconds:02} s"),
        (hours, minutes, _) => format!("{hours} h {minutes:02} min"),
    }
}

#[cfg(test)]
mod tests {
    use expect_test::expect;
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn times_and_shares_read_naturally() {
        assert_eq!(clock(Duration::from_secs(59)), "59 s");
        assert_eq!(clock(Duration::from_secs(61)), "1 min 01 s");
        assert_eq!(clock(Duration::from_secs(7_260)), "2 h 01 min");
        assert_eq!(percent(104.0 / 352.0), "29.55 %");
    }

    #[test]
    fn long_values_go_on_below_themselves() {
        let value = "1.42 % (5 of 352): the best of all 16580160 descriptors has 28.12 % (99)";
        expect![[r#"
            regret        1.42 % (5 of 352): the best of all 16580160 descriptors has
                          28.12 % (99)
        "#]]
        .assert_eq(&labelled("regret", 14, value));
        let path = "/".repeat(90);
        assert_eq!(labelled("results", 14, &path), format!("results       {path}\n"));
        assert_eq!(labelled("top", 6, "a   b"), "top   a   b\n");
    }

    #[test]
    fn a_table_that_is_too_wide_has_its_labels_in_lines_of_their_own() {
        let rows =
            |name: &str| [["run", "error"], [name, "1.00 %"]].map(|row| row.map(str::to_owned).to_vec());
        assert_eq!(table(&rows("pop-10")), "run      error\npop-10  1.00 %\n");
        let long = "a".repeat(COLUMNS);
        assert_eq!(table(&rows(&long)), format!("run\n   error\n{long}\n  1.00 %\n"));
    }

    proptest! {
        #[test]
        fn no_line_is_too_long_unless_it_is_one_word(words in prop::collection::vec("[a-zé]{1,90}", 0..30), width in 0..20_usize) {
            let value = words.join(" ");
            let text = labelled("", width, &value);
            prop_assert_eq!(text.split_whitespace().collect::<Vec<_>>(), words);
            for line in text.lines() {
                prop_assert!(line.chars().count() <= COLUMNS || line.split_whitespace().count() <= 1, "{}", line);
            }
        }
    }
}
