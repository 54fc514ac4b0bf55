//! Descriptors beside each other on the test clouds: errors, curves, times, and which objects each gets wrong.

use std::collections::{BTreeMap, BTreeSet};

use super::error_axis;
use crate::error::Error;
use crate::report::data::{Rows, percent};
use crate::report::figure::{Axis, Colour, Dash, Figure, Marks, Numbers, Panel, Series, Symbol};

/// Most rows of the matrix of objects whose names are readable.
const MOST_OBJECTS: usize = 60;
/// How far a curve goes, as a share of the axes, before it is drawn a point further.
const STEP: f64 = 0.001;

/// Errors of every descriptor with their intervals.
pub(crate) fn errors(comparison: &Rows) -> Result<Figure, Error> {
    let level = |level: &str| -> Result<Panel, Error> {
        let column = |name: &str| -> Result<Vec<f64>, Error> {
            Ok(comparison.numbers(&format!("{level}_error{name}"))?.into_iter().map(percent).collect())
        };
        let interval = |low: &str, high: &str| -> Result<Vec<[[f64; 2]; 2]>, Error> {
            let ends = column(low)?.into_iter().zip(column(high)?).enumerate();
            let ends = ends.map(|(row, (low, high))| [[low, row as f64], [high, row as f64]]);
            Ok(ends.filter(|[low, high]| low[0].is_finite() && high[0].is_finite()).collect())
        };
        let errors = column("")?.into_iter().enumerate().map(|(row, error)| [error, row as f64]).collect();
        let series = vec![
            Series::segments(
                "95 %, over objects (bootstrap)",
                Colour::Sky,
                9,
                interval("_instances_low", "_instances_high")?,
            ),
            Series::segments("95 %, over clouds (Wilson)", Colour::Blue, 2, interval("_low", "_high")?),
            Series::points("error", Colour::Black, Symbol::Circle, errors),
        ];
        let names = comparison.texts("descriptor")?;
        let height = 90 + 24 * names.len() as u32;
        let x = error_axis(&format!("{level} error")).including(0.0);
        Ok(Panel { title: String::new(), x, y: Axis::names("", names), series, height })
    };
    Ok(Figure {
        id: "comparison-errors".to_owned(),
        title: "Errors of the descriptors".to_owned(),
        caption: "Errors on the test clouds with their 95 % intervals: as if clouds were independent, and over objects, \
                  which takes the clouds of an object together and is the one to trust."
            .to_owned(),
        panels: vec![level("object")?, level("category")?],
        columns: 2,
        numbers: Numbers::Below,
    })
}

/// Stages with their columns (after `seconds_`), names and colours.
pub(crate) const STAGES: [(&str, &str, Colour); 5] = [
    ("read", "reading", Colour::Grey),
    ("keypoints", "keypoints", Colour::Sky),
    ("normals", "normals", Colour::Orange),
    ("describe", "describing", Colour::Blue),
    ("match", "matching", Colour::Vermillion),
];

/// Where the time of each descriptor goes, in seconds and as shares; `None` if it was not measured.
pub(crate) fn times(comparison: &Rows) -> Result<Option<Figure>, Error> {
    let names = comparison.texts("descriptor")?;
    let mut stages = Vec::new();
    let mut totals = vec![0.0; names.len()];
    for (stage, ..) in STAGES {
        let seconds = comparison.optional(&format!("seconds_{stage}"))?;
        totals.iter_mut().zip(&seconds).for_each(|(total, seconds)| *total += seconds.unwrap_or(0.0));
        stages.push(seconds);
    }
    if totals.iter().all(|&total| total == 0.0) {
        return Ok(None);
    }
    let bars = |scale: &dyn Fn(usize) -> f64| {
        let mut ends = vec![0.0; names.len()];
        let stage = |((_, name, colour), seconds): (&(&str, &str, Colour), &Vec<Option<f64>>)| {
            let mut bars = Vec::new();
            for (row, seconds) in seconds.iter().enumerate() {
                if let Some(seconds) = seconds.filter(|_| totals[row] > 0.0) {
                    let from = ends[row];
                    ends[row] += seconds * scale(row);
                    bars.push([[from, row as f64], [ends[row], row as f64]]);
                }
            }
            Series::segments(name, *colour, 14, bars)
        };
        STAGES.iter().zip(&stages).map(stage).collect::<Vec<_>>()
    };
    let panel = |x: Axis, series: Vec<Series>| {
        let height = 90 + 26 * names.len() as u32;
        Panel { title: String::new(), x: x.including(0.0), y: Axis::names("", names.clone()), series, height }
    };
    let hardware: BTreeSet<String> = comparison.texts("hardware")?.into_iter().collect();
    let hardware: Vec<String> = hardware.into_iter().filter(|hardware| !hardware.is_empty()).collect();
    let hardware = match &hardware[..] {
        [] => String::new(),
        [one] => format!(" Measured on: {one}."),
        several => format!(
            " Measured on several processors, so that not all times can be compared; which, says table comparison: {}.",
            several.join(", ")
        ),
    };
    Ok(Some(Figure {
        id: "comparison-times".to_owned(),
        title: "Time of each stage".to_owned(),
        caption: format!(
            "Time to read, describe and match the test clouds and the database they are matched with, on one thread, by \
             stage: in seconds, and as shares of each descriptor’s own time.{hardware}"
        ),
        panels: vec![
            panel(Axis::numbers("time", "s"), bars(&|_| 1.0)),
            panel(Axis::numbers("share of the time", "%"), bars(&|row| 100.0 / totals[row])),
        ],
        columns: 2,
        numbers: Numbers::Below,
    }))
}

/// Recall over 1 − precision of every descriptor, by name: of all pairs, and of the nearest clouds only.
pub(crate) fn recall_precision(points: &Rows, descriptors: &[String]) -> Result<Figure, Error> {
    let (recall, beside) = (points.numbers("recall")?, points.numbers("one_minus_precision")?);
    // By curve and place of the descriptor.
    let mut curves: BTreeMap<(String, usize), Series> = BTreeMap::new();
    for ([descriptor, curve], rows) in points.parts(["descriptor", "curve"])? {
        let Some(place) = descriptors.iter().position(|name| *name == descriptor) else { continue };
        let points = rows.into_iter().flatten().map(|row| [beside[row], recall[row]]);
        let line = Series::dashed(&descriptor, Colour::nth(place), Dash::nth(place), thinned(points));
        curves.insert((curve, place), line);
    }
    let panel = |(curve, title): (&str, &str)| {
        let axis = |label: &str| Axis::numbers(label, "").including(0.0).including(1.0);
        let of = curves.iter().filter(|((name, _), _)| name == curve);
        let series: Vec<Series> = of.map(|(_, line)| line.clone()).collect();
        let (title, x, y) = (title.to_owned(), axis("1 − precision"), axis("recall"));
        // Of very many pairs no curve is kept.
        (!series.is_empty()).then_some(Panel { title, x, y, series, height: 330 })
    };
    let panels = [("all", "all pairs"), ("nearest", "nearest clouds only")];
    Ok(Figure {
        id: "recall-precision".to_owned(),
        title: "Recall over 1 − precision".to_owned(),
        caption: format!(
            "Recognition of objects as ever greater set distances are accepted (the paper’s figure 3). All pairs: every \
             query with every database cloud, relevant if they show the same object. Nearest clouds: each query with its \
             nearest only. Curves are drawn with the points that are {STEP} apart on an axis; table recall_precision has \
             all."
        ),
        panels: panels.into_iter().filter_map(panel).collect(),
        columns: 2,
        numbers: Numbers::Below,
    })
}

/// The points of a curve worth drawing: the first, the last, and each that is a visible step from the one before.
fn thinned(points: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    let mut kept: Vec<[f64; 2]> = Vec::new();
    let mut last = None;
    for point in points {
        let near =
            |other: &[f64; 2]| (other[0] - point[0]).abs() < STEP && (other[1] - point[1]).abs() < STEP;
        last = if kept.last().is_some_and(near) {
            Some(point)
        } else {
            kept.push(point);
            None
        };
    }
    kept.extend(last);
    kept
}

/// How many clouds of each object each descriptor, by name, gets wrong.
pub(crate) fn objects(answers: &Rows, descriptors: &[String]) -> Result<Figure, Error> {
    let instance = answers.texts("instance")?;
    let category = answers.texts("category")?;
    let right = answers.optional("correct_object")?;
    let mut wrong: BTreeMap<(&str, &str), Vec<f64>> = BTreeMap::new();
    for ([descriptor], rows) in answers.parts(["descriptor"])? {
        let Some(place) = descriptors.iter().position(|name| *name == descriptor) else { continue };
        for row in rows.into_iter().flatten() {
            let none = || vec![0.0; descriptors.len()];
            let counts = wrong.entry((&category[row], &instance[row])).or_insert_with(none);
            counts[place] += if right[row] == Some(1.0) { 0.0 } else { 1.0 };
        }
    }
    let mut caption =
        String::from("Test clouds of each object that each descriptor takes for another object.");
    let mut shown: Vec<(&(&str, &str), &Vec<f64>)> = wrong.iter().collect();
    if shown.len() > MOST_OBJECTS {
        caption.push_str(&format!(
            " Of {} objects, the {MOST_OBJECTS} with the most errors are shown.",
            shown.len()
        ));
        let sum = |counts: &[f64]| counts.iter().sum::<f64>();
        shown.sort_by(|a, b| sum(b.1).total_cmp(&sum(a.1)).then(a.0.cmp(b.0)));
        shown.truncate(MOST_OBJECTS);
        shown.sort_by_key(|(object, _)| *object);
    }
    let cells = shown.iter().map(|(_, counts)| counts.iter().map(|&count| Some(count)).collect());
    let marks = Marks::counts(cells.collect(), "wrong clouds", true);
    let names = shown.iter().map(|((_, instance), _)| (*instance).to_owned()).collect();
    let height = 150 + 13 * shown.len() as u32;
    let series = vec![Series { name: String::new(), colour: Colour::Blue, marks }];
    let (x, y) = (Axis::names("descriptor", descriptors.to_vec()), Axis::names("object", names));
    let panel = Panel { title: String::new(), x, y, series, height };
    Ok(Figure::single("comparison-objects", "Objects that each descriptor gets wrong", caption, panel))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thinned_curve_is_nowhere_far_from_the_whole_one() {
        // A jagged one of a million points.
        let point = |n: u32| {
            let along = f64::from(n) / 1e6;
            [along * along + 0.1 * f64::from(n % 100_000) / 1e5, along]
        };
        let all = || (0..=1_000_000).map(point);
        let kept = thinned(all());
        assert!(kept.len() < 5000, "{}", kept.len());
        assert_eq!((kept[0], *kept.last().unwrap()), (point(0), point(1_000_000)));
        let mut at = kept.iter().peekable();
        let mut before = kept[0];
        for point in all() {
            if at.peek() == Some(&&point) {
                before = point;
                at.next();
            }
            let apart = (before[0] - point[0]).abs().max((before[1] - point[1]).abs());
            assert!(apart < STEP, "{point:?}");
        }
        assert!(at.next().is_none());
        assert_eq!(thinned(std::iter::empty()), Vec::<[f64; 2]>::new());
        assert_eq!(thinned([[0.5, 0.5]; 3].into_iter()), [[0.5, 0.5]; 2]);
    }
}
