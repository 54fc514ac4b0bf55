//! What the whole search space is like: how many descriptors have which error, and how errors depend on genes.

use super::{error_axis, zip};
use crate::columns::GeneColumn;
use crate::error::Error;
use crate::report::data::{Rows, percent};
use crate::report::figure::{Axis, Colour, Dash, Figure, Marks, Numbers, Panel, Series, Symbol};

/// Errors beyond the best one that the second panel of the counts shows, percent.
const NEAR: f64 = 5.0;
/// Values of a gene that are told apart in a landscape.
const MOST_VALUES: usize = 32;

/// How many descriptors have which error.
pub(crate) fn counts(errors: &[f64], descriptors: &[f64]) -> Figure {
    let bars = |scale: f64| {
        errors.iter().zip(descriptors).map(move |(&error, &count)| [[error, 0.0], [error, count / scale]])
    };
    let best = errors.iter().copied().fold(f64::INFINITY, f64::min);
    // The best first.
    let mut near: Vec<[f64; 2]> = errors
        .iter()
        .copied()
        .zip(descriptors.iter().copied())
        .map(|(error, count)| [error, count])
        .collect();
    near.sort_by(|a, b| a[0].total_cmp(&b[0]));
    near.retain(|[error, _]| *error <= best + NEAR);
    let mut sum = 0.0;
    near.iter_mut().for_each(|[_, count]| {
        sum += *count;
        *count = sum;
    });
    let width = (560 / u32::try_from(errors.len()).unwrap_or(1).max(1)).clamp(1, 8);
    let panel = |title: &str, y: Axis, series: Vec<Series>| Panel {
        title: title.to_owned(),
        x: error_axis("training error"),
        y: y.including(0.0),
        series,
        height: 300,
    };
    let all = Series::segments("", Colour::Blue, width, bars(1000.0).collect());
    let at_most = vec![
        Series::steps("", Colour::Vermillion, Dash::Solid, near.clone()),
        Series::points("", Colour::Vermillion, Symbol::Dot, near),
    ];
    Figure {
        id: "grid-counts".to_owned(),
        title: "Errors of all descriptors".to_owned(),
        caption: format!(
            "Left: how many descriptors of the search space have which training error. Right: how many have at most that \
             error, as far as it is within {NEAR:.0} points of the best."
        ),
        panels: vec![
            panel("all", Axis::numbers("descriptors", "thousands"), vec![all]),
            panel("the best", Axis::numbers("descriptors with at most this error", ""), at_most),
        ],
        columns: 2,
        numbers: Numbers::Below,
    }
}

/// Errors at each value of a gene, whatever the others are.
pub(crate) fn marginals(rows: &Rows, genes: &[GeneColumn]) -> Result<Figure, Error> {
    let (names, values) = (rows.texts("gene")?, rows.numbers("value")?);
    let mut panels = Vec::new();
    for gene in genes {
        let line = |column: &str| -> Result<Vec<[f64; 2]>, Error> {
            let errors: Vec<f64> = rows.numbers(column)?.into_iter().map(percent).collect();
            let points = zip(&values, &errors).zip(&names).filter(|(_, name)| **name == gene.name);
            Ok(points.map(|(point, _)| point).collect())
        };
        let best = line("best_object_error")?;
        if best.len() < 2 {
            continue;
        }
        let series = vec![
            Series::dashed("worst", Colour::Grey, Dash::Mixed, line("worst_object_error")?),
            Series::dashed("mean", Colour::Blue, Dash::Dashed, line("mean_object_error")?),
            Series::dashed("median", Colour::Green, Dash::Dotted, line("median_object_error")?),
            Series::dashed("best", Colour::Vermillion, Dash::Solid, best),
        ];
        let (x, y) = (Axis::numbers(&gene.name, &gene.unit), error_axis("training error"));
        panels.push(Panel { title: String::new(), x, y, series, height: 230 });
    }
    Ok(Figure {
        id: "grid-marginals".to_owned(),
        title: "Error over each gene".to_owned(),
        caption: "Training errors of all descriptors with a value of a gene, whatever their other genes are."
            .to_owned(),
        panels,
        columns: 2,
        numbers: Numbers::Below,
    })
}

/// Errors at each pair of values of two genes: the best (`best`) or the mean over all other genes.
pub(crate) fn landscapes(rows: &Rows, genes: &[GeneColumn], best: bool) -> Result<Figure, Error> {
    let names = [rows.texts("gene_a")?, rows.texts("gene_b")?];
    let values = [rows.numbers("value_a")?, rows.numbers("value_b")?];
    let descriptors = rows.numbers("descriptors")?;
    let errors: Vec<f64> = rows
        .numbers(if best { "best_object_error" } else { "mean_object_error" })?
        .into_iter()
        .map(percent)
        .collect();
    let (mut panels, mut is_coarse) = (Vec::new(), false);
    for (place, a) in genes.iter().enumerate() {
        for b in &genes[place + 1..] {
            let of: Vec<usize> =
                (0..rows.len()).filter(|&row| names[0][row] == a.name && names[1][row] == b.name).collect();
            let [xs, ys] = [0, 1].map(|which| {
                let mut all: Vec<f64> = of.iter().map(|&row| values[which][row]).collect();
                all.sort_by(f64::total_cmp);
                all.dedup();
                all
            });
            if xs.len() < 2 || ys.len() < 2 {
                continue;
            }
            let [every_x, every_y] = [&xs, &ys].map(|all| all.len().div_ceil(MOST_VALUES));
            is_coarse |= every_x > 1 || every_y > 1;
            let cell =
                |all: &[f64], every: usize, value: f64| all.partition_point(|&other| other < value) / every;
            let (across, down) = (xs.len().div_ceil(every_x), ys.len().div_ceil(every_y));
            // Sums of errors and their weights, or the lowest error.
            let mut cells = vec![vec![(0.0, 0.0); across]; down];
            for row in of {
                let (sum, weight) =
                    &mut cells[cell(&ys, every_y, values[1][row])][cell(&xs, every_x, values[0][row])];
                if !best {
                    *sum += errors[row] * descriptors[row];
                    *weight += descriptors[row];
                } else if *weight == 0.0 || errors[row] < *sum {
                    (*sum, *weight) = (errors[row], 1.0);
                }
            }
            let value = |(sum, weight): (f64, f64)| (weight > 0.0).then(|| sum / weight);
            let cells: Vec<Vec<Option<f64>>> =
                cells.into_iter().map(|row| row.into_iter().map(value).collect()).collect();
            let found = || cells.iter().flatten().flatten().copied();
            let ends =
                [f64::max as fn(f64, f64) -> f64, f64::min].map(|of| found().reduce(of).unwrap_or(0.0));
            let marks = Marks::Matrix { cells, unit: "% wrong".to_owned(), ends, written: false };
            let axis = |gene: &GeneColumn, all: &[f64], every| {
                Axis::values(&gene.name, &gene.unit, all.iter().copied().step_by(every).collect())
            };
            panels.push(Panel {
                title: String::new(),
                x: axis(a, &xs, every_x),
                y: axis(b, &ys, every_y),
                series: vec![Series { name: String::new(), colour: Colour::Blue, marks }],
                height: 270,
            });
        }
    }
    let (id, title, what) = match best {
        true => ("landscapes-best", "Best error over two genes", "The lowest"),
        false => ("landscapes-mean", "Mean error over two genes", "The mean"),
    };
    let mut caption = format!(
        "{what} training error of all descriptors with two values, whatever their other genes are. Each panel has a scale of \
         its own: its strongest colour is its lowest error."
    );
    if is_coarse {
        caption.push_str(" Neighbouring values share a cell where a gene has many.");
    }
    let numbers = Numbers::Elsewhere; // thousands, in table landscapes
    Ok(Figure { id: id.to_owned(), title: title.to_owned(), caption, panels, columns: 2, numbers })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_add_up_from_the_best() {
        let figure = counts(&[40.0, 10.0, 12.0], &[5000.0, 2.0, 8.0]);
        let Marks::Line { points, .. } = &figure.panels[1].series[0].marks else { panic!("a line") };
        assert_eq!(points[..], [[10.0, 2.0], [12.0, 10.0]]);
        let Marks::Segments { ends, .. } = &figure.panels[0].series[0].marks else { panic!("bars") };
        assert_eq!(ends[0], [[40.0, 0.0], [40.0, 5.0]]);
    }
}
