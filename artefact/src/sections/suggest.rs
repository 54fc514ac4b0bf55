//! The nearest of the known words to a word that is not one.

/// The known word that was probably meant, or `None` if none is near.
///
/// Near is, in this order: at most one edit (a letter too many, missing, exchanged, or two swapped) for each three
/// letters of the longer word; the beginning of a known word; a known word with something behind it, unless that word
/// begins others, too. Of words of two letters only those with the same letters are near: `cm` is no slip for `mm`.
/// Ties go to the first known word.
pub fn nearest_name<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    // Keys are bounded by the file's size only; the distance is quadratic in their length.
    if word.len() > 64 {
        return None;
    }
    let word = word.to_lowercase();
    let by_edits = known.iter().filter_map(|&name| Some((edits(&word, &name.to_lowercase())?, name)));
    let by_edits = by_edits.min_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, name)| name);
    by_edits.or_else(|| abbreviated(&word, known)).or_else(|| extended(&word, known))
}

/// Edits from one word to the other, as a share of the longer one's letters; `None` if they are too many for a slip.
fn edits(word: &str, name: &str) -> Option<f64> {
    let longer = word.chars().count().max(name.chars().count());
    let edits = strsim::damerau_levenshtein(word, name);
    let near = edits * 3 <= longer || (longer == 2 && same_letters(word, name));
    near.then(|| edits as f64 / longer.max(1) as f64)
}

fn same_letters(word: &str, name: &str) -> bool {
    let sorted = |text: &str| {
        let mut letters: Vec<char> = text.chars().collect();
        letters.sort_unstable();
        letters
    };
    sorted(word) == sorted(name)
}

/// Fewest letters that say which word is meant.
const LEAST: usize = 3;

fn abbreviated<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    let begins = |name: &&&str| word.len() >= LEAST && name.to_lowercase().starts_with(word);
    known.iter().find(begins).copied()
}

fn extended<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    let begins = |name: &str| name.len() >= LEAST && word.starts_with(&name.to_lowercase());
    let alone = |name: &str| known.iter().filter(|other| other.starts_with(name)).count() == 1;
    known.iter().copied().find(|name| begins(name) && alone(name))
}

/// A second line for a message about an unknown word: the nearest known one, then all of them.
pub fn advice(word: &str, known: &[&str], meaning_of_list: &str) -> String {
    let list = known.join(", ");
    match nearest_name(word, known) {
        Some(nearest) => format!("did you mean `{nearest}`? {meaning_of_list}: {list}"),
        None => format!("{meaning_of_list}: {list}"),
    }
}

#[cfg(test)]
mod tests {
    use super::nearest_name;

    #[test]
    fn slips_of_the_finger_are_recognised_and_other_words_are_not() {
        let keys =
            ["population", "elite", "crossover", "crossover_rate", "shape_bins", "R1", "R2", "m", "uw", "mm"];
        for (word, expected) in [
            ("populaton", Some("population")),
            ("Population", Some("population")),
            ("pop", Some("population")),
            ("elites", Some("elite")),
            ("eilte", Some("elite")),
            ("shape", Some("shape_bins")),
            ("r1", Some("R1")),
            ("r2", Some("R2")),
            ("population_size", Some("population")),
            ("crossovr", Some("crossover")),
            ("crossover_raet", Some("crossover_rate")),
            ("crossover_prob", Some("crossover_rate")),
            ("crossover_of_parents", None),
            ("MM", Some("mm")),
            ("wu", Some("uw")),
            ("cm", None),
            ("km", None),
            ("R3", None),
            ("x", None),
            ("temperature", None),
            ("", None),
        ] {
            assert_eq!(nearest_name(word, &keys), expected, "{word}");
        }
        assert_eq!(nearest_name(&"population".repeat(100), &keys), None);
    }
}
