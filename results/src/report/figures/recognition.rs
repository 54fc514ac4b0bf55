//! Confusion matrices of objects and categories.

use std::collections::{BTreeMap, BTreeSet};

use crate::error::Error;
use crate::report::data::Rows;
use crate::report::figure::{Axis, Colour, Figure, Marks, Panel, Series};
use crate::report::table::TableBlock;

/// Most objects of a matrix whose names are readable.
const MOST_OBJECTS: usize = 60;

/// A query's true and predicted labels.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Answer {
    /// Its category and object.
    pub truth: [String; 2],
    /// Category and object of the nearest cloud.
    pub named: [String; 2],
}

/// The answers of table `predictions` or `answers` to the queries that `chosen` names by row.
pub(crate) fn answers(rows: &Rows, chosen: impl Fn(usize) -> bool) -> Result<Vec<Answer>, Error> {
    let column = |name: &str| rows.texts(name);
    let truth = [column("category")?, column("instance")?];
    let named = [column("predicted_category")?, column("predicted_instance")?];
    let pick = |columns: &[Vec<String>; 2], row: usize| [columns[0][row].clone(), columns[1][row].clone()];
    let answer = |row| Answer { truth: pick(&truth, row), named: pick(&named, row) };
    Ok((0..rows.len()).filter(|&row| chosen(row)).map(answer).collect())
}

/// The winner's answers to the test clouds.
pub(crate) fn test_answers(predictions: &Rows) -> Result<Vec<Answer>, Error> {
    let split = predictions.texts("split")?;
    answers(predictions, |row| split[row] == "test")
}

/// Objects against the objects they are taken for.
pub(crate) fn confusion_of_objects(answers: &[Answer]) -> Figure {
    // By category, so that look-alikes are neighbours.
    let all: BTreeSet<&[String; 2]> =
        answers.iter().flat_map(|answer| [&answer.truth, &answer.named]).collect();
    let mut involved: BTreeMap<&[String; 2], usize> = BTreeMap::new();
    for answer in answers.iter().filter(|answer| answer.truth != answer.named) {
        *involved.entry(&answer.truth).or_default() += 1;
        *involved.entry(&answer.named).or_default() += 1;
    }
    let mut caption =
        String::from("Rows are the test clouds' objects, columns the objects of their nearest clouds");
    let shown: Vec<&[String; 2]> = if all.len() <= MOST_OBJECTS {
        caption.push_str("; right answers are on the diagonal.");
        all.into_iter().collect()
    } else {
        let mut most: Vec<(usize, &[String; 2])> =
            all.iter().map(|&object| (involved.get(object).copied().unwrap_or(0), object)).collect();
        most.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(b.1)));
        caption.push_str(&format!(
            "; right answers are on the diagonal. Of {} objects, the {MOST_OBJECTS} with the most errors are shown.",
            all.len()
        ));
        let shown: BTreeSet<_> = most.into_iter().take(MOST_OBJECTS).map(|(_, object)| object).collect();
        shown.into_iter().collect()
    };
    let names = shown.iter().map(|object| object[1].clone()).collect();
    let place: BTreeMap<&[String; 2], usize> =
        shown.iter().enumerate().map(|(place, &o)| (o, place)).collect();
    let pairs =
        answers.iter().filter_map(|answer| Some((*place.get(&answer.truth)?, *place.get(&answer.named)?)));
    matrix("confusion-objects", "Confusion between objects", caption, "object", names, pairs, false)
}

/// Categories against the categories they are taken for.
pub(crate) fn confusion_of_categories(answers: &[Answer]) -> Figure {
    let all: BTreeSet<&String> =
        answers.iter().flat_map(|answer| [&answer.truth[0], &answer.named[0]]).collect();
    let place: BTreeMap<&String, usize> =
        all.iter().enumerate().map(|(place, &name)| (name, place)).collect();
    let pairs = answers.iter().map(|answer| (place[&answer.truth[0]], place[&answer.named[0]]));
    let names: Vec<String> = all.iter().map(|&name| name.clone()).collect();
    let caption =
        "Rows are the test clouds' categories, columns the categories of their nearest clouds.".to_owned();
    let written = names.len() <= 30;
    matrix("confusion-categories", "Confusion between categories", caption, "category", names, pairs, written)
}

fn matrix(
    id: &str,
    title: &str,
    caption: String,
    what: &str,
    names: Vec<String>,
    pairs: impl Iterator<Item = (usize, usize)>,
    written: bool,
) -> Figure {
    let mut cells = vec![vec![Some(0.0); names.len()]; names.len()];
    for (truth, named) in pairs {
        if let Some(count) = &mut cells[truth][named] {
            *count += 1.0;
        }
    }
    let height = (names.len() as u32 * 12).clamp(220, 620) + 120;
    let marks = Marks::counts(cells, "clouds", written);
    let series = vec![Series { name: String::new(), colour: Colour::Blue, marks }];
    let x = Axis::names(&format!("{what} of the nearest cloud"), names.clone());
    let y = Axis::names(what, names);
    Figure::single(id, title, caption, Panel { title: String::new(), x, y, series, height })
}

/// The confusions that occur most often.
pub(crate) fn frequent_confusions(answers: &[Answer]) -> TableBlock {
    let mut counts: BTreeMap<(&[String; 2], &[String; 2]), u32> = BTreeMap::new();
    let mut queries: BTreeMap<&[String; 2], u32> = BTreeMap::new();
    for answer in answers {
        *queries.entry(&answer.truth).or_default() += 1;
        if answer.truth != answer.named {
            *counts.entry((&answer.truth, &answer.named)).or_default() += 1;
        }
    }
    let mut most: Vec<_> = counts.into_iter().collect();
    most.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
    let row = |((truth, named), count): ((&[String; 2], &[String; 2]), u32)| {
        vec![
            truth[1].clone(),
            named[1].clone(),
            count.to_string(),
            queries.get(truth).unwrap_or(&0).to_string(),
        ]
    };
    TableBlock {
        caption: "The most frequent confusions of objects on the test clouds.".to_owned(),
        head: ["object", "taken for", "clouds", "of"].map(str::to_owned).to_vec(),
        rows: most.into_iter().take(12).map(row).collect(),
        texts: 2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(truth: &str, named: &str) -> Answer {
        let object = |name: &str| [name[..1].to_owned(), name.to_owned()];
        Answer { truth: object(truth), named: object(named) }
    }

    fn cells(figure: &Figure) -> &[Vec<Option<f64>>] {
        match &figure.panels[0].series[0].marks {
            Marks::Matrix { cells, .. } => cells,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_matrix_counts_each_answer_once() {
        let answers = [answer("a1", "a1"), answer("a1", "b1"), answer("a2", "b1"), answer("a1", "b1")];
        let objects = confusion_of_objects(&answers);
        let row = |row: [f64; 3]| row.map(Some).to_vec();
        // a1, a2, b1.
        assert_eq!(cells(&objects), [row([1.0, 0.0, 2.0]), row([0.0, 0.0, 1.0]), row([0.0; 3])]);
        let categories = confusion_of_categories(&answers);
        assert_eq!(cells(&categories), [[Some(1.0), Some(3.0)], [Some(0.0), Some(0.0)]]);
        let frequent = frequent_confusions(&answers);
        assert_eq!(frequent.rows, [["a1", "b1", "2", "3"], ["a2", "b1", "1", "1"]]);
    }

    #[test]
    fn of_many_objects_those_with_errors_are_shown() {
        let name = |index: usize| format!("a{index:03}");
        let mut answers: Vec<Answer> = (0..300).map(|index| answer(&name(index), &name(index))).collect();
        answers.push(answer(&name(299), &name(150)));
        let figure = confusion_of_objects(&answers);
        let cells = cells(&figure);
        assert_eq!(cells.len(), MOST_OBJECTS);
        assert_eq!(cells.iter().flatten().flatten().sum::<f64>(), MOST_OBJECTS as f64 + 1.0);
        assert!(figure.caption.contains("Of 300 objects"));
        assert!(confusion_of_objects(&[]).panels[0].series[0].marks.is_empty());
    }
}
