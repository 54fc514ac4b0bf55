//! Errors by set of a finished run, counted again from the answers to its test queries.

use std::collections::BTreeSet;
use std::path::Path;

use results::{PredictionSplit, SetRow};

use crate::compare::EVOLVED;
use crate::dataset::Dataset;
use crate::experiment::Experiment;
use crate::run::sets::of_answers;

/// What was found.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// Descriptors whose rows are as they should be, or not.
    pub descriptors: usize,
    /// Rows that are not.
    pub problems: Vec<String>,
    /// Descriptors whose answers are not there.
    pub notes: Vec<String>,
}

/// Compares table `sets` with the answers of each of its descriptors: the winner's in `predictions`, those of others in the
/// comparison.
pub(super) fn check(run: &Path, experiment: &Experiment, dataset: &Dataset) -> Result<Found, results::Error> {
    let rows = results::read_sets(run)?;
    let weights = experiment.set_weights(dataset);
    let mut found = Found::default();
    for of_one in rows.chunk_by(|a, b| a.descriptor == b.descriptor) {
        let label = &of_one[0].descriptor;
        let answers = match label.as_str() {
            EVOLVED => results::read_predictions(run, PredictionSplit::Test)?,
            other => results::read_answers(run, other)?,
        };
        if answers.is_empty() {
            found.notes.push(format!("sets: {label}: not counted again, its answers are not in this folder"));
            continue;
        }
        found.descriptors += 1;
        match of_answers(&dataset.clouds, &weights, label, &answers) {
            Some(expected) => found.problems.extend(differences(&expected, of_one)),
            None => found.problems.push(format!("sets: {label}: answers must be of listed clouds of sets")),
        }
    }
    Ok(found)
}

/// Sets whose row is not as expected, in words.
fn differences(expected: &[SetRow], got: &[SetRow]) -> Vec<String> {
    let sets: BTreeSet<(&str, &str)> =
        expected.iter().chain(got).map(|row| (row.descriptor.as_str(), row.set.as_str())).collect();
    let differs = |(label, set): (&str, &str)| {
        let of_set = |rows: &[SetRow]| rows.iter().filter(|row| row.set == set).cloned().collect::<Vec<_>>();
        let (expected, got) = (of_set(expected), of_set(got));
        let problem =
            || format!("sets: {label} on {set}: expected {}, got {}", shown(&expected), shown(&got));
        (expected != got).then(problem)
    };
    sets.into_iter().filter_map(differs).collect()
}

/// Rows of one set, which has one.
fn shown(rows: &[SetRow]) -> String {
    let row = |row: &SetRow| {
        let SetRow { weight, counts, object_wilson, category_wilson, .. } = row;
        format!(
            "{} objects and {} categories of {} (weight {weight}, intervals {object_wilson:?} and {category_wilson:?})",
            counts.object_correct, counts.category_correct, counts.queries
        )
    };
    if rows.is_empty() { "no row".to_owned() } else { rows.iter().map(row).collect::<Vec<_>>().join(" and ") }
}

#[cfg(test)]
mod tests {
    use results::{Counts, wilson};

    use super::*;

    fn row(set: &str, object_correct: u32) -> SetRow {
        let counts = Counts { object_correct, category_correct: 9, queries: 9 };
        SetRow {
            descriptor: EVOLVED.to_owned(),
            set: set.to_owned(),
            weight: 1,
            counts,
            object_wilson: wilson(9 - object_correct, 9),
            category_wilson: wilson(0, 9),
        }
    }

    #[test]
    fn each_cell_that_is_another_is_told_and_rows_that_are_missing_or_too_many() {
        let expected = [row("a", 5), row("b", 7)];
        assert!(differences(&expected, &expected).is_empty());
        for other in [
            row("b", 6),
            SetRow { weight: 2, ..row("b", 7) },
            SetRow { object_wilson: [0.0, 1.0], ..row("b", 7) },
            SetRow { category_wilson: [0.0, 1.0], ..row("b", 7) },
        ] {
            let told = differences(&expected, &[row("a", 5), other]);
            assert!(
                told.len() == 1 && told[0].starts_with("sets: evolved on b: expected 7 objects"),
                "{told:?}"
            );
        }
        let told = differences(&expected, &[row("a", 5)]);
        assert!(told.len() == 1 && told[0].ends_with("got no row"), "{told:?}");
        let told = differences(&expected[..1], &[row("a", 5), row("c", 5)]);
        assert!(told.len() == 1 && told[0].contains("on c: expected no row, got 5 objects"), "{told:?}");
        assert_eq!(differences(&expected, &[row("a", 5), row("b", 7), row("b", 7)]).len(), 1);
    }
}
