//! The nearest of the known words to a word that is not one.

/// The known word that was probably meant, or `None` if none is near.
///
/// Near is: equal but for upper and lower case, the beginning of the other (three letters at least), or few
/// edits away for its length. Ties go to the first known word.
pub fn nearest_name<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    // Keys are bounded by the file's size only; the distance is quadratic in their length.
    if word.len() > 64 {
        return None;
    }
    let word = word.to_lowercase();
    let distance = |candidate: &str| {
        let candidate = candidate.to_lowercase();
        let (short, long) =
            if word.len() < candidate.len() { (&word, &candidate) } else { (&candidate, &word) };
        let edits = strsim::osa_distance(&word, &candidate);
        if short.len() >= 3 && long.starts_with(short.as_str()) { edits.min(1) } else { edits }
    };
    let allowed = 1 + word.chars().count() / 4;
    known
        .iter()
        .map(|&candidate| (distance(candidate), candidate))
        .filter(|(edits, candidate)| *edits <= allowed && *edits < candidate.chars().count())
        .min_by_key(|(edits, _)| *edits)
        .map(|(_, candidate)| candidate)
}

/// A second line for a message about an unknown word: the nearest known one, then all of them.
pub(crate) fn advice(word: &str, known: &[&str], meaning_of_list: &str) -> String {
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
        let keys = ["population", "elite", "selection", "shape_bins", "R1", "R2", "m"];
        for (word, expected) in [
            ("populaton", Some("population")),
            ("Population", Some("population")),
            ("pop", Some("population")),
            ("elites", Some("elite")),
            ("eilte", Some("elite")),
            ("shape", Some("shape_bins")),
            ("r1", Some("R1")),
            ("r2", Some("R2")),
            ("x", None),
            ("temperature", None),
            ("", None),
        ] {
            assert_eq!(nearest_name(word, &keys), expected, "{word}");
        }
        assert_eq!(nearest_name(&"population".repeat(100), &keys), None);
    }
}
